"""A polyhedron with many rows of which few matter: rows enter the program when a vertex violates them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.interfaces import LinearEngine, LinearSolution, LinearStatus

Floats = npt.NDArray[np.float64]

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
        self._matrix, self._rhs = optional
        columns = self._matrix.shape[1]
        # the rows with the least room at the origin are the likeliest to matter
        order = np.argsort(self._rhs, kind="stable")
        self.active = np.sort(order[: _FIRST_ROWS * columns])
        self.programs = 0
        engine.load(
            np.concatenate([fixed[0], self._matrix[self.active]]),
            np.concatenate([fixed[1], self._rhs[self.active]]),
            *bounds,
        )

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
        excess[self.active] = 0.0
        worst = np.argsort(-excess, kind="stable")[:_MORE_ROWS]
        new = np.sort(worst[excess[worst] > _VIOLATION])
        if new.size:
            self.active = np.concatenate([self.active, new])
            self._engine.add_rows(self._matrix[new], self._rhs[new])
        return bool(new.size)
