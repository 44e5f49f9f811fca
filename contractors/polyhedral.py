"""The box around a polyhedron, by two linear programs per variable (paper, eq. 13 and 14)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from cpcal.solver.contract import Contraction, Polyhedron, Step
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.linear import LazyRows, lower_bound
from cpcal.solver.linear.engine import LinearEngine, LinearSolution, LinearStatus

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

_WORTHWHILE = 1e-3  # a bound that a vertex already meets to this share of the radius needs no program


class Programs:
    """The linear programs of one polyhedron in one bounded box; the solver proposes, `lower_bound` proves."""

    def __init__(
        self,
        name: str,
        polyhedron: Polyhedron,
        origin: Indices,
        box: Box,
        arithmetic: Arithmetic,
        engine: Callable[[], LinearEngine],
    ) -> None:
        self._name, self._origin, self._box, self._arithmetic = name, origin, box, arithmetic
        self._polyhedron = polyhedron
        self._center, self._radius = box.mid, box.rad
        self._rows = self._scaled(engine())
        self._vertices: list[Floats] = []
        self._steps: list[Step] = []

    def _scaled(self, engine: LinearEngine) -> LazyRows:
        """The rows in u = (x - mid) / rad, each scaled to a largest coefficient of 1; those that can matter enter."""
        matrix = self._polyhedron.matrix * self._radius
        largest = np.abs(matrix).max(axis=1, initial=0.0)
        self._scale = np.where(largest > 0.0, largest, 1.0)
        rhs = self._polyhedron.rhs - self._polyhedron.matrix @ self._center
        n = len(self._box)
        none = (np.zeros((0, n)), np.zeros(0))
        rows = (matrix / self._scale[:, None], rhs / self._scale)
        return LazyRows(engine, none, rows, (-np.ones(n), np.ones(n)))

    def run(self, first: int | None) -> Contraction:
        """Contract every bound, the lower one of variable `first` (the objective) before all others."""
        lo, hi = self._box.lo.copy(), self._box.hi.copy()
        point: Floats | None = None
        for k, side in self._order(first):
            if self._radius[k] == 0.0 or self._met(k, side):
                continue
            solution = self._solve(k, side)
            if solution.status is LinearStatus.INFEASIBLE and self._proved_empty(solution):
                return self._result(Box.empty(self._box.names), None)
            if solution.status is not LinearStatus.OPTIMAL:
                continue
            if point is None:
                point = self._center + self._radius * solution.point
            if not self._met(k, side):
                self._move(k, side, solution, lo, hi)
            if lo[k] > hi[k]:
                return self._result(Box.empty(self._box.names), None)
        box = self._box.with_bounds(lo, hi)
        return self._result(box, None if point is None else np.clip(point, box.lo, box.hi))

    def _result(self, box: Box, point: Floats | None) -> Contraction:
        return Contraction(box, tuple(self._steps), point, self._rows.programs, self._polyhedron)

    def _order(self, first: int | None) -> list[tuple[int, str]]:
        others = [(k, side) for k in range(len(self._box)) for side in ("lo", "hi") if k != first]
        return others if first is None else [(first, "lo"), *others, (first, "hi")]

    def _met(self, k: int, side: str) -> bool:
        """Whether some vertex shows that this bound cannot move by much."""
        sign = 1.0 if side == "lo" else -1.0
        return any(sign * u[k] < -1.0 + _WORTHWHILE for u in self._vertices)

    def _solve(self, k: int, side: str) -> LinearSolution:
        objective = np.zeros(len(self._box))
        objective[k] = 1.0 if side == "lo" else -1.0
        solution = self._rows.minimize(objective)
        if solution.status is LinearStatus.OPTIMAL:
            self._vertices.append(solution.point)
        return solution

    def _proved(self, solution: LinearSolution, objective: Floats, unit: float) -> tuple[float, Indices]:
        """Lower bound of `objective @ x` on the polyhedron in the box, and the rows that carry it."""
        chosen = np.flatnonzero(solution.multipliers > 0.0)
        rows = self._rows.active[chosen]
        bound = lower_bound(
            self._arithmetic,
            IntervalArray.point(self._polyhedron.matrix[rows]),
            self._polyhedron.rhs[rows],
            solution.multipliers[chosen] / self._scale[rows] * unit,
            objective,
            self._box.array,
        )
        return bound, rows

    def _proved_empty(self, solution: LinearSolution) -> bool:
        bound, rows = self._proved(solution, np.zeros(len(self._box)), 1.0)
        if bound > 0.0:
            self._steps.append(Step(self._name, None, "", np.nan, self._carriers(rows)))
        return bound > 0.0

    def _move(self, k: int, side: str, solution: LinearSolution, lo: Floats, hi: Floats) -> None:
        """Move a bound to where the multipliers prove that it may be, if that is further in."""
        objective = np.zeros(len(self._box))
        objective[k] = 1.0 if side == "lo" else -1.0
        bound, rows = self._proved(solution, objective, float(self._radius[k]))
        if side == "lo" and lo[k] < bound < np.inf:
            lo[k] = bound
        elif side == "hi" and -np.inf < -bound < hi[k]:
            hi[k] = -bound
        else:
            return
        self._steps.append(Step(self._name, self._box.names[k], side, bound * objective[k], self._carriers(rows)))

    def _carriers(self, rows: Indices) -> tuple[tuple[int, int], ...]:
        return tuple(dict.fromkeys((int(c), int(k)) for c, k in self._origin[rows]))
