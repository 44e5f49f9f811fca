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
from cpcal.vision.dot_kernel import all_placed_centers
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
    return _placed_centers(dots, radius, camera, pose, False)[0]


def predict(
    dots: Floats, radius: float, camera: Camera, pose: Pose, *, by_camera: bool = False, by_dots: bool = False
) -> Prediction:
    """The centres of dots (n, 2) mm with their derivatives by the pose and, on request, by camera and dots."""
    centers, by_pose = _placed_centers(dots, radius, camera, pose, True)
    return Prediction(
        centers,
        by_pose,
        _by_camera(dots, radius, camera, pose, (centers - camera.center) / camera.focal) if by_camera else None,
        by_pose[..., :3] @ pose.rotation[..., None, :, :2] if by_dots else None,
    )


def _placed_centers(dots: Floats, radius: float, camera: Camera, pose: Pose, slope: bool) -> tuple[Floats, Floats]:
    """Centres (..., n, 2), and derivatives (..., n, 2, 6) when they are asked for, by compiled code."""
    given = np.array(dots, dtype=np.float64)  # not read-only, which would be compiled once more
    shape = (*np.shape(pose.position)[:-1], len(given))
    turns, places = pose.rotation.reshape(-1, 3, 3), np.array(pose.position).reshape(-1, 3)
    centers = np.empty((len(places), len(given), 2))
    by_pose = np.empty((len(places), len(given) if slope else 1, 2, 6))
    all_placed_centers(given, radius, camera.packed, turns, places, slope, centers, by_pose)
    return centers.reshape(*shape, 2), by_pose.reshape(*shape, 2, 6) if slope else by_pose


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


def _growth(lens: Jet) -> tuple[Floats, Floats]:
    """J^-1 (..., 2, 2) and g = grad log det J (..., 2)."""
    j = lens.first
    adjugate = np.stack([np.stack([j[..., 1, 1], -j[..., 0, 1]], -1), np.stack([-j[..., 1, 0], j[..., 0, 0]], -1)], -2)
    determinant = j[..., 0, 0] * j[..., 1, 1] - j[..., 0, 1] * j[..., 1, 0]
    inverse = np.asarray(adjugate / determinant[..., None, None])
    return inverse, np.einsum("...ba,...abc->...c", inverse, lens.second)


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


def _by_camera(dots: Floats, radius: float, camera: Camera, pose: Pose, bent: Floats) -> Floats:
    """(..., n, 2, 9) by fx, fy, cx, cy, k1, k2, p1, p2, k3, at dots whose distorted centres are `bent` (..., n, 2)."""
    center, shape = _ellipse(_dual(*_placed(dots, pose), radius))
    lens = camera.lens.jet(center, camera.distortion)
    out = np.zeros((*bent.shape, 9))
    for axis in range(2):
        out[..., axis, axis] = bent[..., axis]
        out[..., axis, 2 + axis] = 1.0
    by_lens = _bent_direction(lens, shape, jets_by_coefficient(center), _growth(lens))
    out[..., 4:] = np.swapaxes(by_lens * camera.focal, -1, -2)
    return out
