"""The box around all poses that satisfy all but q dots, q small: to first order the narrowest there is.

A bound from a linear program holds because of the dots T that have a multiplier in its proof: it holds for every pose
that satisfies those, whatever all other dots do. A pose that satisfies all dots but q either satisfies T, or violates
a t in T and satisfies all other dots but q - 1. So the bound with q outliers is the worst of the bound and, for each t
in T, the bound with q - 1 outliers among the dots without t. T has hardly more members than there are unknowns, so
there are about 7^q programs for each of the twelve bounds, where trying all subsets of dots would need n^q.

The rows are those of `pose_rows`, their products of unknowns replaced by what they are at least on the box; every
bound is proved from its multipliers.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.contract import shrunk
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.linear import BoxProgram, Dense
from cpcal.vision.pose_sets.enclosed import ENGINE
from cpcal.vision.pose_sets.pose_box import NAMES, PoseBox
from cpcal.vision.pose_sets.pose_enclosure import Found, View
from cpcal.vision.pose_sets.pose_rows import PoseRows, pose_rows

Dots = frozenset[int]

MOST = 2  # outliers
_ROUNDS = 3
_STRAIGHT = 0.02  # another round is made on boxes where products of unknowns count for more,
_PAYS = 0.8  # if some width shrinks below this share


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
        if rows.bend(unknowns) < _STRAIGHT or not shrunk(unknowns.width, after.width, _PAYS):
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
        program = BoxProgram(self._matrix[kept], self._rhs[kept], self._box, ENGINE, Dense())
        bound, rows = program.least(k, sign)
        return bound, frozenset((kept[rows] // 4).tolist())
