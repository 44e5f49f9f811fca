"""Where a dot's centre is seen: the centre of the conic through the image of its circle, and its derivatives.

Under perspective the circle becomes an ellipse whose centre is not the image of the circle's centre. With the dot's
centre P = (X, Y, Z) and the plate's normal n in the camera frame the dual conic of the ellipse is

    D = rho^2 (I - n n') - P P',    centre c = D[:2, 2] / D[2, 2],    shape S = c c' - D[:2, :2] / D[2, 2],

so that the ellipse is (u - c)' S^-1 (u - c) = 1 (normalised coordinates; exact).

Distortion d bends the ellipse. With e on the ellipse about c, d(c + e) = d + J e + H[e, e] / 2 + ..., where the linear
part keeps an ellipse an ellipse. The quadratic part moves the contour by the field J^-1 H[e, e] / 2; on the unit circle
that the ellipse is after an affine map, a conic follows the harmonics 0, 1 and 2 of the radial displacement, and its
centre follows the first harmonic alone. Mapped back, the centre of the conic fitted to the contour is

    d(c) + (H : S + 2 J S grad log det J) / 8.

(To this order it is the centroid of the area too, but not the mean of the contour.) What is left out is of the fourth
order in the dot's size, some 1e-6 pixels for an ordinary lens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.robot import Pose
from cpcal.vision.camera import Camera
from cpcal.vision.lens import Jet, jets_by_coefficient
from cpcal.vision.target import Target


@dataclass(frozen=True, eq=False)
class Prediction:
    """Centres with their derivatives; leading axes are those of the poses.

    centers    (..., n, 2) pixels; nan where a dot is not wholly before the camera
    by_pose    (..., n, 2, 6) by position (mm) and by the rotation vector w (rad) in the camera frame: R becomes R(w) R
    by_camera  (..., n, 2, 9) by fx, fy, cx, cy, k1, k2, p1, p2, k3; None when not asked for
    by_dots    (..., n, 2, 2) of each dot by its own x, y on the target (mm); None when not asked for
    """

    centers: Floats
    by_pose: Floats
    by_camera: Floats | None = None
    by_dots: Floats | None = None


def predicted_centers(target: Target, camera: Camera, pose: Pose) -> Floats:
    """Centres (..., n, 2) of the conics through the dots' contours, pixels, for poses of the target in the camera frame
    with any leading axes; nan where a dot is not wholly before the camera."""
    return centers_of(target.dots, target.radius, camera, pose)


def centers_of(dots: Floats, radius: float, camera: Camera, pose: Pose) -> Floats:
    """`predicted_centers` for dots (n, 2) mm of a given radius."""
    points, normal = _placed(dots, pose)
    center, shape = _ellipse(_dual(points, normal, radius))
    lens = camera.lens.jet(center, camera.distortion)
    return np.asarray(camera.center + camera.focal * _bent(lens, shape, _growth(lens)[1]))


def predict(
    dots: Floats, radius: float, camera: Camera, pose: Pose, *, by_camera: bool = False, by_dots: bool = False
) -> Prediction:
    """The centres of dots (n, 2) mm with their derivatives by the pose and, on request, by camera and dots."""
    points, normal = _placed(dots, pose)
    dual = _dual(points, normal, radius)
    center, shape = _ellipse(dual)
    lens = camera.lens.jet(center, camera.distortion)
    growth = _growth(lens)
    bent = _bent(lens, shape, growth[1])
    slope = camera.focal[:, None, None] * _by_dual(dual, lens, shape, growth)  # (..., n, 2, 3, 3)
    by_point = -2.0 * (slope @ points[..., None, :, None])[..., 0]
    by_normal = (-2.0 * radius * radius) * (slope @ normal[..., None, :, None])[..., 0]
    arm = (points - pose.position[..., None, :])[..., None, :]
    by_turn = _crossed(arm, by_point) + _crossed(normal[..., None, :], by_normal)
    return Prediction(
        camera.center + camera.focal * bent,
        np.concatenate([by_point, by_turn], axis=-1),
        _by_camera(center, camera, lens, bent, shape, growth) if by_camera else None,
        by_point @ pose.rotation[..., None, :, :2] if by_dots else None,
    )


def _placed(dots: Floats, pose: Pose) -> tuple[Floats, Floats]:
    """Dots' centres (..., n, 3) and the plate's normal (..., 1, 3) in the camera frame."""
    turn = pose.rotation
    points = dots @ np.swapaxes(turn[..., :, :2], -1, -2) + pose.position[..., None, :]
    return points, np.asarray(turn[..., None, :, 2])


def _dual(points: Floats, normal: Floats, radius: float) -> Floats:
    """The dual conics D (..., n, 3, 3); nan for a dot that reaches behind the camera."""
    square = radius * radius
    dual = square * (np.eye(3) - _outer(normal, normal)) - _outer(points, points)
    hidden = (points[..., 2] <= 0.0) | (dual[..., 2, 2] >= 0.0)  # Z <= rho sqrt(1 - n_z^2): it touches the plane Z = 0
    return np.where(hidden[..., None, None], np.nan, dual)


def _ellipse(dual: Floats) -> tuple[Floats, Floats]:
    center = np.asarray(dual[..., :2, 2] / dual[..., 2:, 2])
    return center, _outer(center, center) - dual[..., :2, :2] / dual[..., 2:, 2:]


def _outer(left: Floats, right: Floats) -> Floats:
    return left[..., :, None] * right[..., None, :]


def _crossed(left: Floats, right: Floats) -> Floats:
    """The vector product, several times faster than numpy's."""
    a, b, c = left[..., 0], left[..., 1], left[..., 2]
    x, y, z = right[..., 0], right[..., 1], right[..., 2]
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)


def _by_dual(dual: Floats, lens: Jet, shape: Floats, growth: tuple[Floats, Floats]) -> Floats:
    """M (..., n, 2, 3, 3), symmetric: the distorted centre moves by M : dD when the dual conic moves by dD.

    With D = [[B, a], [a', w]]: c = a / w and S = c c' - B / w, so dc = (da - c dw) / w and
    dS = dc c' + c dc' - dB / w + B dw / w^2.
    """
    center, scale = dual[..., :2, 2] / dual[..., 2:, 2], dual[..., None, 2, 2]
    turned = lens.first[..., :, None] * growth[1][..., None, None, :]
    by_shape = 0.125 * (lens.second + turned + np.swapaxes(turned, -1, -2))
    by_center = np.swapaxes(_bent_direction(lens, shape, _along_axes(lens), growth), -1, -2)
    by_center = by_center + 2.0 * (by_shape @ center[..., None, :, None])[..., 0]
    out = np.empty((*by_center.shape[:-1], 3, 3))
    out[..., :2, :2] = -by_shape / scale[..., None, None]
    out[..., :2, 2] = out[..., 2, :2] = 0.5 * by_center / scale[..., None]
    by_block = np.einsum("...iab,...ab->...i", by_shape, dual[..., :2, :2])
    out[..., 2, 2] = (by_block / scale - np.einsum("...ia,...a->...i", by_center, center)) / scale
    return out


def _growth(lens: Jet) -> tuple[Floats, Floats]:
    """J^-1 (..., 2, 2) and g = grad log det J (..., 2)."""
    j = lens.first
    adjugate = np.stack([np.stack([j[..., 1, 1], -j[..., 0, 1]], -1), np.stack([-j[..., 1, 0], j[..., 0, 0]], -1)], -2)
    determinant = j[..., 0, 0] * j[..., 1, 1] - j[..., 0, 1] * j[..., 1, 0]
    inverse = np.asarray(adjugate / determinant[..., None, None])
    return inverse, np.einsum("...ba,...abc->...c", inverse, lens.second)


def _bent(lens: Jet, shape: Floats, growth: Floats) -> Floats:
    """The distorted centre (..., 2): d + (H : S + 2 J S g) / 8."""
    second = (lens.second * shape[..., None, :, :]).sum(axis=(-1, -2))
    first = lens.first @ (shape @ growth[..., None])
    return np.asarray(lens.value + 0.125 * (second + 2.0 * first[..., 0]))


def _along_axes(lens: Jet) -> Jet:
    """How the jet changes along x and y: an axis of 2 after those of the points. (Third derivatives: not needed.)"""
    return Jet(
        np.swapaxes(lens.first, -1, -2), np.moveaxis(lens.second, -1, -3), np.moveaxis(lens.third, -1, -4), lens.third
    )


def _bent_direction(lens: Jet, shape: Floats, moved: Jet, growing: tuple[Floats, Floats]) -> Floats:
    """How the distorted centre moves as the jet does in m ways, (..., m, 2); the shape stays.

    The change of g = tr J^-1 dJ is tr J^-1 dH - tr J^-1 dJ J^-1 H.
    """
    inverse, growth = growing
    turned = inverse[..., None, :, :] @ moved.first @ inverse[..., None, :, :]
    d_growth = np.einsum("...ba,...mabc->...mc", inverse, moved.second) - np.einsum(
        "...mba,...abc->...mc", turned, lens.second
    )
    second = np.einsum("...mabc,...bc->...ma", moved.second, shape)
    first = np.einsum("...mab,...b->...ma", moved.first, (shape @ growth[..., None])[..., 0])
    last = d_growth @ np.swapaxes(lens.first @ shape, -1, -2)
    return np.asarray(moved.value + 0.125 * (second + 2.0 * (first + last)))


def _by_camera(
    center: Floats, camera: Camera, lens: Jet, bent: Floats, shape: Floats, growth: tuple[Floats, Floats]
) -> Floats:
    """(..., n, 2, 9) by fx, fy, cx, cy, k1, k2, p1, p2, k3."""
    out = np.zeros((*bent.shape, 9))
    for axis in range(2):
        out[..., axis, axis] = bent[..., axis]
        out[..., axis, 2 + axis] = 1.0
    by_lens = _bent_direction(lens, shape, jets_by_coefficient(center), growth)
    out[..., 4:] = np.swapaxes(by_lens * camera.focal, -1, -2)
    return out
