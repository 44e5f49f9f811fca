"""Proof of a point: x solves the network at a value of the objective, for some readings in their sets.

All in interval arithmetic at the point. A constraint without readings is evaluated; for one with readings see
`cpcal.solver.existence.ReadingConstraint`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.existence import ReadingConstraint, highest, reads
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network import ConstraintNetwork, Tape

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
            if not self._tape.defined(self._engine, slots):
                return np.inf
            worst.append(highest(self._tape.values(slots)))
            open_constraints = 0
            for constraint in self._reading:
                if constraint.holds_for_all(self._engine, box):
                    continue
                open_constraints += 1
                worst.append(float(np.max(constraint.excesses(self._engine, box, point), initial=-np.inf)))
        # Two constraints that hold for some reading each need not hold for a common one.
        return float(max(worst)) if open_constraints <= 1 else np.inf
