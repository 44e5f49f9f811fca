"""Linear programs over a polyhedron in a box; the engine proposes, `lower_bound` proves."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.linear.engine import LinearEngine, LinearSolution, LinearStatus
from cpcal.solver.linear.rigorous import lower_bound


class BoxProgram:
    """`matrix @ x <= rhs`, (m, n) and (m,), for x in a bounded box (n,).

    The programs are in u = (x - mid) / rad, each row scaled to a largest coefficient of 1; `count` were solved.
    """

    def __init__(
        self, matrix: Floats, rhs: Floats, box: IntervalArray, arithmetic: Arithmetic, engine: LinearEngine
    ) -> None:
        self._matrix, self._rhs, self._box, self._arithmetic = matrix, rhs, box, arithmetic
        self._radius = box.rad
        inner = matrix * self._radius
        largest = np.abs(inner).max(axis=1, initial=0.0)
        self._scale = np.where(largest > 0.0, largest, 1.0)
        self._engine, self.count = engine, 0
        n = matrix.shape[1]
        engine.load(inner / self._scale[:, None], (rhs - matrix @ box.mid) / self._scale, -np.ones(n), np.ones(n))

    def minimize(self, k: int, sign: float) -> LinearSolution:
        """The least `sign * u_k`."""
        self.count += 1
        return self._engine.minimize(self._unit(k, sign))

    def proved(self, k: int, sign: float, solution: LinearSolution) -> tuple[float, Indices]:
        """A lower bound of `sign * x_k` from the multipliers, and the rows that carry it."""
        return self._bound(self._unit(k, sign), solution, float(self._radius[k]))

    def proved_empty(self, solution: LinearSolution) -> tuple[bool, Indices]:
        """Whether the multipliers prove that there is no such x, and the rows that carry that."""
        bound, rows = self._bound(np.zeros(len(self._radius)), solution, 1.0)
        return bound > 0.0, rows

    def least(self, k: int, sign: float) -> tuple[float, Indices]:
        """Solve, and prove what comes of it: infinite when there is no such x, -inf when nothing is proved."""
        solution = self.minimize(k, sign)
        if solution.status is not LinearStatus.INFEASIBLE:
            return self.proved(k, sign, solution)
        empty, rows = self.proved_empty(solution)
        return (np.inf if empty else -np.inf), rows

    def _unit(self, k: int, sign: float) -> Floats:
        objective = np.zeros(len(self._radius))
        objective[k] = sign
        return objective

    def _bound(self, objective: Floats, solution: LinearSolution, unit: float) -> tuple[float, Indices]:
        rows = solution.rows
        weights = solution.multipliers / self._scale[rows] * unit
        matrix, rhs = self._matrix, self._rhs
        return lower_bound(self._arithmetic, matrix, rhs, rows, weights, objective, self._box), rows
