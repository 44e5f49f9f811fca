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

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.model import Network
from cpcal.vision.pose_sets.enclosed import (
    ENGINE,
    cross,
    exact,
    inner,
    joined,
    rotation,
    times,
    transposed,
    with_float_coefficients,
)
from cpcal.vision.pose_sets.pose_box import NAMES, PoseBox, stretch
from cpcal.vision.pose_sets.pyramid import Pyramids
from cpcal.vision.pose_sets.sight import Sight

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
