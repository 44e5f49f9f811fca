"""Whole numbers: bounds of components that take nothing else are rounded inward."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.solver.contract import Composable, Contraction, Step
from cpcal.solver.interval import Box, IntervalArray


class WholeNumbers(Composable):
    """A contractor that goes with every other one where a network has whole numbers."""

    idempotent = True

    def __init__(self, whole: Bools) -> None:
        self._whole = whole

    def contract(self, box: Box) -> Contraction:
        lo, hi = self._rounded(box.lo, box.hi)
        after = box.intersect(box.with_bounds(lo, hi)) if (lo <= hi).all() else Box.empty(box.names)
        if after.is_empty and not box.is_empty:
            return Contraction(after, (Step("whole numbers", None, "", np.nan),))
        moved = [("lo", k) for k in np.flatnonzero(lo > box.lo)] + [("hi", k) for k in np.flatnonzero(hi < box.hi)]
        names = box.names
        steps = [Step("whole numbers", names[k], side, float((lo if side == "lo" else hi)[k])) for side, k in moved]
        return Contraction(after, tuple(steps))

    def contract_batch(self, boxes: IntervalArray) -> IntervalArray:
        """All boxes (B, n) at once, NaN where one holds no whole number."""
        lo, hi = self._rounded(boxes.lo, boxes.hi)
        empty = ~(lo <= hi).all(axis=1)
        lo[empty], hi[empty] = np.nan, np.nan
        return IntervalArray(lo, hi)

    def _rounded(self, lo: Floats, hi: Floats) -> tuple[Floats, Floats]:
        return np.where(self._whole, np.ceil(lo), lo), np.where(self._whole, np.floor(hi), hi)
