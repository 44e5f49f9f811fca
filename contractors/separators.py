"""Separators: a pair of contractors, one for a set and one for its complement, so that boxes shrink from both sides.

After Jaulin and Desrochers, Introduction to the algebra of separators (2014). What the first removes is proved to
lie outside of the set, what the second removes to lie inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contractors.hc4 import HC4, moved_bounds
from cpcal.solver.contract import Composable, Contraction, Contractor, Step, Then, Union
from cpcal.solver.interval import Box, IntervalArray, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, Tape, one_sided_rows


class Violating(Composable):
    """Contracts to the points that may violate some constraint: each point that it removes is a solution.

    The hull, over all rows `r <= 0` of the network, of hc4 on `r >= 0`. A row that is not defined on all of the box
    removes nothing. With readings a point is removed when all readings of the sets satisfy all constraints: then some
    do, but much stays undecided.
    """

    monotone_tolerance = np.inf  # where a row begins to be defined, everything may go at once

    def __init__(self, network: ConstraintNetwork, *, arithmetic: str = "float64") -> None:
        self._engine = get_arithmetic(arithmetic)
        self._domain = network.domain
        rows = [row.expr for row in one_sided_rows(network)]
        self._tape = Tape(network, rows)
        self._parts = []
        for row in rows:
            for element in [row] if not row.shape else [row[k] for k in np.ndindex(row.shape)]:
                negated = network.without_constraints()
                negated.add(element >= 0.0)
                self._parts.append(HC4(negated, arithmetic=arithmetic))

    def contract(self, box: Box) -> Contraction:
        if box.is_empty or not box.subset(self._domain):
            return Contraction(box)
        slots = self._tape.forward(self._engine, IntervalArray(box.lo[None], box.hi[None]))
        if not self._tape.defined(self._engine, slots):
            return Contraction(box)
        after = Box.empty(box.names)
        for part in self._parts:
            after = after.hull(part.contract(box).box)
        if after.is_empty:
            return Contraction(after, (Step("violating", None, "", np.nan),))
        return Contraction(after, moved_bounds("violating", box, after))


@dataclass(frozen=True)
class Separation:
    """What both sides leave of a box: the set lies in `outer`, its complement in `inner`."""

    outer: Box
    inner: Box

    @property
    def undecided(self) -> Box:
        """The part of the box of which neither is known."""
        return self.outer.intersect(self.inner)


@dataclass(frozen=True)
class Separator:
    """`outer` keeps a set, `inner` its complement. `~s` is the complement, `s & t` and `s | t` are set operations."""

    outer: Contractor
    inner: Contractor

    @classmethod
    def of(cls, network: ConstraintNetwork, *, arithmetic: str = "float64") -> Separator:
        """The solutions of a network in its domain, by hc4 on both sides."""
        return cls(HC4(network, arithmetic=arithmetic), Violating(network, arithmetic=arithmetic))

    def separate(self, box: Box) -> Separation:
        return Separation(self.outer.contract(box).box, self.inner.contract(box).box)

    def __invert__(self) -> Separator:
        return Separator(self.inner, self.outer)

    def __and__(self, other: Separator) -> Separator:
        return Separator(Then(self.outer, other.outer), Union(self.inner, other.inner))

    def __or__(self, other: Separator) -> Separator:
        return Separator(Union(self.outer, other.outer), Then(self.inner, other.inner))
