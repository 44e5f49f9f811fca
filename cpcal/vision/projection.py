"""The median without numpy's generality, which takes five times as long for the hundred numbers of an image's dots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Floats
from cpcal.robot import Pose
from cpcal.solver.compiled import compiled
from cpcal.vision.camera import Camera, Jet, bent, jets_by_coefficient, radial
from cpcal.vision.target import Target


def median(values: npt.NDArray[np.floating]) -> float:
    """Of (n,), n at least 1; nan where one is."""
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
# Where dots' centres are seen, and how they move with the pose, compiled: the formulas of `cpcal.vision.projection`.
#
# A camera is packed as (13,): fx, fy, cx, cy and its lens (`cpcal.vision.camera`). All tensors of a lens are
# symmetric, because d is the gradient of a function: J has the parts xx, xy, yy, its derivative xxx, xxy, xyy, yyy.


@compiled
def placed_centers(
    dots: Floats, radius: float, camera: Floats, turn: Floats, at: Floats, slope: bool, centers: Floats, by_pose: Floats
) -> None:
    """The centres (n, 2) pixels of dots (n, 2) mm under the rotation (3, 3) and the position (3,) mm; with `slope`
    their derivatives (n, 2, 6) by position and rotation vector. nan where a dot is not wholly before the camera."""
    square = radius * radius
    nx, ny, nz = turn[0, 2], turn[1, 2], turn[2, 2]
    jet, shape, by = np.empty(14), np.empty(3), np.empty((2, 6))
    for i in range(len(dots)):
        arm_x = turn[0, 0] * dots[i, 0] + turn[0, 1] * dots[i, 1]
        arm_y = turn[1, 0] * dots[i, 0] + turn[1, 1] * dots[i, 1]
        arm_z = turn[2, 0] * dots[i, 0] + turn[2, 1] * dots[i, 1]
        x, y, z = arm_x + at[0], arm_y + at[1], arm_z + at[2]
        w = square * (1.0 - nz * nz) - z * z
        if not (z > 0.0 and w < 0.0):  # Z <= rho sqrt(1 - n_z^2): the dot touches the plane Z = 0
            centers[i] = np.nan
            if slope:
                by_pose[i] = np.nan
            continue
        bxx, bxy = square * (1.0 - nx * nx) - x * x, -square * nx * ny - x * y
        byy = square * (1.0 - ny * ny) - y * y
        cx, cy = (-square * nx * nz - x * z) / w, (-square * ny * nz - y * z) / w
        shape[0], shape[1], shape[2] = cx * cx - bxx / w, cx * cy - bxy / w, cy * cy - byy / w
        _jet(camera[4:], cx, cy, jet)
        u, v = _center(jet, shape, slope, by)
        centers[i, 0], centers[i, 1] = camera[2] + camera[0] * u, camera[3] + camera[1] * v
        if slope:
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
def _jet(lens: Floats, x: float, y: float, out: Floats) -> None:
    """d (2), and its derivatives of the first (3), second (4) and third (5) order at (x, y)."""
    out[0], out[1], out[2], out[3], out[4] = bent(lens, x, y)
    _, g1, g2, g3 = radial(lens, x * x + y * y)
    p1, p2 = lens[1], lens[2]
    out[5] = 6.0 * g1 * x + 4.0 * g2 * x * x * x + 6.0 * p2
    out[6] = 2.0 * g1 * y + 4.0 * g2 * x * x * y + 2.0 * p1
    out[7] = 2.0 * g1 * x + 4.0 * g2 * x * y * y + 2.0 * p2
    out[8] = 6.0 * g1 * y + 4.0 * g2 * y * y * y + 6.0 * p1
    xx, xy, yy = x * x, x * y, y * y
    out[9] = 6.0 * g1 + 24.0 * g2 * xx + 8.0 * g3 * xx * xx
    out[10] = 12.0 * g2 * xy + 8.0 * g3 * xx * xy
    out[11] = 2.0 * g1 + 4.0 * g2 * (xx + yy) + 8.0 * g3 * xx * yy
    out[12] = 12.0 * g2 * xy + 8.0 * g3 * xy * yy
    out[13] = 6.0 * g1 + 24.0 * g2 * yy + 8.0 * g3 * yy * yy


@compiled
def _center(jet: Floats, shape: Floats, slope: bool, by: Floats) -> tuple[float, float]:
    """The distorted centre d + (H : S + 2 J S g) / 8 with g = grad log det J; with `slope` its derivatives (2, 5) by
    the undistorted centre and by the shape's xx, xy (each of the two), yy."""
    xx, xy, yy = jet[2], jet[3], jet[4]
    sxx, sxy, syy = shape[0], shape[1], shape[2]
    det = xx * yy - xy * xy
    gx = (yy * jet[5] - 2.0 * xy * jet[6] + xx * jet[7]) / det
    gy = (yy * jet[6] - 2.0 * xy * jet[7] + xx * jet[8]) / det
    ax, ay = sxx * gx + sxy * gy, sxy * gx + syy * gy  # S g
    u = jet[0] + 0.125 * (jet[5] * sxx + 2.0 * jet[6] * sxy + jet[7] * syy + 2.0 * (xx * ax + xy * ay))
    v = jet[1] + 0.125 * (jet[6] * sxx + 2.0 * jet[7] * sxy + jet[8] * syy + 2.0 * (xy * ax + yy * ay))
    if slope:
        for m in range(2):  # as the centre moves along x or y
            hxx, hxy, hyy = jet[5 + m], jet[6 + m], jet[7 + m]
            # how g changes: tr J^-1 dH - tr J^-1 dJ J^-1 H, with T = J^-1 dJ J^-1
            txx = (yy * yy * hxx - 2.0 * yy * xy * hxy + xy * xy * hyy) / (det * det)
            txy = (-yy * xy * hxx + (yy * xx + xy * xy) * hxy - xy * xx * hyy) / (det * det)
            tyy = (xy * xy * hxx - 2.0 * xy * xx * hxy + xx * xx * hyy) / (det * det)
            dgx = (yy * jet[9 + m] - 2.0 * xy * jet[10 + m] + xx * jet[11 + m]) / det
            dgx -= txx * jet[5] + 2.0 * txy * jet[6] + tyy * jet[7]
            dgy = (yy * jet[10 + m] - 2.0 * xy * jet[11 + m] + xx * jet[12 + m]) / det
            dgy -= txx * jet[6] + 2.0 * txy * jet[7] + tyy * jet[8]
            bx, by_ = sxx * dgx + sxy * dgy, sxy * dgx + syy * dgy
            second_u = jet[9 + m] * sxx + 2.0 * jet[10 + m] * sxy + jet[11 + m] * syy
            second_v = jet[10 + m] * sxx + 2.0 * jet[11 + m] * sxy + jet[12 + m] * syy
            first_u = hxx * ax + hxy * ay + xx * bx + xy * by_
            first_v = hxy * ax + hyy * ay + xy * bx + yy * by_
            by[0, m] = (xx if m == 0 else xy) + 0.125 * (second_u + 2.0 * first_u)
            by[1, m] = (xy if m == 0 else yy) + 0.125 * (second_v + 2.0 * first_v)
        by[0, 2], by[0, 3] = 0.125 * (jet[5] + 2.0 * xx * gx), 0.125 * (jet[6] + xx * gy + xy * gx)
        by[0, 4] = 0.125 * (jet[7] + 2.0 * xy * gy)
        by[1, 2], by[1, 3] = 0.125 * (jet[6] + 2.0 * xy * gx), 0.125 * (jet[7] + xy * gy + yy * gx)
        by[1, 4] = 0.125 * (jet[8] + 2.0 * yy * gy)
    return u, v


# ------------------------------------------------------------------------------------------------------------------
# Where a dot's centre is seen: the centre of the conic through the image of its circle, and its derivatives.
#
# Under perspective the circle becomes an ellipse whose centre is not the image of the circle's centre. With the dot's
# centre P = (X, Y, Z) and the plate's normal n in the camera frame the dual conic of the ellipse is
#
#     D = rho^2 (I - n n') - P P',    centre c = D[:2, 2] / D[2, 2],    shape S = c c' - D[:2, :2] / D[2, 2],
#
# so that the ellipse is (u - c)' S^-1 (u - c) = 1 (normalised coordinates; exact).
#
# Distortion d bends the ellipse. With e on the ellipse about c, d(c + e) = d + J e + H[e, e] / 2 + ..., where the
# linear
# part keeps an ellipse an ellipse. The quadratic part moves the contour by the field J^-1 H[e, e] / 2; on the unit
# circle
# that the ellipse is after an affine map, a conic follows the harmonics 0, 1 and 2 of the radial displacement, and its
# centre follows the first harmonic alone. Mapped back, the centre of the conic fitted to the contour is
#
#     d(c) + (H : S + 2 J S grad log det J) / 8.
#
# (To this order it is the centroid of the area too, but not the mean of the contour.) What is left out is of the fourth
# order in the dot's size, some 1e-6 pixels for an ordinary lens.


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


# ------------------------------------------------------------------------------------------------------------------
# Plane homographies: applied, fitted, and the one-dimensional kind along a line.


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
