"""hc4: one forward and one backward sweep over the whole network (HC4-revise on a shared DAG)."""

from __future__ import annotations

import numpy as np

from cpcal.solver.contract import Composable, Contraction, Step
from cpcal.solver.interval import Box, IntervalArray, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, rows_tape


class HC4(Composable):
    """Natural interval evaluation of every constraint, then narrowing of its arguments down to the variables.

    Works on any network and any box, also unbounded ones. Readings are narrowed like variables but never
    reported: a reading is a number that exists in its set. `sweeps` is how often the two sweeps are repeated, unless
    nothing moves.
    """

    def __init__(
        self, network: ConstraintNetwork, *, objective: str | None = None, arithmetic: str = "float64", sweeps: int = 1
    ) -> None:
        self._engine, self._sweeps = get_arithmetic(arithmetic), sweeps
        self._tape = rows_tape(network)

    def contract(self, box: Box) -> Contraction:
        narrowed = self.contract_batch(IntervalArray(box.lo[None], box.hi[None]))
        result = box.intersect(box.with_bounds(narrowed.lo[0], narrowed.hi[0]))
        if result.is_empty and not box.is_empty:
            return Contraction(result, (Step("hc4", None, "", np.nan),))
        return Contraction(result, moved_bounds("hc4", box, result))

    def contract_batch(self, boxes: IntervalArray) -> IntervalArray:
        """Contract B boxes at once: shape (B, n) in and out, NaN where a box holds no solution."""
        return self._tape.contract(self._engine, boxes, self._sweeps)


def moved_bounds(contractor: str, before: Box, after: Box) -> tuple[Step, ...]:
    """The bounds that differ, as steps (without the rows that moved them)."""
    steps = [Step(contractor, after.names[k], "lo", float(after.lo[k])) for k in np.flatnonzero(after.lo > before.lo)]
    steps += [Step(contractor, after.names[k], "hi", float(after.hi[k])) for k in np.flatnonzero(after.hi < before.hi)]
    return tuple(steps)
