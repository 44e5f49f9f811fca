"""Linear programs: one polyhedron, many objectives. The simplex method proposes; rigorous arithmetic disposes."""

from __future__ import annotations

import math
import time
from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from cpcal.common.values import Floats, Indices
from cpcal.solver.compiled import compiled
from cpcal.solver.contract import Contraction, Step
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.linear.simplex import FAILED, INFEASIBLE, OPTIMAL, Vertex, begin, exact_point, minimise, to_box


class LinearStatus(Enum):
    """What a linear engine says. No status is a proof: the multipliers decide."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass(frozen=True)
class LinearSolution:
    """Approximate answer to `min c.z : matrix z <= rhs, lower <= z <= upper`.

    `rows` (k,) are those with a multiplier, `multipliers` (k,) > 0 theirs: few. With status INFEASIBLE they are a
    Farkas ray.
    """

    status: LinearStatus
    point: Floats  # (columns,)
    rows: Indices
    multipliers: Floats


# ------------------------------------------------------------------------------------------------------------------
# Rigorous bounds from the approximate multipliers of a linear program (DESIGN section 5, Rigour).
#
# For rows `U z <= u` over a box of z, any y >= 0 gives, with r = c + U^T y,
#
#     min c.z  >=  -y.u + sum_j min(r_j lo_j, r_j hi_j)
#
# whatever the solver that proposed y did. With c = 0 a positive value proves that the polyhedron is empty.

_UNIT = 2.0**-53
_UNDERFLOW = 1e-290  # more than all that products lose that are too small


def lower_bound(
    engine: Arithmetic,
    matrix: Floats,
    rhs: Floats,
    rows: Indices,
    multipliers: Floats,
    objective: Floats,
    columns: IntervalArray,
) -> float:
    """A proved lower bound of `objective . z` over `{z in columns : matrix z <= rhs}`, exact float64 numbers all.

    Shapes: matrix (m, n), rhs (m,); rows and multipliers (k,): the multiplier of each of some rows, each named once
    (negative multipliers count as zero); objective and columns (n,).
    """
    y = np.where(np.isfinite(multipliers), np.maximum(multipliers, 0.0), 0.0)
    if engine.name == "float64":
        return float(_bound(matrix.T, rhs, rows, y, objective, columns.lo, columns.hi))
    augmented = IntervalArray.point(np.concatenate([matrix[rows], -rhs[rows, None]], axis=1))
    combined = engine.dot(IntervalArray.point(y[None, :]), augmented)[0]
    residual = engine.add(combined[:-1], IntervalArray.point(objective))
    terms = engine.mul(residual, columns)
    lowest = IntervalArray.point(np.append(terms.lo, combined.lo[-1]))
    bound = float(engine.sum(lowest, 0).lo)
    return bound if np.isfinite(bound) else -np.inf


@compiled
def _bound(
    columns: Floats, rhs: Floats, rows: Indices, y: Floats, objective: Floats, lower: Floats, upper: Floats
) -> float:
    """The bound in float64, less all that rounding can have added (Neumaier and Shcherbina).

    With unit roundoff u, a sum of p products in any order, with or without fused operations, errs by at most
    p u / (1 - p u) times the sum of their absolute values, but for underflow: k + 1 for each r, one for its product
    with a bound, n + k for the total. The factor taken, 2 (n + k + 4) u, leaves n + 6 units of it for the roundings of
    the error's own formula.
    """
    n, k = columns.shape[0], rows.size
    gamma = 2.0 * (n + k + 4) * _UNIT
    total, size = 0.0, 0.0
    for i in range(k):
        term = -y[i] * rhs[rows[i]]
        total += term
        size += abs(term) + _UNDERFLOW
    for j in range(n):
        r, weight = objective[j], abs(objective[j])
        for i in range(k):
            term = y[i] * columns[j, rows[i]]
            r += term
            weight += abs(term)
        if r == 0.0 and weight == 0.0:
            continue
        term = min(r * lower[j], r * upper[j])
        largest = max(abs(lower[j]), abs(upper[j]))
        total += term
        size += largest * (weight + _UNDERFLOW / gamma) + abs(term)
    bound = total - gamma * size - _UNDERFLOW
    return bound if np.isfinite(bound) else -np.inf


# ------------------------------------------------------------------------------------------------------------------
# The simplex method of `simplex`; a program that it fails at goes to scipy's HiGHS.

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
    """One polyhedron, many objectives, each minimised from where the one before ended."""

    def load(self, matrix: Floats, rhs: Floats, lower: Floats, upper: Floats, always: int = 0) -> None:
        """Forget what was before and take `matrix z <= rhs`, `lower <= z <= upper` (finite bounds).

        Of many rows those enter that a vertex violates; the first `always` are likely to matter.
        """
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
            return self._by_highs(objective)
        meaning = LinearStatus.OPTIMAL if status == OPTIMAL else LinearStatus.INFEASIBLE
        return LinearSolution(meaning, point, rows[:count], weights[:count])

    def _by_highs(self, objective: Floats) -> LinearSolution:
        """Where there is no point, `min t : rows z <= rhs + t`, whose multipliers are a Farkas ray."""
        from scipy.optimize import linprog  # here: it takes half a second to load, and is rarely needed

        rows, n = self._columns.T, len(objective)
        bounds = np.stack([self._vertex.lower, self._vertex.upper], axis=1)
        elastic = np.concatenate([rows, np.full((len(rows), 1), -1.0)], axis=1)
        programs = (
            (LinearStatus.OPTIMAL, objective, rows, bounds),
            (LinearStatus.INFEASIBLE, np.eye(n + 1)[n], elastic, np.concatenate([bounds, [[0.0, np.inf]]])),
        )
        for status, cost, matrix, reach in programs if np.isfinite(rows).all() and np.isfinite(self._rhs).all() else ():
            found = linprog(cost, A_ub=matrix, b_ub=self._rhs, bounds=reach, method="highs")
            if found.x is not None:
                weights = -np.asarray(found.ineqlin.marginals)
                carrying = np.flatnonzero(weights > 0.0)
                return LinearSolution(status, np.asarray(found.x[:n]), carrying, weights[carrying])
        return LinearSolution(LinearStatus.FAILED, np.zeros(n), np.zeros(0, np.intp), np.zeros(0))


# ------------------------------------------------------------------------------------------------------------------
# Linear programs over a polyhedron in a box; the engine proposes, `lower_bound` proves.


class BoxProgram:
    """`matrix @ x <= rhs`, (m, n) and (m,), for x in a bounded box (n,).

    The programs are in u = (x - mid) / rad, each row scaled to a largest coefficient of 1; `count` were solved.
    """

    @np.errstate(
        over="ignore", invalid="ignore"
    )  # a program that overflows proposes nothing; what is proved is NaN-safe
    def __init__(self, matrix: Floats, rhs: Floats, box: IntervalArray, arithmetic: Arithmetic) -> None:
        self._matrix, self._rhs, self._box, self._arithmetic = matrix, rhs, box, arithmetic
        self._radius = box.rad
        inner = matrix * self._radius
        largest = np.abs(inner).max(axis=1, initial=0.0)
        self._scale = np.where(largest > 0.0, largest, 1.0)
        self._engine, self.count = Dense(), 0
        n = matrix.shape[1]
        rows, right = inner / self._scale[:, None], (rhs - matrix @ box.mid) / self._scale
        finite = np.isfinite(rows).all(axis=1) & np.isfinite(right)  # a row that overflows proposes nothing
        self._engine.load(np.where(finite[:, None], rows, 0.0), np.where(finite, right, 0.0), -np.ones(n), np.ones(n))

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


# ------------------------------------------------------------------------------------------------------------------
# Bound tightening: two linear programs for each variable of a box, each bound proved from its multipliers.

_WORTHWHILE = 1e-3  # a bound that some vertex already meets to this (in [-1, 1]) needs no program


class Programs(Protocol):
    """A polyhedron around the solutions in a bounded box, with a coordinate u = (x - mid) / rad for some variables."""

    @property
    def variables(self) -> Collection[int]:
        """Those with a coordinate."""
        ...

    @property
    def count(self) -> int:
        """Programs solved so far."""
        ...

    def minimize(self, variable: int, sign: float) -> LinearSolution:
        """The least `sign * u` of one variable."""
        ...

    def coordinates(self, solution: LinearSolution) -> Floats:
        """u (n,) at the vertex that a program found; 0 for the other variables."""
        ...

    def bound(self, variable: int, side: str, solution: LinearSolution) -> Step | None:
        """What the multipliers prove of a bound ("lo" or "hi"), if that is better than the box's."""
        ...

    def empty(self, solution: LinearSolution) -> Step | None:
        """The proof that no solution lies in the box, if the multipliers give one."""
        ...


def tightened(programs: Programs, box: Box, first: int | None, deadline: float = math.inf) -> Contraction:
    """The box around the polyhedron, the lower bound of variable `first` (the objective) before all others.

    After the `deadline` no program begins.

    `point` is the optimum of the first program. A bound that a vertex shows to move by next to nothing is left alone.
    """
    lo, hi, radius = box.lo.copy(), box.hi.copy(), box.rad
    point, met = None, _Met(len(box))
    steps: list[Step] = []
    for variable, side in _order(programs.variables, first):
        sign = 1.0 if side == "lo" else -1.0
        if radius[variable] == 0.0 or met(variable, sign):
            continue
        if time.monotonic() > deadline:
            break
        solution = programs.minimize(variable, sign)
        proof = programs.empty(solution) if solution.status is LinearStatus.INFEASIBLE else None
        if proof is not None:
            return Contraction(Box.empty(box.names), (*steps, proof), None, programs.count)
        if solution.status is not LinearStatus.OPTIMAL:
            continue
        vertex = programs.coordinates(solution)
        point = vertex if point is None else point
        met.add(vertex)
        step = None if met(variable, sign) else programs.bound(variable, side, solution)
        if step is None:
            continue
        steps.append(step)
        (lo if side == "lo" else hi)[variable] = step.bound
        if lo[variable] > hi[variable]:
            return Contraction(Box.empty(box.names), tuple(steps), None, programs.count)
    left = box.with_bounds(lo, hi)
    if point is not None:
        point = np.clip(box.mid + radius * point, left.lo, left.hi)
    return Contraction(left, tuple(steps), point, programs.count)


def _order(variables: Collection[int], first: int | None) -> list[tuple[int, str]]:
    """The objective's lower bound first; its upper one last, which the vertices before mostly meet."""
    others = [(v, side) for v in sorted(variables) for side in ("lo", "hi") if v != first]
    return others if first is None or first not in variables else [(first, "lo"), *others, (first, "hi")]


class _Met:
    """Which bounds some vertex of a program shows not to move by much."""

    def __init__(self, count: int) -> None:
        self._lowest, self._highest = np.full(count, np.inf), np.full(count, -np.inf)

    def add(self, vertex: Floats) -> None:
        np.minimum(self._lowest, vertex, out=self._lowest)
        np.maximum(self._highest, vertex, out=self._highest)

    def __call__(self, variable: int, sign: float) -> bool:
        end = self._lowest[variable] if sign > 0.0 else -self._highest[variable]
        return bool(end < -1.0 + _WORTHWHILE)
