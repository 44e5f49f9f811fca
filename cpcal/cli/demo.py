"""`cpcal demo`: the paper's whole study on a simulated platform, from readings or images to one page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from time import perf_counter
from typing import Annotated, Any

import numpy as np
import typer

from cpcal.calibration import CalibrationRecord, calibrate_study
from cpcal.calibration.statistics import Of
from cpcal.cli.calibrate import show_record, write_calibration
from cpcal.cli.campaign import IMAGES, TABLES, shot_study, write_shots
from cpcal.cli.certify import certified_into, show_result, status_of
from cpcal.cli.image import show_detections
from cpcal.cli.options import (
    CAMPAIGN,
    FITS,
    PIXEL_CAMPAIGN,
    PIXEL_RUN,
    PIXEL_SETS,
    RUN,
    STUDY,
    TIMEOUT,
    Status,
    Talk,
    check_new,
    is_earlier_demo,
    made,
    talking,
    unwritable,
)
from cpcal.cli.progress import bar, watch
from cpcal.cli.report import study_found
from cpcal.common.errors import InputError, ModelError, Problem
from cpcal.common.files import write_file
from cpcal.common.numbers import about, bracket_text, nearest, stated
from cpcal.common.values import Floats
from cpcal.files import load_campaign, load_study, save_campaign, save_study
from cpcal.files.run_folder import POSE_SETS, REPORT_NAME, answers_into
from cpcal.legs import PLAIN
from cpcal.questions import Result, certify, save_result
from cpcal.questions.fits import certify_fits
from cpcal.report.section import Picture, picture
from cpcal.report.study_page import IMAGES_NAME, ImagePart, ImagesFound, render_study, save_images
from cpcal.robot import DELTALAB, Campaign, PoseTable, Study, quaternion_conjugate, quaternion_product, rotation_vector
from cpcal.simulate import simulate_study
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.stopping import heard
from cpcal.vision.batch.detect import Detections, ImageFolder, ImageSource, detect, in_parallel
from cpcal.vision.batch.enclose import stem_of
from cpcal.vision.batch.study_images import RenderedImages, study_table
from cpcal.vision.files.detection import (
    POSITION,
    QUATERNION,
    RMS,
    SIGMA,
    by_reason,
    detections_bytes,
    readings_of,
    values_of,
)
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.pose_sets import PixelBoxes, PoseSet, campaign_of, enclose_pose
from cpcal.vision.render import overlay

# ------------------------------------------------------------------------------------------------------------------
# The demo's study by way of images: rendered, detected, and from there on as any other study.

SUBSET = {"runs": 2, "validation_runs": 1, "images": 2}
WHOLE = {"runs": 11, "validation_runs": 10, "images": 11}  # the paper's 14,784 images


@dataclass(frozen=True)
class ImageStudy:
    """A study whose poses come from images. `exact` has the poses that were rendered, row by row of all images."""

    study: Study
    exact: Study
    shots: Mapping[str, RenderedImages]
    found: Mapping[str, Detections]
    rendering: float | None  # seconds, all workers beside each other; None: rendered when measured


def image_study(
    folder: Path, seed: int, imperfect: Mapping[str, float], talk: Talk, *, size: Mapping[str, int], keep: bool
) -> ImageStudy:
    """Render and detect. Images are files below `folder` if they are to be kept; else each is rendered when measured,
    since all of the paper's would take six gigabytes."""
    options: dict[str, Any] = {"seed": seed, **imperfect, **size}
    exact, shots = shot_study(DELTALAB, options)
    count = sum(len(images.names) for images in shots.values())
    talk.say(f"Images: {count:,}, rendered{f' in {folder / IMAGES}' if keep else ''}")
    made(folder)
    start = perf_counter()
    if keep:
        write_shots(exact, shots, folder)
    rendering = perf_counter() - start if keep else None
    found, tables = {}, []
    for name, true in zip(TABLES, (exact.calibration, exact.validation), strict=True):
        source: ImageSource = ImageFolder(folder / IMAGES / name) if keep else shots[name]
        output = folder / f"poses-{name}.csv"
        journal = output.with_name(f"{output.name}.journal")
        with bar(f"{name} images", quiet=talk.quiet) as progress:
            found[name] = detect(source, shots[name].target, shots[name].camera, journal=journal, progress=progress)
        write_file(output, detections_bytes(found[name].rows))
        show_detections(found[name], output, talk)
        tables.append(study_table(found[name].rows, readings_of(true)))
    study = Study(exact.robot, tables[0], tables[1], exact.truth, {**exact.provenance, "poses": "from rendered images"})
    return ImageStudy(study, exact, shots, found, rendering)


# ------------------------------------------------------------------------------------------------------------------
# What the demo's page says of the images that its study came from.

PAPER_PACE = 14_784 / (3 * 3600.0)  # images a second
_PICTURES, _WIDTH = 6, 480
_AXES = ("x", "y", "z", "rx", "ry", "rz")


def images_found(done: ImageStudy) -> ImagesFound:
    """All but the pixel sets."""
    title = "Figure 2 and section 2.3: from images to poses"
    return ImagesFound(
        (
            ImagePart(title, _said(done), _counts(done), tuple(_pictures(done))),
            ImagePart("Errors of single images’ poses, against the simulation’s truth", table=_errors(done)),
            ImagePart("Where time went", table=_time(done)),
        )
    )


def _said(done: ImageStudy) -> tuple[str, ...]:
    images = next(iter(done.shots.values()))
    scene, camera, target = images.scene, images.camera, images.target
    count = sum(len(found.rows) for found in done.found.values())
    light = [f"{100 * share:.0f} %" for share in scene.gradient]
    return (
        f"The poses of this study come from {count:,} rendered images of {camera.width} x {camera.height} pixels: a "
        f"camera with a focal length of {camera.focal[0]:.0f} pixels and an ordinary lens's distortion, aimed by eye, "
        f"sees the target “{target.name}” of {len(target.dots)} dots. Blur {scene.blur:g} px, noise {scene.noise:g} "
        f"grey levels of 256, light that grows by {light[0]} from left to right and by {light[1]} downwards.",
        "Dots are found to a hundredth of a pixel or better, told apart by the cross-ratios along the two diagonals, "
        "and the pose is fitted to where the model of an imaged dot says its centre should be.",
    )


def _counts(done: ImageStudy) -> tuple[tuple[str, ...], ...]:
    lines: list[tuple[str, ...]] = []
    for name, found in done.found.items():
        values = values_of(found.rows)
        dots = np.median([row.dots for row in found.rows if row.found])
        rms = np.median(values[:, RMS])
        lines.append((name, f"{len(found.rows):,}", f"{len(values):,}", f"{dots:.0f}", f"{rms:.4f}"))
        lines += [
            (f"no pose: {reason}", f"{len(files):,}", "", "", "") for reason, files in by_reason(found.rows).items()
        ]
    return (("images of", "images", "poses", "dots, median", "residual, median RMS [px]"), *lines)


def _errors(done: ImageStudy) -> tuple[tuple[str, ...], ...]:
    """Of all images, in the camera frame."""
    errors, sigmas = [], []
    for (name, found), table in zip(done.found.items(), (done.exact.calibration, done.exact.validation), strict=True):
        true = dict(zip(done.shots[name].names, range(len(table)), strict=True))
        values = values_of(found.rows)
        errors.append(_pose_errors(values, table, [true[row.file] for row in found.rows if row.found]))
        sigmas.append(values[:, SIGMA])
    error, sigma = np.concatenate(errors), np.concatenate(sigmas)
    scaled = np.where(np.arange(6) < 3, 1e3, 1e3 * 180.0 / math.pi)
    shown = {
        "error, RMS": np.sqrt(np.mean(error**2, axis=0)) * scaled,
        "error, largest": np.abs(error).max(axis=0) * scaled,
        "stated standard deviation, RMS": np.sqrt(np.mean(sigma**2, axis=0)) * scaled,
    }
    ratio = np.sqrt(np.mean((error / sigma) ** 2, axis=0))
    rows = [(name, *(f"{v:.2f}" for v in row)) for name, row in shown.items()]
    rows.append(("error / its stated deviation, RMS", *(f"{v:.2f}" for v in ratio)))
    head = ("", *(f"{axis} [{'µm' if k < 3 else '10⁻³ °'}]" for k, axis in enumerate(_AXES)))
    return (head, *rows)


def _pose_errors(values: Floats, table: PoseTable, rows: list[int]) -> Floats:
    """(m, 6): mm, and rad of the rotation vector in the camera frame."""
    turn = quaternion_product(values[:, QUATERNION], quaternion_conjugate(table.quaternion[rows]))
    return np.concatenate([values[:, POSITION] - table.position[rows], rotation_vector(turn)], axis=1)


def _time(done: ImageStudy) -> tuple[tuple[str, ...], ...]:
    count = sum(found.measured for found in done.found.values())
    work: dict[str, float] = {}
    for found in done.found.values():
        for stage, seconds in found.seconds.items():
            work[stage] = work.get(stage, 0.0) + seconds
    rows = []
    if done.rendering is not None:
        rows.append(("rendering and writing, side by side", f"{done.rendering:.1f}", ""))
    for stage, seconds in work.items():
        rows.append((stage, f"{seconds:.1f}", f"{1e3 * seconds / max(count, 1):.1f}"))
    total = sum(seconds for stage, seconds in work.items() if stage != RenderedImages.stage)
    pace = f"{count / total:.0f}" if total > 0.0 else "—"
    but = " but rendering" if RenderedImages.stage in work else ""
    rows.append((f"all{but}: {pace} images a second of work; the paper: {PAPER_PACE:.1f}", f"{total:.1f}", ""))
    return (("stage", "work [s]", "an image [ms]"), *rows)


def _pictures(done: ImageStudy) -> list[Picture]:
    """Some images of the calibration, evenly spread."""
    images = done.shots["calibration"]
    rows = [row.file for row in done.found["calibration"].rows if row.found]
    out = []
    for name in [rows[k] for k in np.linspace(0, len(rows) - 1, min(_PICTURES, len(rows))).astype(int)]:
        image = images.read(name)
        try:
            found = measure_pose(image, images.target, images.camera)
        except NotMeasured:  # rendered anew it is the same image, so that this does not happen
            continue
        pose, run, shot = PurePosixPath(name).with_suffix("").parts
        caption = f"configuration {pose}, run {run}, image {shot}: {len(found.numbers)} dots"
        height = round(_WIDTH * image.shape[0] / image.shape[1])
        out.append(picture(caption, overlay(image, found, images.target, images.camera, _WIDTH), (_WIDTH, height)))
    return out


# ------------------------------------------------------------------------------------------------------------------
# The demo's second campaign: reading sets proved from pixel boxes, one image a configuration.

HALF_WIDTH = 0.03  # pixels: every dot's box; no dot of the demo's images is farther from where it should be


@dataclass(frozen=True)
class _Enclosing:
    """What a worker does: pose sets of some images, each with a certificate in `folder` where one can be made."""

    images: RenderedImages
    folder: Path

    def __call__(self, names: Sequence[str]) -> list[tuple[str, PoseSet]]:
        return [(name, self._one(name)) for name in names]

    def _one(self, name: str) -> PoseSet:
        target, camera = self.images.target, self.images.camera
        found = measure_pose(self.images.read(name), target, camera)
        boxes = PixelBoxes.around(found.numbers, found.centers, HALF_WIDTH, of_images=True)
        try:
            return enclose_pose(boxes, target, camera, certificate=self.folder / stem_of(name))
        except ModelError:  # the proof in exact numbers is a little weaker
            return enclose_pose(boxes, target, camera)


@dataclass(frozen=True)
class PixelRun:
    """Pose sets by the image's name, the campaign of those that are proved, and what was certified of it."""

    sets: dict[str, PoseSet]
    campaign: Campaign
    result: Result


def certify_pixels(
    done: ImageStudy,
    campaign: Campaign,
    legs: Sequence[int] | None,
    folder: Path,
    talk: Talk,
    *,
    every: int = 1,
    resume: bool,
) -> PixelRun:
    """One image of each (of every n-th) configuration of `campaign`, whose legs' reading sets are kept.

    Raises InputError.
    """
    images, found = done.shots["calibration"], done.found["calibration"]
    first: dict[str, str] = {}
    for row in found.rows:
        if row.found:
            first.setdefault(PurePosixPath(row.file).parts[0], row.file)
    rows = range(0, len(campaign), every)
    names = [first[campaign.pose[k]] for k in rows]
    with answers_into(folder / PIXEL_SETS, POSE_SETS) as draft:
        sets = dict(pair for pairs in in_parallel(_Enclosing(images, draft), names) for pair in pairs)
    enclosed = {k: name for k, name in zip(rows, names, strict=True) if sets[name].verdict is Verdict.PROVED}
    proved = list(enclosed)
    runs = [PurePosixPath(name).parts[1] for name in enclosed.values()]
    readings = readings_of(done.study.calibration)
    pixel = campaign_of(
        [sets[name] for name in enclosed.values()],
        np.array([readings[campaign.pose[k], run] for k, run in zip(proved, runs, strict=True)]),
        campaign.robot,
        length_radius=campaign.length_radius[proved],
        pose=[campaign.pose[k] for k in proved],
        run=runs,
        provenance={
            "reading sets": f"poses from pixel boxes of +-{stated(HALF_WIDTH)} px, proved; "
            "legs as in the other campaign"
        },
    )
    save_campaign(pixel, folder / PIXEL_CAMPAIGN)
    result = certified_into(folder / PIXEL_RUN, pixel, {"legs": legs}, talk=talk, resume=resume)
    return PixelRun(sets, pixel, result)


def with_sets(found: ImagesFound, done: ImageStudy, run: PixelRun, campaign: Campaign, result: Result) -> ImagesFound:
    """The page's words on the images, and those on the pixel sets beside the sets from repeats."""
    names = list(run.sets)
    count, refuted = len(names), sum(run.sets[n].verdict is Verdict.REFUTED for n in names)
    proved = [n for n in names if run.sets[n].verdict is Verdict.PROVED]
    holding = sum(done.shots["calibration"].pose(name) in run.sets[name] for name in proved)
    seconds = np.median([run.sets[name].seconds for name in names])
    said = (
        f"Each dot of one image a configuration is stated to be within ±{stated(HALF_WIDTH)} pixels of where it was "
        "found (the centre of its image); camera and plate are assumed exact: the images were rendered with them. "
        f"Of {count} sets of poses that show all dots in such boxes, {len(proved)} are enclosed and {refuted} empty, "
        f"both proved, in {about(float(seconds), 2)} s each with a certificate. The true pose lies in {holding} of the "
        f"{len(proved)}. No page checks these proofs: `cpcal verify {PIXEL_SETS}` does. "
        "The half-widths of the enclosures, beside those of the first campaign's reading sets:",
        "These sets are the readings' sets of a second campaign, certified as the first is: for some pose that the "
        "pixels allow, and some leg reading in its set. So the proof begins at the image. The smallest model error of "
        "each leg, for both campaigns:",
    )
    sets = ImagePart("Reading sets from pixels", said[:1], _widths(run.campaign, campaign))
    return ImagesFound((*found.parts, sets, ImagePart("", said[1:], _brackets(run.result, result))))


def _widths(pixel: Campaign, repeats: Campaign) -> tuple[tuple[str, ...], ...]:
    head = ("half-width, median", *(f"{n} [µm]" for n in "xyz"), *(f"r{n} [10⁻³ °]" for n in "xyz"))
    rows = []
    for name, one in ((f"pixels ±{stated(HALF_WIDTH)}", pixel), ("repeats, as in table 3", repeats)):
        position = 1e3 * np.median(one.position_radius, axis=0)
        rotation = 1e3 * np.degrees(np.median(one.rotation_radius, axis=0))
        rows.append((name, *(nearest(float(v), 1) for v in (*position, *rotation))))
    return (head, *rows)


def _brackets(pixel: Result, repeats: Result) -> tuple[tuple[str, ...], ...]:
    rows = []
    for name, result in (("pixels", pixel), ("repeats", repeats)):
        bounds = [bracket_text(leg.eps_lo, leg.eps_hi) for leg in result.legs]
        rows.append((f"{name}: none below [mm]", *(lo for lo, _ in bounds)))
        rows.append((f"{name}: attained [mm]", *(hi for _, hi in bounds)))
    return (("leg", *(str(leg.leg) for leg in repeats.legs)), *rows)


# ------------------------------------------------------------------------------------------------------------------
# `cpcal demo`: the paper's whole study on a simulated platform, from readings to one page.

FACTOR = 3.0  # half-width of the reading sets, in standard deviations of
OF: Of = "single"  # readings: the paper's choice


@dataclass(frozen=True)
class DemoPlan:
    """How much is done. `imperfect`: legs that no seven parameters describe, so that the model must be refuted."""

    imperfect: Mapping[str, float] = field(default_factory=lambda: {"sag": 2.0, "axis_offset": 2.0})  # mm
    size: Mapping[str, int] = field(default_factory=dict)  # of the study; left out: the paper's
    photographs: Mapping[str, int] | None = None  # of a study from images; left out: some hundred
    enclosed: int = 1  # of so many configurations one is enclosed from an image
    legs: tuple[int, ...] | None = None
    timeout_seconds: float = 3.0  # a leg, for the paper's timeout method
    script_gap: float = 0.01  # relative


PLAN = DemoPlan()


@talking
def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the study and all that follows from it.")
    ] = Path("cpcal-demo"),
    seed: Annotated[int, typer.Option(help="Of the simulated robot and its readings.")] = 1,
    images: Annotated[
        bool, typer.Option("--images", help="Render images of the study, and find its poses in them.")
    ] = False,
    full: Annotated[
        bool, typer.Option("--full", help="With --images: all 14,784 of the paper, not kept, instead of some hundred.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from where a stopped demo of the same options was.")
    ] = False,
    *,
    talk: Talk,
) -> None:
    """The paper's whole study on a simulated robot: calibrate, certify, check the proofs, write the report.

    The robot is the DeltaLab Table of Stewart with legs that sag and joints whose axes miss each other by 2 mm, which
    the model with seven parameters a leg does not know; the noise is the paper's. Writes DIR/study, DIR/campaign,
    DIR/validation, DIR/calibration.json, DIR/fits, DIR/run, DIR/timeout and the page DIR/report.html; with --images
    also DIR/images and what was found in them, and a campaign whose reading sets are proved from pixels, certified too.
    A certificate that the checker refuses makes the exit status 1.
    """
    if full and not images:
        raise InputError([Problem("option --full", "has no meaning without --images", "add --images, or leave it out")])
    check_new(output, force=force or is_earlier_demo(output))
    for name in (REPORT_NAME, IMAGES_NAME):  # what is older must not stand beside newer results
        (output / name).unlink(missing_ok=True)
    console = talk.out
    photos = _photos(output, seed, full, talk) if images else None
    study = photos.study if photos else simulate_study(seed=seed, **PLAN.size, **PLAN.imperfect)  # type: ignore[arg-type]
    save_study(study, output / STUDY)
    record = _calibrated(output, seed, talk)
    campaign = load_campaign(output / CAMPAIGN)
    _fits(campaign, record, output / FITS, talk)
    result = _unless_stopped(
        lambda: certified_into(output / RUN, campaign, {"legs": PLAN.legs}, talk=talk, resume=resume)
    )
    _unless_stopped(lambda: _timeout(campaign, output / TIMEOUT, talk))
    if photos is not None:
        _pixels(photos, campaign, result, output, talk, resume)
    accepted, found = study_found(output)
    console.print(found.checked, soft_wrap=True)
    page = write_file(output / REPORT_NAME, render_study(found, output / RUN))
    console.print(f"The whole study: {page}", soft_wrap=True)
    raise typer.Exit(status_of(result) if accepted else Status.UNKNOWN)


def _unless_stopped(certified: Callable[[], Result]) -> Result:
    """The result of long work; the demo ends with it where a signal stopped it."""
    with heard(terminate=True):
        result = certified()
        if result.interrupted:
            raise typer.Exit(status_of(result))
        return result


def _photos(output: Path, seed: int, full: bool, talk: Talk) -> ImageStudy:
    size, keep = (WHOLE, False) if full else (PLAN.photographs or SUBSET, True)
    return image_study(output, seed, PLAN.imperfect, talk, size=size, keep=keep)


def _calibrated(output: Path, seed: int, talk: Talk) -> CalibrationRecord:
    """Read the study, calibrate, write, show."""
    how = ", ".join(f"{name.replace('_', ' ')} {stated(size)} mm" for name, size in PLAN.imperfect.items())
    talk.say(f"Study: {output / STUDY} (simulated, seed {seed}; {how})")
    found = calibrate_study(load_study(output / STUDY), factor=FACTOR, of=OF)
    write_calibration(found, found.record, output)
    show_record(talk, found.record)
    return found.record


def _fits(campaign: Campaign, record: CalibrationRecord, folder: Path, talk: Talk) -> None:
    """Are x_c and x_c_sigma solutions? A line for each; with --verbose for each leg."""
    fits = certify_fits(campaign, record, folder, legs=PLAN.legs)
    for name, verified in fits.both:
        if talk.verbose:
            for fit in verified:
                talk.say(f"Leg {fit.leg}: {fit.verified.sentence(name)}")
            continue
        legs = {word: [str(fit.leg) for fit in verified if fit.verified.verdict is word] for word in Verdict}
        said = [f"{word.value} for leg {', '.join(some)}" for word, some in legs.items() if some]
        talk.say(f"{name} satisfies every equation exactly, for some readings in their sets: {'; '.join(said)}.")


def _pixels(photos: ImageStudy, campaign: Campaign, result: Result, output: Path, talk: Talk, resume: bool) -> None:
    """Reading sets from pixels, certified, and what the page says of the images."""
    talk.say(f"Reading sets from pixel boxes of ±{stated(HALF_WIDTH)} px:")
    with heard(terminate=True):
        run = certify_pixels(photos, campaign, PLAN.legs, output, talk, every=PLAN.enclosed, resume=resume)
        if run.result.interrupted:
            raise typer.Exit(status_of(run.result))
    try:
        save_images(with_sets(images_found(photos), photos, run, campaign, result), output)
    except OSError as error:
        raise unwritable(output, error) from None


def _timeout(campaign: Campaign, folder: Path, talk: Talk) -> Result:
    """eps by the paper's timeout method, a few seconds a leg."""
    legs = list(PLAN.legs or range(1, campaign.legs + 1))
    console = talk.out
    console.print(f"The paper's timeout method (section 5.2.1), {stated(PLAN.timeout_seconds)} s a leg:")
    with watch(legs, PLAN.script_gap, talk.errors) as progress:
        timeout = certify(
            campaign,
            legs=legs,
            method="timeout",
            time_limit=PLAN.timeout_seconds,
            gap=PLAN.script_gap,
            progress=progress,
        )
    save_result(timeout, folder, campaign)
    show_result(console, campaign, timeout, PLAIN)
    return timeout
