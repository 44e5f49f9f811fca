"""The best point that is proved so far: the one thing that the nodes of a branch and bound have in common."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Box
from cpcal.solver.limits import Limits
from cpcal.solver.linear import Dense
from cpcal.solver.optimize.local_minimum import fit_of_many
from cpcal.solver.optimize.local_search import LocalSearch
from cpcal.solver.optimize.prepared import Prepared
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
        prepared: Prepared,
        limits: Limits,
        deadline: float = np.inf,
        *,
        domain: Box | None = None,
        best: Known | None = None,
    ) -> None:
        self.objective = prepared.objective
        self.domain = prepared.network.domain if domain is None else domain
        self._prepared, self._limits, self._deadline = prepared, limits, deadline
        self._one_value = bool(self.domain.lo[self.objective] == self.domain.hi[self.objective])
        self.calls = 0  # of `propose`
        self.witness: Witness | None = None if best is None else best.witness

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
        return 0.0 if self.witness is None else self._prepared.rows.second_order(self.witness.point)

    @property
    def served(self) -> bool:
        """Whether another fit can wait while boxes shrink: there is a point, or a fit found none for the one value."""
        return self.witness is not None or (self._one_value and self._prepared.minimax and self.calls > 0)

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

    @np.errstate(all="ignore")  # fits run where numbers overflow, too: what they propose is proved or dropped
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
        if self._one_value and self._keep(start):  # no other point is better
            return True
        if self._prepared.minimax or not self._local.applies:
            prepared = self._prepared
            better = self._keep(fit_of_many(prepared.network, prepared.rows, o, start, Dense(), self.domain))
        better = better or (not self._one_value and self._keep(start))
        if self._local.applies and not (self._prepared.minimax and (better or self._one_value)) and _due(self.calls):
            for point in self._local.proposals(start):
                kept = self._keep(point)
                better = better or kept
                if kept or self._known_better(point):
                    break
        return better

    @cached_property
    def _prover(self) -> WitnessProver:
        return self._prepared.prover.within(self.domain)

    @cached_property
    def _local(self) -> LocalSearch:
        prepared, equations = self._prepared, self._prover.equations
        return LocalSearch(prepared.network, prepared.rows, self.objective, equations, self._deadline, self.domain)

    def _known_better(self, point: Floats) -> bool:
        """Whether the point is no improvement, whatever its margin."""
        return bool(point[self.objective] >= self.hi)

    def _keep(self, point: Floats) -> bool:
        """Prove a point; keep it if it is better."""
        if self._known_better(point) and not self._prepared.minimax:
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
