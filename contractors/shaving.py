"""Shaving (3B consistency): a slice at the end of a variable's domain that an inner contractor refutes is cut off.

After Lhomme, Consistency techniques for numeric CSPs (IJCAI 1993). A slice is a smaller box, so that the inner
contractor sees more in it than in the whole; the ends of all variables are tried in one batch.
"""

from __future__ import annotations

import numpy as np

from contractors.hc4 import HC4, moved_bounds
from contractors.slices import contract_all, slice_of
from cpcal.common.arrays import Floats
from cpcal.solver.contract import Composable, Contraction, Contractor, Step
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork

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

    def contract(self, box: Box) -> Contraction:
        after = self._shaved(box) if not box.is_empty else box
        if after.is_empty and not box.is_empty:
            return Contraction(after, (Step("shaving", None, "", np.nan),))
        return Contraction(after, moved_bounds("shaving", box, after))

    def _shaved(self, box: Box) -> Box:
        box = self._inner.contract(box).box
        share = np.full((len(box), _SIDES), self._fraction)
        for _ in range(self._most):
            ends = [] if box.is_empty else self._open_ends(box, share)
            if not ends or self.late:
                break
            slices = [_end(box, component, side, share[component, side]) for component, side in ends]
            results = contract_all(self._inner, slices, self._passes)
            lo, hi = box.lo.copy(), box.hi.copy()
            for (component, side), piece, rest in zip(ends, slices, results, strict=True):
                _cut_off(lo, hi, component, side, piece, rest)
                share[component, side] = self._next(share[component, side], rest.is_empty)
            smaller = box.with_bounds(lo, hi)
            box = self._inner.contract(smaller).box if smaller != box else box
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
