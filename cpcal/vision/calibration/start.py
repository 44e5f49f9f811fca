"""Where a camera calibration starts: homographies, and Zhang's closed form for the focal lengths and the poses.

A homography H = K [r1 r2 p] takes the target's plane to undistorted pixels. With the principal point in the middle of
the image, r1.r2 = 0 and |r1| = |r2| are two linear equations a view in (1 / fx^2, 1 / fy^2).
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.robot import Pose, quaternion_from_matrix
from cpcal.vision.camera import Camera
from cpcal.vision.homography import mapped

_FOCAL_RANGE = (0.2, 20.0)  # of the image's longer side: else the equations say nothing


def homography_rms(matrix: Floats, dots: Floats, centers: Floats) -> float:
    """How far, in pixels per axis, a homography (3, 3) is from taking dots (m, 2) to centers (m, 2)."""
    off = mapped(matrix, dots) - centers
    return float(np.sqrt(np.mean(off**2))) if np.isfinite(off).all() else np.inf


def first_camera(homographies: Floats, size: tuple[int, int]) -> Camera:
    """A pinhole camera without distortion for images of `size` (width, height), from homographies (v, 3, 3)."""
    width, height = size
    center = np.array([0.5 * (width - 1), 0.5 * (height - 1)])
    unit = float(max(size))
    shift = np.array([[1.0, 0.0, -center[0]], [0.0, 1.0, -center[1]], [0.0, 0.0, unit]]) / unit
    h = shift @ homographies
    h = h / np.linalg.norm(h, axis=(1, 2), keepdims=True)
    one, two = h[..., 0], h[..., 1]
    left = np.concatenate([one * two, one * one - two * two])
    focal = _focal(left[:, :2], -left[:, 2]) or _focal(left[:, :2].sum(axis=1, keepdims=True), -left[:, 2]) or (1.0,)
    return Camera(width, height, unit * np.resize(focal, 2), center, np.zeros(5))


def first_pose(matrix: Floats, camera: Camera) -> Pose:
    """The pose of the target in the frame of a camera without distortion, from its homography."""
    k = np.array([[camera.focal[0], 0, camera.center[0]], [0, camera.focal[1], camera.center[1]], [0, 0, 1.0]])
    columns = np.linalg.solve(k, matrix)
    scale = 2.0 / (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1]))
    columns = columns * (scale if columns[2, 2] > 0.0 else -scale)
    u, _, v = np.linalg.svd(columns[:, :2], full_matrices=False)
    x, y = (u @ v).T
    return Pose(columns[:, 2], quaternion_from_matrix(np.stack([x, y, np.cross(x, y)], axis=1)))


def _focal(left: Floats, right: Floats) -> tuple[float, ...] | None:
    inverse_squares = np.linalg.lstsq(left, right, rcond=None)[0]
    if not (inverse_squares > 0.0).all():
        return None
    focal = inverse_squares**-0.5
    inside = (focal > _FOCAL_RANGE[0]) & (focal < _FOCAL_RANGE[1])
    return tuple(focal.tolist()) if inside.all() else None
