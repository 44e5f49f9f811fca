"""The contract of a linear engine: one polyhedron, many objectives. It proposes; rigorous arithmetic disposes."""

from __future__ import annotations

import math
import time
from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from ortools.linear_solver import pywraplp

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


class LinearEngine(Protocol):
    """One polyhedron, many objectives. Proposes; rigorous arithmetic disposes."""

    def load(self, matrix: Floats, rhs: Floats, lower: Floats, upper: Floats, always: int = 0) -> None:
        """Forget what was before and take `matrix z <= rhs`, `lower <= z <= upper` (finite bounds).

        Of many rows an engine may leave out those that no vertex violates; the first `always` are likely to matter.
        """
        ...

    def minimize(self, objective: Floats) -> LinearSolution:
        """Minimise, from where the program before ended."""
        ...


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
# ortools' GLOP as a linear engine: to compare with, and for programs that the dense simplex method fails at.

# Columns arrive centred and scaled, so the solver's own scaling and presolve only cost time and hot starts.
# The primal simplex cycles now and then on degenerate programs: after the iterations that it never needs
# otherwise the dual simplex takes over, from scratch.
_FAST = "use_preprocessing:false use_scaling:false use_dual_simplex:false max_number_of_iterations:1000"
_CAREFUL = "use_preprocessing:false use_scaling:true use_dual_simplex:true max_number_of_iterations:20000"

_FIRST_ROWS = 3  # rows at the start, per column
_MORE_ROWS = 24  # violated rows added at a time
_ROUNDS = 12  # times that rows are added for one objective
_VIOLATION = 1e-9  # of a row scaled to a largest coefficient of about 1


class Glop:
    """`LinearEngine` on GLOP. The primal simplex starts from the last basis when only the objective changed.

    Rows enter when a vertex violates them; bounds from a part of them are valid, only weaker. An elastic column t,
    fixed at zero, sits in every row; when the program has no solution it is freed and `min t` is solved, whose
    multipliers are a Farkas ray.
    """

    def load(self, matrix: Floats, rhs: Floats, lower: Floats, upper: Floats, always: int = 0) -> None:
        solver = pywraplp.Solver.CreateSolver("GLOP")
        if solver is None:  # pragma: no cover - every ortools wheel holds GLOP
            raise RuntimeError("this build of ortools has no GLOP")
        self._solver = solver
        self._columns = [solver.NumVar(float(lo), float(hi), "") for lo, hi in zip(lower, upper, strict=True)]
        self._elastic = solver.NumVar(0.0, 0.0, "elastic")
        self._objective = solver.Objective()
        self._objective.SetMinimization()
        self._matrix, self._rhs = matrix, rhs
        self._entered = np.zeros(0, np.intp)
        self._constraints: list[pywraplp.Constraint] = []
        self._enter(self._first(lower, upper, always))

    def _first(self, lower: Floats, upper: Floats, always: int) -> Indices:
        """Of the rows that some point within the bounds violates, those with the least room at the origin."""
        matrix, rhs = self._matrix[always:], self._rhs[always:]
        largest = np.maximum(matrix, 0.0) @ upper + np.minimum(matrix, 0.0) @ lower
        candidates = np.flatnonzero(largest > rhs)
        likeliest = candidates[np.argsort(rhs[candidates], kind="stable")[: _FIRST_ROWS * matrix.shape[1]]]
        return np.concatenate([np.arange(always), np.sort(always + likeliest)])

    def _enter(self, rows: Indices) -> None:
        infinity = self._solver.infinity()
        for i in rows:
            row = self._solver.Constraint(-infinity, float(self._rhs[i]))
            for j in np.flatnonzero(self._matrix[i]):
                row.SetCoefficient(self._columns[j], float(self._matrix[i, j]))
            row.SetCoefficient(self._elastic, -1.0)
            self._constraints.append(row)
        self._entered = np.concatenate([self._entered, rows])

    def _enter_violated(self, point: Floats) -> bool:
        excess = self._matrix @ point - self._rhs
        excess[self._entered] = 0.0
        violated = np.flatnonzero(excess > _VIOLATION)
        self._enter(np.sort(violated[np.argsort(-excess[violated], kind="stable")[:_MORE_ROWS]]))
        return bool(violated.size)

    def minimize(self, objective: Floats) -> LinearSolution:
        for _ in range(_ROUNDS):
            solution = self._minimized(objective)
            if solution.status is not LinearStatus.OPTIMAL or not self._enter_violated(solution.point):
                break
        return solution

    def _minimized(self, objective: Floats) -> LinearSolution:
        """Over the rows that have entered."""
        self._objective.Clear()
        self._objective.SetMinimization()
        for j in np.flatnonzero(objective):
            self._objective.SetCoefficient(self._columns[j], float(objective[j]))
        if self._solve(_FAST) or self._solve(_CAREFUL):
            return self._solution(LinearStatus.OPTIMAL)
        return self._elastic_program()

    def _solve(self, parameters: str) -> bool:
        """Whether the program was solved to the end, by these parameters."""
        start = pywraplp.MPSolverParameters()
        if parameters == _CAREFUL:
            start.SetIntegerParam(start.INCREMENTALITY, start.INCREMENTALITY_OFF)
        self._solver.SetSolverSpecificParametersAsString(parameters)
        return bool(self._solver.Solve(start) == pywraplp.Solver.OPTIMAL)

    def _elastic_program(self) -> LinearSolution:
        """`min t : rows z <= rhs + t`: always solvable; t > 0 when the rows have no common point."""
        self._objective.Clear()
        self._objective.SetMinimization()
        self._objective.SetCoefficient(self._elastic, 1.0)
        self._elastic.SetBounds(0.0, self._solver.infinity())
        if self._solve(_FAST) or self._solve(_CAREFUL):
            found = self._solution(LinearStatus.INFEASIBLE)
        else:
            nothing = np.zeros(0, np.intp)
            found = LinearSolution(LinearStatus.FAILED, np.zeros(len(self._columns)), nothing, np.zeros(0))
        self._elastic.SetBounds(0.0, 0.0)
        return found

    def _solution(self, status: LinearStatus) -> LinearSolution:
        point = np.array([column.solution_value() for column in self._columns])
        weights = np.array([-row.dual_value() for row in self._constraints])
        carrying = np.flatnonzero(weights > 0.0)
        return LinearSolution(status, point, self._entered[carrying], weights[carrying])


# ------------------------------------------------------------------------------------------------------------------
# The default linear engine: a dense simplex method, compiled.

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
            self._glop = Glop()
            self._glop.load(self._columns.T, self._rhs, self._vertex.lower, self._vertex.upper)
        return self._glop.minimize(objective)


# ------------------------------------------------------------------------------------------------------------------
# Linear programs over a polyhedron in a box; the engine proposes, `lower_bound` proves.


class BoxProgram:
    """`matrix @ x <= rhs`, (m, n) and (m,), for x in a bounded box (n,).

    The programs are in u = (x - mid) / rad, each row scaled to a largest coefficient of 1; `count` were solved.
    """

    @np.errstate(
        over="ignore", invalid="ignore"
    )  # a program that overflows proposes nothing; what is proved is NaN-safe
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
        rows, right = inner / self._scale[:, None], (rhs - matrix @ box.mid) / self._scale
        finite = np.isfinite(rows).all(axis=1) & np.isfinite(right)  # a row that overflows proposes nothing
        engine.load(np.where(finite[:, None], rows, 0.0), np.where(finite, right, 0.0), -np.ones(n), np.ones(n))

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
