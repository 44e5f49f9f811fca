"""The hand-eye study of a parallel robot's own study: its drawing and leg readings say where the platform is.

The mobile frame is the hand: the camera stands beside the robot, the target is on the platform. The poses come from the
drawing, whose errors they have; half-widths say how large these may be. The camera is taken as exact.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.pose_pairs_study import study_of_pairs
from cpcal.robot import Pose, Study, central_pose, forward_kinematics


def platform_poses(study: Study) -> dict[str, tuple[float, ...]]:
    """By row of the calibration table (`pose/run`, or `pose/run/image`) the mobile frame in the base frame.

    x, y, z in mm, then a unit quaternion, scalar first. Raises KinematicsError where the drawing cannot reach readings.
    """
    found = _poses(study)
    rows = np.concatenate([found.position, found.quaternion], axis=1).tolist()
    return {name: tuple(row) for name, row in zip(study.calibration.row_ids, rows, strict=True)}


def _poses(study: Study) -> Pose:
    readings = study.calibration.length
    return forward_kinematics(study.robot, readings, central_pose(study.robot, readings.mean(axis=0)))


def study_of_robot(study: Study) -> HandEyeStudy:
    """Of the poses that the camera saw: one row of the calibration table for each configuration, its first.

    Raises KinematicsError, and InputError as `study_of_pairs` does.
    """
    table = study.calibration
    _, first = np.unique(table.pose, return_index=True)
    chosen = np.sort(first)
    hand = _poses(study)
    return study_of_pairs(
        Pose(hand.position[chosen], hand.quaternion[chosen]),
        Pose(table.position[chosen], table.quaternion[chosen]),
        setup="eye-to-hand",
        names=tuple(table.row_ids[k].replace("/", "-") for k in chosen),
    )


def with_half_widths(study: HandEyeStudy, text: str) -> HandEyeStudy:
    """Every pose uncertain by `MM,DEG` on each axis. Raises InputError."""
    try:
        position, angle = (float(part) for part in text.split(","))
    except ValueError:
        position = angle = np.nan
    if not (0.0 <= position < 1e4 and 0.0 <= angle <= 30.0):
        raise InputError([Problem("option --off", f"is {text!r:.60}", "give mm and degrees, such as 0.1,0.05")])
    wide = [position] * 3 + [float(np.radians(angle))] * 3
    return replace(study, pose_half_width=np.tile(wide, (len(study.images), 1)))
