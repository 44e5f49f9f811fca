"""The box around a polyhedron, by two linear programs per variable (paper, eq. 13 and 14)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.solver.contract import Contraction, Polyhedron, Step
from cpcal.solver.interval import Arithmetic, Box
from cpcal.solver.linear import BoxProgram, LinearEngine, LinearSolution, tightened


class PolyhedralPrograms:
    """The linear programs of one polyhedron in one bounded box; `origin` (m, 2) names the constraint of each row."""

    def __init__(
        self,
        name: str,
        polyhedron: Polyhedron,
        origin: Indices,
        box: Box,
        arithmetic: Arithmetic,
        engine: LinearEngine,
    ) -> None:
        self._name, self._origin, self._box, self._polyhedron = name, origin, box, polyhedron
        self._program = BoxProgram(polyhedron.matrix, polyhedron.rhs, box.array, arithmetic, engine)

    def run(self, first: int | None, deadline: float) -> Contraction:
        """Contract every bound, the lower one of variable `first` (the objective) before all others."""
        return replace(tightened(self, self._box, first, deadline), polyhedron=self._polyhedron)

    @property
    def variables(self) -> Collection[int]:
        return range(len(self._box))

    @property
    def count(self) -> int:
        return self._program.count

    def minimize(self, variable: int, sign: float) -> LinearSolution:
        return self._program.minimize(variable, sign)

    def coordinates(self, solution: LinearSolution) -> Floats:
        return solution.point

    def bound(self, variable: int, side: str, solution: LinearSolution) -> Step | None:
        sign = 1.0 if side == "lo" else -1.0
        lowest, rows = self._program.proved(variable, sign, solution)
        new = sign * lowest
        better = new > self._box.lo[variable] if side == "lo" else new < self._box.hi[variable]
        if not (better and np.isfinite(new)):
            return None
        return Step(self._name, self._box.names[variable], side, new, self._carriers(rows))

    def empty(self, solution: LinearSolution) -> Step | None:
        proved, rows = self._program.proved_empty(solution)
        return Step(self._name, None, "", np.nan, self._carriers(rows)) if proved else None

    def _carriers(self, rows: Indices) -> tuple[tuple[int, int], ...]:
        return tuple(dict.fromkeys((int(c), int(k)) for c, k in self._origin[rows]))
