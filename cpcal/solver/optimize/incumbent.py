"""The best point that is proved so far: the one thing that the nodes of a branch and bound have in common."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.contract import Limits
from cpcal.solver.interval import Arithmetic, Box
from cpcal.solver.linear import Dense
from cpcal.solver.network import Constraint, ConstraintNetwork
from cpcal.solver.network.dag import leaves
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local_minimum import fit_of_many
from cpcal.solver.optimize.local_search import LocalSearch
from cpcal.solver.optimize.witness import Witness, WitnessProver


@dataclass(frozen=True)
class Known:
    """The best point that is proved, and how often points were proposed."""

    witness: Witness | None
    calls: int


class Incumbent:
    """Proves points that local fits propose, and says what a box can still improve. It only ever gets better."""

    def __init__(
        self,
        network: ConstraintNetwork,
        objective: int,
        limits: Limits,
        engine: Arithmetic,
        deadline: float = np.inf,
    ) -> None:
        self.objective, self.domain, self._limits = objective, network.domain, limits
        self._network, self._rows = network, Rows(network)
        self._prover = WitnessProver(network, objective, engine)
        self._local = LocalSearch(network, self._rows, objective, self._prover.equations, deadline)
        self._minimax = all(self._enters(c) for c in network.constraints)
        self._one_value = bool(self.domain.lo[objective] == self.domain.hi[objective])
        self.calls = 0  # of `propose`
        self.witness: Witness | None = None

    def _enters(self, constraint: Constraint) -> bool:
        """Whether the constraint may be mended by the objective."""
        leaf = self._network.leaf_of(self.domain.names[self.objective])
        return any(node is leaf for node in leaves((constraint.body, constraint.lower, constraint.upper)))

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

    @property
    def served(self) -> bool:
        """Whether another fit can wait while boxes shrink: there is a point, or a fit found none for the one value."""
        return self.witness is not None or (self._one_value and self._minimax and self.calls > 0)

    @property
    def state(self) -> Known:
        """What decisions depend on."""
        return Known(self.witness, self.calls)

    def at(self, state: Known) -> Incumbent:
        """Another one of the same problem, in that state."""
        other = copy(self)
        other.witness, other.calls = state.witness, state.calls
        return other

    def learn(self, state: Known, since: Known) -> None:
        """Keep what another one has found from the state `since` on, if it is better."""
        self.calls += state.calls - since.calls
        if state.witness is not None and state.witness.value < self.hi:
            self.witness = state.witness

    def propose(self, start: Floats) -> bool:
        """Fit from a point and keep what is proved, if it is better; whether it is.

        Where every constraint bounds the objective, the sequence of linear programs ends in the optimum, a vertex,
        which tells whether there is a point for one value that is asked about, too.
        Other problems have a local search that takes longer: it runs at the first proposals, then ever less often.
        """
        self.calls += 1
        better, o = False, self.objective
        if not np.isfinite(self.domain.hi[o] - self.domain.lo[o]):  # the middle of a half-line is of no use
            start = start.copy()
            start[o] = np.clip(0.0, self.domain.lo[o], self.domain.hi[o])
        if self._minimax or not self._local.applies:
            better = self._keep(fit_of_many(self._network, self._rows, self.objective, start, Dense()))
        better = better or self._keep(start)
        if self._local.applies and not (self._minimax and (better or self._one_value)) and _due(self.calls):
            for point in self._local.proposals(start):
                kept = self._keep(point)
                better = better or kept
                if kept or self._known_better(point):
                    break
        return better

    def _known_better(self, point: Floats) -> bool:
        """Whether the point is no improvement, whatever its margin."""
        return bool(point[self.objective] >= self.hi)

    def _keep(self, point: Floats) -> bool:
        """Prove a point; keep it if it is better."""
        if self._known_better(point) and not self._minimax:
            return False
        witness = self._prover.prove(point)
        if witness is None or witness.value >= self.hi:
            return False
        self.witness = witness
        return True

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


def _due(call: int) -> bool:
    """1, 2, 3, 4, 6, 8, 12, 16, 24, ..."""
    power = 1 << (call.bit_length() - 1)
    return call == power or 2 * call == 3 * power
