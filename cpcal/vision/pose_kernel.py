"""Levenberg-Marquardt fits of a pose, compiled: of the pinhole model's equations, and of the dot model to pixels.

A pose is packed as (7,): position (mm) and unit quaternion, scalar first. A step is (6,): of the position, and a
rotation vector in the camera frame.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled
from cpcal.vision.dot_kernel import placed_centers
from cpcal.vision.scaled_solve import solved

DONE, SINGULAR, ENDLESS, NOWHERE = 0, 1, 2, 3  # how a fit ends
STEPS = 200  # most fits need five, those of a small distant target a hundred
_SMALL = 1e-3  # standard deviations: a step that ends the fit
_ROUGH = 1e-9  # of chi-square: a decrease that ends the fit when the residuals are large


@compiled
def fit_pose(
    matrix: Floats,
    dots: Floats,
    seen: Floats,
    factors: Floats,
    radius: float,
    camera: Floats,
    pose: Floats,
    residuals: Floats,
    normal: Floats,
) -> tuple[int, float]:
    """Fits `pose` in place, and fills in residuals (k,) and normal matrix (6, 6); returns how it ended and chi-square.

    With a matrix (9, 9) the residuals are minus it times (r_1, r_2, t). With none (0, 9) they are those of dots (n, 2)
    mm seen at (n, 2) pixels, in standard deviations by lower triangular factors (n, 2, 2) of the covariances.
    """
    size = len(residuals)
    slope, trial, trial_slope = np.empty((size, 6)), np.empty(size), np.empty((size, 6))
    moved, right, step = np.empty(7), np.empty(6), np.empty(6)
    _evaluate(matrix, dots, seen, factors, radius, camera, pose, residuals, slope)
    chi_square, damping = _square(residuals), 0.0
    if not np.isfinite(chi_square):
        return NOWHERE, np.inf
    for _ in range(STEPS):
        _products(slope, residuals, normal, right)
        if not solved(normal, 6, damping, 0.0, right, step):
            return SINGULAR, chi_square
        _moved(pose, step, moved)
        gain = 0.0
        for i in range(6):
            for j in range(6):
                gain += step[i] * normal[i, j] * step[j]
        if gain < max(_SMALL**2, _ROUGH * chi_square) and damping < 1e-3:
            pose[:] = moved
            for i in range(size):
                for j in range(6):
                    residuals[i] -= slope[i, j] * step[j]
            return DONE, _square(residuals)
        _evaluate(matrix, dots, seen, factors, radius, camera, moved, trial, trial_slope)
        square = _square(trial)
        if square <= chi_square:
            pose[:], residuals[:], slope[:] = moved, trial, trial_slope
            chi_square, damping = square, 0.1 * damping
        else:
            damping = max(10.0 * damping, 1e-4)
    return ENDLESS, chi_square


@compiled
def _evaluate(
    matrix: Floats,
    dots: Floats,
    seen: Floats,
    factors: Floats,
    radius: float,
    camera: Floats,
    pose: Floats,
    residuals: Floats,
    slope: Floats,
) -> None:
    """Residuals (k,), and minus their derivatives (k, 6)."""
    turn = _rotation(pose)
    if len(matrix):
        _equations(matrix, turn, pose, residuals, slope)
        return
    count = len(dots)
    centers, by_pose = np.empty((count, 2)), np.empty((count, 2, 6))
    placed_centers(dots, radius, camera, turn, pose[:3], True, centers, by_pose)
    for i in range(count):
        a, b, c = factors[i, 0, 0], factors[i, 1, 0], factors[i, 1, 1]
        residuals[2 * i] = (seen[i, 0] - centers[i, 0]) / a
        residuals[2 * i + 1] = (seen[i, 1] - centers[i, 1] - b * residuals[2 * i]) / c
        for j in range(6):
            slope[2 * i, j] = by_pose[i, 0, j] / a
            slope[2 * i + 1, j] = (by_pose[i, 1, j] - b * slope[2 * i, j]) / c


@compiled
def _equations(matrix: Floats, turn: Floats, pose: Floats, residuals: Floats, slope: Floats) -> None:
    """Those of X - u Z = 0 and Y - v Z = 0, linear in (r_1, r_2, t)."""
    h, by = np.empty(9), np.zeros((9, 6))
    for k in range(3):
        h[k], h[3 + k], h[6 + k] = turn[k, 0], turn[k, 1], pose[k]
        by[6 + k, k] = 1.0
    for m in range(2):  # w x r
        x, y, z = turn[0, m], turn[1, m], turn[2, m]
        by[3 * m, 4], by[3 * m, 5] = z, -y
        by[3 * m + 1, 3], by[3 * m + 1, 5] = -z, x
        by[3 * m + 2, 3], by[3 * m + 2, 4] = y, -x
    for i in range(len(matrix)):
        total = 0.0
        for k in range(9):
            total += matrix[i, k] * h[k]
        residuals[i] = -total
        for j in range(6):
            total = 0.0
            for k in range(9):
                total += matrix[i, k] * by[k, j]
            slope[i, j] = total


@compiled
def _rotation(pose: Floats) -> Floats:
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    scale = 2.0 / (w * w + x * x + y * y + z * z)
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - scale * (y * y + z * z), scale * (x * y - w * z), scale * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = scale * (x * y + w * z), 1.0 - scale * (x * x + z * z), scale * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = scale * (x * z - w * y), scale * (y * z + w * x), 1.0 - scale * (x * x + y * y)
    return out


@compiled
def _square(values: Floats) -> float:
    total = 0.0
    for value in values:
        total += value * value
    return total


@compiled
def _products(slope: Floats, residuals: Floats, normal: Floats, right: Floats) -> None:
    normal[:], right[:] = 0.0, 0.0
    for k in range(len(residuals)):
        for i in range(6):
            right[i] += slope[k, i] * residuals[k]
            for j in range(i + 1):
                normal[i, j] += slope[k, i] * slope[k, j]
    for i in range(6):
        for j in range(i):
            normal[j, i] = normal[i, j]


@compiled
def _moved(pose: Floats, step: Floats, out: Floats) -> None:
    """position + step[:3], and R(step[3:]) R."""
    for k in range(3):
        out[k] = pose[k] + step[k]
    x, y, z = step[3], step[4], step[5]
    angle = np.sqrt(x * x + y * y + z * z)
    c, s = np.cos(0.5 * angle), (0.5 if angle < 1e-9 else np.sin(0.5 * angle) / angle)
    x, y, z = s * x, s * y, s * z
    w0, x0, y0, z0 = pose[3], pose[4], pose[5], pose[6]
    out[3] = c * w0 - x * x0 - y * y0 - z * z0
    out[4] = c * x0 + x * w0 + y * z0 - z * y0
    out[5] = c * y0 + y * w0 + z * x0 - x * z0
    out[6] = c * z0 + z * w0 + x * y0 - y * x0
    length = np.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2 + out[6] ** 2)
    for k in range(3, 7):
        out[k] /= length


@compiled
def pose_distance(pose: Floats, other: Floats, normal: Floats) -> float:
    """The square of how far a packed pose is from another, in standard deviations by a normal matrix (6, 6)."""
    step = np.empty(6)
    step[:3] = pose[:3] - other[:3]
    w1, x1, y1, z1 = pose[3], pose[4], pose[5], pose[6]
    w2, x2, y2, z2 = other[3], -other[4], -other[5], -other[6]
    w, x = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2, w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2
    y, z = w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2, w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2
    half = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 if half < 1e-12 else 2.0 * np.arctan2(half, abs(w)) / half
    sign = -scale if w < 0.0 else scale
    step[3], step[4], step[5] = sign * x, sign * y, sign * z
    square = 0.0
    for i in range(6):
        for j in range(6):
            square += step[i] * normal[i, j] * step[j]
    return square
