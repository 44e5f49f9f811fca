"""What is done to one node of the branch and bound: contract, cut with the incumbent, decide what comes next."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.solver.contract import Contraction, Contractor, Limits, Strategy
from cpcal.solver.interval import Arithmetic, Box
from cpcal.solver.linear import Glop
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.fit import fit
from cpcal.solver.optimize.witness import Witness, WitnessProver
from cpcal.solver.search import bisect

Floats = npt.NDArray[np.float64]

_SHRINK = 0.8  # go on with a node while some width falls below this share of what it was
_SETTLE = 0.95  # the same for a node that was closed from the start, where only the enclosure is at stake
_THIN = 1e-12  # a width below this share of the domain's does not count


class Bounding:
    """Contractor and strategy in one: they share the incumbent (a proved point), which cuts the objective."""

    idempotent = False

    def __init__(
        self,
        network: ConstraintNetwork,
        objective: int,
        contractor: Contractor,
        strategy: Strategy,
        limits: Limits,
        engine: Arithmetic,
        enclose: bool,
    ) -> None:
        self._enclose = enclose
        self._inner, self._strategy, self.objective, self.limits = contractor, strategy, objective, limits
        self._rows = Rows(network)
        self._prover = WitnessProver(network, objective, engine)
        self.domain = network.domain
        self.witness: Witness | None = None
        self.programs = 0
        self.used: set[tuple[int, int]] = set()
        self.decisive: set[tuple[int, int]] = set()  # rows of the steps that decided the leaves
        self._last: set[tuple[int, int]] = set()  # rows of the latest step that raised the objective
        self._fresh = True  # no fit has started in what the last division made
        self._productive = self._was_closed = False

    @property
    def hi(self) -> float:
        return np.inf if self.witness is None else self.witness.value

    @property
    def goal(self) -> float:
        """Nodes whose objective is at least this need no more work."""
        return self.hi - max(self.limits.gap * abs(self.hi), self.limits.gap_absolute)

    @property
    def floor(self) -> float:
        """The second-order effect of the readings at the incumbent (0 without one)."""
        return 0.0 if self.witness is None else self._rows.second_order(self.witness.point)

    def propose(self, start: Floats) -> None:
        """Fit from a point and keep what is proved, if it is better."""
        for point in (fit(self._rows, self.objective, self.domain, start, Glop()), start):
            witness = self._prover.prove(point)
            if witness is not None and witness.value < self.hi:
                self.witness = witness
                return

    def cut(self, box: Box) -> Box:
        """Drop what is worse than the incumbent."""
        name = box.names[self.objective]
        return box.replace(name, hi=min(float(box.hi[self.objective]), self.hi))

    def contract(self, box: Box) -> Contraction:
        """One pass of the contractor, between cuts; a fit from its point, once after every division."""
        before = self.cut(box)
        if before.is_empty:
            return Contraction(before)
        self._was_closed = self.closed(before)
        step = self._inner.contract(before)
        self.programs += step.programs
        self._remember(step)
        if step.point is not None and self._fresh and not self.closed(step.box):
            self.propose(step.point)
            self._fresh = False
        counts = before.width > _THIN * self.domain.width
        ratio = _SETTLE if self._was_closed else _SHRINK
        self._productive = bool((step.box.width < ratio * before.width)[counts].any())
        return Contraction(self.cut(step.box), step.steps, step.point, step.programs)

    def _remember(self, step: Contraction) -> None:
        """The rows that the proof stands on."""
        self.used.update(row for s in step.steps for row in s.rows)
        name = self.domain.names[self.objective]
        raised = [s for s in step.steps if s.variable is None or (s.variable == name and s.side == "lo")]
        if raised:
            self._last = set(raised[-1].rows)
        if step.box.is_empty:
            self.decisive |= self._last

    def closed(self, box: Box) -> bool:
        """Whether the box can raise the bracket's lower end no further than the gap asked for."""
        return not box.is_empty and bool(box.lo[self.objective] >= self.goal)

    def settled(self, box: Box) -> bool:
        """Whether dividing the box is pointless: it is closed, or down to the second order of the readings."""
        return self.closed(box) or (not box.is_empty and bool(box.lo[self.objective] >= self.hi - self.floor))

    def split(self, box: Box) -> tuple[Box, ...]:
        """The box itself for another pass, () once it is settled, else its pieces by the strategy.

        Where that finds nothing to divide, the objective itself is halved.
        """
        closed = self.closed(box)
        if self._productive and closed == self._was_closed and (self._enclose or not closed):
            return (box,)
        pieces = () if self.settled(box) else self._strategy.split(box) or bisect(box, self.objective)
        self._fresh = len(pieces) > 1
        if not pieces:
            self.decisive |= self._last
        return pieces
