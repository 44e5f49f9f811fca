"""Whole boxes of solutions: at every point THERE EXIST readings in their sets with which all constraints hold."""

from __future__ import annotations

import numpy as np

from cpcal.interval import Arithmetic, Box, IntervalArray
from cpcal.network import Constraint, ConstraintNetwork, Expr, Tape
from cpcal.network.network import leaves
from cpcal.network.rows import Extremes


class Inside:
    """Proves boxes of one network; False means that it is not known.

    Constraints without readings are evaluated over the box, as are those with readings, which may hold for all of
    them. For one constraint `lower <= body <= upper` more can be done: with one choice of readings body <= upper on
    the whole box and with another body >= lower, hence at each point some readings between them satisfy both (the
    sets are convex and the body continuous), provided that no component of a reading enters two elements.
    """

    def __init__(self, network: ConstraintNetwork, engine: Arithmetic) -> None:
        self._engine, self._domain = engine, network.domain
        self._plain = Tape(network, [e for c in network.constraints if not _reads(c) for e in _sides(c)])
        self._reading = [_ReadingConstraint(network, c) for c in network.constraints if _reads(c)]

    def __call__(self, box: Box) -> bool:
        """Whether every point of the box is proved to be a solution, in the domain."""
        if box.is_empty or not box.subset(self._domain):
            return False
        values = IntervalArray(box.lo[None], box.hi[None])
        with np.errstate(all="ignore"):
            if not _hold(self._engine, self._plain, values):
                return False
            choices = [c for c in self._reading if not c.holds_for_all(self._engine, values)]
            # Two constraints that hold for some readings each need not hold for common ones.
            return not choices or (len(choices) == 1 and choices[0].holds_for_some(self._engine, values))


class _ReadingConstraint:
    """One constraint with readings."""

    def __init__(self, network: ConstraintNetwork, constraint: Constraint) -> None:
        self._over, self._under = _sides(constraint)
        self._order = constraint.lower - constraint.upper
        self._tape = Tape(network, [self._over, self._under, self._order])
        self._extremes = Extremes(network, constraint.body)
        bounds = leaves((constraint.lower, constraint.upper))
        self._usable = self._extremes.owners.exclusive and all(leaf.op != "reading" for leaf in bounds)

    def holds_for_all(self, engine: Arithmetic, box: IntervalArray) -> bool:
        return _hold(engine, self._tape, box)

    def holds_for_some(self, engine: Arithmetic, box: IntervalArray) -> bool:
        slots = self._tape.forward(engine, box)
        if not self._usable or not self._tape.defined(slots):
            return False
        smallest, largest = self._extremes.at(box.mid[0])
        over = self._tape.forward(engine, box, self._moved(smallest))[self._tape.slot(self._over)]
        under = self._tape.forward(engine, box, self._moved(largest))[self._tape.slot(self._under)]
        return all(map(_nonpositive, (over, under, slots[self._tape.slot(self._order)])))

    def _moved(self, readings: dict[int, IntervalArray]) -> dict[int, IntervalArray]:
        """The same readings by the slots of this tape (constants keep their enclosures)."""
        tape = self._extremes.tape
        return {self._tape.slot(tape.nodes[k]): _surely_inside(readings[k], tape.nodes[k]) for k in tape.readings}


def _surely_inside(values: IntervalArray, reading: Expr) -> IntervalArray:
    """Values moved into a reading's set, whose bounds are stored rounded outward by up to two floats."""
    data = reading.data
    assert isinstance(data, IntervalArray)
    lo = np.minimum(np.nextafter(np.nextafter(data.lo, np.inf), np.inf), data.mid)
    hi = np.maximum(np.nextafter(np.nextafter(data.hi, -np.inf), -np.inf), data.mid)
    return IntervalArray.point(np.where(data.lo == data.hi, data.lo, np.clip(values.lo, lo, hi)))


def _hold(engine: Arithmetic, tape: Tape, box: IntervalArray) -> bool:
    """Whether all roots are defined and at most zero on a box."""
    slots = tape.forward(engine, box)
    return tape.defined(slots) and all(_nonpositive(slots[tape.slot(root)]) for root in tape.roots)


def _nonpositive(x: IntervalArray) -> bool:
    return bool(np.all(x.hi <= 0.0))  # NaN, the empty interval, is not


def _sides(constraint: Constraint) -> tuple[Expr, Expr]:
    """The two expressions that are at most zero where the constraint holds."""
    return constraint.body - constraint.upper, constraint.lower - constraint.body


def _reads(constraint: Constraint) -> bool:
    return any(leaf.op == "reading" for leaf in leaves((constraint.body, constraint.lower, constraint.upper)))
