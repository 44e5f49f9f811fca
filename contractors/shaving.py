"""Shaving (3B consistency): a slice at the end of a variable's domain that an inner contractor refutes is cut off.

After Lhomme, Consistency techniques for numeric CSPs (IJCAI 1993). A slice is a smaller box, so that the inner
contractor sees more in it than in the whole; the ends of all variables are tried in one batch.
"""

from __future__ import annotations

import math
import time

import numpy as np

from contractors.hc4 import HC4
from cpcal.common.values import Floats, Ints
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
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork

# ------------------------------------------------------------------------------------------------------------------
# Boxes cut into slices along one variable, and all slices contracted: what shaving and CID have in common.


def cuts(lo: float, hi: float, pieces: int) -> Floats:
    """`pieces + 1` numbers from lo to hi (finite), increasing, the ends exact."""
    inner = lo + (hi - lo) * (np.arange(1, pieces) / pieces) if hi - lo < np.inf else np.zeros(pieces - 1)
    return np.unique(np.concatenate([[lo], np.clip(inner, lo, hi), [hi]]))


def contracted_slices(
    inner: Contractor, box: Box, component: Ints, slices: IntervalArray, passes: int, deadline: float = math.inf
) -> IntervalArray:
    """What `inner` leaves (B, n) of parts of a box, each between two values of one component: `component` (B,) and
    `slices` (B,). NaN where nothing is left. All at once, `passes` times, where it takes batches."""
    rows = np.arange(len(component))
    lo, hi = (np.repeat(bound[None], len(rows), axis=0) for bound in (box.lo, box.hi))
    lo[rows, component], hi[rows, component] = slices.lo, slices.hi
    if not takes_batches(inner):
        left = [contracted(inner, box.with_bounds(*bounds), deadline).box for bounds in zip(lo, hi, strict=True)]
        return IntervalArray(np.stack([one.lo for one in left]), np.stack([one.hi for one in left]))
    array = IntervalArray(lo, hi)
    for _ in range(passes):
        alive = np.flatnonzero(~array.empty.any(axis=1))
        if not alive.size:
            break
        lo, hi = array.lo.copy(), array.hi.copy()
        left = answered(inner, "contract_batch", array[alive], deadline)
        lo[alive], hi[alive] = left.lo, left.hi
        with np.errstate(all="ignore"):
            pays = shrunk((array.hi - array.lo)[alive], (hi - lo)[alive], 0.9)
        array = IntervalArray(lo, hi)
        if not pays:
            break
    return array


class Shaving(Composable):
    """Shaves both ends of every bounded variable with `inner`, between passes of `inner` over the whole box.

    An end begins with a slice of `fraction` of the width. Adaptive: a slice that was refuted is doubled, one that was
    not is divided by four, and an end whose slice falls below `least` is left alone. With `adaptive=False` every
    slice keeps its size and an end is left at the first failure.
    """

    monotone_tolerance = np.inf  # where slices end depends on the box

    def __init__(
        self,
        inner: Contractor,
        *,
        fraction: float = 0.25,
        least: float = 0.01,
        adaptive: bool = True,
        most: int = 50,
        passes: int = 5,
    ) -> None:
        if not 0.0 < least <= fraction <= 0.5:
            raise ValueError(f"0 < least <= fraction <= 0.5 does not hold for least={least}, fraction={fraction}")
        self._inner, self._fraction, self._least = inner, fraction, least if adaptive else fraction
        self._adaptive, self._most, self._passes = adaptive, most, passes

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        return narrowed("shaving", box, box if box.is_empty else self._shaved(box, deadline))

    def _shaved(self, box: Box, deadline: float) -> Box:
        box = contracted(self._inner, box, deadline).box
        share = np.full((len(box), 2), self._fraction)  # of the width, at the lower and the upper end
        for _ in range(self._most):
            bounded = np.isfinite(box.lo) & np.isfinite(box.hi) & (box.hi > box.lo) & np.isfinite(box.hi - box.lo)
            component, side = np.nonzero(bounded[:, None] & (share >= self._least))
            if box.is_empty or not component.size or time.monotonic() > deadline:
                break
            lo, hi, low = box.lo[component], box.hi[component], side == 0
            step = share[component, side] * (hi - lo)
            cut = np.minimum(np.maximum(np.where(low, lo + step, hi - step), lo), hi)
            slices = IntervalArray(np.where(low, lo, cut), np.where(low, cut, hi))
            left = contracted_slices(self._inner, box, component, slices, self._passes, deadline)
            refuted = left.empty.any(axis=1)
            rows = np.arange(len(component))
            ends = np.where(refuted, cut, np.where(low, left.lo[rows, component], left.hi[rows, component]))
            new_lo, new_hi = box.lo.copy(), box.hi.copy()
            new_lo[component[low]] = np.maximum(lo, ends)[low]
            new_hi[component[~low]] = np.minimum(hi, ends)[~low]
            again = np.where(refuted, np.minimum(2.0 * share[component, side], 0.5), 0.25 * share[component, side])
            share[component, side] = again if self._adaptive else np.where(refuted, share[component, side], 0.0)
            smaller = box.with_bounds(new_lo, new_hi)
            box = contracted(self._inner, smaller, deadline).box if smaller != box else box
        return box


def shaving(network: ConstraintNetwork, *, objective: str | None = None, arithmetic: str = "float64") -> Shaving:
    """Shaving with hc4."""
    return Shaving(HC4(network, objective=objective, arithmetic=arithmetic))


# ------------------------------------------------------------------------------------------------------------------
# Constructive interval disjunction: cut one variable's domain into slices, contract each, keep the hull.
#
# After Trombettoni and Chabert, Constructive interval disjunction (CP 2007). Unlike shaving it narrows all variables
# by what all slices of one agree on.


class Cid(Composable):
    """One variable after the other, `slices` slices each, `inner` on every slice.

    Adaptive: in the next round only those variables are cut again whose last turn made some component narrower than
    `ratio` times its width, until there is none (or `rounds` are over). Otherwise every variable has one turn.
    """

    monotone_tolerance = np.inf  # where slices end depends on the box

    def __init__(
        self,
        inner: Contractor,
        *,
        slices: int = 4,
        adaptive: bool = False,
        ratio: float = 0.95,
        rounds: int = 10,
        passes: int = 5,
    ) -> None:
        if slices < 2:
            raise ValueError(f"a disjunction has at least 2 slices, not {slices}")
        self._inner, self._slices, self._passes = inner, slices, passes
        self._ratio, self._rounds = ratio, rounds if adaptive else 1

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        return narrowed("cid", box, box if box.is_empty else self._disjoined(box, deadline))

    def _disjoined(self, box: Box, deadline: float) -> Box:
        box = contracted(self._inner, box, deadline).box
        active = list(range(len(box)))
        for _ in range(self._rounds):
            paying = []
            for component in active:
                if box.is_empty or time.monotonic() > deadline:
                    return box
                before, box = box, self._turn(box, component, deadline)
                if not box.is_empty and shrunk(before.width, box.width, self._ratio):
                    paying.append(component)
            active = paying
        return box

    def _turn(self, box: Box, component: int, deadline: float) -> Box:
        """The hull of what is left of the slices along one component."""
        if not np.isfinite(box.width[component]) or box.lo[component] == box.hi[component]:
            return box
        ends = cuts(float(box.lo[component]), float(box.hi[component]), self._slices)
        slices = IntervalArray(ends[:-1], ends[1:])
        which = np.full(len(ends) - 1, component)
        left = contracted_slices(self._inner, box, which, slices, self._passes, deadline)
        some = ~left.empty.any(axis=1)
        if not some.any():
            return Box.empty(box.names)
        return box.intersect(box.with_bounds(left.lo[some].min(axis=0), left.hi[some].max(axis=0)))


def cid(network: ConstraintNetwork, *, objective: str | None = None, arithmetic: str = "float64") -> Cid:
    """Constructive interval disjunction with hc4, adaptive."""
    return Cid(HC4(network, objective=objective, arithmetic=arithmetic), adaptive=True)
