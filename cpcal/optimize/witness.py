"""Proof of a point: x solves the network at a value of the objective, for some readings in their sets.

All in interval arithmetic at the point. A constraint without readings is evaluated. For a constraint
`lower <= body <= upper` with readings it is enough (intermediate value theorem: the reading sets are
convex and the body continuous) that one reading has `body <= upper` and one has `body >= lower`, as long as no
component of a reading enters two elements of the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.interval import Arithmetic, IntervalArray
from cpcal.network import Constraint, ConstraintNetwork, Expr, Tape
from cpcal.network.network import leaves
from cpcal.network.rows import Extremes

Floats = npt.NDArray[np.float64]

_TRIES = 60


@dataclass(frozen=True)
class Witness:
    """A point (n,) proved to solve the network; `value` is its objective component."""

    point: Floats
    value: float


class WitnessProver:
    """Proves points of one network."""

    def __init__(self, network: ConstraintNetwork, objective: int, engine: Arithmetic) -> None:
        self.objective, self._engine = objective, engine
        self._domain = network.domain
        self._plain = [c for c in network.constraints if not reads(c)]
        reading = [c for c in network.constraints if reads(c)]
        self._tape = Tape(network, [e for c in self._plain for e in (c.body - c.upper, c.lower - c.body)])
        self._reading = [ReadingConstraint(network, c) for c in reading]

    def prove(self, point: Floats) -> Witness | None:
        """The smallest objective (within rounding) at which the rest of `point` is proved, or None.

        The objective component of `point` is only where the search for it begins.
        """
        candidate = np.clip(point, self._domain.lo, self._domain.hi)
        o = self.objective
        increment = 0.0
        for _ in range(_TRIES):
            excess = self.excess(candidate)
            if excess <= 0.0:
                return Witness(candidate, float(candidate[o]))
            if not np.isfinite(excess):
                return None
            increment = max(2.0 * increment, excess, np.spacing(abs(candidate[o])))
            candidate[o] += increment
            if candidate[o] > self._domain.hi[o]:
                return None
        return None

    def excess(self, point: Floats) -> float:
        """A proved upper bound of the worst row at the point; <= 0 proves it. Infinite when it cannot be."""
        box = IntervalArray.point(point[None])
        worst = [-np.inf]
        with np.errstate(all="ignore"):
            slots = self._tape.forward(self._engine, box)
            if not self._tape.defined(slots):
                return np.inf
            worst += [_highest(slots[self._tape.slot(root)]) for root in self._tape.roots]
            open_constraints = 0
            for constraint in self._reading:
                if constraint.holds_for_all(self._engine, box):
                    continue
                open_constraints += 1
                worst.append(float(np.max(constraint.excesses(self._engine, box, point), initial=-np.inf)))
        # Two constraints that hold for some reading each need not hold for a common one.
        return float(max(worst)) if open_constraints <= 1 else np.inf


class ReadingConstraint:
    """One constraint whose body, and only its body, depends on readings."""

    def __init__(self, network: ConstraintNetwork, constraint: Constraint) -> None:
        self._over = constraint.body - constraint.upper
        self._under = constraint.lower - constraint.body
        self._order = constraint.lower - constraint.upper
        self._tape = Tape(network, [self._over, self._under, self._order, constraint.body])
        self._extremes = Extremes(network, constraint.body)
        bounds_read = any(_reads_expr(e) for e in (constraint.lower, constraint.upper))
        self._usable = self._extremes.owners.exclusive and not bounds_read

    def holds_for_all(self, engine: Arithmetic, box: IntervalArray) -> bool:
        slots = self._tape.forward(engine, box)
        highest = max(_highest(slots[self._tape.slot(e)]) for e in (self._over, self._under))
        return highest <= 0.0 and self._tape.defined(slots)

    def excesses(self, engine: Arithmetic, box: IntervalArray, point: Floats) -> Floats:
        """Element by element a bound of how far some reading is from satisfying it; <= 0: some reading does."""
        slots = self._tape.forward(engine, box)
        size = int(np.prod(self._over.shape))
        if not self._usable or not self._tape.defined(slots):
            return np.full(size, np.inf)
        smallest, largest = self._extremes.at(point)
        over = self._tape.forward(engine, box, self._moved(smallest))[self._tape.slot(self._over)]
        under = self._tape.forward(engine, box, self._moved(largest))[self._tape.slot(self._under)]
        order = slots[self._tape.slot(self._order)]
        return np.asarray(np.max([upper_ends(x, size) for x in (over, under, order)], axis=0))

    def _moved(self, readings: dict[int, IntervalArray]) -> dict[int, IntervalArray]:
        """The same readings (not constants: those keep their enclosures) by the slots of this tape."""
        tape = self._extremes.tape
        return {self._tape.slot(tape.nodes[k]): _inside(readings[k], tape.nodes[k]) for k in tape.readings}


def _inside(values: IntervalArray, reading: Expr) -> IntervalArray:
    """Values moved surely into a reading's set: its bounds are stored rounded outward by up to two floats."""
    data = reading.data
    assert isinstance(data, IntervalArray)
    lo = np.minimum(np.nextafter(np.nextafter(data.lo, np.inf), np.inf), data.mid)
    hi = np.maximum(np.nextafter(np.nextafter(data.hi, -np.inf), -np.inf), data.mid)
    return IntervalArray.point(np.where(data.lo == data.hi, data.lo, np.clip(values.lo, lo, hi)))


def upper_ends(x: IntervalArray, size: int) -> Floats:
    """The upper bounds of so many elements, infinite where one is undefined."""
    return np.broadcast_to(np.where(x.empty, np.inf, x.hi).ravel(), (size,))


def _highest(x: IntervalArray) -> float:
    """The largest upper bound; infinite where something is undefined."""
    if bool(np.any(x.empty)):
        return np.inf
    return float(np.max(x.hi, initial=-np.inf))


def reads(constraint: Constraint) -> bool:
    return any(_reads_expr(e) for e in (constraint.body, constraint.lower, constraint.upper))


def _reads_expr(expr: object) -> bool:
    return any(leaf.op == "reading" for leaf in leaves((expr,)))  # type: ignore[arg-type]
