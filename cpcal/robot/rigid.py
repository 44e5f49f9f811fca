"""Poses put one after the other: a pose (P, q) is also the change of frame x -> P + R(q) x."""

from __future__ import annotations

import numpy as np

from cpcal.robot.kinematics import Pose
from cpcal.robot.rotation import normalised, quaternion_conjugate, quaternion_product


def composed(*poses: Pose) -> Pose:
    """The change of frame that applies the last pose first; leading axes broadcast."""
    result = poses[0]
    for inner in poses[1:]:
        position = result.position + (result.rotation @ inner.position[..., None])[..., 0]
        outer, own = np.broadcast_arrays(result.quaternion, inner.quaternion)
        result = Pose(position, normalised(quaternion_product(outer, own)))
    return result


def inverted(pose: Pose) -> Pose:
    """The change of frame back."""
    back = np.swapaxes(pose.rotation, -1, -2)
    return Pose(-(back @ pose.position[..., None])[..., 0], normalised(quaternion_conjugate(pose.quaternion)))
