"""`cpcal handeye-study`: a hand-eye study from photographs, from pairs of poses, or simulated."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from cpcal.cli.folders import check_new, output_path
from cpcal.common.errors import InputError, Problem, printable
from cpcal.files import load_study
from cpcal.handeye.files import load_hand_poses, save_hand_eye
from cpcal.handeye.sources import (
    REMEDY,
    TARGET,
    PrintedBoard,
    platform_poses,
    read_pose_pairs,
    study_of_pairs,
    study_of_photos,
    study_of_robot,
    study_of_target_photos,
    with_half_widths,
)
from cpcal.handeye.study import HandEyeStudy, Setup, simulate_hand_eye
from cpcal.vision.files.plate_and_camera import load_camera, load_target


class SetupName(StrEnum):
    HAND = "eye-in-hand"
    BASE = "eye-to-hand"


def hand_eye_study(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", parser=output_path, help="Folder for the study.")
    ],
    setup: Annotated[SetupName, typer.Option(help="Where the camera is.")] = SetupName.HAND,
    photos: Annotated[Path | None, typer.Option(metavar="DIR", help="Photographs of a board.")] = None,
    board: Annotated[str | None, typer.Option(metavar="BOARD", help=REMEDY.replace("write ", "Write ") + ".")] = None,
    camera: Annotated[Path | None, typer.Option(metavar="FILE", help="Of the photographs.")] = None,
    poses: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Of the photographs: image,x,y,z,qw,qx,qy,qz; no suffixes.")
    ] = None,
    pairs: Annotated[
        Path | None, typer.Option(metavar="YAML", help="Pairs of poses: MoveIt's samples, OpenCV's lists, ROS.")
    ] = None,
    millimetres: Annotated[bool, typer.Option("--mm", help="Translations of --pairs are in mm, not m.")] = False,
    robot: Annotated[
        Path | None,
        typer.Option(metavar="STUDY", help="A parallel robot's study: its drawing and legs say where the platform is."),
    ] = None,
    off: Annotated[
        str | None, typer.Option(metavar="MM,DEG", help="How far each pose of the robot may be off, on each axis.")
    ] = None,
    size: Annotated[float, typer.Option(metavar="MM", help="Of the square that stands in for a marker.")] = 100.0,
    simulated: Annotated[int | None, typer.Option("--simulate", metavar="N", help="Simulate N images.")] = None,
    pixel_error: Annotated[float, typer.Option(metavar="PX", help="With --simulate: at most, on each axis.")] = 0.2,
    position_error: Annotated[float, typer.Option(metavar="MM", help="With --simulate: of the robot.")] = 0.0,
    rotation_error: Annotated[float, typer.Option(metavar="DEG", help="With --simulate: of the robot.")] = 0.0,
    seed: Annotated[int, typer.Option(help="With --simulate.")] = 1,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that holds something.")] = False,
) -> None:
    """Make a study for `cpcal handeye`: from --photos of a board, from --pairs of poses, or with --simulate.

    With --robot the poses are those of a parallel robot's platform, as its drawing has them; its photographs are named
    POSE/RUN or POSE/RUN/IMAGE, and without --photos the poses that its camera saw stand in for them.
    """
    sources = [bool(photos or robot), bool(pairs), simulated is not None]
    if sum(sources) != 1:
        remedy = "give --photos, --pairs, --simulate N, or --robot with or without --photos"
        raise InputError([Problem("handeye-study", "needs one source", remedy)])
    check_new(output, force=force)
    left: list[str] = []
    if photos is not None:
        study, left = _of_photos(photos, board, camera, poses, robot, setup.value)
    elif robot is not None:
        study = study_of_robot(load_study(robot))
    elif pairs is not None:
        hand, seen = read_pose_pairs(pairs, setup=setup.value, metres=not millimetres)
        study = study_of_pairs(hand, seen, setup=setup.value, size=size)
    else:
        study = _simulated(simulated or 0, setup.value, pixel_error, position_error, rotation_error, seed)
    if off is not None:
        study = with_half_widths(study, off)
    save_hand_eye(study, output)
    for text in left:
        typer.echo(printable(f"left out: {text}"))
    typer.echo(printable(f"{study.setup}: {len(study.images)} images, {len(study.image):,} points in {output}"))


def _simulated(images: int, setup: Setup, pixel: float, position: float, rotation: float, seed: int) -> HandEyeStudy:
    if not 3 <= images <= 1000:
        raise InputError([Problem("option --simulate", f"is {images}", "give a number of images from 3 to 1000")])
    return simulate_hand_eye(
        setup=setup,
        images=images,
        pixel_error=pixel,
        position_error=position,
        rotation_error=float(np.radians(rotation)),
        seed=seed,
    ).study


_TURNED = (
    "photographs in which it is turned by more than a right angle have their points exchanged. Take one even and one "
    "odd count of inner corners, or ChArUco"
)


def _of_photos(
    photos: Path, board: str | None, camera: Path | None, poses: Path | None, robot: Path | None, setup: Setup
) -> tuple[HandEyeStudy, list[str]]:
    if board is None or camera is None or (poses is None) == (robot is None):
        remedy = "give --board, --camera and --poses (or --robot) too"
        raise InputError([Problem("option --photos", "is not enough", remedy)])
    if poses is not None:
        given = load_hand_poses(poses)
    else:
        assert robot is not None
        given, setup = platform_poses(load_study(robot)), "eye-to-hand"
    if board.startswith(TARGET):
        target = load_target(board.removeprefix(TARGET))
        return study_of_target_photos(photos, target, camera=load_camera(camera).camera, poses=given, setup=setup)
    printed = PrintedBoard.parsed(board)
    if printed.looks_the_same_turned:
        typer.echo(f"warning: the board {printable(board)} looks the same upside down: {_TURNED}", err=True)
    return study_of_photos(photos, printed, camera=load_camera(camera).camera, poses=given, setup=setup)
