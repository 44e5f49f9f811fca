"""Whole boxes of solutions: at every point THERE EXIST readings in their sets with which all constraints hold."""

from __future__ import annotations

import numpy as np

from cpcal.solver.existence.quantified import ReadingConstraint, highest, reads, sides
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, Tape


class Inside:
    """Proves boxes of one network; False means that it is not known.

    Constraints without readings are evaluated over the box, as are those with readings, which may hold for all of
    them. One constraint may hold for some readings only: with the same two choices on the whole box, see
    `ReadingConstraint`.
    """

    def __init__(self, network: ConstraintNetwork, engine: Arithmetic) -> None:
        self._engine, self._domain, self._whole = engine, network.domain, network.whole
        self._plain = Tape(network, [e for c in network.constraints if not reads(c) for e in sides(c)])
        self._reading = [ReadingConstraint(network, c) for c in network.constraints if reads(c)]

    def __call__(self, box: Box) -> bool:
        """Whether every point of the box is proved to be a solution, in the domain."""
        if box.is_empty or not box.subset(self._domain) or (self._whole & (box.lo < box.hi)).any():
            return False  # between two whole numbers no point is a solution
        values = IntervalArray(box.lo[None], box.hi[None])
        with np.errstate(all="ignore"):
            if not _hold(self._engine, self._plain, values):
                return False
            choices = [c for c in self._reading if not c.holds_for_all(self._engine, values)]
            # Two constraints that hold for some readings each need not hold for common ones.
            return not choices or (len(choices) == 1 and self._for_some(choices[0], values))

    def _for_some(self, constraint: ReadingConstraint, values: IntervalArray) -> bool:
        return bool((constraint.excesses(self._engine, values, values.mid[0]) <= 0.0).all())


def _hold(engine: Arithmetic, tape: Tape, box: IntervalArray) -> bool:
    """Whether all roots are defined and at most zero on a box."""
    slots = tape.forward(engine, box)
    return tape.defined(engine, slots) and highest(tape.values(slots)) <= 0.0
