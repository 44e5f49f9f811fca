"""Shaving by constructive interval disjunction: cut one variable's domain into slices, contract each, keep the hull.

After Trombettoni and Chabert, Constructive interval disjunction (CP 2007). It cuts off slices that are refuted, as
shaving (3B) does, and narrows all variables by what all slices of one agree on.
"""

from __future__ import annotations

import math
import time

import numpy as np

from contractors.hc4 import HC4
from cpcal.solver.contract import Composable, Contraction, Contractor, TakesBatches, contracted, narrowed, shrunk
from cpcal.solver.interval import Box, Floats, IntervalArray
from cpcal.solver.network import ConstraintNetwork

_PASSES = 5  # of the inner contractor over all slices, while some width falls below nine tenths
_ROUNDS = 10  # times that all variables are cut, at most
_PAYS = 0.95  # of a width: what a variable's turn must leave less of, so that it has another


class Cid(Composable):
    """One variable after the other, `slices` slices each, `inner` on every slice.

    In the next round only those variables are cut again whose last turn made some component narrower than 0.95 times
    its width, until there is none.
    """

    def __init__(self, inner: Contractor, *, slices: int = 4) -> None:
        if slices < 2:
            raise ValueError(f"a disjunction has at least 2 slices, not {slices}")
        self._inner, self._slices = inner, slices

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        return narrowed("cid", box, box if box.is_empty else self._left(box, deadline))

    def _left(self, box: Box, deadline: float) -> Box:
        box = contracted(self._inner, box, deadline).box
        active = list(range(len(box)))
        for _ in range(_ROUNDS):
            paying = []
            for component in active:
                if box.is_empty or time.monotonic() > deadline:
                    return box
                before, box = box, self._turn(box, component, deadline)
                if not box.is_empty and shrunk(before.width, box.width, _PAYS):
                    paying.append(component)
            active = paying
        return box

    def _turn(self, box: Box, component: int, deadline: float) -> Box:
        """The hull of what is left of the slices along one component."""
        if not np.isfinite(box.width[component]) or box.lo[component] == box.hi[component]:
            return box
        ends = cuts(float(box.lo[component]), float(box.hi[component]), self._slices)
        left = self.slices(box, component, ends, deadline)
        some = ~left.empty.any(axis=1)
        if not some.any():
            return Box.empty(box.names)
        return box.intersect(IntervalArray(left.lo[some].min(axis=0), left.hi[some].max(axis=0)))

    def slices(self, box: Box, component: int, ends: Floats, deadline: float = math.inf) -> IntervalArray:
        """What `inner` leaves (B, n) of the parts of a box between B + 1 ends of one component; NaN where nothing is
        left. All at once, in several passes, where it takes batches."""
        lo, hi = (np.repeat(bound[None], len(ends) - 1, axis=0) for bound in (box.lo, box.hi))
        lo[:, component], hi[:, component] = ends[:-1], ends[1:]
        if not isinstance(self._inner, TakesBatches):
            parts = [box.with_bounds(*bounds) for bounds in zip(lo, hi, strict=True)]
            return Box.stacked(contracted(self._inner, part, deadline).box for part in parts)
        array = IntervalArray(lo, hi)
        for _ in range(_PASSES):
            alive = np.flatnonzero(~array.empty.any(axis=1))
            if not alive.size:
                break
            lo, hi = array.lo.copy(), array.hi.copy()
            some = self._inner.contract_batch(array[alive], deadline)
            lo[alive], hi[alive] = some.lo, some.hi
            with np.errstate(all="ignore"):
                pays = shrunk((array.hi - array.lo)[alive], (hi - lo)[alive], 0.9)
            array = IntervalArray(lo, hi)
            if not pays:
                break
        return array


def cuts(lo: float, hi: float, pieces: int) -> Floats:
    """`pieces + 1` numbers from lo to hi (finite), increasing, the ends exact."""
    inner = lo + (hi - lo) * (np.arange(1, pieces) / pieces) if hi - lo < np.inf else np.zeros(pieces - 1)
    return np.unique(np.concatenate([[lo], np.clip(inner, lo, hi), [hi]]))


def cid(network: ConstraintNetwork, *, objective: str | None = None) -> Cid:
    """Constructive interval disjunction with hc4."""
    return Cid(HC4(network, objective=objective))
