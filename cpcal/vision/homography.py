"""Plane homographies: applied, fitted, and the one-dimensional kind along a line."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
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
    (p, into), (q, out) = _normalised(points), _normalised(images)
    rows = np.zeros((len(p), 2, 9))
    rows[:, 0, 0:2] = rows[:, 1, 3:5] = p
    rows[:, 0, 2] = rows[:, 1, 5] = 1.0
    rows[:, :, 6:8] = -q[:, :, None] * p[:, None, :]
    rows[:, :, 8] = -q
    flat = rows.reshape(-1, 9)
    homography = np.linalg.eigh(flat.T @ flat)[1][:, 0].reshape(3, 3)
    homography = np.linalg.solve(out, homography @ into)
    depth = points @ homography[2, :2] + homography[2, 2]
    return np.asarray(homography * (np.sign(median(np.sign(depth))) or 1.0) / np.linalg.norm(homography))


def _normalised(points: Floats) -> tuple[Floats, Floats]:
    """Points about their mean at a mean distance of sqrt 2, and the matrix (3, 3) that does it."""
    mean = points.mean(axis=0)
    scale = np.sqrt(2.0 / max(((points - mean) ** 2).sum(axis=1).mean(), 1e-300))
    matrix = np.array([[scale, 0.0, -scale * mean[0]], [0.0, scale, -scale * mean[1]], [0.0, 0.0, 1.0]])
    return (points - mean) * scale, matrix


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
