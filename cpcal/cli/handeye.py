"""`cpcal handeye`: a study, how accurate its calibration can be, and legs in the robot's own frames."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cpcal.cli.options import Status, Talk, check_new, check_writable, output_path, talking
from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.files import listed
from cpcal.common.numbers import at_least, at_most, bracket_text, nearest, rounded_down, rounded_up
from cpcal.files import load_study
from cpcal.files.run_folder import HANDEYE, HANDEYE_WRONG, answers_into, check_replaceable
from cpcal.handeye.certify import (
    GAP,
    HandEyeResult,
    Within,
    certify_hand_eye,
    load_hand_eye_result,
    save_hand_eye_result,
)
from cpcal.handeye.files import hand_eye_files, load_hand_eye, load_hand_poses, save_hand_eye
from cpcal.handeye.next_images import ChosenPose, next_poses
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
from cpcal.handeye.words import names_of, sentences, wrong_sentences
from cpcal.handeye.wrong_images import find_wrong_images, save_wrong_images
from cpcal.questions import load_result
from cpcal.questions.legs_in_frames import JOINTS, legs_in_frames
from cpcal.report.hand_eye_page import HAND_EYE_PAGE, WRONG_PAGE, write_hand_eye, write_wrong_images
from cpcal.vision.files.plate_and_camera import load_camera, load_target

# ------------------------------------------------------------------------------------------------------------------
# `cpcal handeye-study`: a hand-eye study from photographs, from pairs of poses, or simulated.


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


# ------------------------------------------------------------------------------------------------------------------
# `cpcal handeye`: how accurate a hand-eye calibration can be. For exit statuses see `cpcal.cli`.


@talking
def hand_eye(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY", help="Folder of handeye.toml, a camera file, poses.csv, points.csv.")
    ],
    folder: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", parser=output_path, help="Folder for the run; replaced there."),
    ],
    within: Annotated[
        str,
        typer.Option(metavar="DEG,MM", help="Search within these of the classical answer; 'any' for all rotations."),
    ] = "any,2000",
    tolerance: Annotated[
        float | None, typer.Option(metavar="PX", help="Largest error allowed.", show_default="ranges at 1.1 eps*")
    ] = None,
    images: Annotated[
        str | None, typer.Option(metavar="A,B", help="Names of the images to use.", show_default="all")
    ] = None,
    gap: Annotated[float, typer.Option(help="Relative width of the bracket that is asked for.")] = GAP,
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds for each proof, at most.")] = None,
    *,
    talk: Talk,
) -> None:
    """How well can any camera and target frames explain the pixels of a STUDY, and how well are the frames known?

    The least possible largest error eps* in pixels is bracketed: proved from below by a certificate, attained
    from above by frames that are checked in exact arithmetic. Then come ranges of all frames that are nearly as good.
    """
    check_writable(folder)
    check_replaceable(folder, HANDEYE)
    loaded = _chosen(load_hand_eye(study), images)
    with answers_into(folder, HANDEYE) as draft:
        for name, content in hand_eye_files(loaded).items():
            (draft / name).write_bytes(content)
        found = certify_hand_eye(
            loaded,
            within=Within.parsed(within),
            tolerance=tolerance,
            gap=gap,
            certificates=draft,
            time_limit=np.inf if time_limit is None else time_limit,
            tell=talk.progress(),
        )
        save_hand_eye_result(found, draft)
        write_hand_eye(found, draft)
    _show(talk.out, found)
    talk.say(f"Page: {folder / HAND_EYE_PAGE}")
    raise typer.Exit(_status(found))


def _chosen(study: HandEyeStudy, images: str | None) -> HandEyeStudy:
    if images is None:
        return study
    names = [name.strip() for name in images.split(",")]
    strange = [name for name in names if name not in study.images]
    if strange or len(set(names)) < len(names):
        what = f"names {strange[0]!r:.60}, which is no image" if strange else "names an image twice"
        raise InputError([Problem("option --images", what, "give names of poses.csv, each once, by commas")])
    return study.part(np.array([study.images.index(name) for name in names], dtype=np.intp))


def _show(console: Console, found: HandEyeResult) -> None:
    for text in sentences(found):
        console.print(printable(text), soft_wrap=not console.is_terminal)
    if found.ranges.empty:
        return
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in ("parameter", "at least", "at most", "unit"):
        table.add_column(name, justify="right" if name.startswith("at") else "left")
    ends = zip(found.ranges.low, found.ranges.high, strict=True)
    for (name, unit), (low, high) in zip(names_of(found.setup), ends, strict=True):
        table.add_row(name, rounded_down(low, 3), rounded_up(high, 3), unit)
    console.print(table)


def _status(found: HandEyeResult) -> Status:
    if found.tolerance is not None:
        return Status.ANSWERED if found.passes else Status.UNKNOWN
    return Status.ANSWERED if found.complete else Status.UNKNOWN


# ------------------------------------------------------------------------------------------------------------------
# `cpcal handeye-legs`: joints of certified legs in the robot's own frames. For exit statuses see `cpcal.cli`.


@talking
def hand_eye_legs(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Of cpcal certify, with --tolerance.")],
    frames: Annotated[Path, typer.Option(metavar="RUN", help="Of cpcal handeye: camera and target of that robot.")],
    *,
    talk: Talk,
) -> None:
    """Joints of the legs in the frames of base and platform, for all frames in the ranges of a hand-eye run.

    The campaign must be in the frames of camera and target, as `cpcal calibrate` makes it: eps* of a leg then needs no
    frames. Proved, if `cpcal verify` accepts both runs; the camera is taken as exact.
    """
    known = load_hand_eye_result(frames)
    found = legs_in_frames(load_result(run), known)
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in ("leg", "eps* [mm]", "joint", "at least", "at most", "width"):
        table.add_column(name, justify="left" if name == "joint" else "right")
    for leg in found:
        low, high = bracket_text(leg.eps_lo, leg.eps_hi)
        for k, (name, a, b) in enumerate(zip(JOINTS, leg.low, leg.high, strict=True)):
            first = (str(leg.leg), f"[{low}, {high}]") if not k else ("", "")
            table.add_row(*first, name, rounded_down(a, 3), rounded_up(b, 3), at_most(b - a, 3))
    talk.out.print(table)
    talk.say(
        f"For every pair of frames that explains the pixels to {at_least(known.ranges.eps, 4)} px, and all parameters "
        f"of a leg at its tolerance ({', '.join(sorted({at_least(leg.eps, 4) for leg in found}))} mm). Base in the "
        "drawing's base frame, mobile in its mobile frame."
    )


# ------------------------------------------------------------------------------------------------------------------
# `cpcal handeye-next`: which poses to measure next. For exit statuses see `cpcal.cli`.


@talking
def hand_eye_next(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY", help="Folder of handeye.toml, a camera file, poses.csv, points.csv.")
    ],
    poses: Annotated[
        Path, typer.Option(metavar="CSV", help="Poses that the robot can reach: image,x,y,z,qw,qx,qy,qz.")
    ],
    count: Annotated[int, typer.Option(metavar="N", help="How many to choose.")] = 3,
    tolerance: Annotated[
        float | None, typer.Option(metavar="PX", help="Largest error of the ranges.", show_default="1.1 eps*")
    ] = None,
    *,
    talk: Talk,
) -> None:
    """Choose the poses whose images would shrink the widest range of a STUDY most, one after another.

    The widths are first-order estimates about the best frames, not proofs: certify again when the images are there.
    """
    found = next_poses(load_hand_eye(study), load_hand_poses(poses), count, tolerance=tolerance, tell=talk.progress())
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    table.add_column("pose")
    for name in ("camera mm", "camera deg", "target mm", "target deg", "widest mm"):
        table.add_column(name, justify="right")
    for label, one in (("so far", found.before), *((f"+ {one.name}", one) for one in found.chosen)):
        table.add_row(label, *_widths(one), nearest(one.widest, 3))
    talk.out.print(table)
    talk.say(
        f"Widths of ranges at {nearest(found.tolerance, 4)} px: first-order estimates, with each pose and those above "
        f"it. The widest counts a turn as what it moves at {nearest(found.reach, 3)} mm."
    )
    if found.unseen:
        talk.say(f"The camera would not see the whole target from {len(found.unseen)} poses: {listed(found.unseen)}.")


def _widths(one: ChosenPose) -> list[str]:
    return [nearest(max(one.widths[k : k + 3]), 3) for k in (0, 3, 6, 9)]


# ------------------------------------------------------------------------------------------------------------------
# `cpcal handeye-wrong`: which images are wrong. For exit statuses see `cpcal.cli`.


@talking
def wrong_images(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY", help="Folder of handeye.toml, a camera file, poses.csv, points.csv.")
    ],
    folder: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", parser=output_path, help="Folder for the run; replaced there."),
    ],
    outliers: Annotated[int, typer.Option(metavar="N", help="Images that may be wrong, at most.")] = 1,
    within: Annotated[
        str,
        typer.Option(metavar="DEG,MM", help="Search within these of the trimmed fit; 'any' for all rotations."),
    ] = "any,2000",
    tolerance: Annotated[
        float | None, typer.Option(metavar="PX", help="Largest error of right images.", show_default="1.1 eps*")
    ] = None,
    *,
    talk: Talk,
) -> None:
    """Bracket the least largest error of a STUDY when some images may be wrong, and prove which ones are.

    A wrong image has a slipped board, a wrong robot pose, a wrong name. Nobody needs to know which.
    """
    check_writable(folder)
    check_replaceable(folder, HANDEYE_WRONG)
    loaded = load_hand_eye(study)
    with answers_into(folder, HANDEYE_WRONG) as draft:
        for name, content in hand_eye_files(loaded).items():
            (draft / name).write_bytes(content)
        found = find_wrong_images(
            loaded,
            outliers,
            draft,
            within=Within.parsed(within),
            tolerance=tolerance,
            tell=talk.progress(),
        )
        save_wrong_images(found, draft)
        write_wrong_images(loaded, found, draft)
    for text in wrong_sentences(found):
        talk.say(text)
    talk.say(f"Page: {folder / WRONG_PAGE}")
    raise typer.Exit(Status.ANSWERED if found.eps_lo > 0.0 else Status.UNKNOWN)
