"""Hand-eye studies from what people have: photographs of a target, pairs of poses, a parallel robot's own study."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.errors import InputError, unusable
from cpcal.common.numbers import at_most, nearest, stated
from cpcal.common.values import ArrayPair, Floats, Names, Numbers
from cpcal.models.hand_eye import SETUPS, HandEyeStudy, Setup, by_name, study_of_board
from cpcal.models.hand_eye_fit import classical_answer, estimated_half_widths
from cpcal.robot import (
    Pose,
    Study,
    central_pose,
    forward_kinematics,
    inverse,
    normalised,
    quaternion_from_matrix,
    transformed,
)
from cpcal.vision.camera import Camera
from cpcal.vision.files.image_file import image_files, image_path, read_image
from cpcal.vision.files.plate_and_camera import yaml_document
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.projection import predicted_centers
from cpcal.vision.target import Target


def photo_names(folder: Path) -> list[str]:
    """The photographs in a folder as a table without names means them: image2 before image10."""

    def key(name: str) -> list[tuple[str, int]]:
        parts = re.split("([0-9]+)", name)
        return [(part, 0) if k % 2 == 0 else ("", int(part)) for k, part in enumerate(parts)]

    return sorted(image_files(folder), key=key)


def study_of_photos(
    folder: Path,
    target: Target,
    *,
    camera: Camera,
    poses: dict[str, Numbers],
    setup: Setup,
    first_row: str | Pose = "",
) -> tuple[HandEyeStudy, list[str]]:
    """A study of the photographs of a target in a folder, and what was left out, in sentences.

    poses      by the name of each photograph, with or without its suffix: x, y, z, qw, qx, qy, qz of the hand in the
               base, mm
    first_row  how a target is turned that looks the same when it is (`measure_pose`)

    A photograph in a folder below goes by its path, as "folder/name", if its name alone has no pose. An outline's
    centre is not the image of the dot's centre; the difference at the pose that the image shows is taken off.

    Raises InputError where no photograph has both a pose and a target, UnreadableImageError, MissingExtraError.
    """
    seen = []
    left = []
    for name in image_files(folder):
        whole = Path(name)
        names = (whole.stem, whole.name, whole.with_suffix("").as_posix(), name)
        stem = next((key for key in names if key in poses), None)
        if stem is None:
            left.append(f"{name} has no pose")
            continue
        image = read_image(image_path(folder, name), (camera.width, camera.height))
        try:
            found = measure_pose(image, target, camera, first_row=first_row)
        except NotMeasured as reason:
            left.append(f"{name}: {reason}")
            continue
        bias = predicted_centers(target, camera, found.pose) - camera.project(transformed(found.pose, target.points))
        seen.append((stem, found.numbers, found.centers - bias[found.numbers]))
    if not seen:
        what = "holds no photograph with a pose and the board: " + "; ".join(left[:3] or ["no file is an image"])
        raise unusable(str(folder), what, "check the board, the poses' names, the camera's size")
    given = np.array([poses[stem] for stem, *_ in seen])
    study = HandEyeStudy(
        setup=setup,
        camera=camera,
        images=tuple(stem.replace("/", "-") for stem, *_ in seen),
        poses=Pose(given[:, :3], given[:, 3:]),
        image=np.concatenate([np.full(len(numbers), k) for k, (_, numbers, _) in enumerate(seen)]),
        names=tuple(f"d{n}" for _, numbers, _ in seen for n in numbers.tolist()),
        pixels=np.concatenate([pixels for *_, pixels in seen]),
        points=np.concatenate([target.points[numbers] for _, numbers, _ in seen]),
    )
    return study, left


_BETTER = 3.0  # times smaller, to say so


def other_direction(study: HandEyeStudy) -> list[str]:
    """In a sentence, that poses read in the other direction, base in hand, fit far better; else nothing. A camera on
    the hand and one beside it differ in no other way, so pixels cannot tell which of the two it is."""

    def left(poses: Pose) -> float:
        try:
            return classical_answer(replace(study, poses=poses, pose_half_width=np.zeros(0))).rms
        except InputError:
            return np.inf

    as_stated, back = left(study.poses), left(inverse(study.poses))
    if not _BETTER * back < as_stated:
        return []
    other = next(setup for setup in SETUPS if setup != study.setup)
    so = f"leave {nearest(as_stated, 3)} px rms" if np.isfinite(as_stated) else "fit no frames"
    return [
        f"The poses {so}, and {nearest(back, 3)} px if they are read as base in hand: either they are "
        f"(--base-in-hand), or the camera is {_WHERE[other]} (--setup {other}); pixels cannot tell which of the two."
    ]


_WHERE = {"eye-in-hand": "on the hand", "eye-to-hand": "beside the robot"}


# ------------------------------------------------------------------------------------------------------------------
# The hand-eye study of a parallel robot's own study: its drawing and leg readings say where the platform is.
#
# The mobile frame is the hand: the camera stands beside the robot, the target is on the platform. The poses come from
# the drawing, whose errors they have; half-widths say how large these may be. The camera is taken as exact.


def platform_poses(study: Study) -> dict[str, Numbers]:
    """By row of the calibration table (`pose/run`, or `pose/run/image`) the mobile frame in the base frame.

    x, y, z in mm, then a unit quaternion, scalar first. Raises KinematicsError where the drawing cannot reach readings.
    """
    return by_name(study.calibration.row_ids, _poses(study))


def _poses(study: Study) -> Pose:
    readings = study.calibration.length
    return forward_kinematics(study.robot, readings, central_pose(study.robot, readings.mean(axis=0)))


def study_of_robot(study: Study) -> HandEyeStudy:
    """Of the poses that the camera saw: one row of the calibration table for each configuration, its first.

    Raises KinematicsError, and InputError as `study_of_pairs` does.
    """
    table = study.calibration
    chosen = np.sort(np.unique(table.pose, return_index=True)[1])
    return study_of_pairs(
        _poses(study).rows(chosen),
        Pose(table.position[chosen], table.quaternion[chosen]),
        setup="eye-to-hand",
        names=tuple(table.row_ids[k].replace("/", "-") for k in chosen),
    )


def with_half_widths(study: HandEyeStudy, text: str) -> HandEyeStudy:
    """Every pose uncertain by `MM,DEG` on each axis, or by what the data tell ("estimated"). Raises InputError."""
    if text == "estimated":
        try:
            position, turn = estimated_half_widths(study)
        except np.linalg.LinAlgError:  # single images that fit without error leave no scale to weigh poses by
            what = "cannot be estimated from these data"
            raise unusable("what the poses may be off", what, "state it: --off MM,DEG") from None
        told = f"estimated from the data: {at_most(position, 2)} mm, {at_most(np.degrees(turn), 2)} degrees"
    else:
        try:
            position, angle = (float(part) for part in text.split(","))
        except ValueError:
            position = angle = np.nan
        if not (0.0 <= position < 1e4 and 0.0 <= angle <= 30.0):
            what = f"is {text!r:.60}"
            raise unusable("option --off", what, "give mm and degrees, such as 0.1,0.05, or estimated")
        turn, told = float(np.radians(angle)), f"stated: {stated(position)} mm, {stated(angle)} degrees"
    widths = np.tile([position] * 3 + [turn] * 3, (len(study.images), 1))
    return replace(study, pose_half_width=widths, provenance={**study.provenance, "half_widths": told})


# ------------------------------------------------------------------------------------------------------------------
# Pairs of poses.
#
# Pairs of poses say where the robot had its hand and where a camera saw a marker. They hold no pixels; four corners
# of a square of stated size stand in for the marker, seen at the stated pose by a stated camera without distortion.
# Then eps is in pixels of that camera: a pixel is (distance / focal length) across the line of sight.

STAND_IN = Camera(2000, 2000, np.array([1000.0, 1000.0]), np.array([999.5, 999.5]), np.zeros(5))


def study_of_pairs(hand: Pose, seen: Pose, *, setup: Setup, size: float = 100.0, names: Names = ()) -> HandEyeStudy:
    """A study whose pixels are those of a square board (3 x 3 points, `size` mm) at the poses where the camera saw it.

    hand   (n, 3) mm and (n, 4): hand in base
    seen   of the same n: target in camera

    Raises InputError for poses that do not go together, or with the board behind the camera.
    """
    count = len(hand.position)
    if len(seen.position) != count:
        what = f"are {count} of the hand and {len(seen.position)} of the target"
        raise unusable("poses", what, "give the same samples in the same order")
    side = size * np.array([-0.5, 0.0, 0.5])
    board = np.array([[x, y, 0.0] for y in side for x in side])
    images = names or tuple(f"sample{k + 1:03d}" for k in range(count))
    return study_of_board(hand, seen, board, setup=setup, camera=STAND_IN, images=images)


# ------------------------------------------------------------------------------------------------------------------
# Pairs of poses from files of other packages, all of them YAML.
#
# | package | file | what is read |
# | --- | --- | --- |
# | MoveIt (hand-eye calibration) | samples | a list of `effector_wrt_world`, `object_wrt_sensor`: 16 numbers by rows |
# | OpenCV | `cv::FileStorage` or plain lists | `R_gripper2base`, `t_gripper2base`, `R_target2cam`, `t_target2cam` |
# | easy_handeye2 | `NAME.samples` | a list under `samples` of `robot` and `tracking`, ROS transforms |
# | ROS | transforms | the same with `hand` and `camera_marker` |
#
# A ROS transform is `translation: {x, y, z}` in m and `rotation: {x, y, z, w}`. Translations are in m unless said.
# With the camera beside the robot, easy_handeye2 stores under `robot` the base in the effector frame
# (handeye_sampler.py, `_get_transforms`); everything else is the hand in the base frame.

_REMEDY = "give samples of MoveIt, OpenCV's four lists, or ROS transforms: see docs/hand-eye.md"
_KEYS = (("effector_wrt_world", "object_wrt_sensor"), ("robot", "tracking"), ("hand", "camera_marker"))
_MATRIX = 1e-3  # how far from a rotation a matrix may be
_FARTHEST = 1e9  # of a number, in the file's units: beyond it is no length, and squares of it overflow
_SHORTEST = 1e-6  # of a quaternion


def read_pose_pairs(path: Path, *, setup: Setup = "eye-in-hand", metres: bool = True) -> tuple[Pose, Pose]:
    """Hand in base and target in camera, (n, 3) mm and (n, 4), of a YAML file. Raises InputError."""
    document = yaml_document(path, _REMEDY)
    scale, names, both = 1000.0 if metres else 1.0, ("", ""), []
    try:
        if isinstance(document, dict) and "R_gripper2base" in document:
            for name in ("gripper2base", "target2cam"):
                lists = [
                    [value["data"] if isinstance(value, dict) else value for value in document[f"{part}_{name}"]]
                    for part in "Rt"
                ]
                both.append([_motion(*motion) for motion in zip(*lists, strict=True)])
        else:
            samples = document.get("samples") if isinstance(document, dict) else document
            if not isinstance(samples, list) or not samples:
                raise ValueError("no list of samples")
            names = next((names for names in _KEYS if names[0] in samples[0]), names)
            both = [[_pose(sample[name]) for sample in samples] for name in names]
    except OverflowError:  # of a whole number that no float holds, too
        raise unusable(str(path), "holds a number that is not finite, or too large", _REMEDY) from None
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise unusable(str(path), f"holds no pairs of poses: {error!s:.80}", _REMEDY) from None
    hand, seen = (Pose(scale * np.array([t for t, _ in one]), np.array([q for _, q in one])) for one in both)
    return inverse(hand) if setup == "eye-to-hand" and names[0] == "robot" else hand, seen


def _pose(value: Any) -> ArrayPair:
    """Of a ROS transform, or of 16 numbers by rows."""
    if not isinstance(value, dict):
        matrix = _numbers(value, 4, 4)
        return _motion(matrix[:3, :3], matrix[:3, 3])
    turn, place = (
        _numbers([float(value[key][a]) for a in axes], len(axes))
        for key, axes in (("rotation", "wxyz"), ("translation", "xyz"))
    )
    if not np.linalg.norm(turn) > _SHORTEST:
        raise ValueError("a rotation is all zeros")
    return place, normalised(turn)


def _motion(turn: Any, place: Any) -> ArrayPair:
    matrix = _numbers(turn, 3, 3)
    if not np.abs(matrix @ matrix.T - np.eye(3)).max() < _MATRIX or not np.linalg.det(matrix) > 0.0:
        raise ValueError("a matrix is no rotation")
    return _numbers(place, 3), quaternion_from_matrix(matrix)


def _numbers(values: Any, *shape: int) -> Floats:
    found = np.array(values, np.float64).reshape(shape)
    if not (np.abs(found) < _FARTHEST).all():  # NaN is not
        raise OverflowError
    return found
