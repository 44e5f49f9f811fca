"""A strategy that asks the lifted relaxation where to cut: where its products are furthest from being products.

On a box the relaxation replaces each monomial of the scaled variables u in [-1, 1]^n by a column of its own. At the
vertices of two linear programs the difference `|w_gamma - prod_i u_i|` shows what the relaxation does not know; halving
a variable of the monomial divides it by about four.
"""

from __future__ import annotations

import numpy as np

from contractors.relaxation import Relaxation, Structure
from cpcal.common.values import Floats
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.linear import Dense
from cpcal.solver.linear.engine import LinearStatus
from cpcal.solver.network import ConstraintNetwork, polynomial_form
from cpcal.solver.search import LargestFirst


class MostViolated(LargestFirst):
    """Bisect the variable whose monomials are violated most at the vertices that minimise and maximise sum(u).

    Where there is no product, or no vertex, the widest variable.
    """

    def __init__(
        self,
        network: ConstraintNetwork,
        width: float = 0.0,
        *,
        arithmetic: str = "float64",
    ) -> None:
        super().__init__(width)
        self._arithmetic = get_arithmetic(arithmetic)
        self._structure = Structure(polynomial_form(network, self._arithmetic))
        used = self._structure.used
        self._products = [(k, m) for k, m in enumerate(self._structure.system.monomials[1:]) if len(m) > 1 and used[k]]

    def split(self, box: Box) -> tuple[Box, ...]:
        if not self._products or not box.is_bounded:
            return super().split(box)
        score = self._violations(box)
        return self._cut(box, score) if score.any() else super().split(box)

    def _violations(self, box: Box) -> Floats:
        """For every variable the violations of the monomials that it is part of, summed over the vertices: (n,)."""
        score = np.zeros(len(box))
        for vertex in self._vertices(box):
            u = np.zeros(len(box))
            for variable, k in self._structure.positions.items():
                u[variable] = vertex[k]
            for k, monomial in self._products:
                gap = abs(vertex[k] - float(np.prod(u[list(monomial)])))
                score[list(set(monomial))] += gap if gap > 1e-9 else 0.0  # not where there is no column
        return score

    def _vertices(self, box: Box) -> list[Floats]:
        """The columns that a product has on the box, at two vertices; where it has none, the product itself."""
        structure, relaxation = self._structure, Relaxation(self._structure, self._arithmetic, box)
        engine = relaxation.load(Dense())
        places = {column: k for k, column in enumerate(relaxation.columns.tolist())}
        vertices = []
        for sign in (1.0, -1.0):
            objective = np.zeros(len(places))
            objective[[places[k] for k in structure.positions.values()]] = sign
            solution = engine.minimize(objective)
            if solution.status is LinearStatus.OPTIMAL:
                vertex = np.full(len(structure.used), np.nan)
                vertex[relaxation.columns] = solution.point
                vertices.append(vertex)
        return vertices
