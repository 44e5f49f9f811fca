"""The best point that is proved so far: the one thing that the nodes of a branch and bound have in common."""

from __future__ import annotations

from copy import copy

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.contract import Limits
from cpcal.solver.interval import Arithmetic, Box
from cpcal.solver.linear import Dense
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local_minimum import fit_of_many
from cpcal.solver.optimize.witness import Witness, WitnessProver


class Incumbent:
    """Proves points that local fits propose, and says what a box can still improve. It only ever gets better."""

    def __init__(self, network: ConstraintNetwork, objective: int, limits: Limits, engine: Arithmetic) -> None:
        self.objective, self.domain, self._limits = objective, network.domain, limits
        self._network, self._rows = network, Rows(network)
        self._prover = WitnessProver(network, objective, engine)
        self.witness: Witness | None = None

    @property
    def hi(self) -> float:
        """Its objective; infinite while there is none."""
        return np.inf if self.witness is None else self.witness.value

    @property
    def gap(self) -> float:
        """The width at which a bracket below it counts as closed."""
        return max(self._limits.gap * abs(self.hi), self._limits.gap_absolute)

    @property
    def floor(self) -> float:
        """The second-order effect of the readings at it (0 without one)."""
        return 0.0 if self.witness is None else self._rows.second_order(self.witness.point)

    def alike(self) -> Incumbent:
        """Another one of the same problem that has the same point now."""
        return copy(self)

    def learn(self, witness: Witness | None) -> None:
        """Keep a proved point, if it is better."""
        if witness is not None and witness.value < self.hi:
            self.witness = witness

    def propose(self, start: Floats) -> bool:
        """Fit from a point and keep what is proved, if it is better; whether it is."""
        fitted = fit_of_many(self._network, self._rows, self.objective, start, Dense())
        for point in (fitted, start):
            witness = self._prover.prove(point)
            if witness is not None and witness.value < self.hi:
                self.witness = witness
                return True
        return False

    def cut(self, box: Box) -> Box:
        """Drop what is worse than it."""
        name = box.names[self.objective]
        return box.replace(name, hi=min(float(box.hi[self.objective]), self.hi))

    def closed(self, box: Box) -> bool:
        """Whether the box can raise the bracket's lower end no further than the gap asked for."""
        return not box.is_empty and bool(box.lo[self.objective] >= self.hi - self.gap)

    def settled(self, box: Box) -> bool:
        """Whether dividing the box is pointless: it is closed, or down to the second order of the readings."""
        return self.closed(box) or (not box.is_empty and bool(box.lo[self.objective] >= self.hi - self.floor))
