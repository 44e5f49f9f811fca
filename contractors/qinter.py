"""qinter: all but q of the constraints hold. The hull of the points that lie in at least N - q of N boxes, exactly.

Each constraint contracts the box by itself; a point that satisfies N - q of them lies in N - q of the results. (After
Carbonnel, Trombettoni, Vismara and Chabert, Q-intersection algorithms for constraint-based robust parameter
estimation, AAAI 2014.)

Why the hull can be had exactly. Boxes that meet pairwise have a common point (Helly's theorem for boxes). So N - q
of them have one exactly if leaving out at most q makes the others meet pairwise: if the graph of the pairs that do not
meet has a vertex cover of at most q. The smallest value of a component over all such points is the lower end of one
of the boxes, namely one of the q + 1 greatest such ends, since N - q boxes must begin before it; each is tried on the
boxes that contain it. In n dimensions that is 2 n (q + 1) graphs of O(n N^2) each and a search of O(2^q N^2) in each
graph. In one dimension it is the sweep over sorted ends; intersecting those sweeps over all dimensions (the usual
relaxation) can be much wider.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from contractors.hc4 import HC4
from cpcal.checker.rule import hitting_set
from cpcal.solver.contract import Composable, Contraction, Contractor, contracted, narrowed
from cpcal.solver.interval import Box, Floats, IntervalArray
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.network import restricted


class QInter(Composable):
    """The exact q-intersection of what N contractors make of a box: keeps all points that N - q of them keep."""

    def __init__(self, parts: Sequence[Contractor], q: int) -> None:
        if not 0 <= q < len(parts):
            raise ValueError(f"q = {q} of {len(parts)} constraints: q is at least 0 and less than their number")
        self._parts, self._q = tuple(parts), q

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        if box.is_empty:
            return Contraction(box)
        hull = q_intersection(Box.stacked(contracted(part, box, deadline).box for part in self._parts), self._q)
        after = Box.empty(box.names) if hull is None else box.intersect(hull)
        return narrowed("qinter", box, after)


def qinter(network: ConstraintNetwork, *, objective: str | None = None, q: int = 0) -> Contractor:
    """hc4 on each measurement (element along the leading axis) of each constraint, all but q of which must hold."""
    parts = [HC4(part, objective=objective) for part in one_by_one(network)]
    return QInter(parts, q) if parts else HC4(network, objective=objective)


def one_by_one(network: ConstraintNetwork) -> list[ConstraintNetwork]:
    """A network for each measurement of each constraint."""
    out = []
    for constraint in network.constraints:
        count = constraint.body.shape[0] if constraint.body.shape else 1
        alone = network.without_constraints()
        alone.add(constraint)
        for k in range(count):
            out.append(restricted(alone, [np.array([k])]) if constraint.body.shape else alone)
    return out


def q_intersection(boxes: IntervalArray, q: int) -> IntervalArray | None:
    """The hull (n,) of all points in at least N - q of N boxes (N, n), or None when there is none.

    Boxes with NaN hold no point; bounds may be infinite.
    """
    alive = ~boxes.empty.any(axis=1)
    q -= int(np.count_nonzero(~alive))
    if q < 0:
        return None
    lo, hi = boxes.lo[alive], boxes.hi[alive]
    if not _coverable(lo, hi, q):
        return None
    below = [_least(lo, hi, k, q) for k in range(lo.shape[1])]
    above = [-_least(-hi, -lo, k, q) for k in range(lo.shape[1])]
    return IntervalArray(np.array(below), np.array(above))


def _least(lo: Floats, hi: Floats, k: int, q: int) -> float:
    """The smallest k-th component of the points in all but q of the boxes, some such point being known to exist."""
    candidates = np.sort(lo[:, k])[-(q + 1) :]
    for value in candidates[:-1]:
        through = (lo[:, k] <= value) & (value <= hi[:, k])
        left = q - int(np.count_nonzero(~through))
        if left >= 0 and _coverable(lo[through], hi[through], left):
            return float(value)
    return float(candidates[-1])


def _coverable(lo: Floats, hi: Floats, q: int) -> bool:
    """Whether all but at most q boxes meet pairwise."""
    apart = np.argwhere((lo[:, None] > hi).any(axis=2)).tolist()
    return hitting_set([frozenset(pair) for pair in apart], q) is not None
