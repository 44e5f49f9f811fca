"""Rigid motions x -> P + R(q) x, written as a `Pose`: product, inverse, and what they do to points.

Every function broadcasts over leading axes: one motion times N motions gives N.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.robot.kinematics import Pose
from cpcal.robot.rotation import normalised, quaternion_conjugate, quaternion_product


def compose(left: Pose, right: Pose) -> Pose:
    """First `right`, then `left`: position P + R p (mm) and quaternion of R r, normalised."""
    turned = np.einsum("...ij,...j->...i", left.rotation, right.position)
    return Pose(left.position + turned, normalised(quaternion_product(left.quaternion, right.quaternion)))


def inverse(pose: Pose) -> Pose:
    """The motion back: -R^T P and R^T. A pose of frame B in frame A becomes that of A in B."""
    turned = np.einsum("...ji,...j->...i", pose.rotation, pose.position)
    return Pose(-turned, normalised(quaternion_conjugate(pose.quaternion)))


def transformed(pose: Pose, points: npt.ArrayLike) -> Floats:
    """P + R x for points (..., n, 3) mm: coordinates in the pose's own frame become those in its reference."""
    turned = np.einsum("...ij,...nj->...ni", pose.rotation, np.asarray(points, dtype=np.float64))
    return np.asarray(pose.position[..., None, :] + turned)
