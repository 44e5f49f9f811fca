"""Where dots are seen, with derivatives; plane homographies; small closed forms for the hundred dots of an image."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Floats
from cpcal.robot import Pose
from cpcal.solver.compiled import compiled
from cpcal.vision.camera import CAMERA_NUMBERS, JET, PACKED, Camera, jet
from cpcal.vision.opencv import opencv
from cpcal.vision.target import Target


def median(values: npt.NDArray[np.floating]) -> float:
    """Of (n,), n at least 1; nan where one is. Numpy's general one takes five times as long."""
    rising = np.sort(values)  # with any nan at the end
    if np.isnan(rising[-1]):
        return float("nan")
    return 0.5 * float(rising[(len(rising) - 1) // 2] + rising[len(rising) // 2])


# ------------------------------------------------------------------------------------------------------------------
# Symmetric 2 x 2 matrices, many at once, in closed form: several times faster than LAPACK on each.


def determinants(matrices: Floats) -> Floats:
    """(..., 2, 2) -> (...)."""
    return np.asarray(matrices[..., 0, 0] * matrices[..., 1, 1] - matrices[..., 0, 1] * matrices[..., 1, 0])


def eigenvalues(matrices: Floats) -> Floats:
    """(..., 2, 2) -> (..., 2), rising; exact to rounding of the larger one. That of a nan is nan."""
    xx, xy, yy = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    out = np.empty((*half.shape, 2))
    np.subtract(half, apart, out=out[..., 0])
    np.add(half, apart, out=out[..., 1])
    return out


def inverses(matrices: Floats) -> Floats:
    """(..., 2, 2) -> (..., 2, 2), of regular ones."""
    out = np.empty_like(matrices)
    out[..., 0, 0], out[..., 1, 1] = matrices[..., 1, 1], matrices[..., 0, 0]
    out[..., 0, 1], out[..., 1, 0] = -matrices[..., 0, 1], -matrices[..., 1, 0]
    out /= determinants(matrices)[..., None, None]
    return out


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

Four = tuple[float, float, float, float]
_ASIDE = 1e-4  # of a normalised coordinate and of a lens's number: derivatives by differences are good to 1e-8


@compiled
def _dual(square: float, x: float, y: float, z: float, turn: Floats) -> tuple[float, float, float, float, float, float]:
    """D[2, 2], D[:2, :2] (xx, xy, yy) and the centre of a dot at (x, y, z); D[2, 2] is 0 where it is not wholly before
    the camera: it touches the plane Z = 0 where Z <= rho sqrt(1 - n_z^2)."""
    nx, ny, nz = turn[0, 2], turn[1, 2], turn[2, 2]
    w = square * (1.0 - nz * nz) - z * z
    if not (z > 0.0 and w < 0.0):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    xx, xy, yy = square * (1.0 - nx * nx) - x * x, -square * nx * ny - x * y, square * (1.0 - ny * ny) - y * y
    return w, xx, xy, yy, (-square * nx * nz - x * z) / w, (-square * ny * nz - y * z) / w


@compiled
def placed_centers(
    dots: Floats, radius: float, camera: Floats, turn: Floats, at: Floats, slope: bool, centers: Floats, by_pose: Floats
) -> None:
    """The centres (n, 2) pixels of dots (n, 2) mm under the rotation (3, 3) and the position (3,) mm; with `slope`
    their derivatives (n, 2, 6) by position and rotation vector. nan where a dot is not wholly before the camera."""
    square = radius * radius
    lens, nx, ny, nz = camera[4:], turn[0, 2], turn[1, 2], turn[2, 2]
    bend, shape, by = np.empty(JET), np.empty(3), np.empty((2, 5))
    for i in range(len(dots)):
        arm_x = turn[0, 0] * dots[i, 0] + turn[0, 1] * dots[i, 1]
        arm_y = turn[1, 0] * dots[i, 0] + turn[1, 1] * dots[i, 1]
        arm_z = turn[2, 0] * dots[i, 0] + turn[2, 1] * dots[i, 1]
        x, y, z = arm_x + at[0], arm_y + at[1], arm_z + at[2]
        w, bxx, bxy, byy, cx, cy = _dual(square, x, y, z, turn)
        if w == 0.0:
            centers[i] = np.nan
            if slope:
                by_pose[i] = np.nan
            continue
        shape[0], shape[1], shape[2] = cx * cx - bxx / w, cx * cy - bxy / w, cy * cy - byy / w
        u, v, gx, gy = _center(lens, cx, cy, shape, bend)
        centers[i, 0], centers[i, 1] = camera[2] + camera[0] * u, camera[3] + camera[1] * v
        if slope:
            xx, xy, yy = bend[2], bend[3], bend[4]
            by[0, 2], by[0, 3] = 0.125 * (bend[5] + 2.0 * xx * gx), 0.125 * (bend[6] + xx * gy + xy * gx)
            by[0, 4] = 0.125 * (bend[7] + 2.0 * xy * gy)
            by[1, 2], by[1, 3] = 0.125 * (bend[6] + 2.0 * xy * gx), 0.125 * (bend[7] + xy * gy + yy * gx)
            by[1, 4] = 0.125 * (bend[8] + 2.0 * yy * gy)
            for m in range(2):
                dx, dy = (_ASIDE, 0.0) if m == 0 else (0.0, _ASIDE)
                ahead = _center(lens, cx + dx, cy + dy, shape, bend)
                behind = _center(lens, cx - dx, cy - dy, shape, bend)
                by[0, m], by[1, m] = 0.5 * (ahead[0] - behind[0]) / _ASIDE, 0.5 * (ahead[1] - behind[1]) / _ASIDE
            for k in range(2):
                # how the centre moves with the dual conic D: M : dD; with the point -2 M P, with the normal -2 r^2 M n
                sxx, sxy, syy = by[k, 2], by[k, 3], by[k, 4]
                to_x, to_y = by[k, 0] + 2.0 * (sxx * cx + sxy * cy), by[k, 1] + 2.0 * (sxy * cx + syy * cy)
                last = ((sxx * bxx + 2.0 * sxy * bxy + syy * byy) / w - to_x * cx - to_y * cy) / w
                mxx, mxy, myy, mxz, myz = -sxx / w, -sxy / w, -syy / w, 0.5 * to_x / w, 0.5 * to_y / w
                f = -2.0 * camera[k]
                px, py = f * (mxx * x + mxy * y + mxz * z), f * (mxy * x + myy * y + myz * z)
                pz = f * (mxz * x + myz * y + last * z)
                f *= square
                qx, qy = f * (mxx * nx + mxy * ny + mxz * nz), f * (mxy * nx + myy * ny + myz * nz)
                qz = f * (mxz * nx + myz * ny + last * nz)
                by_pose[i, k, 0], by_pose[i, k, 1], by_pose[i, k, 2] = px, py, pz
                by_pose[i, k, 3] = arm_y * pz - arm_z * py + ny * qz - nz * qy
                by_pose[i, k, 4] = arm_z * px - arm_x * pz + nz * qx - nx * qz
                by_pose[i, k, 5] = arm_x * py - arm_y * px + nx * qy - ny * qx


@compiled
def all_placed_centers(
    dots: Floats, radius: float, camera: Floats, turns: Floats, places: Floats, slope: bool, centers: Floats, by: Floats
) -> None:
    """`placed_centers` of rotations (m, 3, 3) and positions (m, 3): (m, n, 2) and, with `slope`, (m, n, 2, 6)."""
    for k in range(len(places)):
        placed_centers(dots, radius, camera, turns[k], places[k], slope, centers[k], by[k])


@compiled
def _center(lens: Floats, x: float, y: float, shape: Floats, bend: Floats) -> Four:
    """The distorted centre, see above, of an ellipse about (x, y) with the shape's xx, xy, yy; and g. The jet of d
    goes into `bend`."""
    jet(lens, x, y, bend)
    xx, xy, yy = bend[2], bend[3], bend[4]
    sxx, sxy, syy = shape[0], shape[1], shape[2]
    det = xx * yy - xy * xy
    gx = (yy * bend[5] - 2.0 * xy * bend[6] + xx * bend[7]) / det
    gy = (yy * bend[6] - 2.0 * xy * bend[7] + xx * bend[8]) / det
    ax, ay = sxx * gx + sxy * gy, sxy * gx + syy * gy  # S g
    u = bend[0] + 0.125 * (bend[5] * sxx + 2.0 * bend[6] * sxy + bend[7] * syy + 2.0 * (xx * ax + xy * ay))
    v = bend[1] + 0.125 * (bend[6] * sxx + 2.0 * bend[7] * sxy + bend[8] * syy + 2.0 * (xy * ax + yy * ay))
    return u, v, gx, gy


def predicted_centers(target: Target, camera: Camera, pose: Pose) -> Floats:
    """Centres (..., n, 2) of the conics through the dots' contours, pixels, for poses of the target in the camera frame
    with any leading axes; nan where a dot is not wholly before the camera."""
    return centers_of(target.dots, target.radius, camera, pose)


def centers_of(dots: Floats, radius: float, camera: Camera, pose: Pose) -> Floats:
    """`predicted_centers` for dots (n, 2) mm of a given radius."""
    return _placed_centers(dots, radius, camera.packed, pose, False)[0]


def centers_by_pose(dots: Floats, radius: float, camera: Camera, pose: Pose) -> tuple[Floats, Floats]:
    """`centers_of`, and their derivatives (..., n, 2, 6) by position (mm) and by the rotation vector w (rad) in the
    camera frame: R becomes R(w) R."""
    return _placed_centers(dots, radius, camera.packed, pose, True)


def by_camera(dots: Floats, radius: float, camera: Camera, pose: Pose, centers: Floats) -> Floats:
    """The derivatives (..., n, 2, 9) of `centers` by fx, fy, cx, cy, k1, k2, p1, p2, k3 of a lens of the model
    "brown"."""
    out = np.zeros((*centers.shape, len(CAMERA_NUMBERS)))
    out[..., [0, 1], [0, 1]] = (centers - camera.center) / camera.focal
    out[..., [0, 1], [2, 3]] = 1.0
    for k, name in enumerate(CAMERA_NUMBERS[4:], start=4):
        step = _ASIDE * np.eye(len(camera.packed))[4 + PACKED.index(name)]
        ahead, behind = (_placed_centers(dots, radius, camera.packed + s * step, pose, False)[0] for s in (1.0, -1.0))
        out[..., k] = 0.5 * (ahead - behind) / _ASIDE
    return out


def _placed_centers(dots: Floats, radius: float, camera: Floats, pose: Pose, slope: bool) -> tuple[Floats, Floats]:
    """Centres (..., n, 2) by a packed camera, and derivatives (..., n, 2, 6) when they are asked for."""
    # not read-only, for which would be compiled once more
    places, dots = np.array(pose.position).reshape(-1, 3), np.array(dots, dtype=np.float64)
    count, shape = len(dots), (*np.shape(pose.position)[:-1], len(dots))
    centers = np.empty((len(places), count, 2))
    by_pose = np.empty((len(places), count if slope else 1, 2, 6))
    all_placed_centers(dots, radius, camera, pose.rotation.reshape(-1, 3, 3), places, slope, centers, by_pose)
    return centers.reshape(*shape, 2), by_pose.reshape(*shape, 2, 6) if slope else by_pose


# ------------------------------------------------------------------------------------------------------------------
# Plane homographies: applied, fitted, and the one-dimensional kind along a line.


def mapped(homography: Floats, points: Floats) -> Floats:
    """Points (..., n, 2) through H (..., 3, 3); nan where they go beyond the horizon (third coordinate <= 0)."""
    turned = points @ np.swapaxes(homography[..., :2], -1, -2) + homography[..., None, :, 2]
    depth = turned[..., 2:]
    return np.asarray(turned[..., :2] / np.where(depth > 0.0, depth, np.nan))


def fitted(points: Floats, images: Floats) -> Floats:
    """The H (3, 3) that takes points (n, 2) to images (n, 2), n >= 4, of norm 1 and with a sign that makes the third
    coordinates of most points positive; nan where they determine none."""
    homography = opencv().findHomography(points, images, 0)[0]
    if homography is None:
        return np.full((3, 3), np.nan)
    depth = points @ homography[2, :2] + homography[2, 2]
    return np.asarray(homography * (np.sign(median(np.sign(depth))) or 1.0) / np.linalg.norm(homography))


def orientation(homography: Floats, points: Floats) -> Floats:
    """The sign (n,) of the area that H gives to a small positive area at each of the points (n, 2)."""
    depth = points @ homography[2, :2] + homography[2, 2]
    return np.asarray(np.sign(np.linalg.det(homography) * depth))
