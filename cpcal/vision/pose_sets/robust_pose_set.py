"""Pose sets when up to q dots may lie outside their pixel boxes, nobody knows which.

Why it is sound. Let (P, R) be a pose that shows at least n - q of n dots in their boxes. Deal the dots into G >= 2 q +
1 groups without common dots: at most q groups contain one of the at most q dots outside, so the pose shows *all* dots
of at least G - q groups, and lies in the enclosures of those. The hull of the points that lie in at least G - q of G
boxes (the plug-in `qinter`, exact) therefore holds it. G - q > q, so that wrong groups alone, whatever they agree
upon, never make such a point.

A dot that is outside its box for every pose of that hull is outside for (P, R) too. If there are j such dots, the pose
shows at least (n - j) - (q - j) of the n - j others: the question again with n - j dots and q - j outliers, and none
when j > q. With no outlier left over all others must be in their boxes, which is the plain question. With one or two
left over `all_but` narrows the hull. With more the dots are dealt anew, as long as that narrows it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats, Indices
from cpcal.robot import Pose, normalised
from cpcal.solver import plugins
from cpcal.solver.contract import shrunk
from cpcal.solver.interval import IntervalArray
from cpcal.solver.model import Network
from cpcal.vision.pose_sets.all_but import MOST, all_but
from cpcal.vision.pose_sets.enclosed import joined
from cpcal.vision.pose_sets.pose_box import PoseBox
from cpcal.vision.pose_sets.pose_enclosure import Found, View, contracted, enclosed
from cpcal.vision.pose_sets.pose_rows import pose_rows

_LEAST = 5  # dots of a group
_TURNS = 8  # at most
_PAYS = 0.95


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
    return before is None or shrunk(before.unknowns.width, after.unknowns.width, _PAYS)


def _others(view: View, active: Indices) -> Indices:
    return np.setdiff1d(np.arange(len(view.sight)), active)
