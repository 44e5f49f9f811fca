"""Shaving (3B consistency): a slice at the end of a variable's domain that an inner contractor refutes is cut off.

After Lhomme, Consistency techniques for numeric CSPs (IJCAI 1993). A slice is a smaller box, so that the inner
contractor sees more in it than in the whole; the ends of all variables are tried in one batch.
"""

from __future__ import annotations

import math
import time

import numpy as np

from contractors.hc4 import HC4
from cpcal.solver.contract import (
    Composable,
    Contraction,
    Contractor,
    answered,
    contracted,
    narrowed,
    shrunk,
    takes_batches,
)
from cpcal.solver.interval import Box, Floats, IntervalArray, Ints
from cpcal.solver.network import ConstraintNetwork

# ------------------------------------------------------------------------------------------------------------------
# Boxes cut into slices along one variable, and all slices contracted: what shaving and CID have in common.

_PASSES = 5  # of the inner contractor over all slices, while some width falls below nine tenths
_FIRST, _LEAST = 0.25, 0.01  # of a width: the slice that shaving begins with at an end, and the smallest
_SHAVINGS, _ROUNDS = 50, 10  # times that all ends are shaved, or all variables cut, at most
_PAYS = 0.95  # of a width: what a variable's turn must leave less of, so that it has another


def cuts(lo: float, hi: float, pieces: int) -> Floats:
    """`pieces + 1` numbers from lo to hi (finite), increasing, the ends exact."""
    inner = lo + (hi - lo) * (np.arange(1, pieces) / pieces) if hi - lo < np.inf else np.zeros(pieces - 1)
    return np.unique(np.concatenate([[lo], np.clip(inner, lo, hi), [hi]]))


class _OnSlices(Composable):
    """A contractor that tries `inner` on parts of what it leaves of the whole box."""

    name = ""

    def __init__(self, inner: Contractor) -> None:
        self._inner = inner

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        return narrowed(self.name, box, box if box.is_empty else self._left(box, deadline))

    def _left(self, box: Box, deadline: float) -> Box:
        raise NotImplementedError

    def _contracted(self, box: Box, deadline: float) -> Box:
        return contracted(self._inner, box, deadline).box

    def slices(self, box: Box, component: Ints, slices: IntervalArray, deadline: float = math.inf) -> IntervalArray:
        """What `inner` leaves (B, n) of parts of a box, each between two values of one component: `component` (B,) and
        `slices` (B,). NaN where nothing is left. All at once, in several passes, where it takes batches."""
        rows = np.arange(len(component))
        lo, hi = (np.repeat(bound[None], len(rows), axis=0) for bound in (box.lo, box.hi))
        lo[rows, component], hi[rows, component] = slices.lo, slices.hi
        if not takes_batches(self._inner):
            left = [self._contracted(box.with_bounds(*bounds), deadline) for bounds in zip(lo, hi, strict=True)]
            return IntervalArray(np.stack([one.lo for one in left]), np.stack([one.hi for one in left]))
        array = IntervalArray(lo, hi)
        for _ in range(_PASSES):
            alive = np.flatnonzero(~array.empty.any(axis=1))
            if not alive.size:
                break
            lo, hi = array.lo.copy(), array.hi.copy()
            some = answered(self._inner, "contract_batch", array[alive], deadline)
            lo[alive], hi[alive] = some.lo, some.hi
            with np.errstate(all="ignore"):
                pays = shrunk((array.hi - array.lo)[alive], (hi - lo)[alive], 0.9)
            array = IntervalArray(lo, hi)
            if not pays:
                break
        return array


class Shaving(_OnSlices):
    """Shaves both ends of every bounded variable with `inner`, between passes of `inner` over the whole box.

    An end begins with a slice of a quarter of the width. A slice that was refuted is doubled, one that was not is
    divided by four, and an end whose slice falls below a hundredth is left alone.
    """

    name = "shaving"

    def _left(self, box: Box, deadline: float) -> Box:
        box = self._contracted(box, deadline)
        share = np.full((len(box), 2), _FIRST)  # of the width, at the lower and the upper end
        for _ in range(_SHAVINGS):
            bounded = np.isfinite(box.lo) & np.isfinite(box.hi) & (box.hi > box.lo) & np.isfinite(box.hi - box.lo)
            component, side = np.nonzero(bounded[:, None] & (share >= _LEAST))
            if box.is_empty or not component.size or time.monotonic() > deadline:
                break
            lo, hi, low = box.lo[component], box.hi[component], side == 0
            step = share[component, side] * (hi - lo)
            cut = np.minimum(np.maximum(np.where(low, lo + step, hi - step), lo), hi)
            left = self.slices(box, component, IntervalArray(np.where(low, lo, cut), np.where(low, cut, hi)), deadline)
            refuted = left.empty.any(axis=1)
            rows = np.arange(len(component))
            ends = np.where(refuted, cut, np.where(low, left.lo[rows, component], left.hi[rows, component]))
            new_lo, new_hi = box.lo.copy(), box.hi.copy()
            new_lo[component[low]] = np.maximum(lo, ends)[low]
            new_hi[component[~low]] = np.minimum(hi, ends)[~low]
            share[component, side] *= np.where(refuted, 2.0, 0.25)
            share = np.minimum(share, 0.5)
            smaller = box.with_bounds(new_lo, new_hi)
            box = self._contracted(smaller, deadline) if smaller != box else box
        return box


def shaving(network: ConstraintNetwork, *, objective: str | None = None) -> Shaving:
    """Shaving with hc4."""
    return Shaving(HC4(network, objective=objective))


# ------------------------------------------------------------------------------------------------------------------
# Constructive interval disjunction: cut one variable's domain into slices, contract each, keep the hull.
#
# After Trombettoni and Chabert, Constructive interval disjunction (CP 2007). Unlike shaving it narrows all variables
# by what all slices of one agree on.


class Cid(_OnSlices):
    """One variable after the other, `slices` slices each, `inner` on every slice.

    In the next round only those variables are cut again whose last turn made some component narrower than 0.95 times
    its width, until there is none.
    """

    name = "cid"

    def __init__(self, inner: Contractor, *, slices: int = 4) -> None:
        if slices < 2:
            raise ValueError(f"a disjunction has at least 2 slices, not {slices}")
        super().__init__(inner)
        self._slices = slices

    def _left(self, box: Box, deadline: float) -> Box:
        box = self._contracted(box, deadline)
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
        which = np.full(len(ends) - 1, component)
        left = self.slices(box, which, IntervalArray(ends[:-1], ends[1:]), deadline)
        some = ~left.empty.any(axis=1)
        if not some.any():
            return Box.empty(box.names)
        return box.intersect(box.with_bounds(left.lo[some].min(axis=0), left.hi[some].max(axis=0)))


def cid(network: ConstraintNetwork, *, objective: str | None = None) -> Cid:
    """Constructive interval disjunction with hc4."""
    return Cid(HC4(network, objective=objective))
