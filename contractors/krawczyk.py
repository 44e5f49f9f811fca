"""krawczyk: the paper's interval Newton method for over-determined systems (section 4.3, eq. 7 to 14)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from contractors.interval_rows import Decomposition, IntervalRows, Linearised, inequalities, krawczyk
from contractors.polyhedral import PolyhedralPrograms
from cpcal.common.arrays import Floats, Indices
from cpcal.solver.contract import Composable, Contraction, Polyhedron, repeated
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.linear import Dense
from cpcal.solver.linear.engine import LinearEngine
from cpcal.solver.network import ConstraintNetwork


class Krawczyk(Composable):
    """Centred form on the box, the polyhedron of eq. 12, a linear program per bound; again while it pays.

    `slopes` takes slopes (eq. 5) instead of interval Jacobians (eq. 7). The loop ends when the sum of the widths,
    each measured in units of what it was at first, shrinks to no less than `ratio` of what it was, or after `most`
    rounds. Boxes that are not bounded come back as they are.
    """

    monotone_tolerance = np.inf  # the loop may stop on a part where it goes on with the whole
    name = "krawczyk"

    def __init__(
        self,
        network: ConstraintNetwork,
        *,
        objective: str | None = None,
        arithmetic: str = "float64",
        engine: Callable[[], LinearEngine] = Dense,
        slopes: bool = False,
        ratio: float = 0.9,
        most: int = 20,
    ) -> None:
        self._arithmetic = get_arithmetic(arithmetic)
        self._engine = engine
        self._system = Linearised(network, self._arithmetic, slopes)
        self._objective = None if objective is None else network.names.index(objective)
        self._ratio, self._most = ratio, most

    def contract(self, box: Box) -> Contraction:
        if box.is_empty or not box.is_bounded:
            return Contraction(box)
        unit = np.where(box.width > 0.0, box.width, 1.0)

        def pays(before: Floats, after: Floats, ratio: float) -> bool:
            with np.errstate(all="ignore"):  # widths beyond float64 tell nothing
                return bool(np.sum(after / unit) < ratio * np.sum(before / unit))

        return repeated(self._once, box, ratio=self._ratio, most=self._most, pays=pays)

    def _once(self, box: Box) -> Contraction:
        """One step of the interval Newton method, eq. 9."""
        parts = [(inequalities(self._arithmetic, rows, box, how), rows.origin) for rows, how in self._rows(box)]
        polyhedron, origin = _cutting(box, parts)
        if not origin.size:
            return Contraction(box)
        return PolyhedralPrograms(self.name, polyhedron, origin, box, self._arithmetic, self._engine()).run(
            self._objective, self.deadline
        )

    def _rows(self, box: Box) -> list[tuple[IntervalRows, Decomposition]]:
        """The interval-linear rows on a box, and how each block of them becomes real."""
        return [(rows, krawczyk) for rows in self._system.at(box, [box.mid])]


def _cutting(box: Box, parts: list[tuple[Polyhedron, Indices]]) -> tuple[Polyhedron, Indices]:
    """All rows in one polyhedron, without those that, up to rounding, no point of the box violates."""
    matrix = np.concatenate([p.matrix for p, _ in parts])
    rhs = np.concatenate([p.rhs for p, _ in parts])
    origin = np.concatenate([o for _, o in parts])
    with np.errstate(all="ignore"):
        largest = np.maximum(matrix, 0.0) @ box.hi + np.minimum(matrix, 0.0) @ box.lo
    keep = np.isfinite(matrix).all(axis=1) & np.isfinite(rhs) & np.isfinite(largest) & (largest > rhs)
    return Polyhedron(box.names, matrix[keep], rhs[keep]), origin[keep]
