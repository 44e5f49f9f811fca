"""A first box of poses, proved for all rotations and all positions at once, by linear programs.

With the columns r1, r2 of the rotation of the target in the camera frame and its position P, dot (x, y) is at
X = P + x r1 + y r2 + R d, d the error of its place, so that a half-space g . X + Z k . t <= 0 of its viewing pyramid is
linear in nine unknowns:

    g' . P + x g' . r1 + y g' . r2 <= |g'| (|d1| + |d2| + |d3|)         g'_z = g_z - max k . t

and so is Z >= nearest. These are the linear equations of a homography. With r1.r1 = r2.r2 = 1 and r1.r2 = 0, a network
like any other: a few contractions bring it from all rotations, and positions within `FARTHEST`, to a small box; the
third column is r1 x r2. No region to look in has to be stated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.contract import Contractor, Repeat
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.model import Network
from cpcal.solver.network import ConstraintNetwork
from cpcal.vision.pose_sets.enclosed import (
    ENGINE,
    cross,
    exact,
    joined,
    stacked,
    transposed,
    with_float_coefficients,
)
from cpcal.vision.pose_sets.pose_frames import Motions
from cpcal.vision.pose_sets.pyramid import Pyramids
from cpcal.vision.pose_sets.sight import Sight, plane_sizes

FARTHEST = 2.0**20  # mm: the origin of the target is no farther from the camera along any axis
SIDES = 5  # rows of a dot: its four planes, and Z >= nearest
_PASSES = 6
_PAYS = 0.5
_FLAT = 1e-3  # triangles of this height over their longest side are no triangles
_WIDEST = 1.0  # entry of a rotation that is of any use
_SLACK = 2.0**-12  # px mm that every row gives away, so that a checker's other roundings prove it too
_LARGEST = np.array([FARTHEST] * 3 + [1.0] * 6)
_TOO_WIDE = "the pixel boxes are too wide, or the dots too few or too near to one another"


@dataclass(frozen=True)
class MotionRows:
    """Rows `matrix @ (P, r1, r2) + constant <= 0`, (5 m, 9) and (5 m,), which every motion of a target satisfies that
    shows dot k in its pyramid: rows 5 k to 5 k + 4."""

    matrix: Floats
    constant: Floats

    def network(self) -> Network:
        network = Network()
        position = network.variable("P", 3, (-_LARGEST[:3], _LARGEST[:3]))
        turn = network.variable("r", 6, (-_LARGEST[3:], _LARGEST[3:]))
        moved = network.constant(self.matrix[:, :3]) @ position + network.constant(self.matrix[:, 3:]) @ turn
        network.add(moved + self.constant <= 0.0)
        first, second = turn[np.arange(3)], turn[np.arange(3, 6)]
        network.add((first * first).sum().within((1.0, 1.0)))
        network.add((second * second).sum().within((1.0, 1.0)))
        network.add((first * second).sum().within((0.0, 0.0)))
        return network


def motion_rows(sight: Sight, seen: Pyramids) -> MotionRows:
    """The rows of the pyramids through which dots are seen."""
    e, cameras, dots = ENGINE, sight.cameras, sight.dots
    planes = exact(seen.planes)
    if cameras.size:
        lost = cameras.most(exact(seen.shared))
        steep = e.sub(planes[..., 2], lost)
        planes = joined([planes[..., :2], steep.reshape((*steep.shape, 1))], axis=-1)
    size = np.maximum(plane_sizes(planes.lo), plane_sizes(planes.hi))
    ahead = np.broadcast_to([0.0, 0.0, -1.0], (len(dots), 1, 3))
    g = joined([planes, exact(np.ascontiguousarray(ahead))], axis=1)
    off = e.sum(exact(sight.widths), -1)
    room = e.mul(joined([exact(size), exact(np.ones((len(dots), 1)))], axis=1), off[:, None])
    nearest = np.zeros((len(dots), SIDES))
    nearest[:, 4] = sight.nearest
    constant = e.sub(e.sub(exact(nearest), room), exact(_SLACK))
    x, y = (exact(dots[:, k])[:, None, None] for k in range(2))
    coefficients = joined([g, e.mul(x, g), e.mul(y, g)], axis=-1).reshape((-1, 9))
    return MotionRows(*with_float_coefficients(coefficients, constant.reshape((-1,)), _LARGEST))


def first_motions(
    sight: Sight, seen: Pyramids, contractor_of: Callable[[ConstraintNetwork], Contractor]
) -> Motions | str | None:
    """All motions of the target in the camera frame that show dot i within pyramid i.

    None: proved that there is none. A text says why nothing bounded could be proved.
    """
    if not spread_out(sight.dots):
        return "the dots are on a line, or fewer than three"
    network = motion_rows(sight, seen).network()
    box = Repeat(contractor_of(network), _PAYS, _PASSES).contract(network.domain).box
    return None if box.is_empty else motions_of(box)


def motions_of(box: Box) -> Motions | str:
    """Motions from a box of the nine unknowns."""
    values = box.array
    if float(values.mag[:3].max()) >= FARTHEST or float((values.hi - values.lo)[3:].max()) > _WIDEST:
        return _TOO_WIDE
    first, second = values[3:6], values[6:9]
    columns = stacked([first, second, cross(first, second)], axis=0)
    columns = columns.intersect(IntervalArray(np.full((3, 3), -1.0), np.ones((3, 3))))
    return Motions(transposed(columns), values[:3])


def spread_out(dots: Floats) -> bool:
    """Whether dots (n, 2) are three or more that do not lie nearly on a line."""
    if len(dots) < 3:
        return False
    a = int(np.argmax(np.linalg.norm(dots - dots.mean(axis=0), axis=1)))
    b = int(np.argmax(np.linalg.norm(dots - dots[a], axis=1)))
    side, away = dots[b] - dots[a], dots - dots[a]
    height = np.abs(side[0] * away[:, 1] - side[1] * away[:, 0])
    return bool(height.max() > _FLAT * float(side @ side))
