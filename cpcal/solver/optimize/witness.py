"""Proof of a point: x solves the network at a value of the objective, for some readings in their sets.

All in interval arithmetic. A constraint without readings is evaluated; for one with readings see
`cpcal.solver.existence.ReadingConstraint`. Equations hold at no point of float64 numbers as a rule: a solution of them
is proved to exist in a tiny box (see `cpcal.solver.optimize.equations`), on which everything else must hold.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.existence import ReadingConstraint, highest, reads, sides
from cpcal.solver.interval import Arithmetic, Box, IntervalArray, get_arithmetic
from cpcal.solver.network import Constraint, ConstraintNetwork, Tape
from cpcal.solver.network.dag import leaves
from cpcal.solver.optimize.equations import Equations

_TRIES = 60
_PATIENCE = 6  # tries after which each must lower the worst row


@dataclass(frozen=True)
class Witness:
    """A point (n,) proved to solve the network; `value` is its objective component.

    `around`: where there are equations, the tiny box in which a solution is proved to exist, with an objective of at
    most `value`; `point` is its middle, and solves them up to rounding. None: the point itself is the solution.
    """

    point: Floats
    value: float
    around: Box | None = None


class WitnessProver:
    """Proves points of one network."""

    def __init__(self, network: ConstraintNetwork, objective: int, engine: Arithmetic) -> None:
        self.objective, self._engine = objective, engine
        self._domain, self._whole = network.domain, network.whole
        if self._whole.any():  # their rows hold with equality, which outward rounding in float64 does not see
            self._engine = engine = get_arithmetic("arb")
        self._plain = _Rows(network, [c for c in network.constraints if not reads(c)], objective)
        self.reading = [ReadingConstraint(network, c) for c in network.constraints if reads(c)]
        self.equations = Equations(network, engine)
        rest = list(self.equations.rest.constraints) if self.equations.count else []
        self._rest = _Rows(network, [c for c in rest if not reads(c)], objective)

    def within(self, domain: Box) -> WitnessProver:
        """The same for points in a part of the network's domain."""
        other = copy(self)
        other._domain, other.equations = domain, self.equations.within(domain)
        return other

    def prove(self, point: Floats) -> Witness | None:
        """The smallest objective (within rounding) at which the rest of `point` is proved, or None.

        The objective component of `point` is only where the search for it begins.
        """
        candidate = np.clip(point, self._domain.lo, self._domain.hi)
        candidate = np.where(self._whole, np.round(candidate), candidate)
        if not np.isfinite(candidate).all():
            return None
        found = self._raised(self._plain, IntervalArray.point(candidate), candidate)
        if found is not None or not self.equations.count:
            return found
        solved = self.equations.solved(candidate)
        return None if solved is None else self._on(solved)

    def _on(self, solved: Box) -> Witness | None:
        """A proof on a box that is known to hold a solution of the equations."""
        name, middle = solved.names[self.objective], solved.mid
        if self.objective in self.equations.enter:  # then they say what the objective is
            if not self._excess(self._rest, solved.array, middle)[0] <= 0.0:
                return None
            return Witness(middle, float(solved.hi[self.objective]), solved)
        found = self._raised(self._rest, solved.array, middle)
        return None if found is None else replace(found, around=solved.replace(name, lo=found.value, hi=found.value))

    def _raised(self, rows: _Rows, box: IntervalArray, middle: Floats) -> Witness | None:
        """Raise the objective until all rows hold on the box; None where that does not help, or too far."""
        candidate, o = middle.copy(), self.objective
        lo, hi = box.lo.copy(), box.hi.copy()
        increment, last = 0.0, np.inf
        for attempt in range(_TRIES):
            lo[o] = hi[o] = candidate[o]
            excess, stuck = self._excess(rows, IntervalArray(lo, hi), candidate)
            if excess <= 0.0:
                return Witness(candidate, float(candidate[o]))
            if stuck or not np.isfinite(excess) or (attempt > _PATIENCE and excess >= last):
                return None
            last = min(last, excess)
            increment = max(2.0 * increment, excess, np.spacing(abs(candidate[o])))
            candidate[o] += increment
            if candidate[o] > self._domain.hi[o]:
                return None
        return None

    def excess(self, point: Floats) -> float:
        """A proved upper bound of the worst row at the point; <= 0 proves it. Infinite when it cannot be."""
        return self._excess(self._plain, IntervalArray.point(point), point)[0]

    def _excess(self, rows: _Rows, box: IntervalArray, point: Floats) -> tuple[float, bool]:
        """The worst row on a tiny box around the point; and whether one fails that the objective does not enter."""
        values = IntervalArray(box.lo[None], box.hi[None])
        with np.errstate(all="ignore"):
            plain, stuck = rows.worst(self._engine, values)
            if stuck or plain == np.inf:
                return np.inf, stuck
            worst = [plain]
            open_constraints = 0
            for constraint in self.reading:
                if constraint.holds_for_all(self._engine, values):
                    continue
                open_constraints += 1
                worst.append(float(np.max(constraint.excesses(self._engine, values, point), initial=-np.inf)))
        # Two constraints that hold for some reading each need not hold for a common one.
        return (float(max(worst)) if open_constraints <= 1 else np.inf), False


class _Rows:
    """Constraints without readings as rows `r <= 0`: those that the objective enters, and the others."""

    def __init__(self, network: ConstraintNetwork, constraints: list[Constraint], objective: int) -> None:
        leaf = network.leaf_of(network.names[objective])
        groups: tuple[list[Constraint], list[Constraint]] = ([], [])
        for c in constraints:
            groups[any(node is leaf for node in leaves((c.body, c.lower, c.upper)))].append(c)
        self._tapes = [Tape(network, [e for c in group for e in sides(c)]) if group else None for group in groups]

    def worst(self, engine: Arithmetic, box: IntervalArray) -> tuple[float, bool]:
        """The worst row on a box (1, n), and whether it is one that no objective mends."""
        worst = -np.inf
        for tape, mended in zip(self._tapes, (False, True), strict=True):
            if tape is None:
                continue
            slots = tape.forward(engine, box)
            if not tape.defined(engine, slots):
                return np.inf, True
            worst = max(worst, highest(tape.values(slots)))
            if worst > 0.0 and not mended:
                return worst, True
        return worst, False
