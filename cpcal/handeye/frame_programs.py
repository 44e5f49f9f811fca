"""Linear programs that propose bounds on a box; nothing that they say is believed without its weights.

Every row of `equations` in the coordinates u of the box is linear but for products u_i u_j. A product is either a
column, tied to its factors by the four bound products (McCormick; tangents of a square), or it is bounded by its
coefficient. Without columns a program has 24 columns and takes a millisecond; it contracts boxes of a few degrees. With
them it has some 200, and contracts the box of all rotations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.handeye.quadratic_rows import Layout, Quadratics
from cpcal.solver.contract import Contraction, Step, StepWeights
from cpcal.solver.interval import Box
from cpcal.solver.linear import Dense, LinearSolution, LinearStatus

_MET = 1e-3  # a bound that some vertex meets to this (in [-1, 1]) needs no program
_WORTH = 0.02  # of a half-width: what a bound must gain to be kept
_TANGENTS = (-1.0, -0.5, 0.5, 1.0)


@dataclass(frozen=True)
class _Product:
    """A row that bounds a column: (1 + p u_i)(1 + q u_j) >= 0, or (u_i - t)^2 >= 0."""

    i: int
    j: int
    p: float
    q: float
    t: float | None = None


class FramePrograms:
    """The linear programs of some rows on one box."""

    def __init__(self, rows: Quadratics, places: Indices, box: Box, columns: Bools) -> None:
        """`places` (M, 2): constraint and part of each row; `columns` (P,): which products have one."""
        self.layout = layout = rows.layout
        self.box, self.count = box, 0
        centred = rows.centred(box.mid, box.rad)
        chosen = np.flatnonzero(columns & (np.abs(centred.products).max(axis=0) > 0.0))
        beside = np.where(layout.square, np.maximum(-centred.products, 0.0), np.abs(centred.products))
        beside[:, chosen] = 0.0
        matrix = np.concatenate([centred.linear, centred.products[:, chosen]], axis=1)
        rhs = beside.sum(axis=1) - centred.constant
        scale = np.abs(matrix).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            matters = (scale > 0.0) & (np.abs(matrix).sum(axis=1) > rhs)
        self._kept = np.flatnonzero(matters)
        self._places = places[self._kept].tolist()
        self._scale = scale[self._kept]
        self._products, above, sides = _product_rows(chosen, layout)
        self._columns = layout.size + len(chosen)
        lower = -np.ones(self._columns)
        lower[layout.size :][layout.square[chosen]] = 0.0
        self._engine = Dense()
        self._engine.load(
            np.concatenate([above, matrix[self._kept] / self._scale[:, None]]),
            np.concatenate([sides, rhs[self._kept] / self._scale]),
            lower,
            np.ones(self._columns),
        )

    def minimize(self, unknown: int | None, sign: float) -> LinearSolution:
        objective = np.zeros(self._columns)
        if unknown is not None:
            objective[unknown] = sign
        self.count += 1
        return self._engine.minimize(objective)

    def weights(self, solution: LinearSolution) -> StepWeights:
        """The multipliers of a program, as the rule of certificates takes them."""
        rows, pairs, tangents = [], [], []
        for place, weight in zip(solution.rows.tolist(), solution.multipliers.tolist(), strict=True):
            if place < len(self._products):
                product = self._products[place]
                if product.t is None:
                    pairs.append((product.i, product.j, product.p, product.q, weight))
                else:
                    tangents.append((product.i, product.t, weight))
                continue
            place -= len(self._products)
            number, part = self._places[place]
            rows.append((number, part, 0, weight / float(self._scale[place])))
        return StepWeights(tuple(rows), tuple(pairs), tuple(tangents))


def _product_rows(chosen: Indices, layout: Layout) -> tuple[list[_Product], Floats, Floats]:
    """Rows (K, columns) and right sides that tie the columns of the chosen products to their factors."""
    products: list[_Product] = []
    rows: list[tuple[int, float, int, float, int, float]] = []
    sides: list[float] = []
    for place, pair in enumerate(chosen.tolist()):
        (i, j), column = layout.pairs[pair].tolist(), layout.size + place
        if i == j:
            for t in _TANGENTS:
                products.append(_Product(i, i, 0.0, 0.0, t))
                rows.append((i, 2.0 * t, i, 0.0, column, -1.0))
                sides.append(t * t)
            continue
        for p, q in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
            products.append(_Product(i, j, p, q))
            rows.append((i, -p, j, -q, column, -p * q))
            sides.append(1.0)
    matrix = np.zeros((len(rows), layout.size + len(chosen)))
    for k, (i, a, j, b, column, c) in enumerate(rows):
        matrix[k, i] += a
        matrix[k, j] += b
        matrix[k, column] = c
    return products, matrix, np.array(sides)


def proposed(programs: FramePrograms) -> Contraction:
    """Bounds of all unknowns, by two programs each; those that vertices show to move by next to nothing are left."""
    box, names = programs.box, programs.layout.names
    lo, hi, radius, mid = box.lo.copy(), box.hi.copy(), box.rad, box.mid
    lowest, highest = np.full(len(names), np.inf), np.full(len(names), -np.inf)
    steps: list[Step] = []
    for i in range(len(names)):
        for side, sign in (("lo", 1.0), ("hi", -1.0)):
            met = lowest[i] < -1.0 + _MET if sign > 0.0 else highest[i] > 1.0 - _MET
            if radius[i] == 0.0 or met:
                continue
            solution = programs.minimize(i, sign)
            if solution.status is LinearStatus.INFEASIBLE:
                step = Step("handeye", None, "", np.nan, (), programs.weights(solution))
                return Contraction(Box.empty(box.names), (*steps, step), None, programs.count)
            if solution.status is not LinearStatus.OPTIMAL:
                continue
            u = solution.point[: len(names)]
            np.minimum(lowest, u, out=lowest)
            np.maximum(highest, u, out=highest)
            if sign * u[i] < -1.0 + _WORTH:
                continue
            bound = float(mid[i] + radius[i] * u[i])
            steps.append(Step("handeye", names[i], side, bound, (), programs.weights(solution)))
            (lo if sign > 0.0 else hi)[i] = bound
    crossed = lo > hi
    lo[crossed] = hi[crossed] = mid[crossed]
    return Contraction(box.with_bounds(lo, hi), tuple(steps), None, programs.count)
