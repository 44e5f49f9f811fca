"""`cpcal demo`: the paper's whole study on a simulated platform, from readings or images to one page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import numpy as np
import typer

from cpcal.calibration import CalibrationRecord, calibrate_study
from cpcal.calibration.statistics import Of
from cpcal.cli.calibrate import show_record, write_calibration
from cpcal.cli.certify import certified_into, show_result, status_of
from cpcal.cli.image import IMAGES, TABLES, detected, enclosed, shot_study, write_shots
from cpcal.cli.options import (
    CAMPAIGN,
    FITS,
    PIXEL_CAMPAIGN,
    PIXEL_RUN,
    PIXEL_SETS,
    RUN,
    STUDY,
    TIMEOUT,
    Force,
    Status,
    Talk,
    check_new,
    option,
    output,
)
from cpcal.cli.progress import Legs, line
from cpcal.cli.report import study_found
from cpcal.common.files import write_file
from cpcal.common.numbers import about, bracket_text, nearest, stated
from cpcal.files import load_campaign, load_study, save_campaign, save_study
from cpcal.files.run_folder import REPORT_NAME
from cpcal.models import PLAIN
from cpcal.models.sight import CameraSet, Enclosing, PoseSet, TargetSet, campaign_of
from cpcal.questions import Result, certify, save_result
from cpcal.questions.ask import question_of
from cpcal.questions.fits import certify_fits
from cpcal.report.study_page import IMAGES_NAME, ImagePart, ImagesFound, render_study, save_images
from cpcal.robot import DELTALAB, Campaign, Study, quaternion_conjugate, quaternion_product, rotation_vector
from cpcal.simulate import simulate_study
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.stopping import heard
from cpcal.vision.batch.detect import Detections, ImageFolder
from cpcal.vision.batch.study_images import RenderedImages, study_table
from cpcal.vision.files.detection import POSITION, QUATERNION, SIGMA, readings_of, values_of
from cpcal.vision.files.plate_and_camera import CameraRecord

FACTOR = 3.0  # half-width of the reading sets, in standard deviations of
OF: Of = "single"  # readings: the paper's choice
HALF_WIDTH = 0.03  # pixels: every dot's box; no dot of the demo's images is farther from where it should be


@dataclass(frozen=True)
class DemoPlan:
    """How much is done. `imperfect`: legs that no seven parameters describe, so that the model must be refuted."""

    imperfect: Mapping[str, float] = field(default_factory=lambda: {"sag": 2.0, "axis_offset": 2.0})  # mm
    size: Mapping[str, int] = field(default_factory=dict)  # of the study; left out: the paper's
    photographs: Mapping[str, int] = field(default_factory=lambda: {"runs": 2, "validation_runs": 1, "images": 2})
    enclosed: int = 1  # of so many configurations one is enclosed from an image
    legs: tuple[int, ...] | None = None
    timeout_seconds: float = 3.0  # a leg, for the paper's timeout method
    timeout_gap: float = 0.01  # relative


PLAN = DemoPlan()


def demo(
    folder: Annotated[Path, output("DIR", "Folder for the study and all that follows from it.")] = Path("cpcal-demo"),
    seed: Annotated[int, option(None, "Of the simulated robot and its readings.")] = 1,
    images: Annotated[
        bool, option(None, "Render images of the study, and find its poses in them.", "--images")
    ] = False,
    force: Force = False,
    resume: Annotated[
        bool, option(None, "Go on in DIR, from where a stopped demo of the same options was.", "--resume")
    ] = False,
    *,
    talk: Talk,
) -> Status:
    """The paper's whole study on a simulated robot: calibrate, certify, check the proofs, write the report.

    The robot is the DeltaLab Table of Stewart with legs that sag and joints whose axes miss each other by 2 mm, which
    the model with seven parameters a leg does not know; the noise is the paper's. Writes DIR/study, DIR/campaign,
    DIR/validation, DIR/calibration.json, DIR/fits, DIR/run, DIR/timeout and the page DIR/report.html; with --images
    also DIR/images and what was found in them, and a campaign whose reading sets are proved from pixels, certified too.
    A certificate that the checker refuses makes the exit status 1.
    """
    check_new(folder, force=force or resume)
    for name in (REPORT_NAME, IMAGES_NAME):  # what is older must not stand beside newer results
        (folder / name).unlink(missing_ok=True)
    photos = _images(folder, seed, talk) if images else None
    given: dict[str, Any] = {"seed": seed, **PLAN.size, **PLAN.imperfect}
    study = photos.study if photos else simulate_study(**given)
    save_study(study, folder / STUDY)
    how = ", ".join(f"{name.replace('_', ' ')} {stated(size)} mm" for name, size in PLAN.imperfect.items())
    talk.say(f"Study: {folder / STUDY} (simulated, seed {seed}; {how})")
    found = calibrate_study(load_study(folder / STUDY), factor=FACTOR, of=OF)
    write_calibration(found, found.record, folder)
    show_record(talk, found.record)
    campaign = load_campaign(folder / CAMPAIGN)
    _fits(campaign, found.record, folder / FITS, talk)

    def run(name: str, of: Campaign) -> Result:
        question = replace(question_of(of, legs=PLAN.legs), whole=True)
        return _unless_stopped(lambda: certified_into(folder / name, question, talk=talk, resume=resume))

    result = run(RUN, campaign)
    _unless_stopped(lambda: _timeout(campaign, folder / TIMEOUT, talk))
    if photos is not None:
        talk.say(f"Reading sets from pixel boxes of ±{stated(HALF_WIDTH)} px:")
        sets, pixel = _pixel_campaign(photos, campaign, folder, talk)
        save_images(_images_found(photos, sets, (pixel, campaign), (run(PIXEL_RUN, pixel), result)), folder)
    accepted, whole = study_found(folder)
    page = write_file(folder / REPORT_NAME, render_study(whole, folder / RUN))
    talk.say(whole.checked, f"The whole study: {page}")
    return status_of(result) if accepted else Status.UNKNOWN


def _unless_stopped(certified: Callable[[], Result]) -> Result:
    """The result of long work; the demo ends with it where a signal stopped it."""
    with heard(terminate=True):
        result = certified()
        if result.interrupted:
            raise typer.Exit(status_of(result))
        return result


def _fits(campaign: Campaign, record: CalibrationRecord, folder: Path, talk: Talk) -> None:
    """Are x_c and x_c_sigma solutions? A line for each; with --verbose for each leg."""
    fits = certify_fits(campaign, record, folder, legs=PLAN.legs)
    for name, verified in fits.both:
        if talk.verbose:
            talk.say(*(f"Leg {fit.leg}: {fit.verified.sentence(name)}" for fit in verified))
            continue
        legs = {word: [str(fit.leg) for fit in verified if fit.verified.verdict is word] for word in Verdict}
        said = [f"{word.value} for leg {', '.join(some)}" for word, some in legs.items() if some]
        talk.say(f"{name} satisfies every equation exactly, for some readings in their sets: {'; '.join(said)}.")


def _timeout(campaign: Campaign, folder: Path, talk: Talk) -> Result:
    """eps by the paper's timeout method, a few seconds a leg."""
    legs = list(PLAN.legs or range(1, campaign.legs + 1))
    talk.say(f"The paper's timeout method (section 5.2.1), {stated(PLAN.timeout_seconds)} s a leg:")
    limits: dict[str, Any] = {"time_limit": PLAN.timeout_seconds, "gap": PLAN.timeout_gap}
    with line(talk.console()) as shown:
        timeout = certify(campaign, legs=legs, method="timeout", progress=Legs(shown), **limits)
    save_result(timeout, folder, campaign)
    show_result(replace(talk, verbose=False), campaign, timeout, PLAIN)
    return timeout


# ------------------------------------------------------------------------------------------------------------------
# With --images: the study by way of images, rendered and detected, and from there on as any other study; and a second
# campaign, whose reading sets are proved from pixel boxes, one image a configuration.


@dataclass(frozen=True)
class ImageStudy:
    """A study whose poses come from images. `exact` has the poses that were rendered, row by row of all images."""

    study: Study
    exact: Study
    shots: Mapping[str, RenderedImages]
    found: Mapping[str, Detections]


def _images(folder: Path, seed: int, talk: Talk) -> ImageStudy:
    """Render and detect; images are files below `folder`."""
    exact, shots = shot_study(DELTALAB, {"seed": seed, **PLAN.imperfect, **PLAN.photographs})
    talk.say(f"Images: {sum(len(images.names) for images in shots.values()):,}, rendered in {folder / IMAGES}")
    write_shots(exact, shots, folder)
    found, tables = {}, []
    for name, true in zip(TABLES, (exact.calibration, exact.validation), strict=True):
        source, camera = ImageFolder(folder / IMAGES / name), CameraRecord(shots[name].camera)
        found[name] = detected(source, shots[name].target, camera, folder / f"poses-{name}.csv", talk)
        tables.append(study_table(found[name].rows, readings_of(true)))
    study = Study(exact.robot, tables[0], tables[1], exact.truth, {**exact.provenance, "poses": "from rendered images"})
    return ImageStudy(study, exact, shots, found)


def _pixel_campaign(
    done: ImageStudy, campaign: Campaign, folder: Path, talk: Talk
) -> tuple[Mapping[str, PoseSet], Campaign]:
    """Pose sets by the image's name, one image of each (of every n-th) configuration of `campaign`, and their campaign.

    It has those that are proved, and the legs' reading sets of the other one. Raises InputError.
    """
    images, first = done.shots["calibration"], dict[str, str]()
    for row in done.found["calibration"].rows:
        if row.found:
            first.setdefault(PurePosixPath(row.file).parts[0], row.file)
    rows = {first[campaign.pose[k]]: k for k in range(0, len(campaign), PLAN.enclosed)}
    exact = TargetSet.of(images.target), CameraSet(images.camera)
    work = Enclosing(images, *exact, HALF_WIDTH, 0, folder / PIXEL_SETS, {})
    sets = {one.file: one.found for one in enclosed(work, list(rows), talk) if one.found is not None}
    names = [name for name in rows if name in sets and sets[name].verdict is Verdict.PROVED]
    proved, runs = [rows[name] for name in names], [PurePosixPath(name).parts[1] for name in names]
    readings = readings_of(done.study.calibration)
    said = f"poses from pixel boxes of +-{stated(HALF_WIDTH)} px, proved; legs as in the other campaign"
    pixel = campaign_of(
        [sets[name] for name in names],
        np.array([readings[campaign.pose[k], run] for k, run in zip(proved, runs, strict=True)]),
        campaign.robot,
        length_radius=campaign.length_radius[proved],
        pose=[campaign.pose[k] for k in proved],
        run=runs,
        provenance={"reading sets": said},
    )
    save_campaign(pixel, folder / PIXEL_CAMPAIGN)
    return sets, pixel


# ------------------------------------------------------------------------------------------------------------------
# What the demo's page says of the images that its study came from; `detected` wrote a page of each of the two tables.

_AXES = ("x [µm]", "y [µm]", "z [µm]", "rx [10⁻³ °]", "ry [10⁻³ °]", "rz [10⁻³ °]")


def _images_found(
    done: ImageStudy, sets: Mapping[str, PoseSet], campaigns: tuple[Campaign, Campaign], results: tuple[Result, Result]
) -> ImagesFound:
    """`campaigns`, `results`: from pixels, and from repeats."""
    images = done.shots["calibration"]
    scene, camera, target = images.scene, images.camera, images.target
    light = [f"{100 * share:.0f} %" for share in scene.gradient]
    rows = [row for found in done.found.values() for row in found.rows]
    count, shown = len(rows), sum(row.found for row in rows)
    rendered = (
        f"The poses of this study come from {count:,} rendered images of {camera.width} x {camera.height} pixels: a "
        f"camera with a focal length of {camera.focal[0]:.0f} pixels and an ordinary lens's distortion, aimed by eye, "
        f"sees the target “{target.name}” of {len(target.dots)} dots. Blur {scene.blur:g} px, noise {scene.noise:g} "
        f"grey levels of 256, light that grows by {light[0]} from left to right and by {light[1]} downwards. "
        f"{shown:,} of them show a pose: see the pages beside poses-calibration.csv and poses-validation.csv."
    )
    detected = (
        "Dots are found to a hundredth of a pixel or better, told apart by the cross-ratios along the two diagonals, "
        "and the pose is fitted to where the model of an imaged dot says its centre should be."
    )
    proved = [name for name, one in sets.items() if one.verdict is Verdict.PROVED]
    refuted = sum(one.verdict is Verdict.REFUTED for one in sets.values())
    holding = sum(images.pose(name) in sets[name] for name in proved)
    seconds = float(np.median([one.seconds for one in sets.values()]))
    enclosed = (
        f"Each dot of one image a configuration is stated to be within ±{stated(HALF_WIDTH)} pixels of where it was "
        "found (the centre of its image); camera and plate are assumed exact: the images were rendered with them. "
        f"Of {len(sets)} sets of poses that show all dots in such boxes, {len(proved)} are enclosed and {refuted} "
        f"empty, both proved, in {about(seconds, 2)} s each with a certificate. The true pose lies in {holding} of the "
        f"{len(proved)}. No page checks these proofs: `cpcal verify {PIXEL_SETS}` does. "
        "The half-widths of the enclosures, beside those of the first campaign's reading sets:"
    )
    again = (
        "These sets are the readings' sets of a second campaign, certified as the first is: for some pose that the "
        "pixels allow, and some leg reading in its set. So the proof begins at the image. The smallest model error of "
        "each leg, for both campaigns:"
    )
    widths: list[tuple[str, ...]] = [("half-width, median", *_AXES)]
    brackets: list[tuple[str, ...]] = [("leg", *(str(leg.leg) for leg in results[1].legs))]
    for name, one, result in zip(("pixels", "repeats"), campaigns, results, strict=True):
        radii = 1e3 * np.hstack([one.position_radius, np.degrees(one.rotation_radius)])
        of = f"pixels ±{stated(HALF_WIDTH)}" if name == "pixels" else "repeats, as in table 3"
        widths.append((of, *(nearest(float(v), 1) for v in np.median(radii, axis=0))))
        bounds = [bracket_text(leg.bracket.lo, leg.bracket.hi) for leg in result.legs]
        brackets.append((f"{name}: none below [mm]", *(lo for lo, _ in bounds)))
        brackets.append((f"{name}: attained [mm]", *(hi for _, hi in bounds)))
    return ImagesFound(
        (
            ImagePart("Figure 2 and section 2.3: from images to poses", (rendered, detected)),
            ImagePart("Errors of single images’ poses, against the simulation’s truth", table=_errors(done)),
            ImagePart("Reading sets from pixels", (enclosed,), tuple(widths)),
            ImagePart("", (again,), tuple(brackets)),
        )
    )


def _errors(done: ImageStudy) -> tuple[tuple[str, ...], ...]:
    """Of all images, in the camera frame: errors in µm, and in 10⁻³ ° of the rotation vector."""
    errors, sigmas = [], []
    for (name, found), table in zip(done.found.items(), (done.exact.calibration, done.exact.validation), strict=True):
        row_of = {image: row for row, image in enumerate(done.shots[name].names)}
        rows, values = [row_of[row.file] for row in found.rows if row.found], values_of(found.rows)
        turn = quaternion_product(values[:, QUATERNION], quaternion_conjugate(table.quaternion[rows]))
        errors.append(np.hstack([values[:, POSITION] - table.position[rows], rotation_vector(turn)]))
        sigmas.append(values[:, SIGMA])
    scaled = np.where(np.arange(6) < 3, 1e3, 1e3 * 180.0 / math.pi)
    error, sigma = np.concatenate(errors) * scaled, np.concatenate(sigmas) * scaled
    shown = {
        "error, RMS": np.sqrt(np.mean(error**2, axis=0)),
        "error, largest": np.abs(error).max(axis=0),
        "stated standard deviation, RMS": np.sqrt(np.mean(sigma**2, axis=0)),
        "error / its stated deviation, RMS": np.sqrt(np.mean((error / sigma) ** 2, axis=0)),
    }
    return (("", *_AXES), *((name, *(f"{v:.2f}" for v in row)) for name, row in shown.items()))
