"""Readings that a row can do without: where a row only grows with a reading, the reading's end decides.

A row asks for SOME reading m in its set with `r(x, m) <= 0`. Where the derivative of r with respect to a
component of m keeps its sign for all x in a box and all readings in their sets, r is smallest at an end of that
component, so the component may be replaced by that end: nothing is lost, and nothing of second order is added.
"""

from __future__ import annotations

import numpy as np

from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.rewrite import ReadingSets, one_sided_rows
from cpcal.solver.network.sweep import Tape


class DecisiveReadings:
    """For each one-sided row of a network, on any box, the part of every reading set that can matter."""

    def __init__(self, network: ConstraintNetwork, engine: Arithmetic) -> None:
        self._engine = engine
        rows = one_sided_rows(network)
        self._tape = Tape(network, [row.expr for row in rows])
        shapes = {root.shape for root in self._tape.roots}
        # one direction per component of a reading, for all measurements at once: rows only see their own
        self._symbols = [
            (k, j)
            for k in self._tape.readings
            for j in range(int(np.prod(self._tape.nodes[k].shape[1:])))
            if self._tape.nodes[k].shape and self._tape.nodes[k].shape[:1] in shapes
        ]
        self._seeds = self._all_seeds()

    @property
    def any(self) -> bool:
        return bool(self._symbols)

    def _all_seeds(self) -> dict[int, IntervalArray]:
        seeds: dict[int, IntervalArray] = {}
        for d, (k, j) in enumerate(self._symbols):
            shape = self._tape.nodes[k].shape
            seed = seeds[k].lo if k in seeds else np.zeros((len(self._symbols), *shape))
            seed.reshape((len(self._symbols), shape[0], -1))[d, :, j] = 1.0
            seeds[k] = IntervalArray.point(seed)
        return seeds

    def on(self, box: Box) -> list[ReadingSets]:
        """One collection of reading sets per row; components that decide at an end are single points."""
        with np.errstate(all="ignore"):
            slots = self._tape.forward(self._engine, IntervalArray(box.lo[None], box.hi[None]))
            if not self._tape.defined(slots):  # monotone on either side of a pole is not monotone
                return [{} for _ in self._tape.roots]
            tangents = self._tape.tangents(self._engine, slots, self._seeds)
        return [self._sets(root.shape, tangents[self._tape.slot(root)]) for root in self._tape.roots]

    def _sets(self, shape: tuple[int, ...], tangent: IntervalArray | None) -> ReadingSets:
        sets: ReadingSets = {}
        if tangent is None or len(shape) != 1:
            return sets
        for d, (k, j) in enumerate(self._symbols):
            node = self._tape.nodes[k]
            assert isinstance(node.data, IntervalArray)
            if node.shape[0] != shape[0]:
                continue
            known = sets.get(node.digest, IntervalArray(node.data.lo.copy(), node.data.hi.copy()))
            lo, hi = (bound.reshape((shape[0], -1))[:, j] for bound in (known.lo, known.hi))
            grows, falls = tangent.lo[d] >= 0.0, tangent.hi[d] <= 0.0
            hi[grows] = lo[grows]
            lo[falls & ~grows] = hi[falls & ~grows]
            sets[node.digest] = known
        return sets
