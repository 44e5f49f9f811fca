"""`cpcal pose-sets`: from images to boxes of poses that are proved, with certificates."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from cpcal.cli.folders import check_target, output_path
from cpcal.cli.progress import bar
from cpcal.cli.talk import Talk, record, talking
from cpcal.cli.verify_pose_sets import NUMBERS, TABLE, say_assumptions
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import at_most
from cpcal.files.run_folder import POSE_SETS, answers_into
from cpcal.files.tables import file_cell, guarded
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.stopping import heard
from cpcal.vision.batch.detect import ImageFolder, in_parallel
from cpcal.vision.batch.enclose import Enclosed, Enclosing, stem_of
from cpcal.vision.files.plate_and_camera import CameraRecord, load_camera, load_target
from cpcal.vision.pose_sets import CameraSet, TargetSet
from cpcal.vision.target import Target

_COLUMNS = ("file", "verdict", *NUMBERS, "reason")
_TOLD = 5  # images by name


@talking
def pose_sets(
    images: Annotated[Path, typer.Argument(metavar="IMAGES", help="Folder of PNG, JPEG or TIFF files, and below.")],
    folder: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", parser=output_path, help="Folder for certificates; replaced."),
    ],
    target: Annotated[Path, typer.Option(metavar="FILE", help="The target's dots: target.toml.")],
    camera: Annotated[Path, typer.Option(metavar="FILE", help="The camera: camera.toml.")],
    half_width: Annotated[
        float, typer.Option(metavar="PX", min=0.0, help="How far the centre of a dot's image is off, at most.")
    ] = 0.05,
    factor: Annotated[
        float,
        typer.Option(
            min=0.1,
            help="The camera is within so many standard deviations: the ellipsoid of its file's covariance. 5 holds "
            "99.7 % of all calibrations. The plate's scale_sigma and dot_sigma count as many times.",
        ),
    ] = 5.0,
    camera_exact: Annotated[
        bool, typer.Option("--camera-exact", help="Assume that the camera is exactly as its file says.")
    ] = False,
    plate_exact: Annotated[
        bool, typer.Option("--plate-exact", help="Assume that the plate is exactly as its file says.")
    ] = False,
    dots: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            min=0.0,
            help="How far a dot is off its place in the plate along an axis, at most.",
            show_default="--factor times dot_sigma",
        ),
    ] = None,
    outliers: Annotated[int, typer.Option(min=0, max=3, help="Dots of an image that may be anywhere, at most.")] = 0,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes [default: one a core]")] = None,
    *,
    talk: Talk,
) -> None:
    """Boxes that are PROVED to hold the pose in each of IMAGES, with certificates from the pixels on.

    It is proved if what is stated is true: camera, plate and pixels are no farther off than files and options say. A
    camera without covariance, or a plate without deviations, is exact only if you say so.
    """
    check_target(folder, POSE_SETS)
    plate, lens = load_target(target), load_camera(camera)
    plates, cameras = _stated(plate, lens, None if plate_exact else dots, factor, plate_exact, camera_exact)
    source = ImageFolder(images, (lens.camera.width, lens.camera.height))
    names = list(source.names)
    _check_names(names, images)
    sources = {path.name: path.read_bytes() for path in (camera, target)}
    found: list[Enclosed] = []
    with heard(terminate=True), answers_into(folder, POSE_SETS) as draft, bar("images", quiet=talk.quiet) as progress:
        work = Enclosing(
            source,
            plates,
            cameras,
            half_width,
            outliers,
            draft,
            sources,
        )
        for some in in_parallel(work, names, workers):
            found += some
            if progress is not None:
                progress(len(found), len(names))
        found.sort(key=lambda one: one.file)
        (draft / TABLE).write_text(_table(found), encoding="utf-8")
    _say(found, folder, talk)
    say_assumptions(folder, talk)
    if not any(one.found is not None and one.found.verdict is Verdict.PROVED for one in found):
        raise typer.Exit(1)


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
        problems.append(Problem("the camera", what, "calibrate with `cpcal detect --calibrate`, or say --camera-exact"))
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
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for one in rows:
        numbers, verdict, reason = [""] * 13, "unknown", one.reason or one.not_certified
        if one.not_certified:  # then no number stands here: nothing that a checker can look at holds it
            verdict = "not certified"
        elif one.found is not None:
            found, verdict = one.found, one.found.verdict.value
            reason = reason or found.reason
            if found.pose is not None and found.position_radius is not None and found.rotation_radius is not None:
                parts = (found.pose.position, found.pose.quaternion, found.position_radius, found.rotation_radius)
                numbers = [repr(value) for value in np.concatenate(parts).tolist()]
        writer.writerow([file_cell(one.file), verdict, *numbers, guarded(reason)])
    return buffer.getvalue()


def _say(rows: Sequence[Enclosed], folder: Path, talk: Talk) -> None:
    sets = [one.found for one in rows if one.found is not None]
    proved, refuted, unknown = (
        [one for one in sets if one.verdict is verdict]
        for verdict in (Verdict.PROVED, Verdict.REFUTED, Verdict.UNKNOWN)
    )
    talk.say(
        f"{len(rows)} images: {len(proved)} poses enclosed, {len(refuted)} refuted (no pose shows the dots "
        f"so), both proved; {len(unknown)} unknown, {len(rows) - len(sets)} not measured."
    )
    for one in [one for one in rows if one.reason or one.not_certified][:_TOLD]:
        talk.say(f"  {one.file}: {one.reason or f'NOT CERTIFIED, {one.not_certified}'}")
    if proved:
        position = np.median([one.position_radius for one in proved], axis=0)
        turn = np.degrees(np.median([one.rotation_radius for one in proved], axis=0))
        sides = " x ".join(at_most(float(v), 2) for v in position), " x ".join(at_most(float(v), 2) for v in turn)
        talk.say(f"Half-widths, median: {sides[0]} mm, {sides[1]} degrees. Table: {folder / TABLE}")
    talk.say(f"Certificates: cpcal verify {folder}")
    record("enclosed", images=len(rows), proved=len(proved), output=str(folder))
