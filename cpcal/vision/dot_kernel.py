"""Where dots' centres are seen, and how they move with the pose, compiled: the formulas of `cpcal.vision.dot_model`.

A camera is packed as (13,): fx, fy, cx, cy and its lens (`cpcal.vision.lens_kernel`). All tensors of a lens are
symmetric, because d is the gradient of a function: J has the parts xx, xy, yy, its derivative xxx, xxy, xyy, yyy.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled
from cpcal.vision.lens_kernel import bent, radial


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
