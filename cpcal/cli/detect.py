"""`cpcal detect`: from a folder of images to a table of poses; or, with --calibrate, to a camera."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from cpcal.cli.folders import check_writable, made
from cpcal.cli.progress import bar
from cpcal.cli.talk import Talk, record, talking
from cpcal.common.errors import InputError, Problem
from cpcal.common.files import listed, write_file
from cpcal.files.settings import table_bytes
from cpcal.report.detections_page import write_detections_page
from cpcal.solver.execution.stopping import heard
from cpcal.vision.batch.detect import Detections, ImageFolder, ImageSource, detect
from cpcal.vision.batch.study_images import RenderedImages, look_again, study_table
from cpcal.vision.calibration import calibrate_from_images
from cpcal.vision.files.detection import (
    SCALE,
    SHARED,
    Detection,
    Readings,
    by_reason,
    detections_bytes,
    load_readings,
    values_of,
)
from cpcal.vision.files.image_file import image_path
from cpcal.vision.files.plate_and_camera import CameraRecord, load_camera, load_target, save_camera, save_target
from cpcal.vision.target import Target

_NAMED = 3  # files for each reason


@talking
def detect_poses(
    images: Annotated[Path, typer.Argument(metavar="IMAGES", help="Folder of PNG, JPEG or TIFF files, and below.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="What to write: poses.csv, or camera.toml.")
    ],
    target: Annotated[Path, typer.Option(metavar="FILE", help="The target's dots: target.toml.")],
    camera: Annotated[Path | None, typer.Option(metavar="FILE", help="The camera: camera.toml.")] = None,
    readings: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Leg readings pose,run,L1,...,Ln of images named POSE/RUN/IMAGE.png."),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="With --readings: the table of a study to write, such as calibration.csv."),
    ] = None,
    overlays: Annotated[
        Path | None,
        typer.Option("--overlay", metavar="DIR", help="Pictures of what was found, and why not."),
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes [default: one a core]")] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler of a cluster, instead; its workers read IMAGES."),
    ] = None,
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="The camera from IMAGES, instead of poses; FILE is a camera.toml.")
    ] = False,
    refine_dots: Annotated[
        bool, typer.Option("--refine-dots", help="With --calibrate: the places of the dots on the plate, too.")
    ] = False,
    *,
    talk: Talk,
) -> None:
    """Poses of a target in IMAGES. An image that shows none is a row with the reason, and stops no other.

    What is done is kept in FILE.journal: the same command, again, measures only images that are new. Ctrl-C loses
    nothing. The table is the same, byte for byte, whatever the number of workers. FILE.html is a page: counts, some
    images with what was found, where residuals point, where time went.
    """
    _check(images, camera, readings, table, calibrate, refine_dots)
    for file in (output, *([table] if table else [])):
        check_writable(file.absolute().parent)
    if camera is None:
        _calibrate(images, load_target(target), output, refine_dots, talk)
        return
    plate, lens_file, known = _loaded(target, camera, readings)
    made(output.absolute().parent)
    source = ImageFolder(images, (lens_file.camera.width, lens_file.camera.height))
    with heard(terminate=True), bar("images", quiet=talk.quiet) as progress:
        found = detect(
            source,
            plate,
            lens_file.camera,
            lens_file.covariance,
            journal=output.with_name(f"{output.name}.journal"),
            workers=workers,
            scheduler=scheduler,
            progress=progress,
            overlays=overlays,
        )
    _write(found, source, plate, lens_file, output, talk)
    if known is not None and table is not None:
        _write_table(found, known, table, talk)


def _write(found: Detections, source: ImageSource, plate: Target, lens: CameraRecord, output: Path, talk: Talk) -> None:
    """The table first, then the page, for which some images are measured again."""
    write_file(output, detections_bytes(found.rows))
    show_detections(found, output, talk)
    sample = look_again(found.rows, source, plate, lens.camera, lens.covariance)
    talk.say(f"Page: {write_detections_page(found, sample, plate, lens.camera, output)}")


def _write_table(found: Detections, known: Readings, table: Path, talk: Talk) -> None:
    made(table.absolute().parent)
    write_file(table, table_bytes(study_table(found.rows, known)))
    talk.say(f"Table of a study: {table}")


def _loaded(target: Path, camera: Path, readings: Path | None) -> tuple[Target, CameraRecord, Readings | None]:
    """What the files say. Raises one InputError with every problem of all."""
    found: list[Any] = []
    problems: list[Problem] = []
    for load, path in ((load_target, target), (load_camera, camera), (load_readings, readings)):
        try:
            found.append(None if path is None else load(path))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    plate, lens_file, known = found
    return plate, lens_file, known


def show_detections(found: Detections, where: Path, talk: Talk) -> None:
    """Counts, and each reason with some files, or with all."""
    poses = sum(row.found for row in found.rows)
    record("images", images=len(found.rows), poses=poses, measured=found.measured)
    work = sum(seconds for stage, seconds in found.seconds.items() if stage != RenderedImages.stage)
    pace = f"; {found.measured / work:.0f} images a second of work" if work > 0.0 else ""
    talk.say(f"{poses:,} poses in {len(found.rows):,} images ({found.measured:,} measured now{pace}): {where}")
    _say_shared(found.rows, talk)
    doubtful = [row for row in found.rows if row.doubt]
    if doubtful:
        worst = max(doubtful, key=lambda row: row.values[SCALE])
        talk.say(f"  {len(doubtful):,} of the poses are doubtful; {worst.file}: {worst.doubt}")
    for reason, files in by_reason(found.rows).items():
        talk.say(f"  {len(files):,} x {reason}: {listed(files, len(files) if talk.verbose else _NAMED)}")


def _say_shared(rows: Sequence[Detection], talk: Talk) -> None:
    """What the camera's and the plate's errors make, where they are stated: no mean over images lessens it."""
    shared = values_of(rows)[:, SHARED]
    if len(shared) and shared.any():
        position, turn = (float(np.median(shared[:, part].max(axis=1))) for part in (slice(0, 3), slice(3, 6)))
        talk.say(
            f"  errors that all images share (camera, plate): standard deviations of {position:.4f} mm and "
            f"{turn:.6f} rad (medians); no mean lessens them"
        )


def _calibrate(images: Path, plate: Target, output: Path, refine_dots: bool, talk: Talk) -> None:
    """The camera; with refined dots also the target that was found, beside it."""
    files = [image_path(images, name) for name in ImageFolder(images).names]
    found = calibrate_from_images(files, plate, refine_dots=refine_dots)
    save_camera(found.record(), output)
    for line in str(found).split("\n"):
        talk.say(line)
    for view in found.views:
        if not view.reason:
            talk.say(f"  {view.name}: {view.used.sum()} dots, RMS {view.rms:.4f} px per axis")
    talk.say(f"Camera: {output}")
    if refine_dots:
        refined = output.with_name("refined-target.toml")
        save_target(found.target, refined)
        talk.say(f"Target as it was seen: {refined}")


def _check(
    images: Path, camera: Path | None, readings: Path | None, table: Path | None, calibrate: bool, refine_dots: bool
) -> None:
    """InputError for options that do not go together, and for a folder without images."""
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
