"""Pairs of poses from files of other packages, all of them YAML.

| package | file | what is read |
| --- | --- | --- |
| MoveIt (hand-eye calibration) | samples | a list of `effector_wrt_world`, `object_wrt_sensor`: 16 numbers by rows |
| OpenCV | `cv::FileStorage` or plain lists | `R_gripper2base`, `t_gripper2base`, `R_target2cam`, `t_target2cam` |
| easy_handeye2 | `NAME.samples` | a list under `samples` of `robot` and `tracking`, ROS transforms |
| ROS | transforms | the same with `hand` and `camera_marker`, ... |

A ROS transform is `translation: {x, y, z}` in m and `rotation: {x, y, z, w}`. Translations are in m unless said.
With the camera beside the robot, easy_handeye2 stores under `robot` the base in the effector frame (handeye_sampler.py,
`_get_transforms`); everything else is the hand in the base frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem, Problems
from cpcal.files.tables import small_file
from cpcal.handeye.hand_eye_study import Setup
from cpcal.robot import Pose, inverse, normalised, quaternion_from_matrix
from cpcal.vision.files.plate_and_camera import camera_yaml

_REMEDY = "give samples of MoveIt, OpenCV's four lists, or ROS transforms: see docs/hand-eye.md"
_HAND = ("robot", "hand", "effector", "hand_world", "effector_wrt_world")
_SEEN = ("tracking", "optical", "camera_marker", "object", "object_wrt_sensor")
_MATRIX = 1e-3  # how far from a rotation a matrix may be
_FARTHEST = 1e9  # of a number, in the file's units: beyond it is no length, and squares of it overflow
_SHORTEST = 1e-6  # of a quaternion


def read_pose_pairs(path: Path, *, setup: Setup = "eye-in-hand", metres: bool = True) -> tuple[Pose, Pose]:
    """Hand in base and target in camera, (n, 3) mm and (n, 4), of a YAML file. Raises InputError."""
    problems = Problems()
    content = small_file(path, problems, _REMEDY)
    problems.raise_any()
    assert content is not None
    document = camera_yaml().yaml_document(content, path)
    base_in_hand = False
    try:
        if isinstance(document, dict) and "R_gripper2base" in document:
            hand, seen = _opencv(document)
        else:
            samples = _samples(document)
            hand, seen = ([_pose(sample[_key(sample, names)]) for sample in samples] for names in (_HAND, _SEEN))
            base_in_hand = setup == "eye-to-hand" and all({"robot", "tracking"} <= set(one) for one in samples)
    except OverflowError:  # of a whole number that no float holds, too
        raise InputError([Problem(str(path), "holds a number that is not finite, or too large", _REMEDY)]) from None
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError([Problem(str(path), f"holds no pairs of poses: {error!s:.80}", _REMEDY)]) from None
    scale = 1000.0 if metres else 1.0
    stated = _scaled(hand, scale)
    return inverse(stated) if base_in_hand else stated, _scaled(seen, scale)


def _scaled(poses: list[tuple[Any, Any]], scale: float) -> Pose:
    return Pose(np.array([p for p, _ in poses]) * scale, np.array([q for _, q in poses]))


def _samples(document: Any) -> list[Any]:
    samples = document.get("samples", document.get("transforms")) if isinstance(document, dict) else document
    if not isinstance(samples, list) or not samples:
        raise ValueError("no list of samples")
    return samples


def _key(sample: Any, names: Iterable[str]) -> str:
    found = [name for name in names if name in sample]
    if not found:
        raise ValueError(f"a sample has none of {', '.join(names)}")
    return found[0]


def _pose(value: Any) -> tuple[Any, Any]:
    if isinstance(value, dict):
        value = value.get("transform", value)
        t, q = value["translation"], value["rotation"]
        turn = _numbers([float(q[a]) for a in "wxyz"], 4)
        if not np.linalg.norm(turn) > _SHORTEST:
            raise ValueError("a rotation is all zeros")
        return _numbers([float(t[a]) for a in "xyz"], 3), normalised(turn)
    matrix = _numbers(value, 4, 4)
    return matrix[:3, 3], _rotation(matrix[:3, :3])


def _opencv(document: dict[str, Any]) -> tuple[list[tuple[Any, Any]], list[tuple[Any, Any]]]:
    def pairs(name: str) -> list[tuple[Any, Any]]:
        turns, shifts = document[f"R_{name}"], document[f"t_{name}"]
        if len(turns) != len(shifts):
            raise ValueError(f"R_{name} and t_{name} have other lengths")
        return [(_of_list(t, 3), _rotation(_of_list(r, 3, 3))) for r, t in zip(turns, shifts, strict=True)]

    return pairs("gripper2base"), pairs("target2cam")


def _of_list(value: Any, *shape: int) -> Floats:
    return _numbers(value["data"] if isinstance(value, dict) else value, *shape)


def _numbers(values: Any, *shape: int) -> Floats:
    found = np.array(values, dtype=np.float64).reshape(shape)
    if not (np.abs(found) < _FARTHEST).all():  # NaN is not
        raise OverflowError
    return found


def _rotation(matrix: Floats) -> Floats:
    if not np.abs(matrix @ matrix.T - np.eye(3)).max() < _MATRIX or not np.linalg.det(matrix) > 0.0:
        raise ValueError("a matrix is no rotation")
    return quaternion_from_matrix(matrix)
