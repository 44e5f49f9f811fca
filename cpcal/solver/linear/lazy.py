"""A polyhedron with many rows of which few matter: rows enter the program when a vertex violates them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.solver.linear.engine import LinearEngine, LinearSolution, LinearStatus

_FIRST_ROWS = 3  # rows at the start, per column
_MORE_ROWS = 24  # violated rows added at a time
_ROUNDS = 12  # times that rows are added for one objective
_VIOLATION = 1e-9  # of a row scaled to a largest coefficient of about 1


class LazyRows:
    """`fixed` rows always, of the `optional` ones those that have mattered so far.

    Bounds from a subset of the rows are valid, only weaker, so stopping early is never wrong.
    """

    def __init__(
        self,
        engine: LinearEngine,
        fixed: tuple[Floats, Floats],
        optional: tuple[Floats, Floats],
        bounds: tuple[Floats, Floats],
    ) -> None:
        self._engine = engine
        matrix, rhs = optional
        # rows that no point within the bounds violates never matter
        largest = np.maximum(matrix, 0.0) @ bounds[1] + np.minimum(matrix, 0.0) @ bounds[0]
        self._candidates = np.flatnonzero(largest > rhs)
        self._matrix, self._rhs = matrix[self._candidates], rhs[self._candidates]
        # the rows with the least room at the origin are the likeliest to matter
        order = np.argsort(self._rhs, kind="stable")
        self._entered = np.sort(order[: _FIRST_ROWS * matrix.shape[1]])
        self.programs = 0
        engine.load(
            np.concatenate([fixed[0], self._matrix[self._entered]]),
            np.concatenate([fixed[1], self._rhs[self._entered]]),
            *bounds,
        )

    @property
    def active(self) -> npt.NDArray[np.intp]:
        """Indices of the optional rows in the program, in the order of their multipliers."""
        return np.asarray(self._candidates[self._entered])

    def minimize(self, objective: Floats) -> LinearSolution:
        """Minimise over all rows; multipliers are those of the fixed rows, then of the `active` ones."""
        for _ in range(_ROUNDS):
            solution = self._engine.minimize(objective)
            self.programs += 1
            if solution.status is not LinearStatus.OPTIMAL or not self._add_violated(solution.point):
                break
        return solution

    def _add_violated(self, point: Floats) -> bool:
        excess = self._matrix @ point - self._rhs
        excess[self._entered] = 0.0
        violated = np.flatnonzero(excess > _VIOLATION)
        new = np.sort(violated[np.argsort(-excess[violated], kind="stable")[:_MORE_ROWS]])
        if new.size:
            self._entered = np.concatenate([self._entered, new])
            self._engine.add_rows(self._matrix[new], self._rhs[new])
        return bool(new.size)
