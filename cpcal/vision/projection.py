"""Where dots are seen, with derivatives; plane homographies; small closed forms for the hundred dots of an image."""

from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.values import ArrayPair, Floats, Pair
from cpcal.robot import Pose
from cpcal.solver.compiled import compiled
from cpcal.vision.camera import CAMERA_NUMBERS, JET, PACKED, Camera, jet
from cpcal.vision.target import Target


def median(values: npt.NDArray[np.floating]) -> float:
    """Of (n,), n at least 1; nan where one is. Numpy's general one takes five times as long."""
    rising = np.sort(values)  # with any nan at the end
    if np.isnan(rising[-1]):
        return float("nan")
    return 0.5 * float(rising[(len(rising) - 1) // 2] + rising[len(rising) // 2])


# ------------------------------------------------------------------------------------------------------------------
# Symmetric 2 x 2 matrices, many at once, in closed form: several times faster than LAPACK on each.


def eigenvalues(matrices: Floats) -> Floats:
    """(..., 2, 2) -> (..., 2), rising; exact to rounding of the larger one. That of a nan is nan."""
    xx, xy, yy = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    out = np.empty((*half.shape, 2))
    np.subtract(half, apart, out=out[..., 0])
    np.add(half, apart, out=out[..., 1])
    return out


# ------------------------------------------------------------------------------------------------------------------
# A small symmetric positive definite system, compiled, for fits that solve one in every step.


@compiled
def solved(
    matrix: npt.NDArray[np.floating[Any]], size: int, damping: float, least: float, right: Floats, out: Floats
) -> bool:
    """out = (matrix + damping diag(matrix))^-1 right, of the first `size`, by the Cholesky factor scaled to a unit
    diagonal. False where the diagonal is not above `least`, or the matrix is not positive definite.
    """
    factor, scale = np.empty((size, size)), np.empty(size)  # one over the factor's diagonal in the diagonal's place
    for i in range(size):
        if not matrix[i, i] > least:
            return False
        scale[i] = 1.0 / np.sqrt(matrix[i, i])
        for j in range(i):
            value = matrix[i, j] * scale[i] * scale[j]
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            factor[i, j] = value * factor[j, j]
        value = matrix[i, i] * scale[i] * scale[i] + damping
        for k in range(i):
            value -= factor[i, k] * factor[i, k]
        if not value > 0.0:
            return False
        factor[i, i] = 1.0 / np.sqrt(value)
    for i in range(size):
        value = right[i] * scale[i]
        for k in range(i):
            value -= factor[i, k] * out[k]
        out[i] = value * factor[i, i]
    for i in range(size - 1, -1, -1):
        value = out[i]
        for k in range(i + 1, size):
            value -= factor[k, i] * out[k]
        out[i] = value * factor[i, i]
    for i in range(size):
        out[i] *= scale[i]
    return True


# ------------------------------------------------------------------------------------------------------------------
# Where a dot's centre is seen: the centre of the conic through the image of its circle, and its derivatives; compiled.
#
# Under perspective the circle becomes an ellipse whose centre is not the image of the circle's centre. With the dot's
# centre P = (X, Y, Z) and the plate's normal n in the camera frame the dual conic of the ellipse is
#
#     D = rho^2 (I - n n') - P P',    centre c = D[:2, 2] / D[2, 2],    shape S = c c' - D[:2, :2] / D[2, 2],
#
# so that the ellipse is (u - c)' S^-1 (u - c) = 1 (normalised coordinates; exact).
#
# Distortion d bends the ellipse. With e on the ellipse about c, d(c + e) = d + J e + H[e, e] / 2 + ..., where the
# linear part keeps an ellipse an ellipse. The quadratic part moves the contour by the field J^-1 H[e, e] / 2; on the
# unit circle that the ellipse is after an affine map, a conic follows the harmonics 0, 1 and 2 of the radial
# displacement, and its centre follows the first harmonic alone. Mapped back, the centre of the conic fitted to the
# contour is
#
#     d(c) + (H : S + 2 J S g) / 8,    g = grad log det J.
#
# (To this order it is the centroid of the area too, but not the mean of the contour.) What is left out is of the fourth
# order in the dot's size, some 1e-6 pixels for an ordinary lens.
#
# A camera is packed as (13,): fx, fy, cx, cy and its lens (`cpcal.vision.camera`).

_ASIDE = 1e-4  # of a lens's number: derivatives by differences are good to 1e-8


@compiled
def placed_centers(
    dots: Floats, radius: float, camera: Floats, turns: Floats, places: Floats, centers: Floats, by_pose: Floats
) -> None:
    """The centres (m, n, 2) pixels of dots (n, 2) mm under rotations (m, 3, 3) and positions (m, 3) mm, and their
    derivatives (m, n, 2, 6) by position and rotation vector, those of d(c): a thousandth off at most. nan where a dot
    is not wholly before the camera."""
    square = radius * radius
    bend, shape = np.empty(JET), np.empty(3)
    for m in range(len(places)):
        turn = turns[m]
        nx, ny, nz = turn[0, 2], turn[1, 2], turn[2, 2]
        for i in range(len(dots)):
            arm_x = turn[0, 0] * dots[i, 0] + turn[0, 1] * dots[i, 1]
            arm_y = turn[1, 0] * dots[i, 0] + turn[1, 1] * dots[i, 1]
            arm_z = turn[2, 0] * dots[i, 0] + turn[2, 1] * dots[i, 1]
            x, y, z = arm_x + places[m, 0], arm_y + places[m, 1], arm_z + places[m, 2]
            w = square * (1.0 - nz * nz) - z * z  # D[2, 2]
            if not (z > 0.0 and w < 0.0):  # it touches the plane Z = 0 where Z <= rho sqrt(1 - n_z^2)
                centers[m, i], by_pose[m, i] = np.nan, np.nan
                continue
            cx, cy = (-square * nx * nz - x * z) / w, (-square * ny * nz - y * z) / w
            shape[0] = cx * cx - (square * (1.0 - nx * nx) - x * x) / w
            shape[1] = cx * cy + (square * nx * ny + x * y) / w
            shape[2] = cy * cy - (square * (1.0 - ny * ny) - y * y) / w
            u, v = _center(camera[4:], cx, cy, shape, bend)
            centers[m, i, 0], centers[m, i, 1] = camera[2] + camera[0] * u, camera[3] + camera[1] * v
            for k in range(2):
                # J dc = M : dD; with the point -2 M P, with the normal -2 rho^2 M n
                a, b = -camera[k] * bend[2 + k] / w, -camera[k] * bend[3 + k] / w
                c = -2.0 * (a * cx + b * cy)
                px, py, pz = a * z, b * z, a * x + b * y + c * z
                qx, qy, qz = square * a * nz, square * b * nz, square * (a * nx + b * ny + c * nz)
                slope = by_pose[m, i, k]
                slope[0], slope[1], slope[2] = px, py, pz
                slope[3] = arm_y * pz - arm_z * py + ny * qz - nz * qy
                slope[4] = arm_z * px - arm_x * pz + nz * qx - nx * qz
                slope[5] = arm_x * py - arm_y * px + nx * qy - ny * qx


@compiled
def _center(lens: Floats, x: float, y: float, shape: Floats, bend: Floats) -> Pair:
    """The distorted centre, see above, of an ellipse about (x, y) with the shape's xx, xy, yy. The jet of d goes into
    `bend`."""
    jet(lens, x, y, bend)
    xx, xy, yy = bend[2], bend[3], bend[4]
    sxx, sxy, syy = shape[0], shape[1], shape[2]
    det = xx * yy - xy * xy
    gx = (yy * bend[5] - 2.0 * xy * bend[6] + xx * bend[7]) / det
    gy = (yy * bend[6] - 2.0 * xy * bend[7] + xx * bend[8]) / det
    ax, ay = sxx * gx + sxy * gy, sxy * gx + syy * gy  # S g
    u = bend[0] + 0.125 * (bend[5] * sxx + 2.0 * bend[6] * sxy + bend[7] * syy + 2.0 * (xx * ax + xy * ay))
    v = bend[1] + 0.125 * (bend[6] * sxx + 2.0 * bend[7] * sxy + bend[8] * syy + 2.0 * (xy * ax + yy * ay))
    return u, v


def predicted_centers(target: Target, camera: Camera, pose: Pose) -> Floats:
    """Centres (..., n, 2) of the conics through the dots' contours, pixels, for poses of the target in the camera frame
    with any leading axes; nan where a dot is not wholly before the camera."""
    return centers_by_pose(target.dots, target.radius, camera.packed, pose)[0]


def centers_by_pose(dots: Floats, radius: float, camera: Floats, pose: Pose) -> ArrayPair:
    """`predicted_centers` of dots (n, 2) mm by a packed camera, and their derivatives (..., n, 2, 6) by position (mm)
    and by the rotation vector w (rad) in the camera frame: R becomes R(w) R."""
    # not read-only, for which would be compiled once more
    places, dots = np.array(pose.position).reshape(-1, 3), np.array(dots, np.float64)
    shape = *np.shape(pose.position)[:-1], len(dots), 2
    centers, by_pose = np.empty((len(places), len(dots), 2)), np.empty((len(places), len(dots), 2, 6))
    placed_centers(dots, radius, camera, pose.rotation.reshape(-1, 3, 3), places, centers, by_pose)
    return centers.reshape(shape), by_pose.reshape(*shape, 6)


def by_camera(dots: Floats, radius: float, camera: Camera, pose: Pose, centers: Floats) -> Floats:
    """The derivatives (..., n, 2, 9) of `centers` by fx, fy, cx, cy, k1, k2, p1, p2, k3 of a lens of the model
    "brown"."""
    out = np.zeros((*centers.shape, len(CAMERA_NUMBERS)))
    out[..., [0, 1], [0, 1]] = (centers - camera.center) / camera.focal
    out[..., [0, 1], [2, 3]] = 1.0
    for k, name in enumerate(CAMERA_NUMBERS[4:], start=4):
        step = _ASIDE * np.eye(len(camera.packed))[4 + PACKED.index(name)]
        ahead, behind = (centers_by_pose(dots, radius, camera.packed + s * step, pose)[0] for s in (1.0, -1.0))
        out[..., k] = 0.5 * (ahead - behind) / _ASIDE
    return out


# ------------------------------------------------------------------------------------------------------------------
# Plane homographies.


def mapped(homography: Floats, points: Floats) -> Floats:
    """Points (..., n, 2) through H (..., 3, 3); nan where they go beyond the horizon (third coordinate <= 0)."""
    turned = points @ np.swapaxes(homography[..., :2], -1, -2) + homography[..., None, :, 2]
    depth = turned[..., 2:]
    return turned[..., :2] / np.where(depth > 0.0, depth, np.nan)


def fitted(points: Floats, images: Floats) -> Floats:
    """The H (3, 3) that takes points (n, 2) to images (n, 2), n >= 4, with 1 as the third coordinate of the points'
    mean; nan where they determine none."""
    homography = np.full((3, 3), np.nan)
    fit_homography(points, np.array(images), 8, homography)  # not read-only
    return homography


@compiled
def fit_homography(points: Floats, images: Floats, size: int, out: Floats) -> bool:
    """`fitted`, by linear least squares: of a homography (`size` 8), or of an affine map (6). False, and `out` stays,
    where the points determine none."""
    count, x, y = len(points), points[:, 0].mean(), points[:, 1].mean()
    rows, numbers = np.zeros((2 * count, 8)), np.zeros(9)
    for i in range(count):
        for k in range(2):
            row, place = rows[2 * i + k], images[i, k]
            row[3 * k], row[3 * k + 1], row[3 * k + 2] = points[i, 0] - x, points[i, 1] - y, 1.0
            row[6], row[7] = -row[3 * k] * place, -row[3 * k + 1] * place
    if not solved(np.dot(rows.T, rows), size, 0.0, 0.0, np.dot(images.copy().reshape(-1), rows), numbers):
        return False
    numbers[8] = 1.0
    out[:] = numbers.reshape(3, 3)
    out[:, 2] -= x * out[:, 0] + y * out[:, 1]
    return True
