"""Fits of a pose, and the plain pinhole model that starts them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import CpcalError
from cpcal.robot import Pose, quaternion_conjugate, quaternion_from_matrix, quaternion_product, rotation_vector

# residuals (k,) and, on request, minus their slopes (k, 6)
Model = Callable[[Pose, bool], tuple[Floats, Floats | None]]

_STEPS = 200  # most fits need five, those of a small distant target a hundred
_SMALL = 1e-3  # standard deviations: a step that ends the fit
_ROUGH = 1e-9  # of chi-square: a decrease that ends the fit when the residuals are large
_BY_POSITION = np.eye(9, 6, -6)  # h = (r_1, r_2, t) by position and, yet to be filled in, by rotation vector
_TINY = 1e-3  # rad, and of the distance: a step that leaves the derivatives as they are


class NoPose(CpcalError):
    """The dots determine no pose, or more than one. Its text is the reason."""


@dataclass(frozen=True, eq=False)
class PoseFit:
    pose: Pose
    chi_square: float
    normal: Floats  # (6, 6), the inverse of the covariance
    residuals: Floats  # in standard deviations


def fit(model: Model, pose: Pose) -> PoseFit:
    """Levenberg-Marquardt; ends when a step is a small part of the standard deviations. After a step that is small
    beside the distance the derivatives are kept, until they lead astray."""
    damping, kept = 0.0, False
    residuals, slope = model(pose, True)
    if slope is None or not np.isfinite(residuals).all():
        return PoseFit(pose, np.inf, np.eye(6), residuals)
    chi_square = float(residuals @ residuals)
    for _ in range(_STEPS):
        normal = slope.T @ slope
        damped = normal + damping * np.diag(np.diag(normal)) if damping > 0.0 else normal
        try:
            step: Floats = np.asarray(np.linalg.solve(damped, slope.T @ residuals))
        except np.linalg.LinAlgError:
            raise NoPose("the dots do not determine the pose") from None
        moved = moved_by(pose, step)
        if step @ normal @ step < max(_SMALL**2, _ROUGH * chi_square) and damping < 1e-3:
            residuals = residuals - slope @ step
            return PoseFit(moved, float(residuals @ residuals), normal, residuals)
        tiny = _largest(step[:3]) < _TINY * abs(pose.position[2]) and _largest(step[3:]) < _TINY
        trial, trial_slope = model(moved, not tiny)
        trial_square = float(trial @ trial)
        if trial_square <= chi_square:
            pose, residuals, chi_square, damping = moved, trial, trial_square, 0.1 * damping
            slope, kept = (slope, True) if trial_slope is None else (trial_slope, False)
        elif kept:
            fresh, kept = model(pose, True)[1], False
            slope = slope if fresh is None else fresh
        else:
            damping = max(10.0 * damping, 1e-4)
    raise NoPose(f"the fit has not ended after {_STEPS} steps")


def _largest(values: Floats) -> float:
    return float(max(map(abs, values.tolist())))


def moved_by(pose: Pose, step: Floats) -> Pose:
    """position + step[:3] and R(step[3:]) R; in plain floats, because this is done a dozen times an image."""
    x, y, z = step[3:].tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    c, s = math.cos(0.5 * angle), 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    x, y, z = s * x, s * y, s * z
    w0, x0, y0, z0 = pose.quaternion.tolist()
    turned = np.array(
        [
            c * w0 - x * x0 - y * y0 - z * z0,
            c * x0 + x * w0 + y * z0 - z * y0,
            c * y0 + y * w0 + z * x0 - x * z0,
            c * z0 + z * w0 + x * y0 - y * x0,
        ]
    )
    return Pose(pose.position + step[:3], turned / math.sqrt(float(turned @ turned)))


def same_pose(pose: Pose, other: PoseFit) -> bool:
    """Whether a pose is the fit's to within a standard deviation."""
    turn = quaternion_product(pose.quaternion, quaternion_conjugate(other.pose.quaternion))
    step = np.concatenate([pose.position - other.pose.position, rotation_vector(turn)])
    return bool(step @ other.normal @ step < 1.0)


def plain_model(dots: Floats, rays: Floats, sharpness: float) -> tuple[Model, Pose]:
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
    left, _, right = np.linalg.svd(np.stack([h[0], h[1], np.cross(h[0], h[1])], axis=1))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    start = Pose(h[2], quaternion_from_matrix(turn))
    return _Equations(triangle * (np.repeat([size, size, 1.0], 3) * sharpness / h[2, 2])), start


@dataclass(frozen=True, eq=False)
class _Equations:
    """Residuals of the pinhole model: matrix (9, 9) times h = (r_1, r_2, t), and minus their derivatives (9, 6)."""

    matrix: Floats

    def __call__(self, pose: Pose, slope: bool) -> tuple[Floats, Floats | None]:
        turn = pose.rotation
        residuals = self.matrix @ -np.concatenate([turn[:, 0], turn[:, 1], pose.position])
        (x, u, _), (y, v, _), (z, w, _) = turn.tolist()
        moved = _BY_POSITION.copy()
        moved[:6, 3:] = ((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0), (0.0, w, -v), (-w, 0.0, u), (v, -u, 0.0))
        return residuals, self.matrix @ moved


def turned_over(pose: Pose, dots: Floats) -> Pose:
    """The plane's other pose: depths along the line of sight to the dots' middle change their sign."""
    middle = np.append(dots.mean(axis=0), 0.0)
    center = pose.position + pose.rotation @ middle
    sight = center / np.linalg.norm(center)
    turn = (np.eye(3) - 2.0 * np.outer(sight, sight)) @ pose.rotation @ np.diag([1.0, 1.0, -1.0])
    return Pose(center - turn @ middle, quaternion_from_matrix(turn))
