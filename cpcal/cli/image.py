"""`cpcal image`: a target and a camera, images to poses, and boxes of poses that are proved."""

from base64 import b64encode
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from cpcal.cli.certify import show
from cpcal.cli.verbs import FIRST_ROW, TARGET_FILE, Status, Talk, argument, counted, option, output
from cpcal.cli.verified import NUMBERS, TABLE, assumptions
from cpcal.common.documents import csv_table
from cpcal.common.errors import refuse, together, unusable
from cpcal.common.files import unwritable, write_file
from cpcal.common.numbers import about, at_most, nearest
from cpcal.common.values import Json
from cpcal.files.folders import STUDY_NAME, existing_folder, study_bytes, table_bytes
from cpcal.files.run_folder import POSE_SETS, answers_into
from cpcal.files.tables import load_readings, readings_bytes
from cpcal.models.sight import CameraSet, Enclosed, Enclosing, TargetSet, stem_of
from cpcal.report.section import Drawing, Page, Picture, Section, Table, origin, verdict
from cpcal.robot import Robot, Study
from cpcal.robot.campaign import SIMULATION, titled
from cpcal.simulate import simulate_study
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.stopping import heard
from cpcal.vision.batch.detect import (
    FALSE,
    MISSING,
    RMS,
    SCALE,
    SHARED,
    SIGMA,
    Detection,
    Detections,
    ImageFolder,
    by_reason,
    detections_bytes,
    hinted,
    in_parallel,
    values_of,
)
from cpcal.vision.batch.detect import detect as detect_poses
from cpcal.vision.batch.study_images import RenderedImages, SeenImage, camera_above, look_again, study_table
from cpcal.vision.calibrate import calibrate_from_images
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.image_file import image_path
from cpcal.vision.files.plate_and_camera import (
    CameraRecord,
    load_camera,
    load_target,
    save_camera,
    save_target,
    target_bytes,
)
from cpcal.vision.files.target_print import on_paper, print_target
from cpcal.vision.measure import DEVIATION
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Scene
from cpcal.vision.target import DELTALAB_TARGET, TEXTS, Target

# ------------------------------------------------------------------------------------------------------------------
# `cpcal simulate --study --render`: what an engineer would bring home: images, leg readings, target and camera.


def write_shots(nominal: Robot, options: Json, folder: Path) -> Study:
    """A simulated study: images instead of its tables of poses, which `cpcal image detect` makes. Raises InputError,
    MissingExtraError."""
    opencv()  # or nothing is begun
    seed = options["seed"]
    study = simulate_study(nominal, **{"images": 1, **options, "pose_noise": 0.0, "camera": camera_above(seed=seed)})
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in (("calibration", study.calibration), ("validation", study.validation)):
            images = RenderedImages.of(table, DELTALAB_TARGET, DELTALAB_CAMERA, Scene(gradient=(0.25, 0.15)), seed=seed)
            with counted(f"{name}: rendering", Talk().console()) as progress:
                images.write(folder / "images" / name, progress=progress)
            (folder / f"{name}-readings.csv").write_bytes(readings_bytes(table))
        save_target(DELTALAB_TARGET, folder / "target.toml")
        made_by = {"generator": f"{SIMULATION} --study --render"}  # pages of these images call them simulated
        save_camera(CameraRecord(DELTALAB_CAMERA, provenance=made_by), folder / "camera.toml")
        (folder / STUDY_NAME).write_bytes(study_bytes(study))
    except OSError as error:
        raise unwritable(folder, error) from None
    return study


# ------------------------------------------------------------------------------------------------------------------
# `cpcal image camera`: a camera from a file of another kind, or from images. `cpcal image target`: the plate.

IMAGE_FOLDER = argument("IMAGES", "Folder of PNG, JPEG, TIFF or BMP files, and below.")
CAMERA_FILE = option(..., "The camera: camera.toml, or a YAML file of OpenCV or ROS.", "FILE")
WORKERS = option(None, "Processes [default: one a core]", min=1)


def camera(
    source: Path = argument("FILE|IMAGES", "A YAML file of OpenCV or ROS; or images of a target, to calibrate from."),
    file: Path = output("FILE", "The camera.toml to write."),
    target: str | None = option(None, f"With IMAGES: what they show, target.toml or {TEXTS}.", "TARGET"),
    *,
    talk: Talk,
) -> None:
    """A camera as camera.toml: from OpenCV's or ROS's YAML, or calibrated from IMAGES of a target."""
    refuse(
        (source.is_dir() != (target is not None), "options", "IMAGES and --target go together", "give both, or a FILE")
    )
    if target is None:
        record = load_camera(source)
    else:
        names, plate = together(partial(_names, source), partial(load_target, target))
        found = calibrate_from_images([image_path(source, name) for name in names], plate)
        record = CameraRecord(found.camera, found.covariance, found.rms)
        talk.say(*str(found).split("\n"))
        for view in found.views:
            if not view.reason:
                talk.say(f"  {view.name}: {view.used.sum()} dots, RMS {view.rms:.4f} px per axis")
    save_camera(record, file)
    seen = record.camera
    talk.say(f"{seen.width} x {seen.height} pixels, lens {seen.model}: {file}")


def target(
    file: Path = output("FILE", "What to write: target.toml, or a .pdf or .svg page."),
    source: Path | None = option(None, f"Of this target.toml, or {TEXTS}.", "TARGET", "--from"),
    paper: Literal["a4", "a3", "a2", "a1", "a0", "letter"] | None = option(
        None, "Sheet to print on; the default target is made to fit it."
    ),
) -> None:
    """Write a target: a grid of dots with others off it that tell where its axes are, or one of OpenCV's boards.

    Without --from and --paper it is the one that the demo's images show, 300 mm wide, on A2.
    """
    plate = DELTALAB_TARGET if source is None else load_target(source)
    if paper is not None and source is None:
        plate = on_paper(plate, paper)
    if file.suffix == ".toml":
        save_target(plate, file)
    else:
        print_target(plate, file, paper)
    Talk().say(f"{plate.name}: {len(plate.dots)} {'corners' if plate.printed else 'dots'}: {file}")


# ------------------------------------------------------------------------------------------------------------------
# `cpcal image detect`: from a folder of images to a table of poses.


def _names(folder: Path) -> list[str]:
    """Of the images in a folder. Raises InputError where there is none."""
    remedy = "give a folder with images"
    names = list(ImageFolder(existing_folder(folder, remedy)).names)
    if not names:
        raise unusable(str(folder), "holds no PNG, JPEG, TIFF or BMP files", remedy)
    return names


def detect(
    images: Path = IMAGE_FOLDER,
    file: Path = output("FILE", "The table to write: poses.csv."),
    target: Path = TARGET_FILE,
    camera: Path = CAMERA_FILE,
    readings: Path | None = option(None, "Leg readings pose,run,L1,...,Ln of images named POSE/RUN/IMAGE.png.", "FILE"),
    table: Path | None = option(
        None, "With --readings: the table of a study to write, such as calibration.csv.", "FILE"
    ),
    first_row: str | None = FIRST_ROW,
    workers: int | None = WORKERS,
    *,
    talk: Talk,
) -> None:
    """Poses of a target in IMAGES. An image that shows none is a row with the reason, and stops no other.

    What is done is kept in FILE.journal: the same command, again, measures only images that are new. Ctrl-C loses
    nothing. The table is the same, byte for byte, whatever the number of workers. FILE.html is a page: counts, some
    images with what was found, time.
    """
    apart = (readings is None) != (table is None), "options", "--readings and --table go together", "give both"
    _, _, plate, lens, known, turn = together(
        partial(refuse, apart),
        partial(_names, images),
        partial(load_target, target),
        partial(load_camera, camera),
        lambda: {} if readings is None else load_readings(readings),
        partial(hinted, first_row),
    )
    source = ImageFolder(images, (lens.camera.width, lens.camera.height))
    journal = file.with_name(f"{file.name}.journal")
    journal.absolute().parent.mkdir(parents=True, exist_ok=True)
    with heard(terminate=True), counted("images", talk.console()) as progress:
        found = detect_poses(
            source,
            plate,
            lens.camera,
            lens.covariance,
            journal=journal,
            progress=progress,
            first_row=turn,
            workers=workers,
        )
    write_file(file, detections_bytes(found.rows))
    poses = sum(row.found for row in found.rows)
    pace = f"; {found.measured / found.seconds:.0f} images a second of work" if found.seconds > 0.0 else ""
    talk.say(f"Poses in {poses:,} of {len(found.rows):,} images ({found.measured:,} measured now{pace}): {file}")
    show(talk, *rejected(found, file.name), *(numbers(found.rows) if talk.verbose else ()))
    pictures = look_again(found.rows, source, plate, lens, turn)
    talk.say(f"Page: {write_detections_page(found, pictures, plate, lens, file)}")
    if table is not None:
        write_file(table, table_bytes(study_table(found.rows, known)))
        talk.say(f"Table of a study: {table}")


# ------------------------------------------------------------------------------------------------------------------
# The page of `cpcal image detect`: counts with reasons, some images, time.

MOST_ROWS = 12  # of a table
_NAMED = 3  # files for each reason


def write_detections_page(
    found: Detections, pictures: Sequence[SeenImage], target: Target, lens: CameraRecord, table: Path
) -> Path:
    """Write `TABLE.html` beside the table of poses, all or nothing; its path. Raises InputError.

    Images that were simulated are called so, as the camera's provenance says.
    """
    name, doubtful = table.name, sum(bool(row.doubt) for row in found.rows)
    poses = sum(row.found for row in found.rows)
    time = "No image was measured now: all rows are those of the journal."
    if found.measured:
        each = nearest(1e3 * found.seconds / found.measured, 1)
        time = (
            f"{found.measured:,} images were measured now, in {each} ms of processor time each, all workers together."
        )
    page = Page(
        titled(f"Images to poses: {name}", lens.provenance),
        "images to poses",
        titled(f"What was found in the images of {name}", lens.provenance),
        [
            *rejected(found, name),
            *_some_images(pictures),
            *numbers(found.rows),
            origin({"Numbers": f"In full they are in {name}.", "Time": time}),
        ],
        lead=(
            f"Target “{target.name}”. ",
            verdict(f"{poses - doubtful:,}", "explained"),
            " found, ",
            verdict(f"{doubtful:,}", "undecided"),
            " found, doubtful, ",
            verdict(f"{len(found.rows) - poses:,}", "unexplained"),
            " refused.",
        ),
    )
    return page.write(table.with_name(f"{name}.html"))


def rejected(found: Detections, name: str) -> Iterator[Section]:
    """Images without a pose, and with a doubtful one: on the page and on a terminal."""
    refused = [
        (reason, f"{len(files):,}", ", ".join(files[:_NAMED]) + ", ..." * (len(files) > _NAMED))
        for reason, files in by_reason(found.rows).items()
    ]
    if refused:
        head = ("why there is no pose", "images", "such as")
        yield Section("Refused", tables=[Table(head, refused, most=MOST_ROWS, where=name)])
    worst = sorted((row for row in found.rows if row.doubt), key=lambda row: -row.values[SCALE])
    if worst:
        rows = [(row.file, about(row.values[SCALE]), nearest(row.values[RMS], 4), str(row.dots)) for row in worst]
        said = (
            "Residuals are larger than the dots’ noise explains, so that the pose may be off by more than is stated: "
            "check the camera’s calibration, the target’s dots and whether the plate is flat."
        )
        doubtful = Table(("image", "scale", "residuals, RMS [px]", "dots"), rows, most=MOST_ROWS, where=name)
        yield Section("Doubtful", [said], tables=[doubtful])


def _some_images(seen_images: Sequence[SeenImage]) -> Iterator[Section]:
    pictures = []
    for seen in seen_images:
        row, caption, kind, word = seen.row, seen.row.file, "unexplained", "refused"
        if row.found:
            kind, word = ("undecided", "doubtful") if row.doubt else ("explained", "found")
            caption += f": {row.dots} dots, {nearest(row.values[RMS], 4)} px RMS"
        words = verdict(word, kind), f" {caption}"
        pictures.append((Picture(f"{caption}, {word}", b64encode(seen.jpeg).decode(), seen.size), words))
    caption = (
        "Blue rings: dots that the pose rests on; red: dots that should be seen and are not; violet: dots that fit no "
        "pose with the others; yellow crosses: found dots that are none of the target’s. Red and green lines: the "
        "target’s x and y axis. Refused images first, then the most doubtful, then others, evenly spread."
    )
    if pictures:
        yield Section("Some images", figures=[Drawing(caption=caption, pictures=pictures)])


def numbers(rows: Sequence[Detection]) -> Iterator[Section]:
    """Of all poses the median and the worst: on the page and on a terminal."""
    values = values_of(rows)
    if not len(values):
        return
    dots = np.array([row.dots for row in rows if row.found])
    lines = [
        ("dots that the pose rests on", dots, 0),
        ("dots of the target that are missing", values[:, MISSING], 0),
        ("found dots that are none of the target's", values[:, FALSE], 0),
        ("residuals, RMS per axis [px]", values[:, RMS], 4),
        ("scale: mean square of residuals over the stated one", values[:, SCALE], 2),
    ]
    for part, of in ((SIGMA, "stated deviation of"), (SHARED, "of it shared by all images,")):
        position, turn = values[:, part][:, :3].max(axis=1), np.degrees(values[:, part][:, 3:].max(axis=1))
        lines += [
            (f"{of} the position, largest axis [mm]", position, 4),
            (f"{of} the rotation, largest axis [°]", turn, 5),
        ]
    told = []
    for name, of_all, decimals in lines:
        worst = of_all.min() if of_all is dots else of_all.max()
        told.append((name, nearest(float(np.median(of_all)), decimals), nearest(float(worst), decimals)))
    yield Section("Poses", tables=[Table(("of all poses", "median", "worst"), told)])


# ------------------------------------------------------------------------------------------------------------------
# `cpcal image sets`: from images to boxes of poses that are proved, with certificates.

_TOLD = 5  # images by name
_OFF = "0.05; of a printed board's corners 5 stated deviations"


def sets(
    images: Path = IMAGE_FOLDER,
    folder: Path = output("DIR", "Folder for certificates; replaced."),
    target: Path = TARGET_FILE,
    camera: Path = CAMERA_FILE,
    half_width: float | None = option(
        None, "How far the centre of a dot's image, or a corner, is off, at most.", "PX", min=0.0, show_default=_OFF
    ),
    factor: float = option(
        5.0,
        "The camera is within so many standard deviations: the ellipsoid of its file's covariance. 5 holds 99.7 % "
        "of all calibrations. The plate's scale_sigma and dot_sigma count as many times.",
        min=0.1,
    ),
    camera_exact: bool = option(False, "Assume that the camera is exactly as its file says."),
    plate_exact: bool = option(False, "Assume that the plate is exactly as its file says."),
    dots: float | None = option(
        None,
        "How far a dot is off its place in the plate along an axis, at most.",
        "MM",
        min=0.0,
        show_default="--factor times dot_sigma",
    ),
    outliers: int = option(0, "Dots of an image that may be anywhere, at most.", min=0, max=3),
    first_row: str | None = FIRST_ROW,
    workers: int | None = WORKERS,
    *,
    talk: Talk,
) -> Status:
    """Boxes that are PROVED to hold the pose in each of IMAGES, with certificates from the pixels on.

    It is proved if what is stated is true: camera, plate and pixels are no farther off than files and options say. A
    camera without covariance, or a plate without deviations, is exact only if you say so.
    """
    names, plate, lens, turn = together(
        partial(_names, images), partial(load_target, target), partial(load_camera, camera), partial(hinted, first_row)
    )
    plates, cameras = _stated(plate, lens, None if plate_exact else dots, factor, plate_exact, camera_exact)
    off = 5.0 * DEVIATION.get(plate.board.partition(":")[0], 0.01) if half_width is None else half_width
    stems = dict[str, str]()
    for name in names:
        if (other := stems.setdefault(stem_of(name), name)) != name:
            what = f"{name} and {other} would have certificates of one name"
            raise unusable(str(images), what, "rename one of them")
    source = ImageFolder(images, (lens.camera.width, lens.camera.height))
    sources = {camera.name: camera.read_bytes()}
    sources |= {target.name: target.read_bytes()} if target.is_file() else {"target.toml": target_bytes(plate)}
    rows = []
    with heard(terminate=True), answers_into(folder, POSE_SETS) as draft, counted("images", talk.console()) as progress:
        work = Enclosing(source, plates, cameras, off, outliers, draft, sources, turn)
        for some in in_parallel(work, names, workers):
            rows += some
            progress(len(rows), len(names))
        rows.sort(key=lambda one: one.file)
        (draft / TABLE).write_bytes(csv_table(("file", "verdict", "reason", *NUMBERS), map(_cells, rows)))
    found = [one.found for one in rows if one.found is not None]
    proved = [one for one in found if one.verdict is Verdict.PROVED]
    refuted = sum(one.verdict is Verdict.REFUTED for one in found)
    talk.say(
        f"Poses enclosed in {len(proved)} of {len(rows)} images, {refuted} refuted (no pose shows the dots so), both "
        f"proved; {len(found) - len(proved) - refuted} unknown, {len(rows) - len(found)} not measured.",
        *[f"  {one.file}: {one.reason}" for one in rows if one.reason][:_TOLD],
    )
    if proved:
        position = np.median([one.position_radius for one in proved], axis=0)
        turn = np.degrees(np.median([one.rotation_radius for one in proved], axis=0))
        widths = [" x ".join(at_most(float(v), 2) for v in side) for side in (position, turn)]
        talk.say(f"Half-widths, median: {widths[0]} mm, {widths[1]} degrees. Table: {folder / TABLE}")
    talk.say(f"Certificates: cpcal verify {folder}", *assumptions(folder))
    return Status.ANSWERED if proved else Status.UNKNOWN


def _cells(one: Enclosed) -> list[str | float | None]:
    """A row of the table."""
    if (found := one.found) is None:
        return [one.file, "unknown", one.reason, *[None] * len(NUMBERS)]
    numbers = [None] * len(NUMBERS)
    if found.pose is not None and found.position_radius is not None and found.rotation_radius is not None:
        parts = found.pose.position, found.pose.quaternion, found.position_radius, found.rotation_radius
        numbers = np.concatenate(parts).tolist()
    return [one.file, found.verdict.value, one.reason or found.reason, *numbers]


def _stated(
    plate: Target, lens: CameraRecord, dots: float | None, factor: float, plate_exact: bool, camera_exact: bool
) -> tuple[TargetSet, CameraSet]:
    """What the files and options state of plate and camera. Raises InputError: nothing is exact unless it is said."""
    within, says = factor * plate.dot_sigma if dots is None else dots, "nothing says how far its"
    refuse(
        (
            not (plate_exact or within or plate.scale_sigma),
            "the target",
            f"has neither dot_sigma nor scale_sigma: {says} dots may be off",
            "add them to its file, give --dots MM, or say --plate-exact",
        ),
        (
            lens.covariance is None and not camera_exact,
            "the camera",
            f"has no covariance: {says} numbers may be off",
            "calibrate with `cpcal image camera IMAGES`, or say --camera-exact",
        ),
    )
    known = None if camera_exact else lens.covariance
    cameras = CameraSet(lens.camera) if known is None else CameraSet.ellipsoid(lens.camera, known, factor)
    if plate_exact:
        return TargetSet(plate), cameras
    return TargetSet(plate, [within, within, 0.0], factor * plate.scale_sigma), cameras
