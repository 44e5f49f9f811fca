"""hc4: one forward and one backward sweep over the whole network (HC4-revise on a shared DAG)."""

from __future__ import annotations

import numpy as np

from cpcal.solver.contract import Composable, Contraction, Step
from cpcal.solver.interval import Box, IntervalArray, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, Tape, one_sided_rows


class HC4(Composable):
    """Natural interval evaluation of every constraint, then narrowing of its arguments down to the variables.

    Works on any network and any box, also unbounded ones. Readings are narrowed like variables but never
    reported: a reading is a number that exists in its set.
    """

    def __init__(
        self, network: ConstraintNetwork, *, objective: str | None = None, arithmetic: str = "float64"
    ) -> None:
        self._engine = get_arithmetic(arithmetic)
        rows = one_sided_rows(network)
        self._tape = Tape(network, [row.expr for row in rows])
        largest = max((int(np.prod(node.shape)) for node in self._tape.nodes), default=1)
        self._together = max(1, _CACHED // max(largest, 1))

    def contract(self, box: Box) -> Contraction:
        narrowed = self.contract_batch(IntervalArray(box.lo[None], box.hi[None]))
        result = box.intersect(box.with_bounds(narrowed.lo[0], narrowed.hi[0]))
        if result.is_empty and not box.is_empty:
            return Contraction(result, (Step("hc4", None, "", np.nan),))
        return Contraction(result, moved_bounds("hc4", box, result))

    def contract_batch(self, boxes: IntervalArray) -> IntervalArray:
        """Contract B boxes at once: shape (B, n) in and out, NaN where a box holds no solution."""
        count = boxes.shape[0]
        if count == 0:
            return boxes
        parts = [self._contract(boxes[k : k + self._together]) for k in range(0, count, self._together)]
        return IntervalArray(np.concatenate([p.lo for p in parts]), np.concatenate([p.hi for p in parts]))

    def _contract(self, boxes: IntervalArray) -> IntervalArray:
        with np.errstate(all="ignore"):
            slots = self._tape.forward(self._engine, boxes)
            for root in self._tape.roots:
                k = self._tape.slot(root)
                slots[k] = slots[k].intersect(_AT_MOST_ZERO)
            narrowed = self._tape.backward(self._engine, slots, boxes)
        return boxes.intersect(narrowed)


_CACHED = 40_000  # elements of the largest array, so that a few of them stay in the cache
_AT_MOST_ZERO = IntervalArray(np.asarray(-np.inf), np.asarray(0.0))


def moved_bounds(contractor: str, before: Box, after: Box) -> tuple[Step, ...]:
    """The bounds that differ, as steps (without the rows that moved them)."""
    steps = [Step(contractor, after.names[k], "lo", float(after.lo[k])) for k in np.flatnonzero(after.lo > before.lo)]
    steps += [Step(contractor, after.names[k], "hi", float(after.hi[k])) for k in np.flatnonzero(after.hi < before.hi)]
    return tuple(steps)
