"""`cpcal image`: a target and a camera, images to poses, and boxes of poses that are proved."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from cpcal.cli.options import (
    Status,
    Talk,
    TargetFile,
    argument,
    option,
    output,
    record,
)
from cpcal.cli.progress import counted
from cpcal.cli.verified import NUMBERS, TABLE, assumptions
from cpcal.common.errors import InputError, Problem
from cpcal.common.files import listed, unwritable, write_file
from cpcal.common.numbers import at_most
from cpcal.files.run_folder import POSE_SETS, answers_into
from cpcal.files.settings import STUDY_NAME, study_bytes, table_bytes
from cpcal.files.tables import file_cell, guarded
from cpcal.models.sight import CameraSet, Enclosed, Enclosing, TargetSet, stem_of
from cpcal.report.detections_page import write_detections_page
from cpcal.robot import Robot, Study
from cpcal.simulate import simulate_study
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.stopping import heard
from cpcal.vision.batch.detect import Detections, ImageFolder, in_parallel
from cpcal.vision.batch.detect import detect as detect_poses
from cpcal.vision.batch.study_images import RenderedImages, camera_above, look_again, study_table
from cpcal.vision.calibrate import calibrate_from_images
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.detection import (
    SCALE,
    SHARED,
    by_reason,
    detections_bytes,
    load_readings,
    readings_bytes,
    readings_of,
    values_of,
)
from cpcal.vision.files.image_file import image_path
from cpcal.vision.files.plate_and_camera import (
    YAML_SUFFIXES,
    CameraRecord,
    camera_yaml,
    load_camera,
    load_target,
    save_camera,
    save_target,
)
from cpcal.vision.files.target_print import on_paper, print_target
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Scene
from cpcal.vision.target import DELTALAB_TARGET, Target, resized

# ------------------------------------------------------------------------------------------------------------------
# `cpcal simulate --study --render`: what an engineer would bring home: images, leg readings, target and camera.

SCENE = Scene(gradient=(0.25, 0.15))
IMAGES = "images"
TABLES = ("calibration", "validation")


def shot_study(nominal: Robot, options: dict[str, Any]) -> tuple[Study, dict[str, RenderedImages]]:
    """A study with exact poses, and for both of its tables the images of them. Raises MissingExtraError."""
    opencv()  # or nothing is begun
    seed = options["seed"]
    exact = {"images": 1, **options, "pose_noise": 0.0, "camera": camera_above(seed=seed)}
    study = simulate_study(nominal, **exact)
    return study, {
        name: RenderedImages.of(table, DELTALAB_TARGET, DELTALAB_CAMERA, SCENE, seed=seed)
        for name, table in zip(TABLES, (study.calibration, study.validation), strict=True)
    }


def write_shots(study: Study, images: dict[str, RenderedImages], folder: Path) -> None:
    """The study without its tables of poses: `cpcal image detect` makes them. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in zip(TABLES, (study.calibration, study.validation), strict=True):
            with counted(f"{name}: rendering", Talk().console()) as progress:
                images[name].write(folder / IMAGES / name, progress=progress)
            (folder / f"{name}-readings.csv").write_bytes(readings_bytes(readings_of(table)))
        save_target(DELTALAB_TARGET, folder / "target.toml")
        save_camera(DELTALAB_CAMERA, folder / "camera.toml")
        (folder / STUDY_NAME).write_bytes(study_bytes(study))
    except OSError as error:
        raise unwritable(folder, error) from None


# ------------------------------------------------------------------------------------------------------------------
# `cpcal image camera`: a camera from one kind of file to another. `cpcal image target`: the plate that it sees.

Images = Annotated[Path, argument("IMAGES", "Folder of PNG, JPEG or TIFF files, and below.")]
Workers = Annotated[int | None, option(None, "Processes [default: one a core]", min=1)]


def camera(
    source: Annotated[Path, argument("FILE", "camera.toml, or a YAML file of OpenCV or ROS.")],
    file: Annotated[Path, output("FILE", "Ends in .toml, .yaml or .yml.")],
    style: Annotated[Literal["opencv", "ros"], option(None, "Who shall read the YAML.", "--as")] = "ros",
) -> None:
    """Rewrite a camera: OpenCV's and ROS's YAML to camera.toml, and back."""
    record = load_camera(source)
    if file.suffix == ".toml":
        save_camera(record, file)
    elif file.suffix in YAML_SUFFIXES:
        write_file(file, camera_yaml().camera_yaml(record.camera, style))
    else:
        raise InputError([Problem(str(file), "is neither a .toml nor a .yaml file", "name it so")])
    seen = record.camera
    lost = record.covariance is not None and file.suffix != ".toml"
    more = "; the covariance is in camera.toml only" if lost else ""
    Talk().say(f"{seen.width} x {seen.height} pixels, lens {seen.model}: {file}{more}")


def target(
    file: Annotated[Path, output("FILE", "What to write: target.toml, or a .pdf or .svg page.")],
    source: Annotated[Path | None, option("FILE", "Print the target of this target.toml.", "--from")] = None,
    side: Annotated[float | None, option("MM", "As large as this: between the centres of the outermost dots.")] = None,
    dark: Annotated[bool, option(None, "Dark dots on a bright plate.", "--dark")] = False,
    paper: Annotated[
        Literal["a4", "a3", "a2", "a1", "a0", "letter"] | None,
        option(None, "Sheet to print on; the default target is made to fit it."),
    ] = None,
) -> None:
    """Write a target: a grid of dots whose two diagonals tell where its axes are, whatever it is seen from.

    Without --from, --side and --paper it is the one that the demo's images show, 300 mm wide, on A2.
    """
    if source is not None and side is not None:
        raise InputError([Problem("options", "--from and --side exclude each other", "give one of them")])
    if side is not None and not 1.0 <= side <= 1e5:
        raise InputError([Problem("option --side", f"is {side:g}", "give mm, from 1 to 100000")])
    plate = replace(DELTALAB_TARGET, bright=not dark) if source is None else load_target(source)
    if side is not None:
        plate = resized(plate, side / float(np.ptp(plate.dots, axis=0).max()))
    elif paper is not None and source is None:
        plate = on_paper(plate, paper)
    if file.suffix == ".toml":
        save_target(plate, file)
    else:
        print_target(plate, file, paper)
    Talk().say(f"{plate.name}: {len(plate.dots)} dots: {file}")


# ------------------------------------------------------------------------------------------------------------------
# `cpcal image detect`: from a folder of images to a table of poses; or, with --calibrate, to a camera.

_NAMED = 3  # files for each reason


def detect(
    images: Images,
    file: Annotated[Path, output("FILE", "What to write: poses.csv, or camera.toml.")],
    target: TargetFile,
    camera: Annotated[Path | None, option("FILE", "The camera: camera.toml.")] = None,
    readings: Annotated[
        Path | None, option("FILE", "Leg readings pose,run,L1,...,Ln of images named POSE/RUN/IMAGE.png.")
    ] = None,
    table: Annotated[
        Path | None, option("FILE", "With --readings: the table of a study to write, such as calibration.csv.")
    ] = None,
    overlays: Annotated[Path | None, option("DIR", "Pictures of what was found, and why not.", "--overlay")] = None,
    workers: Workers = None,
    scheduler: Annotated[
        str | None, option("ADDRESS", "Dask scheduler of a cluster, instead; its workers read IMAGES.")
    ] = None,
    calibrate: Annotated[
        bool, option(None, "The camera from IMAGES, instead of poses; FILE is a camera.toml.", "--calibrate")
    ] = False,
    refine_dots: Annotated[
        bool, option(None, "With --calibrate: the places of the dots on the plate, too.", "--refine-dots")
    ] = False,
    *,
    talk: Talk,
) -> None:
    """Poses of a target in IMAGES. An image that shows none is a row with the reason, and stops no other.

    What is done is kept in FILE.journal: the same command, again, measures only images that are new. Ctrl-C loses
    nothing. The table is the same, byte for byte, whatever the number of workers. FILE.html is a page: counts, some
    images with what was found, where residuals point, time.
    """
    problems = []
    if calibrate and (camera or readings or table):
        problems.append(Problem("options", "--calibrate goes with none of --camera, --readings, --table", "choose"))
    if not calibrate and camera is None:
        problems.append(Problem("option --camera", "is missing", "name a camera.toml, or make one with --calibrate"))
    if refine_dots and not calibrate:
        problems.append(Problem("option --refine-dots", "has no meaning without --calibrate", "leave it out"))
    if (readings is None) != (table is None):
        problems.append(Problem("options", "--readings and --table go together", "give both, or none"))
    if not images.is_dir():
        what = "is not a folder" if images.exists() else "does not exist"
        problems.append(Problem(str(images), what, "give a folder with images"))
    elif not ImageFolder(images).names:
        problems.append(Problem(str(images), "holds no PNG, JPEG or TIFF files", "give a folder with images"))
    if problems:
        raise InputError(problems)
    if camera is None:
        _calibrate(images, load_target(target), file, refine_dots, talk)
        return
    loads: tuple[tuple[Callable[[Path], Any], Path | None], ...]
    loads = (load_target, target), (load_camera, camera), (load_readings, readings)
    loaded: list[Any] = []
    for load, name in loads:
        try:
            loaded.append(None if name is None else load(name))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    plate, lens, known = loaded
    source = ImageFolder(images, (lens.camera.width, lens.camera.height))
    found = detected(source, plate, lens, file, talk, workers=workers, scheduler=scheduler, overlays=overlays)
    if table is not None:
        write_file(table, table_bytes(study_table(found.rows, known)))
        talk.say(f"Table of a study: {table}")


def detected(
    source: ImageFolder, plate: Target, lens: CameraRecord, file: Path, talk: Talk, **where: Any
) -> Detections:
    """The poses in a folder of images: the table and the page of them, and what is said of it."""
    journal = file.with_name(f"{file.name}.journal")
    journal.absolute().parent.mkdir(parents=True, exist_ok=True)
    with heard(terminate=True), counted("images", talk.console()) as progress:
        found = detect_poses(source, plate, lens.camera, lens.covariance, journal=journal, progress=progress, **where)
    write_file(file, detections_bytes(found.rows))
    poses = sum(row.found for row in found.rows)
    record("images", images=len(found.rows), poses=poses, measured=found.measured)
    pace = f"; {found.measured / found.seconds:.0f} images a second of work" if found.seconds > 0.0 else ""
    talk.say(f"{poses:,} poses in {len(found.rows):,} images ({found.measured:,} measured now{pace}): {file}")
    shared = values_of(found.rows)[:, SHARED]
    if len(shared) and shared.any():
        position, turn = (float(np.median(shared[:, part].max(axis=1))) for part in (slice(0, 3), slice(3, 6)))
        talk.say(
            f"  errors that all images share (camera, plate): standard deviations of {position:.4f} mm and "
            f"{turn:.6f} rad (medians); no mean lessens them"
        )
    doubtful = [row for row in found.rows if row.doubt]
    if doubtful:
        worst = max(doubtful, key=lambda row: row.values[SCALE])
        talk.say(f"  {len(doubtful):,} of the poses are doubtful; {worst.file}: {worst.doubt}")
    for reason, files in by_reason(found.rows).items():
        talk.say(f"  {len(files):,} x {reason}: {listed(files, len(files) if talk.verbose else _NAMED)}")
    sample = look_again(found.rows, source, plate, lens.camera, lens.covariance)
    talk.say(f"Page: {write_detections_page(found, sample, plate, lens.camera, file)}")
    return found


def _calibrate(images: Path, plate: Target, file: Path, refine_dots: bool, talk: Talk) -> None:
    """The camera; with refined dots also the target that was found, beside it."""
    files = [image_path(images, name) for name in ImageFolder(images).names]
    found = calibrate_from_images(files, plate, refine_dots=refine_dots)
    save_camera(found.record(), file)
    talk.say(*str(found).split("\n"))
    for view in found.views:
        if not view.reason:
            talk.say(f"  {view.name}: {view.used.sum()} dots, RMS {view.rms:.4f} px per axis")
    talk.say(f"Camera: {file}")
    if refine_dots:
        refined = file.with_name("refined-target.toml")
        save_target(found.target, refined)
        talk.say(f"Target as it was seen: {refined}")


# ------------------------------------------------------------------------------------------------------------------
# `cpcal image sets`: from images to boxes of poses that are proved, with certificates.

_TOLD = 5  # images by name


def sets(
    images: Images,
    folder: Annotated[Path, output("DIR", "Folder for certificates; replaced.")],
    target: TargetFile,
    camera: Annotated[Path, option("FILE", "The camera: camera.toml.")],
    half_width: Annotated[float, option("PX", "How far the centre of a dot's image is off, at most.", min=0.0)] = 0.05,
    factor: Annotated[
        float,
        option(
            None,
            "The camera is within so many standard deviations: the ellipsoid of its file's covariance. 5 holds 99.7 % "
            "of all calibrations. The plate's scale_sigma and dot_sigma count as many times.",
            min=0.1,
        ),
    ] = 5.0,
    camera_exact: Annotated[
        bool, option(None, "Assume that the camera is exactly as its file says.", "--camera-exact")
    ] = False,
    plate_exact: Annotated[
        bool, option(None, "Assume that the plate is exactly as its file says.", "--plate-exact")
    ] = False,
    dots: Annotated[
        float | None,
        option(
            "MM",
            "How far a dot is off its place in the plate along an axis, at most.",
            min=0.0,
            show_default="--factor times dot_sigma",
        ),
    ] = None,
    outliers: Annotated[int, option(None, "Dots of an image that may be anywhere, at most.", min=0, max=3)] = 0,
    workers: Workers = None,
    *,
    talk: Talk,
) -> Status:
    """Boxes that are PROVED to hold the pose in each of IMAGES, with certificates from the pixels on.

    It is proved if what is stated is true: camera, plate and pixels are no farther off than files and options say. A
    camera without covariance, or a plate without deviations, is exact only if you say so.
    """
    plate, lens = load_target(target), load_camera(camera)
    plates, cameras = _stated(plate, lens, None if plate_exact else dots, factor, plate_exact, camera_exact)
    source = ImageFolder(images, (lens.camera.width, lens.camera.height))
    names = list(source.names)
    _check_names(names, images)
    sources = {path.name: path.read_bytes() for path in (camera, target)}
    work = Enclosing(source, plates, cameras, half_width, outliers, folder, sources)
    found = enclosed(work, names, talk, workers)
    proved = _say(found, folder, talk)
    talk.say(*assumptions(folder))
    record("enclosed", images=len(found), proved=proved, output=str(folder))
    return Status.ANSWERED if proved else Status.UNKNOWN


def enclosed(work: Enclosing, names: Sequence[str], talk: Talk, workers: int | None = None) -> list[Enclosed]:
    """The pose sets of some images, with certificates and a table in the folder of the work."""
    found: list[Enclosed] = []
    with (
        heard(terminate=True),
        answers_into(work.folder, POSE_SETS) as draft,
        counted("images", talk.console()) as progress,
    ):
        for some in in_parallel(replace(work, folder=draft), names, workers):
            found += some
            progress(len(found), len(names))
        found.sort(key=lambda one: one.file)
        (draft / TABLE).write_text(_table(found), encoding="utf-8")
    return found


def _stated(
    plate: Target, lens: CameraRecord, dots: float | None, factor: float, plate_exact: bool, camera_exact: bool
) -> tuple[TargetSet, CameraSet]:
    """What the files and options state of plate and camera. Raises InputError: nothing is exact unless it is said."""
    problems = []
    within = factor * plate.dot_sigma if dots is None else dots
    if not (plate_exact or within or plate.scale_sigma):
        what = "has neither dot_sigma nor scale_sigma: nothing says how far its dots may be off"
        problems.append(Problem("the target", what, "add them to its file, give --dots MM, or say --plate-exact"))
    if lens.covariance is None and not camera_exact:
        what = "has no covariance: nothing says how far its numbers may be off"
        remedy = "calibrate with `cpcal image detect --calibrate`, or say --camera-exact"
        problems.append(Problem("the camera", what, remedy))
    if problems:
        raise InputError(problems)
    known = None if camera_exact else lens.covariance
    cameras = CameraSet(lens.camera) if known is None else CameraSet.ellipsoid(lens.camera, known, factor)
    if plate_exact:
        return TargetSet.of(plate), cameras
    return TargetSet.within(plate, [within, within, 0.0], factor * plate.scale_sigma), cameras


def _check_names(names: list[str], images: Path) -> None:
    if not names:
        raise InputError([Problem(str(images), "holds no images", "give a folder of PNG, JPEG or TIFF files")])
    stems: dict[str, str] = {}
    for name in names:
        other = stems.setdefault(stem_of(name), name)
        if other != name:
            what = f"{name} and {other} would have certificates of one name"
            raise InputError([Problem(str(images), what, "rename one of them")])


def _table(rows: Sequence[Enclosed]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("file", "verdict", "reason", *NUMBERS))
    for one in rows:
        numbers, found = [""] * len(NUMBERS), one.found
        if found is not None and found.pose is not None:
            parts = (found.pose.position, found.pose.quaternion, found.position_radius, found.rotation_radius)
            numbers = [repr(value) for part in parts if part is not None for value in part.tolist()]
        verdict = "unknown" if found is None else found.verdict.value
        reason = one.reason or ("" if found is None else found.reason)
        writer.writerow([file_cell(one.file), verdict, guarded(reason), *numbers])
    return text.getvalue()


def _say(rows: Sequence[Enclosed], folder: Path, talk: Talk) -> int:
    """Counts, reasons and widths; how many are proved."""
    sets = [one.found for one in rows if one.found is not None]
    proved = [one for one in sets if one.verdict is Verdict.PROVED]
    refuted = sum(one.verdict is Verdict.REFUTED for one in sets)
    talk.say(
        f"{len(rows)} images: {len(proved)} poses enclosed, {refuted} refuted (no pose shows the dots so), both "
        f"proved; {len(sets) - len(proved) - refuted} unknown, {len(rows) - len(sets)} not measured."
    )
    for one in [one for one in rows if one.reason][:_TOLD]:
        talk.say(f"  {one.file}: {one.reason}")
    if proved:
        position = np.median([one.position_radius for one in proved], axis=0)
        turn = np.degrees(np.median([one.rotation_radius for one in proved], axis=0))
        widths = [" x ".join(at_most(float(v), 2) for v in side) for side in (position, turn)]
        talk.say(f"Half-widths, median: {widths[0]} mm, {widths[1]} degrees. Table: {folder / TABLE}")
    talk.say(f"Certificates: cpcal verify {folder}")
    return len(proved)
