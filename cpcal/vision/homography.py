"""Plane homographies: applied, fitted, and the one-dimensional kind along a line."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled
from cpcal.vision.median import median


def mapped(homography: Floats, points: Floats) -> Floats:
    """Points (..., n, 2) through H (..., 3, 3); nan where they go beyond the horizon (third coordinate <= 0)."""
    turned = points @ np.swapaxes(homography[..., :2], -1, -2) + homography[..., None, :, 2]
    depth = turned[..., 2:]
    return np.asarray(turned[..., :2] / np.where(depth > 0.0, depth, np.nan))


def fitted(points: Floats, images: Floats) -> Floats:
    """The H (3, 3) that takes points (n, 2) to images (n, 2), n >= 4, by the normalised direct linear transform.

    Its sign makes the third coordinates of most points positive, and H has the norm 1.
    """
    normal, into, out = np.zeros((9, 9)), np.zeros((3, 3)), np.zeros((3, 3))
    transform_equations(np.array(points), np.array(images), normal, into, out)
    homography = np.linalg.eigh(normal)[1][:, 0].reshape(3, 3)
    homography = np.linalg.solve(out, homography @ into)
    depth = points @ homography[2, :2] + homography[2, 2]
    return np.asarray(homography * (np.sign(median(np.sign(depth))) or 1.0) / np.linalg.norm(homography))


@compiled
def transform_equations(points: Floats, images: Floats, normal: Floats, into: Floats, out: Floats) -> None:
    """The normal matrix (9, 9) of the direct linear transform of points about their mean at a mean distance of sqrt 2
    to images likewise, into zeros; and the matrices (3, 3) that bring points and images there."""
    _normalisation(points, into)
    _normalisation(images, out)
    row = np.zeros((2, 9))
    for i in range(len(points)):
        x, y = points[i, 0] * into[0, 0] + into[0, 2], points[i, 1] * into[1, 1] + into[1, 2]
        for axis in range(2):
            seen = images[i, axis] * out[axis, axis] + out[axis, 2]
            row[axis, 3 * axis], row[axis, 3 * axis + 1], row[axis, 3 * axis + 2] = x, y, 1.0
            row[axis, 6], row[axis, 7], row[axis, 8] = -seen * x, -seen * y, -seen
            for j in range(9):
                for k in range(j + 1):
                    normal[j, k] += row[axis, j] * row[axis, k]
    for j in range(9):
        for k in range(j):
            normal[k, j] = normal[j, k]


@compiled
def _normalisation(points: Floats, matrix: Floats) -> None:
    count = len(points)
    x, y = 0.0, 0.0
    for i in range(count):
        x, y = x + points[i, 0] / count, y + points[i, 1] / count
    square = 0.0
    for i in range(count):
        square += ((points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2) / count
    scale = np.sqrt(2.0 / max(square, 1e-300))
    matrix[0, 0], matrix[1, 1], matrix[2, 2] = scale, scale, 1.0
    matrix[0, 2], matrix[1, 2] = -scale * x, -scale * y


def orientation(homography: Floats, points: Floats) -> Floats:
    """The sign (n,) of the area that H gives to a small positive area at each of the points (n, 2)."""
    depth = points @ homography[2, :2] + homography[2, 2]
    return np.asarray(np.sign(np.linalg.det(homography) * depth))


def line_maps(places: Floats, images: Floats) -> Floats:
    """The 1-D homographies (..., 3) a, b, c that take three places (..., 3) to their images (..., 3).

    s goes to (a s + b) / (1 + c (s - s_0)) with s_0 the first place, where the denominator is 1.
    """
    s1, s2 = places[..., 1] - places[..., 0], places[..., 2] - places[..., 0]
    t0 = images[..., 0]
    u1, u2 = (images[..., 1] - t0) / s1, (images[..., 2] - t0) / s2
    # with s from s_0 and t from t_0: t = a s / (c s + 1), so a - c t = t / s at both further places
    v1, v2 = images[..., 1] - t0, images[..., 2] - t0
    with np.errstate(divide="ignore", invalid="ignore"):
        c = (u1 - u2) / (v2 - v1)
    a = u1 + c * v1
    return np.stack([a + c * t0, t0 - (a + c * t0) * places[..., 0], c], axis=-1)


def on_line(maps: Floats, origin: Floats, places: Floats) -> Floats:
    """The images (..., k) of places (..., k) under 1-D homographies (..., 3) with their s_0 (...)."""
    a, b, c = (maps[..., i, None] for i in range(3))
    depth = 1.0 + c * (places - origin[..., None])
    return np.asarray((a * places + b) / np.where(depth > 0.0, depth, np.nan))
