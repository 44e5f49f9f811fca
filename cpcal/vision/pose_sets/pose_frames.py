"""The frames between which a pose stands, and motions as boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import ByValue, frozen_array
from cpcal.robot import Pose
from cpcal.solver.interval import IntervalArray
from cpcal.vision.pose_sets.enclosed import ENGINE, exact, rotation, times, transposed

_IDENTITY = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass(frozen=True)
class Motions:
    """A box of rigid motions of the target in the camera frame: rotation (3, 3) and position (3,) mm, enclosed."""

    rotation: IntervalArray
    position: IntervalArray


@dataclass(frozen=True, eq=False)
class Frames(ByValue):
    """Exact motions between which the pose stands, of the floats that they are (quaternions divided by |q|^2).

    camera  the base frame seen in the camera frame: `x_camera = P + R x_base`, mm
    target  the target frame seen in the mobile frame: `x_mobile = P + R x_target`, mm

    Raises InputError when one of them is not one motion.
    """

    camera: Pose = _IDENTITY
    target: Pose = _IDENTITY

    def __post_init__(self) -> None:
        problems = []
        for name in ("camera", "target"):
            pose: Pose = getattr(self, name)
            one = Pose(frozen_array(pose.position), frozen_array(pose.quaternion))
            object.__setattr__(self, name, one)
            numbers = np.concatenate([one.position.ravel(), one.quaternion.ravel()])
            if one.position.shape != (3,) or one.quaternion.shape != (4,) or not np.isfinite(numbers).all():
                problems.append(Problem(f"frames {name}", "is not one motion", "give (3,) mm and a quaternion (4,)"))
            elif not one.quaternion.any():
                problems.append(Problem(f"frames {name}", "has the quaternion zero", "give a unit quaternion"))
        if problems:
            raise InputError(problems)

    def in_mobile(self, points: IntervalArray) -> IntervalArray:
        """Points (m, 3) of the target frame in the mobile frame."""
        return ENGINE.add(exact(self.target.position), times(rotation(self.target.quaternion), points))

    def mobile_in_base(self, seen: Motions) -> Motions:
        """What motions of the target in the camera frame mean."""
        e = ENGINE
        back = transposed(rotation(self.camera.quaternion))
        turned = e.dot(e.dot(back, seen.rotation), transposed(rotation(self.target.quaternion)))
        moved = times(back, e.sub(seen.position, exact(self.camera.position)))
        return Motions(turned, e.sub(moved, times(turned, exact(self.target.position))))
