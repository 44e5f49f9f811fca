"""A first box of poses, proved for all rotations and all positions at once, by linear programs.

The target is flat: with barycentric coordinates (u, v, w) of dot i with respect to three dots A, B, C that lie on no
line, the dot is at X_i = u X_A + v X_B + w X_C in the camera frame, whatever the pose. So the half-spaces g . X_i <= 0
of its viewing pyramid are *linear* in the nine coordinates of A, B and C. They are homogeneous, and all Z are
positive: scaling by 1 / (Z_A + Z_B + Z_C) leaves eight unknowns with bounds that are known beforehand (0 <= Z <= 1,
and X / Z within the pyramid). Linear programs, their bounds proved from their multipliers, give a box of these
unknowns.

The columns h1, h2 of the homography and its translation are linear in them; a rigid motion has |h1| = |h2| = 1 after
scaling back, which gives the scale, and h3 = h1 x h2. So every pose that shows all dots in their boxes lies in what
comes out, and no region to look in has to be stated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.contract import Contractor, Repeat
from cpcal.solver.interval import IntervalArray
from cpcal.solver.model import Network
from cpcal.solver.network import ConstraintNetwork
from cpcal.vision.pose_sets.enclosed import (
    ENGINE,
    cross,
    exact,
    inner,
    joined,
    stacked,
    transposed,
    with_float_coefficients,
)
from cpcal.vision.pose_sets.pyramid import Pyramids

_PASSES = 3
_FLAT = 1e-3  # triangles of this height over their longest side are no triangles


@dataclass(frozen=True)
class Motions:
    """A box of rigid motions of the target in the camera frame: rotation (3, 3) and position (3,) mm, enclosed."""

    rotation: IntervalArray
    position: IntervalArray


def corner_dots(dots: Floats) -> tuple[int, int, int] | None:
    """Three dots (numbers of rows (n, 2)) far apart and far from collinear; None where all lie nearly on a line."""
    if len(dots) < 3:
        return None
    a = int(np.argmax(np.linalg.norm(dots - dots.mean(axis=0), axis=1)))
    b = int(np.argmax(np.linalg.norm(dots - dots[a], axis=1)))
    side, away = dots[b] - dots[a], dots - dots[a]
    height = np.abs(side[0] * away[:, 1] - side[1] * away[:, 0])
    c = int(np.argmax(height))
    return None if height[c] <= _FLAT * float(side @ side) else (a, b, c)


def first_motions(
    dots: Floats, pyramids: Pyramids, contractor_of: Callable[[ConstraintNetwork], Contractor]
) -> Motions | str | None:
    """All motions that show dot i, at dots (m, 2) mm of the plane z = 0, within pyramid i, in front of the camera.

    None: proved that there is none. A text says why nothing bounded could be proved.
    """
    corners = corner_dots(dots)
    if corners is None:
        return "the dots are on a line, or fewer than three"
    network = homography_network(dots, pyramids)
    contractor = contractor_of(network)
    box = Repeat(contractor, 0.5, _PASSES).contract(network.domain).box
    if box.is_empty:
        return None
    return _motions(box.array, dots[list(corners)])


def _barycentric(dots: Floats, corners: tuple[int, int, int]) -> IntervalArray:
    """Coordinates (m, 3) of all dots with respect to the corners; they add up to 1."""
    a, b, c = (exact(dots[k]) for k in corners)
    e, points = ENGINE, exact(dots)
    whole = _area(e.sub(b, a), e.sub(c, a))
    v = e.div(_area(e.sub(points, a), e.sub(c, a)), whole)
    w = e.div(_area(e.sub(b, a), e.sub(points, a)), whole)
    return stacked([e.sub(exact(1.0), e.add(v, w)), v, w])


def _area(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    e = ENGINE
    return e.sub(e.mul(x[..., 0], y[..., 1]), e.mul(x[..., 1], y[..., 0]))


def homography_network(dots: Floats, pyramids: Pyramids) -> Network:
    """g . X_i <= 0 and Z_i >= 0 in X_A, Y_A, X_B, Y_B, X_C, Y_C, Z_A, Z_B, with Z_C = 1 - Z_A - Z_B.

    The dots (m, 2) must not lie on a line.
    """
    corners = corner_dots(dots)
    assert corners is not None
    barycentric = _barycentric(dots, corners)
    e = ENGINE
    ahead = np.broadcast_to([0.0, 0.0, -1.0], (len(pyramids.planes), 1, 3))
    planes = exact(np.concatenate([pyramids.planes, ahead], axis=1).reshape(-1, 3))
    share = IntervalArray(*(np.repeat(bound, 5, axis=0) for bound in (barycentric.lo, barycentric.hi)))
    sideways = e.mul(share[:, :, None], planes[:, None, :2]).reshape((-1, 6))
    depth = e.mul(e.sub(share[:, :2], share[:, 2:]), planes[:, 2:])
    constant = e.mul(share[:, 2], planes[:, 2])
    lo, hi = np.minimum(pyramids.lo, 0.0)[list(corners)].ravel(), np.maximum(pyramids.hi, 0.0)[list(corners)].ravel()
    lo, hi = np.append(lo, [0.0, 0.0]), np.append(hi, [1.0, 1.0])  # X / Z times Z in [0, 1]
    matrix, rest = with_float_coefficients(
        joined([sideways, depth], axis=1), constant, np.maximum(np.abs(lo), np.abs(hi))
    )
    network = Network()
    unknowns = network.variable("h", 8, (lo, hi))
    network.add(network.constant(matrix) @ unknowns + rest <= 0.0)
    return network


def _motions(box: IntervalArray, corners: Floats) -> Motions | str | None:
    """Rotation and position from the box of the eight unknowns and the places (3, 2) of A, B, C on the plate."""
    e = ENGINE
    depths = joined([box[6:], e.sub(e.sub(exact(1.0), box[6]), box[7]).reshape((1,))])
    depths = depths.intersect(IntervalArray(np.zeros(3), np.ones(3)))
    points = joined([box[:6].reshape((3, 2)), depths.reshape((3, 1))], axis=1)
    a, b, c = (exact(corner) for corner in corners)
    whole = _area(e.sub(b, a), e.sub(c, a))
    # X(t) = X_A + v(t) (X_B - X_A) + w(t) (X_C - X_A), v and w affine in t
    across, up = e.sub(points[1], points[0]), e.sub(points[2], points[0])
    ab, ac = e.sub(b, a), e.sub(c, a)
    first = e.div(e.sub(e.mul(ac[1], across), e.mul(ab[1], up)), whole)
    second = e.div(e.sub(e.mul(ab[0], up), e.mul(ac[0], across)), whole)
    v, w = e.div(e.neg(_area(a, ac)), whole), e.div(e.neg(_area(ab, a)), whole)
    origin = e.add(points[0], e.add(e.mul(v, across), e.mul(w, up)))
    squares = inner(first, first).intersect(inner(second, second))
    if bool(squares.empty):
        return None  # |h1| = |h2| nowhere
    if not float(squares.lo) > 0.0:
        return "the pixel boxes are too wide, or the dots too few or too near to one another"
    scale = e.div(exact(1.0), e.sqrt(squares))
    unit = IntervalArray(np.full((3, 3), -1.0), np.ones((3, 3)))
    one, two = e.mul(scale, first), e.mul(scale, second)
    columns = stacked([one, two, cross(one, two)], axis=0).intersect(unit)
    return None if bool(columns.empty.any()) else Motions(transposed(columns), e.mul(scale, origin))
