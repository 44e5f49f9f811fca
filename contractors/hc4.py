"""hc4: one forward and one backward sweep over the whole network (HC4-revise on a shared DAG)."""

from __future__ import annotations

import math

from cpcal.solver.contract import Composable, Contraction, narrowed
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, rows_tape


class HC4(Composable):
    """Natural interval evaluation of every constraint, then narrowing of its arguments down to the variables.

    Works on any network and any box, also unbounded ones. Readings are narrowed like variables but never
    reported: a reading is a number that exists in its set.
    """

    def __init__(self, network: ConstraintNetwork, *, objective: str | None = None) -> None:
        self._tape = rows_tape(network)

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        return narrowed("hc4", box, box.intersect(self.contract_batch(box.array[None])[0]))

    def contract_batch(self, boxes: IntervalArray, deadline: float = math.inf) -> IntervalArray:
        """Contract B boxes at once: shape (B, n) in and out, NaN where a box holds no solution."""
        return self._tape.contract(boxes)
