"""The stages of `pose_set`: dots seen through pyramids, a first box of poses, and what the constraints leave of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Floats, Indices
from cpcal.robot import Pose, normalised, quaternion_from_matrix
from cpcal.solver import plugins
from cpcal.solver.contract import Contractor, in_sequence, shrunk
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.linear import BoxProgram
from cpcal.solver.model import Network
from cpcal.solver.network import ConstraintNetwork
from cpcal.vision.pose_sets.enclosed import ENGINE, NAMES, Motions, PoseBox, joined, pose_box
from cpcal.vision.pose_sets.pose_rows import PoseRows, first_motions, pose_rows
from cpcal.vision.pose_sets.sight import Sight

Found = PoseBox | str | None  # what holds all poses; or why nothing is known; or that there are none

_PASSES = 8
_PAYS = 0.98  # a further pass is made where some width shrinks below this share
_HALF = 0.5  # and what is seen is found anew where some width shrinks below this share
_HALF_TURN = "the rotation is known too badly"


@dataclass(frozen=True)
class View:
    """What the stages need: what is seen, and what makes contractors of networks."""

    sight: Sight
    contractor: Callable[[ConstraintNetwork], Contractor]

    def part(self, chosen: Indices) -> View:
        """Of some of the dots."""
        return View(self.sight.part(chosen), self.contractor)


def contractor_of(names: Sequence[str]) -> Callable[[ConstraintNetwork], Contractor]:
    """What makes the named contractors, one after the other, for any network; the names are looked up once."""
    factories = [plugins.load(name) for name in names]

    def build(network: ConstraintNetwork) -> Contractor:
        parts = [factory(network, objective=None, arithmetic="float64") for factory in factories]
        return in_sequence(parts)

    return build


def enclosed(view: View) -> Found:
    """All poses that satisfy all of a view, about their middle."""
    start = first_box(view)
    return contracted(view, start) if isinstance(start, PoseBox) else start


def first_box(view: View) -> Found:
    """From the homography alone."""
    seen = view.sight.anywhere()
    motions = seen if isinstance(seen, str) else first_motions(view.sight, seen, view.contractor)
    return box_of(view, motions) if isinstance(motions, Motions) else motions


def box_of(view: View, motions: Motions) -> PoseBox | str:
    """Motions of the target in the camera frame as poses about their middle."""
    moved = view.sight.frames.mobile_in_base(motions)
    left, _, right = np.linalg.svd(moved.rotation.mid)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return pose_box(moved, Pose(moved.position.mid, quaternion_from_matrix(turn))) or _HALF_TURN


def contracted(view: View, box: PoseBox) -> Found:
    """What the constraints leave of a box, about its new middle."""
    seen, known = view.sight.about(box), box.unknowns.width
    for _ in range(_PASSES):
        before = box.unknowns
        if shrunk(known, before.width, _HALF):  # what was seen about a larger box holds for this one
            seen, known = view.sight.about(box), before.width
        if isinstance(seen, str):
            return seen
        rows = pose_rows(view.sight, seen, box, before)
        after = view.contractor(rows.network(before)).contract(rows.unknowns(before)).box
        if after.is_empty:
            return None
        narrower = box.with_unknowns(after)
        moved = narrower.about(narrower.middle)
        if moved is None:
            return _HALF_TURN
        box = moved
        if not shrunk(before.width, after.width[:6], _PAYS):
            break
    return box


# ------------------------------------------------------------------------------------------------------------------
# The box around all poses that satisfy all but q dots, q small: to first order the narrowest there is.
#
# A bound from a linear program holds because of the dots T that have a multiplier in its proof: it holds for every pose
# that satisfies those, whatever all other dots do. A pose that satisfies all dots but q either satisfies T, or violates
# a t in T and satisfies all other dots but q - 1. So the bound with q outliers is the worst of the bound and, for
# each t
# in T, the bound with q - 1 outliers among the dots without t. T has hardly more members than there are unknowns, so
# there are about 7^q programs for each of the twelve bounds, where trying all subsets of dots would need n^q.
#
# The rows are those of `pose_rows`, their products of unknowns replaced by what they are at least on the box; every
# bound is proved from its multipliers.

Dots = frozenset[int]

MOST = 2  # outliers
_ROUNDS = 3
_STRAIGHT = 0.02  # another round is made on boxes where products of unknowns count for more,
_PAYS_FOR_ALL_BUT = 0.8  # if some width shrinks below this share


def all_but(view: View, box: PoseBox, outliers: int) -> Found:
    """The poses of a box that satisfy all dots of a view but at most so many; None: there are none."""
    for _ in range(_ROUNDS):
        unknowns = box.unknowns
        seen = view.sight.about(box)
        if isinstance(seen, str):
            return seen
        rows = pose_rows(view.sight, seen, box, unknowns)
        after = _narrowed(rows, unknowns, outliers)
        if after.is_empty:
            return None
        narrower = box.with_unknowns(after)
        box = narrower.about(narrower.middle) or box
        if rows.bend(unknowns) < _STRAIGHT or not shrunk(unknowns.width, after.width, _PAYS_FOR_ALL_BUT):
            break
    return box


def _narrowed(rows: PoseRows, unknowns: Box, outliers: int) -> Box:
    programs = _Programs(rows.linear, rows.right_side(unknowns), rows.unknowns(unknowns).array)
    lowest, highest = ([programs.least(k, sign, outliers) for k in range(len(NAMES))] for sign in (1.0, -1.0))
    return unknowns.with_bounds(np.array(lowest), -np.array(highest))


class _Programs:
    """`matrix @ x <= rhs` in a box, four rows for each dot."""

    def __init__(self, matrix: Floats, rhs: Floats, box: IntervalArray) -> None:
        self._matrix, self._rhs, self._box = matrix, rhs, box
        self._known: dict[tuple[int, float, Dots], tuple[float, Dots]] = {}

    def least(self, k: int, sign: float, outliers: int, without: Dots = frozenset()) -> float:
        """A lower bound of sign x_k over all x that satisfy all dots but those `without` and so many outliers more.

        Infinite when there are no such x.
        """
        key = (k, sign, without)
        if key not in self._known:
            self._known[key] = self._bound(k, sign, without)
        bound, carriers = self._known[key]
        whole = float(self._box.lo[k] if sign > 0.0 else -self._box.hi[k])
        for dot in sorted(carriers) if outliers else ():
            if bound <= whole:
                break
            bound = min(bound, self.least(k, sign, outliers - 1, without | {dot}))
        return max(bound, whole)

    def _bound(self, k: int, sign: float, without: Dots) -> tuple[float, Dots]:
        """The bound when all dots but these hold, and those that carry its proof."""
        kept = np.setdiff1d(np.arange(len(self._rhs)), [4 * dot + j for dot in without for j in range(4)])
        program = BoxProgram(self._matrix[kept], self._rhs[kept], self._box, ENGINE)
        bound, rows = program.least(k, sign)
        return bound, frozenset((kept[rows] // 4).tolist())


# ------------------------------------------------------------------------------------------------------------------
# Pose sets when up to q dots may lie outside their pixel boxes, nobody knows which.
#
# Why it is sound. Let (P, R) be a pose that shows at least n - q of n dots in their boxes. Deal the dots into G >= 2
# q +
# 1 groups without common dots: at most q groups contain one of the at most q dots outside, so the pose shows *all* dots
# of at least G - q groups, and lies in the enclosures of those. The hull of the points that lie in at least G - q of G
# boxes (the plug-in `qinter`, exact) therefore holds it. G - q > q, so that wrong groups alone, whatever they agree
# upon, never make such a point.
#
# A dot that is outside its box for every pose of that hull is outside for (P, R) too. If there are j such dots, the
# pose
# shows at least (n - j) - (q - j) of the n - j others: the question again with n - j dots and q - j outliers, and none
# when j > q. With no outlier left over all others must be in their boxes, which is the plain question. With one or two
# left over `all_but` narrows the hull. With more the dots are dealt anew, as long as that narrows it.

_LEAST = 5  # dots of a group
_TURNS = 8  # at most
_PAYS_FOR_ROBUST = 0.95


def enclosed_but(view: View, outliers: int) -> tuple[Found, Indices]:
    """All poses that satisfy a view but for at most so many dots; and which dots none of those poses satisfies."""
    active = np.arange(len(view.sight))
    box: PoseBox | None = None
    for turn in range(_TURNS):
        left = outliers - (len(view.sight) - len(active))
        found = _one_turn(view, active, left, turn, box)
        if not isinstance(found, PoseBox):
            # an earlier hull remains true when a later turn fails
            return (box if box is not None and isinstance(found, str) else found), _others(view, active)
        before, box = box, found
        wrong = _refuted(view.part(active), box)
        active = active[~wrong]
        if len(view.sight) - len(active) > outliers:
            return None, _others(view, active)
        last = left == 0 or not (wrong.any() or _narrower(before, box))
        if last or (not wrong.any() and before is not None and left <= MOST):
            break
    return box, _others(view, active)


def _one_turn(view: View, active: Indices, outliers: int, turn: int, box: PoseBox | None) -> Found:
    """What all dots leave when none is an outlier, the linear programs of few, one division into groups of many."""
    part = view.part(active)
    if outliers == 0:
        return enclosed(part) if box is None else contracted(part, box)
    if box is not None and outliers <= MOST:
        return all_but(part, box, outliers)
    return _one_deal(view, active, outliers, turn, box)


def _one_deal(view: View, active: Indices, outliers: int, deal: int, box: PoseBox | None) -> Found:
    """The hull of one division into groups."""
    count = 2 * outliers + 1
    if len(active) < _LEAST * count:
        return f"{len(active)} dots are too few for {outliers} outliers: {count} groups of {_LEAST} are needed"
    sets: list[Found] = []
    for group in groups_of(view.sight.dots[active], count, deal):
        part = view.part(active[group])
        sets.append(enclosed(part) if box is None else contracted(part, box))
    return _common(sets, outliers)


def groups_of(dots: Floats, count: int, deal: int) -> list[Indices]:
    """Dots in an order in which neighbours on the plate follow one another, one of every `count` to each group.

    So each group is all over the plate. Who gets which is drawn, the same in every run.
    """
    away = dots - dots.min(axis=0)
    cells = np.floor(away / max(float(away.max()), 1e-300) * 15.999).astype(np.int64)
    code = sum(((cells[:, k] >> bit) & 1) << (2 * bit + k) for bit in range(4) for k in range(2))
    order = np.argsort(code, kind="stable")
    rng = np.random.default_rng(deal)
    place = np.concatenate([rng.permutation(count) for _ in range(0, len(dots), count)])[: len(dots)]
    return [order[place == k] for k in range(count)]


def _common(sets: list[Found], outliers: int) -> Found:
    """The hull of the poses in all but so many of the sets.

    Sets of which nothing is known hold everything: they are never among those left out, and drop out here.
    """
    alive = [one for one in sets if one is not None]
    left = outliers - (len(sets) - len(alive))
    if left < 0:
        return None
    boxes = [one for one in alive if isinstance(one, PoseBox)]
    if len(boxes) <= left:  # a pose might be in the unknown ones alone
        return next(one for one in alive if isinstance(one, str))
    center = _central(boxes)
    moved = [one.about(center) for one in boxes]
    arrays = [joined([one.position, one.half_turn]) for one in moved if one is not None]
    if len(arrays) < len(boxes):
        return "groups of dots disagree by half a turn"
    hull = _q_intersection(arrays, left)
    if hull is None:
        return None
    common = PoseBox(center, hull[:3], hull[3:])
    return common.about(common.middle)


def _central(boxes: list[PoseBox]) -> Pose:
    """A pose in the middle of most of them."""
    quaternions = np.stack([box.center.quaternion for box in boxes])
    quaternions = quaternions * np.where(quaternions @ quaternions[0] < 0.0, -1.0, 1.0)[:, None]
    position = np.median([box.center.position for box in boxes], axis=0)
    return Pose(position, normalised(np.median(quaternions, axis=0)))


def _q_intersection(boxes: list[IntervalArray], q: int) -> IntervalArray | None:
    """The hull (6,) of the points in all but q of some boxes."""
    lo, hi = np.stack([box.lo for box in boxes]), np.stack([box.hi for box in boxes])
    network = Network()
    x = network.variable("x", 6, (lo.min(axis=0), hi.max(axis=0)))
    network.add((x[None, :] + np.zeros((len(boxes), 1))).within((lo, hi)))
    qinter: Any = plugins.load("qinter")
    found = qinter(network, q=q).contract(network.domain).box
    return None if found.is_empty else found.array


def _refuted(view: View, box: PoseBox) -> npt.NDArray[np.bool_]:
    unknowns = box.unknowns
    seen = view.sight.about(box)
    if isinstance(seen, str):
        return np.zeros(len(view.sight), dtype=np.bool_)
    return pose_rows(view.sight, seen, box, unknowns).refuted(unknowns)


def _narrower(before: PoseBox | None, after: PoseBox) -> bool:
    return before is None or shrunk(before.unknowns.width, after.unknowns.width, _PAYS_FOR_ROBUST)


def _others(view: View, active: Indices) -> Indices:
    return np.setdiff1d(np.arange(len(view.sight)), active)
