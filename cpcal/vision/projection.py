"""Where dots are seen, with derivatives; plane homographies; small closed forms for the hundred dots of an image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Floats
from cpcal.robot import Pose
from cpcal.solver.compiled import compiled
from cpcal.vision.camera import JET, LENSES, PACKED, Camera, jet
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

_BROWN = np.array([PACKED.index(name) for name in LENSES["brown"]])  # where a lens of that model has its numbers


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
    nx, ny, nz = turn[0, 2], turn[1, 2], turn[2, 2]
    bend, shape, by = np.empty(JET), np.empty(5), np.empty((2, 5))
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
        jet(camera[4:], cx, cy, bend)
        u, v = _center(bend, shape)
        centers[i, 0], centers[i, 1] = camera[2] + camera[0] * u, camera[3] + camera[1] * v
        if slope:
            _center_slopes(bend, shape, by)
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
def all_by_lens(dots: Floats, radius: float, camera: Floats, turns: Floats, places: Floats, out: Floats) -> None:
    """The derivatives (m, n, 2, 5) of such centres by k1, k2, p1, p2, k3 of a lens of the model "brown", of which d is
    a sum: each moves it as the lens that has this number alone differs from none."""
    bend, alone, shape, one = np.empty(JET), np.empty(JET), np.empty(5), np.zeros(len(camera) - 4)
    for m in range(len(places)):
        turn = turns[m]
        for i in range(len(dots)):
            x = turn[0, 0] * dots[i, 0] + turn[0, 1] * dots[i, 1] + places[m, 0]
            y = turn[1, 0] * dots[i, 0] + turn[1, 1] * dots[i, 1] + places[m, 1]
            z = turn[2, 0] * dots[i, 0] + turn[2, 1] * dots[i, 1] + places[m, 2]
            w, xx, xy, yy, cx, cy = _dual(radius * radius, x, y, z, turn)
            if w == 0.0:
                out[m, i] = np.nan
                continue
            shape[0], shape[1], shape[2] = cx * cx - xx / w, cx * cy - xy / w, cy * cy - yy / w
            jet(camera[4:], cx, cy, bend)
            _center(bend, shape)
            for k in range(5):
                one[_BROWN[k]] = 1.0
                jet(one, cx, cy, alone)
                one[_BROWN[k]] = 0.0
                u, v = _moved_center(bend, shape, alone[2] - 1.0, alone[3], alone[4] - 1.0, alone[5:9])
                out[m, i, 0, k], out[m, i, 1, k] = camera[0] * (alone[0] - cx + u), camera[1] * (alone[1] - cy + v)


@compiled
def _center(bend: Floats, shape: Floats) -> tuple[float, float]:
    """The distorted centre, see above, by the jet of d and the shape's xx, xy, yy; g goes into shape[3:]."""
    xx, xy, yy = bend[2], bend[3], bend[4]
    sxx, sxy, syy = shape[0], shape[1], shape[2]
    det = xx * yy - xy * xy
    gx = (yy * bend[5] - 2.0 * xy * bend[6] + xx * bend[7]) / det
    gy = (yy * bend[6] - 2.0 * xy * bend[7] + xx * bend[8]) / det
    shape[3], shape[4] = gx, gy
    ax, ay = sxx * gx + sxy * gy, sxy * gx + syy * gy  # S g
    u = bend[0] + 0.125 * (bend[5] * sxx + 2.0 * bend[6] * sxy + bend[7] * syy + 2.0 * (xx * ax + xy * ay))
    v = bend[1] + 0.125 * (bend[6] * sxx + 2.0 * bend[7] * sxy + bend[8] * syy + 2.0 * (xy * ax + yy * ay))
    return u, v


@compiled
def _moved_center(
    bend: Floats, shape: Floats, jxx: float, jxy: float, jyy: float, second: Floats
) -> tuple[float, float]:
    """How (H : S + 2 J S g) / 8 changes as J and H (4) do; g by tr J^-1 dH - tr J^-1 dJ J^-1 H."""
    xx, xy, yy = bend[2], bend[3], bend[4]
    sxx, sxy, syy, gx, gy = shape[0], shape[1], shape[2], shape[3], shape[4]
    det = xx * yy - xy * xy
    ax, ay = sxx * gx + sxy * gy, sxy * gx + syy * gy
    txx = (yy * yy * jxx - 2.0 * yy * xy * jxy + xy * xy * jyy) / (det * det)  # T = J^-1 dJ J^-1
    txy = (-yy * xy * jxx + (yy * xx + xy * xy) * jxy - xy * xx * jyy) / (det * det)
    tyy = (xy * xy * jxx - 2.0 * xy * xx * jxy + xx * xx * jyy) / (det * det)
    dgx = (yy * second[0] - 2.0 * xy * second[1] + xx * second[2]) / det
    dgx -= txx * bend[5] + 2.0 * txy * bend[6] + tyy * bend[7]
    dgy = (yy * second[1] - 2.0 * xy * second[2] + xx * second[3]) / det
    dgy -= txx * bend[6] + 2.0 * txy * bend[7] + tyy * bend[8]
    bx, by = sxx * dgx + sxy * dgy, sxy * dgx + syy * dgy
    u = second[0] * sxx + 2.0 * second[1] * sxy + second[2] * syy + 2.0 * (jxx * ax + jxy * ay + xx * bx + xy * by)
    v = second[1] * sxx + 2.0 * second[2] * sxy + second[3] * syy + 2.0 * (jxy * ax + jyy * ay + xy * bx + yy * by)
    return 0.125 * u, 0.125 * v


@compiled
def _center_slopes(bend: Floats, shape: Floats, by: Floats) -> None:
    """The derivatives (2, 5) of the distorted centre by the undistorted one and by the shape's xx, xy (of both), yy."""
    xx, xy, yy, gx, gy = bend[2], bend[3], bend[4], shape[3], shape[4]
    for m in range(2):  # as the centre moves along x or y
        u, v = _moved_center(bend, shape, bend[5 + m], bend[6 + m], bend[7 + m], bend[9 + m : 13 + m])
        by[0, m], by[1, m] = bend[2 + m] + u, bend[3 + m] + v
    by[0, 2], by[0, 3] = 0.125 * (bend[5] + 2.0 * xx * gx), 0.125 * (bend[6] + xx * gy + xy * gx)
    by[0, 4] = 0.125 * (bend[7] + 2.0 * xy * gy)
    by[1, 2], by[1, 3] = 0.125 * (bend[6] + 2.0 * xy * gx), 0.125 * (bend[7] + xy * gy + yy * gx)
    by[1, 4] = 0.125 * (bend[8] + 2.0 * yy * gy)


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
    numbers = None
    if by_camera:
        numbers = np.zeros((*centers.shape, 9))
        numbers[..., [0, 1], [0, 1]] = (centers - camera.center) / camera.focal
        numbers[..., [0, 1], [2, 3]] = 1.0
        by_lens = np.empty((pose.position.size // 3, len(dots), 2, 5))
        all_by_lens(*_arguments(dots, radius, camera, pose), by_lens)
        numbers[..., 4:] = by_lens.reshape(*centers.shape, 5)
    return Prediction(
        centers, by_pose, numbers, by_pose[..., :3] @ pose.rotation[..., None, :, :2] if by_dots else None
    )


def _placed_centers(dots: Floats, radius: float, camera: Camera, pose: Pose, slope: bool) -> tuple[Floats, Floats]:
    """Centres (..., n, 2), and derivatives (..., n, 2, 6) when they are asked for, by compiled code."""
    given = _arguments(dots, radius, camera, pose)
    count, shape = len(given[0]), (*np.shape(pose.position)[:-1], len(given[0]))
    centers = np.empty((len(given[4]), count, 2))
    by_pose = np.empty((len(given[4]), count if slope else 1, 2, 6))
    all_placed_centers(*given, slope, centers, by_pose)
    return centers.reshape(*shape, 2), by_pose.reshape(*shape, 2, 6) if slope else by_pose


def _arguments(dots: Floats, radius: float, camera: Camera, pose: Pose) -> tuple[Floats, float, Floats, Floats, Floats]:
    """Not read-only, for which would be compiled once more."""
    places = np.array(pose.position).reshape(-1, 3)
    return np.array(dots, dtype=np.float64), radius, camera.packed, pose.rotation.reshape(-1, 3, 3), places


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
