"""Where the platform can be when its controller says P, R: boxes proved by interval Newton to hold the true pose.

The true pose is written P + p, R(1, s) R. With the true parameters x of each leg in its certified set S, and a model
error e of at most eps, its six equations are, divided by 2 `scale` so that they are in mm,

    F_i(p, s) = (||P + p + R(1, s) R b - a||^2 - (L + l + e)^2) / (2 scale_i) = 0,     L the controller's reading

F(0) lies in the ranges of `deviations`, widened by eps. The Krawczyk operator of F, with x over S and e over
[-eps, eps], is taken for all poses of a cell at once; where its image lies in the interior of the box D of (p, s), for
every x and e exactly one (p, s) in D solves the equations, and it lies in the image (see existence.operators).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.accuracy.certified_set import CertifiedSet
from cpcal.accuracy.deviations import center_deviations, deviations_across, scales
from cpcal.accuracy.pose_cells import Cells, leg_vectors_over
from cpcal.accuracy.vectors import (
    ENGINE,
    along_turn,
    applied,
    cross,
    dot,
    joined,
    norm,
    point,
    product,
    rotation,
    total,
    turned,
)
from cpcal.common.arrays import Bools, Floats
from cpcal.robot import Pose, Robot, pose_jacobian
from cpcal.solver.interval import IntervalArray

LEGS = 6  # as many equations as unknowns: what the Newton test needs
_TRIES = 8  # inflations of D
_REFINED = 3  # applications of the operator after the proof
_INFLATE = 0.15  # of the image's width, on both sides
_STRAY = 1e-12


@dataclass(frozen=True, eq=False)
class PoseBounds:
    """For K cells; where `proved` is False nothing is, and bounds are infinite.

    box       (K, 6): (p, s) of the true pose, mm and half a rotation vector, for all poses of the cell
    position  (K,) mm: ||p|| is at most this; rotation (K,) rad: the angle of R(1, s) is at most this
    region    (K, 6): no other solution of the equations lies in this box around `box`
    share     (K, n) mm: how far, to first order and at the center, what is not known of each leg moves the platform
    """

    proved: Bools
    box: IntervalArray
    position: Floats
    rotation: Floats
    region: IntervalArray
    share: Floats


def pose_bounds(poses: Pose, sets: Sequence[CertifiedSet]) -> PoseBounds:
    """Proved bounds for K poses, for the six certified sets of a robot and their controller."""
    cells = Cells.of_poses(poses)
    controller = np.stack([one.controller for one in sets])
    scale = scales(cells, controller)
    return _bounds(cells, sets, center_deviations(cells, sets, controller, scale), scale)


def cell_bounds(cells: Cells, sets: Sequence[CertifiedSet]) -> tuple[PoseBounds, PoseBounds]:
    """Proved bounds for all poses of each cell, and for the centers alone."""
    controller = np.stack([one.controller for one in sets])
    scale = scales(cells, controller)
    at_center = center_deviations(cells, sets, controller, scale)
    over = deviations_across(cells, sets, controller, scale, at_center)
    return _bounds(cells, sets, over, scale), _bounds(cells.centers, sets, at_center, scale)


def _bounds(cells: Cells, sets: Sequence[CertifiedSet], deviation: IntervalArray, scale: Floats) -> PoseBounds:
    controller = np.stack([one.controller for one in sets])
    value = _with_error(cells, sets, controller, deviation, scale)
    inverse, good = _inverses(cells, controller)
    step = ENGINE.neg(applied(point(inverse), value))
    equations = _Equations(cells, sets, controller, scale, inverse)
    region, image, proved = _proved(equations, step, good & np.isfinite(value.lo).all(axis=1))
    position, angle = _sizes(inverse, value, equations.spread(_with_zero(image)))
    share = np.linalg.norm(inverse[:, :3], axis=1) * value.rad
    return PoseBounds(
        proved,
        _where(proved, image),
        np.where(proved, position, np.inf),
        np.where(proved, angle, np.inf),
        _where(proved, region),
        share,
    )


def _with_error(
    cells: Cells, sets: Sequence[CertifiedSet], controller: Floats, deviation: IntervalArray, scale: Floats
) -> IntervalArray:
    """F(0) (K, n) with all errors e: the deviation less e (2 (L + l) + e) / (2 scale). Infinite for legs below eps."""
    eps = point(np.array([one.eps for one in sets]))
    rest = joined([one.box[6:7] for one in sets])
    length = ENGINE.add(leg_vectors_over(cells, controller).length, rest[None])  # L + l
    most = ENGINE.mul(eps[None], ENGINE.div(ENGINE.add(length, ENGINE.mul(point(0.5), eps[None])), point(scale)))
    short = length.lo <= eps.hi[None]
    reach = np.where(short, np.inf, most.hi)
    return ENGINE.add(deviation, IntervalArray(-reach, reach))


def _inverses(cells: Cells, controller: Floats) -> tuple[Floats, Bools]:
    """(K, 6, n): approximate inverses of the Jacobian in (p, s) at the centers; whether there is one."""
    robot = Robot.from_parameters("controller", controller)
    jacobian = pose_jacobian(robot, cells.center)
    jacobian[..., 3:] *= 2.0
    with np.errstate(all="ignore"):
        good = np.linalg.cond(jacobian) < 1e12
        safe = np.where(good[:, None, None], jacobian, np.eye(6))
        return np.linalg.inv(safe), good


@dataclass(frozen=True, eq=False)
class _Equations:
    """The interval Jacobian of F over boxes of (p, s), times approximate inverses C (K, 6, n)."""

    cells: Cells
    sets: Sequence[CertifiedSet]
    controller: Floats
    scale: Floats
    inverse: Floats

    def spread(self, box: IntervalArray) -> IntervalArray:
        """(I - C J(D)) D, (K, 6), for boxes D (K, 6) that hold 0."""
        return applied(ENGINE.sub(point(np.eye(6)[None]), self._product(box)), box)

    def _product(self, box: IntervalArray) -> IntervalArray:
        """C J (K, 6, 6) over D, all x of the sets and all poses of the cells.

        With r the mobile joint's place R b, w = P - a and u = w + r the leg, J is (u, 2 (m - s x m) / (1 + s.s)) over
        scale, m = r x u. Sums over legs are taken before the range over poses, so that what moves all legs alike
        cancels: with a shift t and a turn 2 S of the pose, from the cell's center on, and the weights C / scale,

            sum u = sum u_0 + (sum 1) t + 2 S x (sum r)
            sum m = sum m_0 + (sum r) x t + (T - tr T) 2 S          with T = sum r w'
        """
        cells = self.cells
        shift = ENGINE.add(cells.reach[:, :3], box[:, :3])
        turn = _turns_joined(box[:, 3:], cells.reach[:, 3:])
        weight = ENGINE.div(point(self.inverse), point(self.scale[:, None]))[..., None]  # (K, 6, n, 1)
        arm_0, leg_0 = self._at(point(np.zeros(turn.shape)), point(np.zeros(turn.shape)))
        arm, leg = self._at(turn, shift)
        arms = _sum(weight, arm)  # (K, 6, 3)
        outer = ENGINE.mul(arm[..., :, None], ENGINE.sub(leg, arm)[..., None, :])  # (K, n, 3, 3)
        of_turn = _sum(weight, outer.reshape((*outer.shape[:2], 9))).reshape((len(cells), 6, 3, 3))
        trace = total(IntervalArray(*(np.diagonal(side, axis1=-2, axis2=-1) for side in (of_turn.lo, of_turn.hi))))
        way = _path(turn)[:, None]
        units = total(weight[..., 0])
        of_legs = ENGINE.add(_sum(weight, leg_0), ENGINE.mul(units[..., None], shift[:, None]))
        of_legs = ENGINE.add(of_legs, cross(way, arms))
        turned_by = ENGINE.sub(applied(of_turn, way), ENGINE.mul(trace[..., None], way))
        moments = ENGINE.add(_sum(weight, cross(arm_0, leg_0)), ENGINE.add(cross(arms, shift[:, None]), turned_by))
        return joined([of_legs, along_turn(box[:, None, 3:], moments)])

    def _at(self, turn: IntervalArray, shift: IntervalArray) -> tuple[IntervalArray, IntervalArray]:
        """R b and the leg P + R b - a, (K, n, 3) both, over all x of the sets; `turn` is S and `shift` t, (K, 3)."""
        boxes = joined([one.box[None] for one in self.sets], 0)
        matrix = product(turned(turn), rotation(point(self.cells.center.quaternion)))[:, None]
        arm = applied(matrix, ENGINE.add(point(self.controller[:, 3:6]), boxes[:, 3:6])[None])
        place = ENGINE.add(point(self.cells.center.position), shift)[:, None]
        plain = ENGINE.add(ENGINE.sub(place, ENGINE.add(point(self.controller[:, :3]), boxes[:, :3])[None]), arm)
        return arm, plain.intersect(self._leg(matrix, place))

    def _leg(self, matrix: IntervalArray, place: IntervalArray) -> IntervalArray:
        """The leg by the sets' directions: what shifts a and b alike hardly changes it."""
        known = ENGINE.add(place, applied(matrix, point(self.controller[None, :, 3:6])))
        known = ENGINE.sub(known, point(self.controller[None, :, :3]))
        tau = np.stack([one.basis.T for one in self.sets])  # (n, 7 directions, 7 components)
        along = joined([one.along[None] for one in self.sets], 0)
        by_each = ENGINE.sub(applied(matrix[:, :, None], point(tau[None, :, :, 3:6])), point(tau[None, :, :, :3]))
        # the basis is orthonormal up to rounding: so much of the sets' size covers what that leaves
        stray = np.stack([_STRAY * one.box.mag[:7].sum() for one in self.sets])[None, :, None]
        away = total(ENGINE.mul(by_each, along[None, :, :, None]), 2)
        return ENGINE.add(ENGINE.add(known, away), IntervalArray(-stray, stray))


def _sum(weight: IntervalArray, vectors: IntervalArray) -> IntervalArray:
    """Weighted sums over the legs: (K, 6, n, 1) and (K, n, m) give (K, 6, m)."""
    return total(ENGINE.mul(weight, vectors[:, None]), 2)


def _turns_joined(s: IntervalArray, t: IntervalArray) -> IntervalArray:
    """S with R(1, S) = R(1, s) R(1, t), a box around 0 of (K, 3); infinite where a half-turn is among them."""
    scalar = ENGINE.sub(point(1.0), dot(s, t))
    found = ENGINE.div(ENGINE.add(ENGINE.add(s, t), cross(s, t)), scalar[:, None])
    far = scalar.lo[:, None] <= 0.0
    return _with_zero(IntervalArray(np.where(far, -np.inf, found.lo), np.where(far, np.inf, found.hi)))


def _path(turn: IntervalArray) -> IntervalArray:
    """What the turns tau S, tau from 0 to 1, add up to: 2 S times a number between 1 / (1 + S.S) and 1."""
    most = total(ENGINE.sqr(turn)).hi
    least = ENGINE.div(point(1.0), ENGINE.add(point(1.0), IntervalArray(np.zeros_like(most), most))).lo
    factor = IntervalArray(2.0 * least, np.full_like(least, 2.0))
    return ENGINE.mul(factor[:, None], turn)


def _proved(equations: _Equations, step: IntervalArray, good: Bools) -> tuple[IntervalArray, IntervalArray, Bools]:
    """D, its image, and whether the image lies in the interior of D; D always holds 0."""
    box = _inflated(_with_zero(step))
    image, proved = step, np.zeros(len(good), dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(_TRIES):
            image = ENGINE.add(step, equations.spread(box))
            proved = good & ((image.lo > box.lo) & (image.hi < box.hi)).all(axis=1)
            if proved[good].all():
                break
            grown = _inflated(_with_zero(image))
            keep = proved[:, None] | ~np.isfinite(grown.lo) | ~np.isfinite(grown.hi)
            box = IntervalArray(np.where(keep, box.lo, grown.lo), np.where(keep, box.hi, grown.hi))
        region = box
        for _ in range(_REFINED):
            image = image.intersect(ENGINE.add(step, equations.spread(_with_zero(image))))
    return region, image, proved & np.isfinite(image.lo).all(axis=1)


def _sizes(inverse: Floats, value: IntervalArray, spread: IntervalArray) -> tuple[Floats, Floats]:
    """Bounds (K,) of ||p|| in mm and of the angle in rad.

    (p, s) = -C F(0) + an element of `spread`, and a norm is largest at a corner of the box of F(0). The angle of
    R(1, s) is 2 atan ||s|| <= 2 ||s||.
    """
    corners = (np.arange(64)[:, None] >> np.arange(6) & 1).astype(bool)
    values = np.where(corners[None], value.hi[:, None], value.lo[:, None])  # (K, 64, 6)
    finite = np.where(np.isfinite(values), values, 0.0)
    moves = applied(point(inverse)[:, None], point(finite))  # (K, 64, 6)
    out = []
    for part, factor in ((slice(0, 3), 1.0), (slice(3, 6), 2.0)):
        farthest = norm(moves[..., part]).hi.max(axis=1)
        more = norm(point(spread.mag[:, part])).hi
        out.append(ENGINE.mul(point(factor), ENGINE.add(point(farthest), point(more))).hi)
    return out[0], out[1]


def _with_zero(box: IntervalArray) -> IntervalArray:
    return IntervalArray(np.minimum(box.lo, 0.0), np.maximum(box.hi, 0.0))


def _inflated(box: IntervalArray) -> IntervalArray:
    more = _INFLATE * (box.hi - box.lo) + 1e-9
    return IntervalArray(box.lo - more, box.hi + more)


def _where(proved: Bools, box: IntervalArray) -> IntervalArray:
    keep = proved[:, None]
    return IntervalArray(np.where(keep, box.lo, -np.inf), np.where(keep, box.hi, np.inf))
