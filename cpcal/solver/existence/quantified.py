"""Constraints on a box or at a point: rows that are at most zero, and proofs for all readings, or for some."""

from __future__ import annotations

import math

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network import Constraint, ConstraintNetwork, Expr, Tape
from cpcal.solver.network.rewrite import one_sided
from cpcal.solver.network.rows import Extremes
from cpcal.solver.network.tape import ReadingSets


class ReadingConstraint:
    """One constraint `lower <= body <= upper` with readings.

    With one choice of readings body <= upper and with another body >= lower: then some readings between them satisfy
    both, for the sets are convex and the body is continuous (intermediate value theorem), provided that no component
    of a reading enters two elements of the body, nor the bounds.
    """

    def __init__(self, network: ConstraintNetwork, constraint: Constraint) -> None:
        self._over = constraint.body - constraint.upper
        self._under = constraint.lower - constraint.body
        self._order = constraint.lower - constraint.upper
        self._tape = Tape(network, [self._over, self._under, self._order, constraint.body])
        self._extremes = Extremes(network, constraint.body)
        bounds_read = any(_reads_expr(e) for e in (constraint.lower, constraint.upper))
        self._usable = self._extremes.exclusive and not bounds_read

    def holds_for_all(self, engine: Arithmetic, box: IntervalArray) -> bool:
        slots = self._tape.forward(engine, box)
        worst = max(highest(self._tape.value(slots, e)) for e in (self._over, self._under))
        return worst <= 0.0 and self._tape.defined(engine, slots)

    def holding(self, engine: Arithmetic, box: IntervalArray, point: Floats) -> tuple[Bools, Bools]:
        """Elements that hold on the box for some reading, and those that hold for all."""
        slots = self._tape.forward(engine, box)
        size = int(np.prod(self._over.shape))
        ends = [upper_ends(self._tape.value(slots, e), size) for e in (self._over, self._under)]
        for_all = np.max(ends, axis=0) <= 0.0
        if not self._tape.defined(engine, slots):
            for_all = np.zeros(size, dtype=bool)
        return for_all | (self.excesses(engine, box, point) <= 0.0), for_all

    def excesses(self, engine: Arithmetic, box: IntervalArray, point: Floats) -> Floats:
        """Element by element a bound of how far some reading is from satisfying it; <= 0: some reading does."""
        slots = self._tape.forward(engine, box)
        size = int(np.prod(self._over.shape))
        if not self._usable or not self._tape.continuous(engine, slots):
            return np.full(size, np.inf)
        smallest, largest = (self._moved(ends) for ends in self._extremes.at(point))
        over = self._tape.value(self._tape.forward(engine, box, smallest), self._over)
        under = self._tape.value(self._tape.forward(engine, box, largest), self._under)
        order = self._tape.value(slots, self._order)
        return np.asarray(np.max([upper_ends(x, size) for x in (over, under, order)], axis=0))

    def _moved(self, readings: ReadingSets) -> ReadingSets:
        return {leaf.digest: _inside(readings[leaf.digest], leaf) for leaf in self._extremes.tape.readings}


def _inside(values: IntervalArray, reading: Expr) -> IntervalArray:
    """Values moved surely into a reading's set: its bounds are stored rounded outward by up to two floats."""
    data = reading.data
    assert isinstance(data, IntervalArray)
    lo = np.minimum(np.nextafter(np.nextafter(data.lo, np.inf), np.inf), data.mid)
    hi = np.maximum(np.nextafter(np.nextafter(data.hi, -np.inf), -np.inf), data.mid)
    return IntervalArray.point(np.where(data.lo == data.hi, data.lo, np.clip(values.lo, lo, hi)))


def sides(constraint: Constraint) -> list[Expr]:
    """Expressions that are at most zero where the constraint holds: none for a bound that is not there.

    An element without any bound asks to be defined: 0 times it.
    """
    rows = one_sided(0, constraint)
    count = math.prod(constraint.body.shape)
    bounded = np.zeros(count, dtype=bool)
    for row in rows:
        bounded[slice(None) if row.elements is None else row.elements] = True
    idle = [] if bounded.all() else [0.0 * constraint.body.reshape(-1)[np.flatnonzero(~bounded)]]
    return [row.expr for row in rows] + idle


def upper_ends(x: IntervalArray, size: int) -> Floats:
    """The upper bounds of so many elements, infinite where one is no number."""
    return np.broadcast_to(np.where(x.empty | np.isnan(x.hi), np.inf, x.hi).ravel(), (size,))


def highest(x: IntervalArray) -> float:
    """The largest upper bound; infinite where one is no number."""
    return float(np.max(upper_ends(x, x.lo.size), initial=-np.inf))


def reads(constraint: Constraint) -> bool:
    return any(_reads_expr(e) for e in (constraint.body, constraint.lower, constraint.upper))


def _reads_expr(expr: Expr) -> bool:
    return "reading" in expr.ops
