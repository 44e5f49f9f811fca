"""Shaving (3B consistency): a slice at the end of a variable's domain that an inner contractor refutes is cut off.

After Lhomme, Consistency techniques for numeric CSPs (IJCAI 1993). A slice is a smaller box, so that the inner
contractor sees more in it than in the whole; the ends of all variables are tried in one batch.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Sequence
from functools import reduce

import numpy as np

from contractors.hc4 import HC4, moved_bounds
from cpcal.common.values import Floats
from cpcal.solver.contract import Composable, Contraction, Contractor, Step, shrunk, takes_batches
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork

# ------------------------------------------------------------------------------------------------------------------
# Boxes cut into slices along one variable, and all slices contracted: what shaving and CID have in common.


def slice_of(box: Box, component: int, lo: float, hi: float) -> Box:
    """The part of a box between two values of one component."""
    return box.replace(component, lo=lo, hi=hi)


def cuts(lo: float, hi: float, pieces: int) -> Floats:
    """`pieces + 1` numbers from lo to hi (finite), increasing, the ends exact."""
    inner = lo + (hi - lo) * (np.arange(1, pieces) / pieces) if hi - lo < np.inf else np.zeros(pieces - 1)
    return np.unique(np.concatenate([[lo], np.clip(inner, lo, hi), [hi]]))


def contract_all(inner: Contractor, boxes: Sequence[Box], passes: int, deadline: float = math.inf) -> list[Box]:
    """Each box contracted by `inner`; all at once, `passes` times, where it can do that."""
    if not boxes:
        return []
    if not takes_batches(inner):
        return [inner.contract(box, deadline).box for box in boxes]
    array = IntervalArray(np.stack([box.lo for box in boxes]), np.stack([box.hi for box in boxes]))
    left = contracted(inner, array, passes, deadline)
    return [box.with_bounds(lo, hi) for box, lo, hi in zip(boxes, left.lo, left.hi, strict=True)]


def contracted(inner: Contractor, array: IntervalArray, passes: int, deadline: float = math.inf) -> IntervalArray:
    """The same for bounds (B, n) of boxes, with a contractor that takes batches; NaN where nothing is left."""
    for _ in range(passes):
        alive = np.flatnonzero(~array.empty.any(axis=1))
        if not alive.size:
            break
        lo, hi = array.lo.copy(), array.hi.copy()
        narrowed = inner.contract_batch(array[alive], deadline)  # type: ignore[attr-defined]
        lo[alive], hi[alive] = narrowed.lo, narrowed.hi
        with np.errstate(all="ignore"):
            pays = shrunk((array.hi - array.lo)[alive], (hi - lo)[alive], 0.9)
        array = IntervalArray(lo, hi)
        if not pays:
            break
    return array


_SIDES = 2


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
        after = self._shaved(box, deadline) if not box.is_empty else box
        if after.is_empty and not box.is_empty:
            return Contraction(after, (Step("shaving", None, "", np.nan),))
        return Contraction(after, moved_bounds("shaving", box, after))

    def _shaved(self, box: Box, deadline: float) -> Box:
        box = self._inner.contract(box, deadline).box
        share = np.full((len(box), _SIDES), self._fraction)
        for _ in range(self._most):
            ends = [] if box.is_empty else self._open_ends(box, share)
            if not ends or time.monotonic() > deadline:
                break
            slices = [_end(box, component, side, share[component, side]) for component, side in ends]
            results = contract_all(self._inner, slices, self._passes, deadline)
            lo, hi = box.lo.copy(), box.hi.copy()
            for (component, side), piece, rest in zip(ends, slices, results, strict=True):
                _cut_off(lo, hi, component, side, piece, rest)
                share[component, side] = self._next(share[component, side], rest.is_empty)
            smaller = box.with_bounds(lo, hi)
            box = self._inner.contract(smaller, deadline).box if smaller != box else box
        return box

    def _open_ends(self, box: Box, share: Floats) -> list[tuple[int, int]]:
        """The (component, side) pairs that are still worth a slice."""
        bounded = np.isfinite(box.lo) & np.isfinite(box.hi) & (box.hi > box.lo) & np.isfinite(box.hi - box.lo)
        open_ends = bounded[:, None] & (share >= self._least)
        return [(int(component), int(side)) for component, side in np.argwhere(open_ends)]

    def _next(self, share: float, refuted: bool) -> float:
        """The share of the width for the next slice at an end; 0 when there is to be none."""
        if not self._adaptive:
            return share if refuted else 0.0
        return min(2.0 * share, 0.5) if refuted else 0.25 * share


def _end(box: Box, component: int, side: int, share: float) -> Box:
    """The slice at one end."""
    lo, hi = float(box.lo[component]), float(box.hi[component])
    cut = lo + share * (hi - lo) if side == 0 else hi - share * (hi - lo)
    cut = min(max(cut, lo), hi)
    return slice_of(box, component, lo, cut) if side == 0 else slice_of(box, component, cut, hi)


def _cut_off(lo: Floats, hi: Floats, component: int, side: int, piece: Box, rest: Box) -> None:
    """Move the bound to what is left of the slice, or behind the slice when nothing is."""
    if side == 0:
        new = piece.hi[component] if rest.is_empty else rest.lo[component]
        lo[component] = max(lo[component], new)
    else:
        new = piece.lo[component] if rest.is_empty else rest.hi[component]
        hi[component] = min(hi[component], new)


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
        after = self._narrowed(box, deadline) if not box.is_empty else box
        if after.is_empty and not box.is_empty:
            return Contraction(after, (Step("cid", None, "", np.nan),))
        return Contraction(after, moved_bounds("cid", box, after))

    def _narrowed(self, box: Box, deadline: float) -> Box:
        box = self._inner.contract(box, deadline).box
        active = list(range(len(box)))
        for _ in range(self._rounds):
            paying = []
            for component in active:
                if time.monotonic() > deadline:
                    return box
                before, box = box, self._turn(box, component, deadline)
                if box.is_empty:
                    return box
                if shrunk(before.width, box.width, self._ratio):
                    paying.append(component)
            active = paying
            if not active:
                break
        return box

    def _turn(self, box: Box, component: int, deadline: float) -> Box:
        """The hull of what is left of the slices along one component."""
        if box.is_empty or not np.isfinite(box.width[component]) or box.lo[component] == box.hi[component]:
            return box
        ends = cuts(float(box.lo[component]), float(box.hi[component]), self._slices)
        if not takes_batches(self._inner):
            pieces = [slice_of(box, component, lo, hi) for lo, hi in itertools.pairwise(ends.tolist())]
            return box.intersect(reduce(Box.hull, contract_all(self._inner, pieces, self._passes, deadline)))
        lo, hi = (np.repeat(bound[None], len(ends) - 1, axis=0) for bound in (box.lo, box.hi))
        lo[:, component], hi[:, component] = ends[:-1], ends[1:]
        left = contracted(self._inner, IntervalArray(lo, hi), self._passes, deadline)
        some = ~left.empty.any(axis=1)
        if not some.any():
            return Box.empty(box.names)
        return box.intersect(box.with_bounds(left.lo[some].min(axis=0), left.hi[some].max(axis=0)))


def cid(network: ConstraintNetwork, *, objective: str | None = None, arithmetic: str = "float64") -> Cid:
    """Constructive interval disjunction with hc4, adaptive."""
    return Cid(HC4(network, objective=objective, arithmetic=arithmetic), adaptive=True)
