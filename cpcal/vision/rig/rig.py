"""A rig, and what its cameras see of a plate at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Bools, Floats, Ints
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Value, frozen_array
from cpcal.robot import Pose, quaternion_product
from cpcal.vision.camera import BROWN, CAMERA_NUMBERS, Camera
from cpcal.vision.two_by_two import determinants

EACH = 6 + len(CAMERA_NUMBERS)  # numbers of a camera: its pose's, and its own
MOST = 16  # cameras


@dataclass(frozen=True, eq=False)
class Rig(Value):
    """Cameras that stand still to each other.

    names       of the cameras, of their folders of images, too
    cameras     all of the model "brown"
    position    (c, 3) mm and quaternion (c, 4): the first camera's frame seen by each, X_c = R(q_c) X_1 + t_c; those of
                the first are zero and the identity
    covariance  (15 c, 15 c) of each camera's six (position, mm, and rotation vector in its own frame, rad) and nine
                numbers (fx, fy, cx, cy, k1, k2, p1, p2, k3) in turn; zero where a number is taken for exact
    rms         of the residuals that it was found with, pixels per axis

    Raises InputError when the parts do not belong together.
    """

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    position: Floats
    quaternion: Floats
    covariance: Floats
    rms: float = 0.0

    def __post_init__(self) -> None:
        count = len(self.names)
        for name in ("position", "quaternion", "covariance"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        problems = []
        if not 2 <= count <= MOST or len(set(self.names)) < count or len(self.cameras) != count:
            problems.append(Problem("rig", "is not of two or more cameras of different names", f"at most {MOST}"))
        elif any(camera.model != BROWN for camera in self.cameras):
            problems.append(Problem("rig", f"has a camera whose lens is not {BROWN}", "calibrate it with that model"))
        elif (
            self.position.shape != (count, 3)
            or self.quaternion.shape != (count, 4)
            or self.covariance.shape != (EACH * count, EACH * count)
            or not all(np.isfinite(a).all() for a in (self.position, self.quaternion, self.covariance))
            or np.abs((self.quaternion**2).sum(axis=1) - 1.0).max() > 1e-6
        ):
            problems.append(Problem("rig", "has numbers that are no poses and covariances of its cameras", "see docs"))
        if problems:
            raise InputError(problems)

    def seen_by(self, camera: int, pose: Pose) -> Pose:
        """A pose in the first camera's frame, in the frame of another."""
        own = Pose(self.position[camera], self.quaternion[camera])
        return Pose(own.position + own.rotation @ pose.position, quaternion_product(own.quaternion, pose.quaternion))

    def origin(self, camera: int) -> Floats:
        """(3,) mm: where a camera is, in the first camera's frame."""
        own = Pose(self.position[camera], self.quaternion[camera])
        return np.asarray(-own.rotation.T @ own.position)


@dataclass(frozen=True, eq=False)
class SeenPlate:
    """What one camera sees of the plate: centres (m, 2) px, covariance (m, 2, 2) px^2, the dots' numbers (m,), and the
    plate's pose in this camera's frame; missing, false and margin as `Detection` has them."""

    camera: int
    centers: Floats
    covariance: Floats
    numbers: Ints
    pose: Pose
    missing: int = 0
    false: int = 0
    margin: int = 0

    @property
    def sound(self) -> Bools:
        """(m,) whether each dot's covariance is one."""
        return np.asarray((determinants(self.covariance) > 0.0) & (self.covariance[:, 0, 0] > 0.0))
