"""The default linear engine: a dense simplex method, compiled."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.solver.compiled import compiled
from cpcal.solver.linear.engine import LinearEngine, LinearSolution, LinearStatus
from cpcal.solver.linear.simplex import FAILED, INFEASIBLE, OPTIMAL, begin, minimise
from cpcal.solver.linear.vertex import Vertex, exact_point, to_box

_ALL = 640  # rows that are all looked at in every pivot
_FIRST = 3  # of more rows, those that enter at the start, per column
_ROOM = 1536  # and the most that enter at all
_PIVOTS = 60  # for one program, per column


@compiled
def _solved(
    v: Vertex,
    columns: Floats,
    rhs: Floats,
    objective: Floats,
    pivots: int,
    fresh: bool,
    point: Floats,
    carrying: Indices,
    weights: Floats,
) -> tuple[int, int]:
    """`minimise`, from the box alone where the vertex is not of this polyhedron: the status, and how many rows carry.

    `point` (n,) is the vertex; the rows with a multiplier go into `carrying`, their multipliers into `weights`
    (both (n + 1,)).
    """
    if fresh:
        to_box(v, objective)
    status = minimise(v, columns, rhs, objective, pivots)
    count = 0
    for k in range(point.size):
        if v.tight[k] >= 0 and v.multipliers[k] > 0.0:
            carrying[count], weights[count] = v.number[v.tight[k]], v.multipliers[k]
            count += 1
    if status == OPTIMAL:
        exact_point(v, rhs, point)
        return status, count
    point[:] = v.point
    if status == INFEASIBLE and v.counters[3] >= 0:
        carrying[count], weights[count] = v.number[v.counters[3]], 1.0
        count += 1
    return status, count


class Dense:
    """`LinearEngine` by `cpcal.solver.linear.simplex`; a program that it fails at goes to GLOP."""

    def load(self, matrix: Floats, rhs: Floats, lower: Floats, upper: Floats, always: int = 0) -> None:
        m, n = matrix.shape
        self._columns = np.ascontiguousarray(matrix.T, np.float64)
        self._rhs = np.ascontiguousarray(rhs, np.float64)
        room = m if m <= _ALL else min(m, always + _ROOM)
        self._vertex = Vertex(
            rows=np.empty((n, room)),
            rhs=np.empty(room),
            number=np.empty(room, np.intp),
            entered=np.zeros(m, np.bool_),
            lower=np.ascontiguousarray(lower, np.float64),
            upper=np.ascontiguousarray(upper, np.float64),
            tight=np.empty(n, np.intp),
            inverse=np.empty((n, n)),
            point=np.zeros(n),
            slack=np.empty(room),
            multipliers=np.empty(n),
            counters=np.zeros(4, np.intp),
        )
        begin(self._vertex, self._columns, self._rhs, self._first(always, m, n))
        self._fresh = True
        self._glop: LinearEngine | None = None

    def _first(self, always: int, m: int, n: int) -> Indices:
        if m <= _ALL:
            return np.arange(m)
        # the rows with the least room at the origin are the likeliest to matter
        likeliest = always + np.argsort(self._rhs[always:], kind="stable")[: _FIRST * n]
        return np.concatenate([np.arange(always), np.sort(likeliest)])

    def minimize(self, objective: Floats) -> LinearSolution:
        n = len(objective)
        point, rows, weights = np.empty(n), np.empty(n + 1, np.intp), np.empty(n + 1)
        program = (self._vertex, self._columns, self._rhs, objective, _PIVOTS * n)
        status, count = _solved(*program, self._fresh, point, rows, weights)
        self._fresh = bool(status == FAILED)
        if self._fresh:
            return self._by_glop(objective)
        meaning = LinearStatus.OPTIMAL if status == OPTIMAL else LinearStatus.INFEASIBLE
        return LinearSolution(meaning, point, rows[:count], weights[:count])

    def _by_glop(self, objective: Floats) -> LinearSolution:
        if self._glop is None:
            from cpcal.solver.linear.glop import Glop  # here: it loads ortools

            self._glop = Glop()
            self._glop.load(self._columns.T, self._rhs, self._vertex.lower, self._vertex.upper)
        return self._glop.minimize(objective)
