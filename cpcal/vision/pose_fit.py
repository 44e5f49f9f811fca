"""Fits of a pose, and the two models that are fitted: the plain pinhole, which starts, and the dots' pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.common.errors import CpcalError
from cpcal.robot import Pose, quaternion_from_matrix
from cpcal.vision.camera import Camera
from cpcal.vision.dot_model import centers_of
from cpcal.vision.pose_kernel import ENDLESS, SINGULAR, STEPS, fit_pose, pose_distance


class NoPose(CpcalError):
    """The dots determine no pose, or more than one. Its text is the reason."""


@dataclass(frozen=True, eq=False)
class PinholeEquations:
    """The pinhole model of points: matrix (9, 9); its residuals are minus it times (r_1, r_2, t)."""

    matrix: Floats


@dataclass(frozen=True, eq=False)
class Pixels:
    """The dot model: dots (n, 2) mm that are seen at (n, 2) pixels, with lower triangular factors (n, 2, 2) whose
    squares are the covariances. Its residuals are standard deviations."""

    dots: Floats
    seen: Floats
    factors: Floats
    radius: float
    camera: Camera

    def residuals(self, pose: Pose) -> Floats:
        """(n, 2) at a pose."""
        centers = centers_of(self.dots, self.radius, self.camera, pose)
        return self.whitened((self.seen - centers)[..., None])[..., 0]

    def whitened(self, pixels: Floats) -> Floats:
        """The factors' inverses times (n, 2, k)."""
        out = np.empty_like(pixels)
        out[:, 0] = pixels[:, 0] / self.factors[:, 0, 0, None]
        out[:, 1] = (pixels[:, 1] - self.factors[:, 1, 0, None] * out[:, 0]) / self.factors[:, 1, 1, None]
        return out

    def only(self, used: Bools) -> Pixels:
        """Of some (n,) of the dots."""
        return Pixels(self.dots[used], self.seen[used], self.factors[used], self.radius, self.camera)


Model = PinholeEquations | Pixels


@dataclass(frozen=True, eq=False)
class PoseFit:
    pose: Pose
    chi_square: float
    normal: Floats  # (6, 6), the inverse of the covariance
    residuals: Floats  # in standard deviations


def fit(model: Model, pose: Pose) -> PoseFit:
    """Levenberg-Marquardt from a pose; ends when a step is a small part of the standard deviations."""
    packed, normal = _packed(pose), np.eye(6)
    if isinstance(model, PinholeEquations):
        residuals = np.empty(9)
        none, camera, flat = np.empty((0, 2)), np.empty(13), np.empty((0, 2, 2))
        ended, square = fit_pose(model.matrix, none, none, flat, 0.0, camera, packed, residuals, normal)
    else:
        residuals = np.empty(2 * len(model.dots))
        seen = model.dots, model.seen, model.factors, model.radius, model.camera.packed
        ended, square = fit_pose(np.empty((0, 9)), *seen, packed, residuals, normal)
    if ended == SINGULAR:
        raise NoPose("the dots do not determine the pose")
    if ended == ENDLESS:
        raise NoPose(f"the fit has not ended after {STEPS} steps")
    return PoseFit(Pose(packed[:3], packed[3:]), float(square), normal, residuals)


def _packed(pose: Pose) -> Floats:
    """(7,) as compiled code takes it."""
    return np.concatenate([pose.position, pose.quaternion])


def same_pose(pose: Pose, other: PoseFit) -> bool:
    """Whether a pose is the fit's to within a standard deviation."""
    return bool(pose_distance(_packed(pose), _packed(other.pose), other.normal) < 1.0)


def plain_model(dots: Floats, rays: Floats, sharpness: float) -> tuple[PinholeEquations, Pose]:
    """The pinhole model of points, and the pose whose plane has the homography of the dots' directions.

    A dot (x, y) seen in the direction (u, v, 1) says X - u Z = 0 and Y - v Z = 0, linear in the nine numbers
    h = (r_1, r_2, t). The triangular factor (9, 9) of all these equations says as much as they do, so that a step of a
    fit costs next to nothing. Divided by the mean depth the equations are errors of directions, to within the dots'
    relative depths; `sharpness` is one by the standard deviation of a direction.
    """
    size = float(np.sqrt((dots * dots).mean()))
    rows = np.zeros((len(dots), 2, 9))
    for k, factor in enumerate((dots[:, 0] / size, dots[:, 1] / size, np.ones(len(dots)))):
        rows[:, 0, 3 * k] = rows[:, 1, 3 * k + 1] = factor
        rows[:, :, 3 * k + 2] = -rays * factor[:, None]
    triangle = np.linalg.qr(rows.reshape(-1, 9), mode="r")
    h = np.linalg.svd(triangle)[2][-1].reshape(3, 3) / [[size], [size], [1.0]]
    h = h * (np.sign(h[2, 2]) * 2.0 / np.linalg.norm(h[:2], axis=1).sum())
    (a, b, c), (d, e, f) = h[0].tolist(), h[1].tolist()
    left, _, right = np.linalg.svd(np.array([[a, d, b * f - c * e], [b, e, c * d - a * f], [c, f, a * e - b * d]]))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    start = Pose(h[2], quaternion_from_matrix(turn))
    return PinholeEquations(triangle * (np.repeat([size, size, 1.0], 3) * sharpness / h[2, 2])), start


def turned_over(pose: Pose, dots: Floats) -> Pose:
    """The plane's other pose: depths along the line of sight to the dots' middle change their sign."""
    x, y = dots.mean(axis=0)
    rotation = pose.rotation
    center = pose.position + rotation @ [x, y, 0.0]
    turn = (rotation - center[:, None] * (2.0 / (center @ center) * (center @ rotation))) * [1.0, 1.0, -1.0]
    return Pose(center - turn @ [x, y, 0.0], quaternion_from_matrix(turn))
