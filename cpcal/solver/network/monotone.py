"""Readings that a row can do without: where a row only grows with a reading, the reading's end decides.

A row asks for SOME reading m in its set with `r(x, m) <= 0`. Where the derivative of r with respect to a
component of m keeps its sign for all x in a box and all readings in their sets, r is smallest at an end of that
component, so the component may be replaced by that end: nothing is lost, and nothing of second order is added.
"""

from __future__ import annotations

import numpy as np

from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.rewrite import ReadingSets
from cpcal.solver.network.rows import rows_tape


class DecisiveReadings:
    """For each one-sided row of a network, on any box, the part of every reading set that can matter."""

    def __init__(self, network: ConstraintNetwork, engine: Arithmetic) -> None:
        self._engine = engine
        self.tape = rows_tape(network)
        self._data = {leaf.digest: leaf.data for leaf in self.tape.readings if isinstance(leaf.data, IntervalArray)}

    @property
    def any(self) -> bool:
        return bool(self.tape.readings)

    def on(self, box: Box) -> list[ReadingSets]:
        """One collection of reading sets per row; components that decide at an end are single points."""
        tape = self.tape
        slots = tape.forward(self._engine, IntervalArray(box.lo[None], box.hi[None]))
        if not tape.continuous(self._engine, slots):  # monotone on either side of a pole is not monotone
            return [{} for _ in tape.roots]
        g = tape.gradients(self._engine, tape.derivatives(self._engine, slots[0]))
        return [self._sets(tape.rows(root), g) for root in tape.roots]

    def _sets(self, rows: slice, g: IntervalArray) -> ReadingSets:
        """Of the readings that enter some of these rows: a component that enters two of them stays as it is."""
        paths, tape = self.tape.reach, self.tape
        mine = (paths.leaf >= tape.given) & (paths.row >= rows.start) & (paths.row < rows.stop)
        leaf, entry = paths.leaf[mine], paths.entry[mine]
        alone = np.bincount(leaf, minlength=tape.first) == 1
        grows, falls = np.zeros(tape.first, dtype=bool), np.zeros(tape.first, dtype=bool)
        grows[leaf], falls[leaf] = g.lo[entry] >= 0.0, g.hi[entry] <= 0.0
        sets: ReadingSets = {}
        for digest, where in tape.reading_slots.items():
            if alone[where].any():
                data = self._data[digest]
                up, down = (grows & alone)[where], (falls & ~grows & alone)[where]
                lo, hi = np.where(down, data.hi, data.lo), np.where(up, data.lo, data.hi)
                sets[digest] = IntervalArray(lo, hi)
        return sets
