"""The constraints of a pose set as polynomial rows, and boxes of poses about a centre.

The unknown pose is that of a mobile frame in a base frame, x_base = P + R x_mobile; the base frame in the camera frame
and the target frame in the mobile frame are exact motions (`Frames`; by default both are the identity, and the pose is
that of the target in the camera frame). With a centre (P0, q0) of floats the six unknowns W (mm) and s are

    P = P0 + W / (1 + s.s),        R = R(1, s) R(q0),        R(1, s) v = v + 2 (s x v + s (s.v) - s.s v) / (1 + s.s)

so that (1 + s.s) times a point in the camera frame has degree two: for dot i, at v = R(q0) m in the directions of the
base frame, with c = Rc^T g for a half-space g . X <= 0 of its viewing pyramid,

    (1 + s.s) g . X  =  g . (Pc + Rc (P0 + v)) + c . W + 2 s . (v x c)
                        + s.s (g . (Pc + Rc P0) - c . v) + 2 (s . c) (s . v)

1 + s.s is positive, so g . X <= 0 and this <= 0 are the same. Twelve monomials serve all dots. The coefficients are
enclosed, then weakened to rows of floats on the box of W and s at hand: exact data for solver and certificate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import ByValue, frozen_array
from cpcal.robot import Pose, normalised, quaternion_conjugate, quaternion_product
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.model import Network
from cpcal.vision.pose_sets.enclosed import (
    ENGINE,
    cross,
    exact,
    half_vector,
    inner,
    joined,
    rotation,
    times,
    transposed,
    with_float_coefficients,
)
from cpcal.vision.pose_sets.enclosed import quaternion_product as enclosed_product
from cpcal.vision.pose_sets.proved_homography import Motions

NAMES = ("W[0]", "W[1]", "W[2]", "s[0]", "s[1]", "s[2]")
_PAIRS = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])
_IDENTITY = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass(frozen=True, eq=False)
class Frames(ByValue):
    """Exact motions between which the pose stands, of the floats that they are (quaternions divided by |q|^2).

    camera  the base frame seen in the camera frame: `x_camera = P + R x_base`, mm
    target  the target frame seen in the mobile frame: `x_mobile = P + R x_target`, mm

    Raises InputError when one of them is not one motion.
    """

    camera: Pose = _IDENTITY
    target: Pose = _IDENTITY

    def __post_init__(self) -> None:
        problems = []
        for name in ("camera", "target"):
            pose: Pose = getattr(self, name)
            one = Pose(frozen_array(pose.position), frozen_array(pose.quaternion))
            object.__setattr__(self, name, one)
            numbers = np.concatenate([one.position.ravel(), one.quaternion.ravel()])
            if one.position.shape != (3,) or one.quaternion.shape != (4,) or not np.isfinite(numbers).all():
                problems.append(Problem(f"frames {name}", "is not one motion", "give (3,) mm and a quaternion (4,)"))
            elif not one.quaternion.any():
                problems.append(Problem(f"frames {name}", "has the quaternion zero", "give a unit quaternion"))
        if problems:
            raise InputError(problems)

    def in_mobile(self, points: Floats) -> IntervalArray:
        """Points (m, 3) of the target frame in the mobile frame."""
        return ENGINE.add(exact(self.target.position), times(rotation(self.target.quaternion), exact(points)))

    def mobile_in_base(self, seen: Motions) -> Motions:
        """What motions of the target in the camera frame mean."""
        e = ENGINE
        back = transposed(rotation(self.camera.quaternion))
        turned = e.dot(e.dot(back, seen.rotation), transposed(rotation(self.target.quaternion)))
        moved = times(back, e.sub(seen.position, exact(self.camera.position)))
        return Motions(turned, e.sub(moved, times(turned, exact(self.target.position))))


@dataclass(frozen=True)
class PoseBox:
    """Poses P, R = R(1, s) R(q0) with P - P0 in `position` (3,) mm and s in `half_turn` (3,), q0 and P0 of `center`."""

    center: Pose
    position: IntervalArray
    half_turn: IntervalArray

    @property
    def unknowns(self) -> Box:
        """A box of (W, s) that holds all of its poses."""
        both = joined([ENGINE.mul(self.position, _stretch(self.half_turn)), self.half_turn])
        return Box(NAMES, both.lo, both.hi)

    def with_unknowns(self, box: Box) -> PoseBox:
        """The poses of a box of (W, s) about the same centre."""
        s = box.array[3:]
        return PoseBox(self.center, ENGINE.div(box.array[:3], _stretch(s)), s)

    def about(self, center: Pose) -> PoseBox | None:
        """A box that holds all of its poses about another centre; None where a half-turn may lie between."""
        e = ENGINE
        between = enclosed_product(exact(self.center.quaternion), exact(quaternion_conjugate(center.quaternion)))
        turned = enclosed_product(joined([exact([1.0]), self.half_turn]), between)
        if turned.lo[0] <= 0.0 <= turned.hi[0]:
            return None
        shift = e.sub(exact(self.center.position), exact(center.position))
        return PoseBox(center, e.add(self.position, shift), e.div(turned[1:], turned[0]))

    @property
    def middle(self) -> Pose:
        """The pose in its middle, as floats: a unit quaternion to rounding."""
        turn = np.concatenate([[1.0], self.half_turn.mid])
        quaternion = normalised(quaternion_product(turn, self.center.quaternion))
        return Pose(self.center.position + self.position.mid, quaternion)


def _stretch(s: IntervalArray) -> IntervalArray:
    """1 + s.s"""
    return ENGINE.add(exact(1.0), ENGINE.sum(ENGINE.sqr(s), -1))


def pose_box(motions: Motions, center: Pose) -> PoseBox | None:
    """The motions as a box about a centre; None where a half-turn may lie between."""
    away = ENGINE.dot(motions.rotation, transposed(rotation(center.quaternion)))
    s = half_vector(away)
    return None if s is None else PoseBox(center, ENGINE.sub(motions.position, exact(center.position)), s)


@dataclass(frozen=True)
class PoseRows:
    """Rows `linear @ (W, s) + bilinear @ (s0 s0, s1 s1, s2 s2, s0 s1, s0 s2, s1 s2) + constant <= 0` of floats.

    Every pose in the box that they were made for, with dot k in its pixel box, satisfies rows 4 k to 4 k + 3.
    """

    linear: Floats
    bilinear: Floats
    constant: Floats

    def network(self, box: Box) -> Network:
        """All (W, s) in a box that satisfy the rows."""
        network = Network()
        move = network.variable("W", 3, (box.lo[:3], box.hi[:3]))
        turn = network.variable("s", 3, (box.lo[3:], box.hi[3:]))
        moved = network.constant(self.linear[:, :3]) @ move + network.constant(self.linear[:, 3:]) @ turn
        bent = network.constant(self.bilinear) @ (turn[_PAIRS[:, 0]] * turn[_PAIRS[:, 1]])
        network.add(moved + bent + self.constant <= 0.0)
        return network

    def right_side(self, box: Box) -> Floats:
        """Numbers with `linear @ x <= right side` for every x of the box that satisfies the rows: linear ones alone."""
        e, s = ENGINE, box.array[3:]
        products = joined([e.sqr(s), e.mul(s[_PAIRS[3:, 0]], s[_PAIRS[3:, 1]])])
        bent = inner(exact(self.bilinear), products)
        return e.neg(e.add(bent, exact(self.constant))).hi

    def bend(self, box: Box) -> float:
        """How much the products of unknowns may count on a box, as a share of the half-widths of the pixel boxes."""
        s = box.array.mag[3:]
        most = np.abs(self.bilinear) @ (s[_PAIRS[:, 0]] * s[_PAIRS[:, 1]])
        sides = self.constant.reshape(-1, 4)
        half = -0.5 * (sides[:, :2] + sides[:, 2:])
        return float((most.reshape(-1, 2, 2).max(axis=1) / np.maximum(half, np.finfo(np.float64).tiny)).max())

    def refuted(self, box: Box) -> npt.NDArray[np.bool_]:
        """For which dots no pose of a box has them in their pixel boxes: some row is positive on all of it."""
        lowest = inner(exact(self.linear), box.array).lo
        return np.asarray((lowest > self.right_side(box)).reshape(-1, 4).any(axis=1))


def pose_rows(planes: Floats, points: IntervalArray, frames: Frames, center: Pose, box: Box) -> PoseRows:
    """The rows of pyramids `planes` (m, 4, 3) through which dots `points` (m, 3) of the mobile frame are seen.

    They hold for the poses of a box of (W, s) about the centre.
    """
    e = ENGINE
    g = exact(planes.reshape(-1, 3))
    arm = times(rotation(center.quaternion), points)
    v = IntervalArray(np.repeat(arm.lo, 4, axis=0), np.repeat(arm.hi, 4, axis=0))
    turn = rotation(frames.camera.quaternion)
    c = times(transposed(turn), g)
    seen = e.add(exact(frames.camera.position), times(turn, exact(center.position)))
    origin = inner(g, seen)
    along = inner(c, v)
    two = exact(2.0)
    swing = e.mul(two, cross(v, c))
    even = e.add(e.sub(origin, along)[:, None], e.mul(two, e.mul(c, v)))
    i, j = _PAIRS[3:].T
    odd = e.mul(two, e.add(e.mul(c[:, i], v[:, j]), e.mul(c[:, j], v[:, i])))
    size = box.array.mag
    largest = np.concatenate([size, np.nextafter(size[3:][_PAIRS[:, 0]] * size[3:][_PAIRS[:, 1]], np.inf)])
    depth = max(float(np.linalg.norm(seen.mid)), 1.0)
    share = exact(2.0 ** -round(float(np.log2(depth))))  # nearly pixels, and a power of two rounds nothing
    coefficients = e.mul(joined([c, swing, even, odd], axis=1), share)
    matrix, constant = with_float_coefficients(coefficients, e.mul(e.add(origin, along), share), largest)
    return PoseRows(matrix[:, :6], matrix[:, 6:], constant)
