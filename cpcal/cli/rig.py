"""`cpcal rig`: where the cameras of a rig are; or, with --rig, poses of the plate from all of them together."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from cpcal.cli.folders import check_writable
from cpcal.cli.progress import bar
from cpcal.cli.talk import Talk, record, talking
from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import nearest
from cpcal.execution.stopping import heard
from cpcal.vision.batch.rig_images import RigImages, SeenMoment, rig_detections, seen_moments
from cpcal.vision.camera import Camera
from cpcal.vision.files.camera_file import YAML_SUFFIXES, CameraRecord, load_camera
from cpcal.vision.files.detection import by_reason, detections_bytes
from cpcal.vision.files.rig_file import load_rig, save_rig
from cpcal.vision.files.target_file import load_target
from cpcal.vision.rig.calibrate_rig import FoundRig, calibrate_rig
from cpcal.vision.rig.rig import EACH
from cpcal.vision.target import Target


@talking
def rig(
    images: Annotated[
        Path, typer.Argument(metavar="IMAGES", help="Folder with a folder for each camera; one moment, one name.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="What to write: rig.toml, or poses.csv.")
    ],
    target: Annotated[Path, typer.Option(metavar="FILE", help="The target's dots: target.toml.")],
    cameras: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Finds the rig: NAME.toml of each camera, named as its folder of images."),
    ] = None,
    known: Annotated[
        Path | None, typer.Option("--rig", metavar="FILE", help="Finds poses: the rig.toml found before.")
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes [default: one a core]")] = None,
    *,
    talk: Talk,
) -> None:
    """Several cameras that stand still to each other, from images taken at the same moments.

    With --cameras: where they are, in the frame of the first by name, from moments at which two or more see the plate.
    With --rig: a table of the plate's poses in that frame, each from all cameras that see it.
    """
    if (cameras is None) == (known is None):
        raise InputError([Problem("options", "give either --cameras or --rig", "--cameras first, --rig afterwards")])
    check_writable(output.absolute().parent)
    plate = load_target(target)
    if known is not None:
        placed = load_rig(known)
        moments = _looked(images, dict(zip(placed.names, placed.cameras, strict=True)), plate, workers, talk)
        rows = list(rig_detections(moments, placed, plate))
        write_file(output, detections_bytes(rows))
        record("images", images=len(rows), poses=sum(row.found for row in rows))
        talk.say(f"{sum(row.found for row in rows):,} poses at {len(rows):,} moments: {output}")
        for reason, names in by_reason(rows).items():
            talk.say(f"  {len(names):,} x {reason}: {', '.join(names[:3])}")
        return
    assert cameras is not None
    records = _records(cameras, images)
    moments = _looked(images, {name: one.camera for name, one in records.items()}, plate, workers, talk)
    found = calibrate_rig(records, [moment.plates for moment in moments], plate)
    save_rig(found.rig, output)
    _say(found, len(moments), output, talk)


def _looked(
    images: Path, cameras: dict[str, Camera], plate: Target, workers: int | None, talk: Talk
) -> list[SeenMoment]:
    missing = [name for name in cameras if not (images / name).is_dir()]
    if missing:
        what = f"has no folder {', '.join(missing)}"
        raise InputError([Problem(str(images), what, "give a folder of images for each camera")])
    with heard(terminate=True), bar("moments", quiet=talk.quiet) as progress:
        return seen_moments(RigImages(images, cameras), plate, workers, progress)


def _records(folder: Path, images: Path) -> dict[str, CameraRecord]:
    files = sorted(file for file in folder.glob("*") if file.suffix in (".toml", *YAML_SUFFIXES))
    records = {file.stem: load_camera(file) for file in files if (images / file.stem).is_dir()}
    if len(records) < 2:
        what = f"holds {len(records)} cameras named like folders of {images}: two or more are needed"
        raise InputError([Problem(str(folder), what, "name cameras NAME.toml and folders of images NAME")])
    return records


def _say(found: FoundRig, moments: int, output: Path, talk: Talk) -> None:
    rig = found.rig
    record("rig", cameras=len(rig.names), moments=found.moments)
    talk.say(f"{found.moments} of {moments} moments are seen by two cameras or more")
    for k, name in enumerate(rig.names[1:], start=1):
        sigma = np.sqrt(np.diagonal(rig.covariance)[EACH * k : EACH * k + 6])
        at = ", ".join(nearest(float(x), 3) for x in rig.origin(k))
        place, turn = nearest(float(sigma[:3].max()), 4), nearest(float(sigma[3:].max()), 6)
        apart = f"standard deviations {place} mm and {turn} rad"
        talk.say(f"  {name} is at ({at}) mm in the frame of {rig.names[0]}; {apart}")
    if found.scale > 2.0:
        talk.say(
            f"  doubtful: the residuals are {nearest(float(np.sqrt(found.scale)), 1)} times as large as stated: "
            "check the cameras' calibrations, and whether images of one name were taken at one moment"
        )
    talk.say(f"Rig: {output}")
