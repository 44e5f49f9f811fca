"""Constructive interval disjunction: cut one variable's domain into slices, contract each, keep the hull.

After Trombettoni and Chabert, Constructive interval disjunction (CP 2007). Unlike shaving it narrows all variables
by what all slices of one agree on.
"""

from __future__ import annotations

import itertools
from functools import reduce

import numpy as np

from contractors.hc4 import HC4, moved_bounds
from contractors.slices import contract_all, contracted, cuts, slice_of
from cpcal.solver.contract import Composable, Contraction, Contractor, Step, shrunk, takes_batches
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork


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

    def contract(self, box: Box) -> Contraction:
        after = self._narrowed(box) if not box.is_empty else box
        if after.is_empty and not box.is_empty:
            return Contraction(after, (Step("cid", None, "", np.nan),))
        return Contraction(after, moved_bounds("cid", box, after))

    def _narrowed(self, box: Box) -> Box:
        box = self._inner.contract(box).box
        active = list(range(len(box)))
        for _ in range(self._rounds):
            paying = []
            for component in active:
                if self.late:
                    return box
                before, box = box, self._turn(box, component)
                if box.is_empty:
                    return box
                if shrunk(before.width, box.width, self._ratio):
                    paying.append(component)
            active = paying
            if not active:
                break
        return box

    def _turn(self, box: Box, component: int) -> Box:
        """The hull of what is left of the slices along one component."""
        if box.is_empty or not np.isfinite(box.width[component]) or box.lo[component] == box.hi[component]:
            return box
        ends = cuts(float(box.lo[component]), float(box.hi[component]), self._slices)
        if not takes_batches(self._inner):
            pieces = [slice_of(box, component, lo, hi) for lo, hi in itertools.pairwise(ends.tolist())]
            return box.intersect(reduce(Box.hull, contract_all(self._inner, pieces, self._passes)))
        lo, hi = (np.repeat(bound[None], len(ends) - 1, axis=0) for bound in (box.lo, box.hi))
        lo[:, component], hi[:, component] = ends[:-1], ends[1:]
        left = contracted(self._inner, IntervalArray(lo, hi), self._passes)
        some = ~left.empty.any(axis=1)
        if not some.any():
            return Box.empty(box.names)
        return box.intersect(box.with_bounds(left.lo[some].min(axis=0), left.hi[some].max(axis=0)))


def cid(network: ConstraintNetwork, *, objective: str | None = None, arithmetic: str = "float64") -> Cid:
    """Constructive interval disjunction with hc4, adaptive."""
    return Cid(HC4(network, objective=objective, arithmetic=arithmetic), adaptive=True)
