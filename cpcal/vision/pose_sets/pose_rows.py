"""The constraints of a pose set as polynomial rows.

The unknown pose is that of a mobile frame in a base frame, x_base = P + R x_mobile; the base frame in the camera frame
and the target frame in the mobile frame are exact motions (`Frames`; by default both are the identity, and the pose is
that of the target in the camera frame). With a centre (P0, q0) of floats the six unknowns W (mm) and s are

    P = P0 + W / (1 + s.s),        R = R(1, s) R(q0),        R(1, s) v = v + 2 (s x v + s (s.v) - s.s v) / (1 + s.s)

so that (1 + s.s) times a point in the camera frame has degree two: for dot i, at v = R(q0) m in the directions of the
base frame, with c = Rc^T g for a half-space g . X + Z k . t <= 0 of its viewing pyramid,

    (1 + s.s) g . X  =  g . (Pc + Rc (P0 + v)) + c . W + 2 s . (v x c)
                        + s.s (g . (Pc + Rc P0) - c . v) + 2 (s . c) (s . v)

1 + s.s is positive, so g . X + Z k . t <= 0 and this + D k . t <= 0 with D = (1 + s.s) Z are the same. D hardly varies
over a box of poses: its middle is taken, and its radius times the largest k . t is given away. t are the errors of the
camera, the same for all dots. Twelve monomials and t serve all dots. The coefficients are enclosed, then weakened to
rows of floats on the box of W and s at hand: exact data for solver and certificate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Floats
from cpcal.solver.contract import Contractor, Repeat
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.model import Network
from cpcal.solver.network import ConstraintNetwork
from cpcal.vision.pose_sets.enclosed import (
    ENGINE,
    NAMES,
    Motions,
    PoseBox,
    cross,
    exact,
    inner,
    joined,
    rotation,
    stacked,
    stretch,
    times,
    transposed,
    with_float_coefficients,
)
from cpcal.vision.pose_sets.sight import Pyramids, Sight, plane_sizes

# ------------------------------------------------------------------------------------------------------------------
# A first box of poses, proved for all rotations and all positions at once, by linear programs.
#
# With the columns r1, r2 of the rotation of the target in the camera frame and its position P, dot (x, y) is at
# X = P + x r1 + y r2 + R d, d the error of its place, so that a half-space g . X + Z k . t <= 0 of its viewing
# pyramid is
# linear in nine unknowns:
#
#     g' . P + x g' . r1 + y g' . r2 <= |g'| (|d1| + |d2| + |d3|)         g'_z = g_z - max k . t
#
# and so is Z >= nearest. These are the linear equations of a homography. With r1.r1 = r2.r2 = 1 and r1.r2 = 0, a
# network
# like any other: a few contractions bring it from all rotations, and positions within `FARTHEST`, to a small box; the
# third column is r1 x r2. No region to look in has to be stated.

FARTHEST = 2.0**20  # mm: the origin of the target is no farther from the camera along any axis
SIDES = 5  # rows of a dot: its four planes, and Z >= nearest
_PASSES = 6
_PAYS = 0.5
_FLAT = 1e-3  # triangles of this height over their longest side are no triangles
_WIDEST = 1.0  # entry of a rotation that is of any use
_MOTION_SLACK = 2.0**-12  # px mm that every row gives away, so that a checker's other roundings prove it too
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
    constant = e.sub(e.sub(exact(nearest), room), exact(_MOTION_SLACK))
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


_PAIRS = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])
_SLACK = 2.0**-30  # pixels that every row gives away, so that a checker's other roundings prove it too


@dataclass(frozen=True)
class PoseRows:
    """Rows `linear @ (W, s, t) + bilinear @ (s0 s0, s1 s1, s2 s2, s0 s1, s0 s2, s1 s2) + constant <= 0` of floats.

    Every pose in the box that they were made for, with dot k in its pixel box, satisfies rows 4 k to 4 k + 3 with the t
    of the camera, |t| <= 1 if `ball`, else |t_j| <= 1. In pixels, nearly: they are multiplied by 2^`power`.
    """

    linear: Floats
    bilinear: Floats
    constant: Floats
    ball: bool = False
    power: int = 0

    @property
    def shared(self) -> int:
        """How many unknowns t there are."""
        return int(self.linear.shape[1]) - len(NAMES)

    def unknowns(self, box: Box) -> Box:
        """A box of (W, s) with that of t."""
        names = (*NAMES, *(f"t[{k}]" for k in range(self.shared)))
        one = np.ones(self.shared)
        return Box(names, np.concatenate([box.lo[:6], -one]), np.concatenate([box.hi[:6], one]))

    def network(self, box: Box) -> Network:
        """All (W, s) in a box that satisfy the rows for some t."""
        network = Network()
        move = network.variable("W", 3, (box.lo[:3], box.hi[:3]))
        turn = network.variable("s", 3, (box.lo[3:6], box.hi[3:6]))
        moved = network.constant(self.linear[:, :3]) @ move + network.constant(self.linear[:, 3:6]) @ turn
        bent = network.constant(self.bilinear) @ (turn[_PAIRS[:, 0]] * turn[_PAIRS[:, 1]])
        rows = moved + bent + self.constant
        if self.shared:
            camera = network.variable("t", self.shared, (-np.ones(self.shared), np.ones(self.shared)))
            rows = rows + network.constant(self.linear[:, 6:]) @ camera
        network.add(rows <= 0.0)
        if self.shared and self.ball:
            network.add((camera * camera).sum() <= 1.0)
        return network

    def right_side(self, box: Box) -> Floats:
        """Numbers with `linear @ x <= right side` for every x of the box that satisfies the rows: linear ones alone."""
        e, s = ENGINE, box.array[3:6]
        products = joined([e.sqr(s), e.mul(s[_PAIRS[3:, 0]], s[_PAIRS[3:, 1]])])
        bent = inner(exact(self.bilinear), products)
        return e.neg(e.add(bent, exact(self.constant))).hi

    def bend(self, box: Box) -> float:
        """How much the products of unknowns may count on a box, as a share of the half-widths of the pixel boxes."""
        s = box.array.mag[3:6]
        most = np.abs(self.bilinear) @ (s[_PAIRS[:, 0]] * s[_PAIRS[:, 1]])
        sides = self.constant.reshape(-1, 4)
        half = -0.5 * (sides[:, :2] + sides[:, 2:])
        return float((most.reshape(-1, 2, 2).max(axis=1) / np.maximum(half, np.finfo(np.float64).tiny)).max())

    def refuted(self, box: Box) -> npt.NDArray[np.bool_]:
        """For which dots no pose of a box has them in their pixel boxes: some row is positive on all of it."""
        lowest = inner(exact(self.linear), self.unknowns(box).array).lo
        return np.asarray((lowest > self.right_side(box)).reshape(-1, 4).any(axis=1))


def pose_rows(sight: Sight, seen: Pyramids, box: PoseBox, unknowns: Box) -> PoseRows:
    """The rows of the pyramids through which dots are seen, for the poses of a box, whose (W, s) are in `unknowns`."""
    e, frames, cameras = ENGINE, sight.frames, sight.cameras
    g = exact(seen.planes.reshape(-1, 3))
    arm = times(rotation(box.center.quaternion), sight.points)
    v = _four_times(arm)
    turn = rotation(frames.camera.quaternion)
    c = times(transposed(turn), g)
    middle = e.add(exact(frames.camera.position), times(turn, exact(box.center.position)))
    origin = inner(g, middle)
    along = inner(c, v)
    two = exact(2.0)
    swing = e.mul(two, cross(v, c))
    even = e.add(e.sub(origin, along)[:, None], e.mul(two, e.mul(c, v)))
    i, j = _PAIRS[3:].T
    odd = e.mul(two, e.add(e.mul(c[:, i], v[:, j]), e.mul(c[:, j], v[:, i])))
    size = unknowns.array.mag[:6]
    largest = np.concatenate([size, np.nextafter(size[3:][_PAIRS[:, 0]] * size[3:][_PAIRS[:, 1]], np.inf)])
    power = power_of(middle)
    share = exact(2.0**power)
    coefficients, constant = joined([c, swing, even, odd], axis=1), e.add(origin, along)
    if cameras.size:
        shared = exact(seen.shared.reshape(-1, cameras.size))
        depth = _four_times(e.mul(stretch(unknowns.array[3:6]), sight.placed(box)[0][:, 2]))
        coefficients = joined([coefficients, e.mul(shared, exact(depth.mid)[:, None])], axis=1)
        constant = e.sub(constant, e.mul(cameras.most(shared), exact(depth.rad)))
        largest = np.concatenate([largest, np.ones(cameras.size)])
    matrix, rest = with_float_coefficients(e.mul(coefficients, share), e.mul(constant, share), largest)
    linear = np.concatenate([matrix[:, :6], matrix[:, 12:]], axis=1)
    return PoseRows(linear, matrix[:, 6:12], e.sub(exact(rest), exact(_SLACK)).lo, cameras.ball, power)


def power_of(seen: IntervalArray) -> int:
    """Of two, nearly one by the depth: it rounds nothing."""
    depth = max(float(np.linalg.norm(seen.mid)), 1.0)
    return -round(float(np.log2(depth)))


def _four_times(values: IntervalArray) -> IntervalArray:
    return IntervalArray(np.repeat(values.lo, 4, axis=0), np.repeat(values.hi, 4, axis=0))
