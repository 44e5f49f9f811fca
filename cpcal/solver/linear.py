"""Linear programs: one polyhedron, many objectives. The simplex method proposes; rigorous arithmetic disposes."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.values import Bools, Floats, Indices, all_finite
from cpcal.solver.compiled import ahead, compiled
from cpcal.solver.contract import Contraction, Row, Step, StepWeights
from cpcal.solver.interval import Box, IntervalArray


class LinearStatus(Enum):
    """What a linear engine says. No status is a proof: the multipliers decide."""

    OPTIMAL = 0
    INFEASIBLE = 1
    FAILED = 2


class LinearSolution(NamedTuple):
    """Approximate answer to `min c.z : matrix z <= rhs, lower <= z <= upper`.

    `rows` (k,) are those with a multiplier, `multipliers` (k,) > 0 theirs: few. With status INFEASIBLE they are a
    Farkas ray. `lowest`: what they prove of the objective (of a ray: of 0) where the program's numbers are exact.
    """

    status: LinearStatus
    point: Floats  # (columns,)
    rows: Indices
    multipliers: Floats
    lowest: float = -math.inf


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
    matrix: Floats, rhs: Floats, rows: Indices, multipliers: Floats, objective: Floats, columns: IntervalArray
) -> float:
    """A proved lower bound of `objective . z` over `{z in columns : matrix z <= rhs}`, exact float64 numbers all.

    Shapes: matrix (m, n), rhs (m,); rows and multipliers (k,): the multiplier of each of some rows, each named once
    (negative multipliers count as zero); objective and columns (n,).
    """
    return float(_bound(matrix.T, rhs, rows, multipliers, objective, columns.lo, columns.hi))


@compiled
def _bound(
    columns: Floats, rhs: Floats, rows: Indices, multipliers: Floats, objective: Floats, lower: Floats, upper: Floats
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
    y = np.zeros(k)
    for i in range(k):
        y[i] = max(multipliers[i], 0.0) if np.isfinite(multipliers[i]) else 0.0
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
# A bounded simplex method on the vertices of a polyhedron with few columns and many rows, dense and compiled.
#
# From any n constraints that meet in a point: a dual phase, with costs shifted to what suits that point, reaches a
# vertex of the polyhedron; a primal phase follows with the true costs. After a change of the objective only the second
# has work, after new rows only the first, on true costs. Right sides are a little larger than asked, each by another
# amount, so that no more than n constraints meet by chance; where steps of length zero go on all the same, the first
# constraint that may move does (Bland's rule), and the number of pivots is bounded. Nothing here is a proof.

# A vertex of a polyhedron in a box, given by its n tight constraints, and the moves of a simplex method on it.
#
# The constraints are `a.z <= b`: the working rows, and the bounds of the n columns. At a vertex n of them are tight;
# `inverse` is the inverse of their matrix, so its column k is the edge along which only constraint k gets worse. All
# moves keep the inverse up to date; `refactored` computes it anew. The functions compile; all loops that matter run
# along contiguous memory.

TOO_SMALL = 1e-9  # a pivot that counts as zero


class Vertex(NamedTuple):
    """All arrays of one program in n columns, with room for c working rows.

    `tight` names constraints: k >= 0 is working row k, -1 - j the lower and -1 - n - j the upper bound of column j.
    """

    rows: Floats  # (n, c): the coefficients of the working rows
    rhs: Floats  # (c,)
    number: Indices  # (c,): the place of a working row in the polyhedron
    entered: Bools  # (m,): which rows of the polyhedron are working rows
    lower: Floats  # (n,)
    upper: Floats  # (n,)
    tight: Indices  # (n,)
    inverse: Floats  # (n, n)
    point: Floats  # (n,)
    slack: Floats  # (c,): of the working rows at the point
    multipliers: Floats  # (n,): of the tight constraints
    counters: Indices  # (4,): working rows, pivots so far, pivots since the inverse was computed, start of a ray


@compiled
def coefficients(rows: Floats, constraint: int, out: Floats) -> None:
    """The row of a constraint."""
    n = out.size
    for j in range(n):
        out[j] = rows[j, constraint] if constraint >= 0 else 0.0
    if constraint < 0:
        out[(-1 - constraint) % n] = -1.0 if -1 - constraint < n else 1.0


@compiled
def side(v: Vertex, constraint: int) -> float:
    """The right side of a constraint."""
    n = v.point.size
    if constraint >= 0:
        return float(v.rhs[constraint])
    j = -1 - constraint
    return float(-v.lower[j] if j < n else v.upper[j - n])


@compiled
def to_box(v: Vertex, objective: Floats) -> None:
    """Start where the objective is least in the box alone."""
    n = v.point.size
    v.inverse[:, :] = 0.0
    for j in range(n):
        at_upper = objective[j] < 0.0
        v.tight[j] = -1 - n - j if at_upper else -1 - j
        v.inverse[j, j] = 1.0 if at_upper else -1.0
    v.counters[2] = 0
    settle(v)


@compiled
def settle(v: Vertex) -> None:
    """Point and slacks from the inverse."""
    n, count = v.point.size, v.counters[0]
    v.point[:] = 0.0
    for k in range(n):
        b = side(v, v.tight[k])
        for j in range(n):
            v.point[j] += b * v.inverse[j, k]
    v.slack[:count] = v.rhs[:count]
    for j in range(n):
        z = v.point[j]
        for i in range(count):
            v.slack[i] -= z * v.rows[j, i]


@compiled
def eliminated(work: Floats, least: float) -> bool:
    """A matrix and the identity beside it (n, 2n) to the identity and the inverse, by Gauss-Jordan elimination.

    False where the matrix is singular: no pivot is larger than `least`.
    """
    n = len(work)
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(work[i, k]) > abs(work[best, k]):
                best = i
        if not abs(work[best, k]) > least:
            return False
        if best != k:
            for j in range(2 * n):
                work[k, j], work[best, j] = work[best, j], work[k, j]
        scale = 1.0 / work[k, k]
        for j in range(k, 2 * n):
            work[k, j] *= scale
        for i in range(n):
            factor = work[i, k]
            if i != k and factor != 0.0:
                for j in range(k, 2 * n):
                    work[i, j] -= factor * work[k, j]
    return True


@compiled
def refactored(v: Vertex) -> bool:
    """Compute the inverse, point and slacks anew; False if the matrix is singular."""
    n = v.point.size
    work = np.zeros((n, 2 * n))
    for k in range(n):
        coefficients(v.rows, v.tight[k], work[k, :n])
        work[k, n + k] = 1.0
    if not eliminated(work, TOO_SMALL):
        return False
    v.inverse[:, :] = work[:, n:]
    v.counters[2] = 0
    settle(v)
    return True


@compiled
def times_inverse(v: Vertex, row: Floats, out: Floats) -> None:
    """`row @ inverse`."""
    n = row.size
    out[:] = 0.0
    for j in range(n):
        factor = row[j]
        if factor != 0.0:
            for k in range(n):
                out[k] += factor * v.inverse[j, k]


@compiled
def along(v: Vertex, k: int, out: Floats) -> None:
    """What a unit step along edge k adds to each working row."""
    n, count = v.point.size, v.counters[0]
    out[:count] = 0.0
    for j in range(n):
        step = v.inverse[j, k]
        if step != 0.0:
            for i in range(count):
                out[i] += step * v.rows[j, i]


@compiled
def exchange(v: Vertex, k: int, constraint: int, alpha: Floats, growth: Floats, step: float) -> None:
    """Move by `step` along edge k and let the constraint take the k-th place.

    `alpha` (n,) is the constraint's row times the inverse, `growth` (c,) what the edge adds to the working rows.
    """
    n, count = v.point.size, v.counters[0]
    for j in range(n):
        v.point[j] += step * v.inverse[j, k]
    for i in range(count):
        v.slack[i] -= step * growth[i]
    old = v.tight[k]
    if old >= 0:
        v.slack[old] = -step
    if constraint >= 0:
        v.slack[constraint] = 0.0
    pivot = 1.0 / alpha[k]
    alpha[k] = 0.0
    for j in range(n):
        edge = v.inverse[j, k] * pivot
        if edge != 0.0:
            for i in range(n):
                v.inverse[j, i] -= edge * alpha[i]
        v.inverse[j, k] = edge
    v.tight[k] = constraint
    v.counters[1] += 1
    v.counters[2] += 1


@compiled
def residual(v: Vertex) -> float:
    """How far the tight constraints are from tight: the error of the point."""
    n = v.point.size
    row = np.empty(n)
    worst = 0.0
    for k in range(n):
        coefficients(v.rows, v.tight[k], row)
        total = -side(v, v.tight[k])
        for j in range(n):
            total += row[j] * v.point[j]
        worst = max(worst, abs(total))
    return worst


@compiled
def spread(k: int) -> float:
    """Numbers in [1, 2) that look like random ones."""
    value = k * 0.6180339887498949 + 0.5
    return float(1.0 + value - np.floor(value))


_SAID = tuple(LinearStatus)
OPTIMAL, INFEASIBLE, FAILED = (status.value for status in _SAID)

PERTURBATION = 1e-9  # of a right side, once to twice
_FEASIBLE = 1e-10  # by which rows may be violated
_DUAL = 1e-9  # by which multipliers may be negative
_SHIFT = 1e-3  # multipliers that a shift of costs gives, once to twice
_REFACTOR = 60  # pivots after which the inverse is computed anew
_ACCURATE = 1e-11  # error of a point
_STALLED = 20  # steps of length zero in a row, after which Bland's rule takes over
_MORE_ROWS = 24  # violated rows that enter at a time
_ROUNDS = 40  # times that rows enter for one objective


@compiled
def _enter(v: Vertex, columns: Floats, rhs: Floats, i: int) -> None:
    """Row i of the polyhedron becomes a working row; there must be room."""
    place = v.counters[0]
    total = 0.0
    for j in range(v.point.size):
        v.rows[j, place] = columns[j, i]
        total += columns[j, i] * v.point[j]
    v.rhs[place] = rhs[i] + PERTURBATION * spread(i)
    v.slack[place] = v.rhs[place] - total
    v.number[place] = i
    v.entered[i] = True
    v.counters[0] += 1


@compiled
def begin(v: Vertex, columns: Floats, rhs: Floats, first: Indices) -> None:
    """At a vertex of the box, with the first rows."""
    v.counters[:] = 0
    v.entered[:] = False
    v.point[:] = 0.0
    for i in first:
        _enter(v, columns, rhs, i)


@compiled
def _enter_violated(v: Vertex, columns: Floats, rhs: Floats) -> bool:
    """Let the rows enter that the point violates most; False if there are none, or no room."""
    n, m = columns.shape
    room = min(_MORE_ROWS, v.rhs.size - v.counters[0])
    if v.counters[0] == m or room <= 0:
        return False
    excess = np.zeros(m)
    for j in range(n):
        z = v.point[j]
        for i in range(m):
            excess[i] += z * columns[j, i]
    worst = np.zeros(room)
    chosen = np.full(room, -1)
    for i in range(m):
        beyond = excess[i] - rhs[i] - 2.0 * PERTURBATION
        if beyond > worst[room - 1] + _FEASIBLE and not v.entered[i]:
            place = room - 1
            while place > 0 and beyond > worst[place - 1]:
                worst[place], chosen[place] = worst[place - 1], chosen[place - 1]
                place -= 1
            worst[place], chosen[place] = beyond, i
    for k in range(room):
        if chosen[k] >= 0:
            _enter(v, columns, rhs, chosen[k])
    return bool(chosen[0] >= 0)


@compiled
def _violated(v: Vertex, bland: bool) -> int:
    """The constraint to become tight in a dual step, named as in `Vertex.tight`; the number of rows if none."""
    n, count = v.point.size, v.counters[0]
    worst, found = _FEASIBLE, count
    for i in range(count):
        if -v.slack[i] > worst:
            worst, found = -v.slack[i], i
            if bland:
                return int(found)
    for j in range(n):
        if v.lower[j] - v.point[j] > worst:
            worst, found = v.lower[j] - v.point[j], -1 - j
        if v.point[j] - v.upper[j] > worst:
            worst, found = v.point[j] - v.upper[j], -1 - n - j
    return int(found)


@compiled
def _excess(v: Vertex, constraint: int) -> float:
    n = v.point.size
    if constraint >= 0:
        return float(-v.slack[constraint])
    j = -1 - constraint
    return float(v.lower[j] - v.point[j] if j < n else v.point[j - n] - v.upper[j - n])


@compiled
def _leaving(alpha: Floats, y: Floats, bland: bool) -> int:
    """The tight constraint whose multiplier reaches zero first in a dual step; -1 if none ever does.

    Of several the one with the largest pivot, multipliers being allowed to become negative by a tolerance.
    """
    n = alpha.size
    reach = np.inf
    for k in range(n):
        if alpha[k] > TOO_SMALL:
            reach = min(reach, (y[k] if bland else y[k] + _DUAL) / alpha[k])
    best, found = 0.0, -1
    for k in range(n):
        if alpha[k] > max(best, TOO_SMALL) and y[k] <= reach * alpha[k]:
            best, found = alpha[k], k
            if bland:
                break
    return int(found)


@compiled
def _feasible(v: Vertex, objective: Floats, limit: int) -> int:
    """The dual phase: OPTIMAL at a vertex of the polyhedron, INFEASIBLE with a ray as multipliers of `tight`."""
    n = v.point.size
    y, row, alpha, growth = v.multipliers, np.empty(n), np.empty(n), np.empty(v.rhs.size)
    times_inverse(v, objective, y)
    for k in range(n):
        y[k] = max(-y[k], 0.0)
        if y[k] < _DUAL:
            y[k] = _SHIFT * spread(v.counters[1] + k)
    stalled = 0
    while v.counters[1] < limit:
        bland = stalled > _STALLED
        entering = _violated(v, bland)
        if entering == v.counters[0]:
            return OPTIMAL
        coefficients(v.rows, entering, row)
        times_inverse(v, row, alpha)
        k = _leaving(alpha, y, bland)
        if k < 0:
            if v.counters[2] > 0 and refactored(v):  # be sure of it, unless the matrix is nearly singular
                continue
            for j in range(n):
                y[j] = max(-alpha[j], 0.0)
            v.counters[3] = entering
            return INFEASIBLE
        ratio = max(y[k], 0.0) / alpha[k]
        stalled = stalled + 1 if ratio == 0.0 else 0
        for j in range(n):
            y[j] = max(y[j] - ratio * alpha[j], 0.0)
        y[k] = ratio
        along(v, k, growth)
        exchange(v, k, entering, alpha, growth, -_excess(v, entering) / alpha[k])
        if v.counters[2] >= max(_REFACTOR, n) and not refactored(v):
            return FAILED
    return FAILED


@compiled
def _edge(v: Vertex, bland: bool) -> int:
    """The edge along which the objective falls most steeply, from the multipliers; -1 if it falls along none."""
    n = v.point.size
    best, found, lengths = 0.0, -1, np.zeros(n)
    for j in range(n):  # along contiguous memory
        for k in range(n):
            lengths[k] += v.inverse[j, k] * v.inverse[j, k]
    for k in range(n):
        y = v.multipliers[k]
        if y < -_DUAL:
            if bland:
                return int(k)
            if y * y > best * lengths[k]:
                best, found = y * y / lengths[k], k
    return int(found)


@compiled
def _blocking(v: Vertex, k: int, growth: Floats, bland: bool) -> int:
    """The constraint that ends a step along edge k, backwards; the number of rows if none does.

    Of several the one with the largest pivot, rows being allowed to be violated by a tolerance.
    """
    n, count = v.point.size, v.counters[0]
    slip = 0.0 if bland else _FEASIBLE
    reach = np.inf
    for i in range(count):
        if growth[i] < -TOO_SMALL:
            reach = min(reach, (max(v.slack[i], 0.0) + slip) / -growth[i])
    for j in range(n):
        g = v.inverse[j, k]
        if g > TOO_SMALL:
            reach = min(reach, (max(v.point[j] - v.lower[j], 0.0) + slip) / g)
        elif g < -TOO_SMALL:
            reach = min(reach, (max(v.upper[j] - v.point[j], 0.0) + slip) / -g)
    best, found = TOO_SMALL, count
    for i in range(count):
        if -growth[i] > best and v.slack[i] <= reach * -growth[i]:
            best, found = -growth[i], i
            if bland:
                return int(found)
    for j in range(n):
        g = v.inverse[j, k]
        if g > best and v.point[j] - v.lower[j] <= reach * g:
            best, found = g, -1 - j
        elif -g > best and v.upper[j] - v.point[j] <= reach * -g:
            best, found = -g, -1 - n - j
    return int(found)


@compiled
def _improved(v: Vertex, objective: Floats, limit: int) -> int:
    """The primal phase, from a vertex of the polyhedron: OPTIMAL with its multipliers, or FAILED."""
    n = v.point.size
    row, alpha, growth, down = np.empty(n), np.empty(n), np.empty(v.rhs.size), -objective
    stalled = 0
    while v.counters[1] < limit:
        times_inverse(v, down, v.multipliers)
        bland = stalled > _STALLED
        k = _edge(v, bland)
        if k < 0:
            return OPTIMAL
        along(v, k, growth)
        entering = _blocking(v, k, growth, bland)
        if entering == v.counters[0]:
            return FAILED
        coefficients(v.rows, entering, row)
        times_inverse(v, row, alpha)
        if not abs(alpha[k]) > TOO_SMALL:
            return FAILED
        step = max(-_excess(v, entering), 0.0) / alpha[k]
        stalled = stalled + 1 if step > -1e-14 else 0
        exchange(v, k, entering, alpha, growth, step)
        if v.counters[2] >= max(_REFACTOR, n) and not refactored(v):
            return FAILED
    return FAILED


@compiled
def _on_working_rows(v: Vertex, objective: Floats, limit: int) -> int:
    """Both phases, until point and multipliers are accurate."""
    for _ in range(4):
        status = _feasible(v, objective, limit)
        if status == OPTIMAL:
            status = _improved(v, objective, limit)
        if status != OPTIMAL:
            return status
        if residual(v) <= _ACCURATE and _violated(v, False) == v.counters[0]:
            return OPTIMAL
        if not refactored(v):
            return FAILED
    return FAILED


@compiled
def minimise(v: Vertex, columns: Floats, rhs: Floats, objective: Floats, pivots: int) -> int:
    """From the vertex where the last program ended; rows (n, m) of the polyhedron enter as they are violated.

    The multipliers are those of `tight`; for a ray that of constraint `counters[3]` is 1.
    """
    status = FAILED
    for attempt in range(2):
        if attempt == 1:
            to_box(v, objective)
        limit = v.counters[1] + pivots
        for _ in range(_ROUNDS):
            status = _on_working_rows(v, objective, limit)
            if status != OPTIMAL or not _enter_violated(v, columns, rhs):
                break
        if status != FAILED:
            return status
    return status


# ------------------------------------------------------------------------------------------------------------------
# The simplex method; a program that it fails at goes to scipy's HiGHS.

_ALL = 640  # rows that are all looked at in every pivot
_FIRST = 3  # of more rows, those that enter at the start, per column
_ROOM = 1536  # and the most that enter at all
_PIVOTS = 60  # for one program, per column
_QUICK = 30_000  # coefficients, up to which all programs of a box are solved before the clock is looked at again
_WORTHWHILE = 1e-3  # a bound that some vertex already meets to this (in [-1, 1]) needs no program


_WAITING, _LEFT_OUT = -1, 3  # beside the statuses of programs that were solved


@compiled
def _next(status: Indices, objectives: Floats, point: Floats) -> int:
    """The waiting program whose objective is least at a point: from there it takes the fewest pivots."""
    best, found = np.inf, 0
    for k in range(status.size):
        if status[k] == _WAITING:
            value = 0.0
            for j in range(point.size):
                value += objectives[k, j] * point[j]
            if value < best:
                best, found = value, k
    return int(found)


@compiled
def _solved(
    v: Vertex,
    columns: Floats,
    rhs: Floats,
    objectives: Floats,
    near: Indices,
    pivots: int,
    first: Indices,
    fresh: bool,
    done: int,
    last: int,
    reach: Floats,
    status: Indices,
    order: Indices,
    points: Floats,
    count: Indices,
    carrying: Indices,
    weights: Floats,
    lowest: Floats,
) -> int:
    """`minimise` for the objectives (P, n), number 0 first, until `last` of them are `done`, or one is not OPTIMAL.

    From the box and the `first` rows where the vertex is not of this polyhedron (`fresh`). One is left out where a
    vertex before is next to the bound that it asks about: column `near[k]` at -1 or, where its objective falls, 1.
    `order` says which are done, in turn. `reach` (2, n): the lowest and the highest of all vertices. `points` (P, n)
    are the vertices; the rows with a multiplier go into `carrying`, their multipliers into `weights` (both (P, n + 1)),
    `count` of them, and what they prove into `lowest`.
    """
    n = v.point.size
    while done < last:
        k = _next(status, objectives, v.point) if done > 0 else 0
        order[done] = k
        done += 1
        objective, j = objectives[k], near[k]
        if j >= 0 and (reach[0, j] if objective[j] > 0.0 else -reach[1, j]) < -1.0 + _WORTHWHILE:
            status[k] = _LEFT_OUT
            continue
        if fresh:
            begin(v, columns, rhs, first)
            to_box(v, objective)
            fresh = False
        status[k] = minimise(v, columns, rhs, objective, pivots)
        size = 0
        for i in range(n):
            if v.tight[i] >= 0 and v.multipliers[i] > 0.0:
                carrying[k, size], weights[k, size] = v.number[v.tight[i]], v.multipliers[i]
                size += 1
        if status[k] == OPTIMAL:
            points[k] = 0.0  # where the tight constraints meet, their right sides as they are
            for i in range(n):
                constraint = v.tight[i]
                b = rhs[v.number[constraint]] if constraint >= 0 else side(v, constraint)
                for j in range(n):
                    points[k, j] += b * v.inverse[j, i]
            for i in range(n):
                reach[0, i] = min(reach[0, i], points[k, i])
                reach[1, i] = max(reach[1, i], points[k, i])
        else:
            points[k] = v.point
            if status[k] == INFEASIBLE and v.counters[3] >= 0:
                carrying[k, size], weights[k, size] = v.number[v.counters[3]], 1.0
                size += 1
            objective = np.zeros(n)
        lowest[k] = _bound(columns, rhs, carrying[k, :size], weights[k, :size], objective, v.lower, v.upper)
        count[k] = size
        if status[k] != OPTIMAL:
            break
    return done


class Dense:
    """One polyhedron, many objectives, each minimised from where the one before ended."""

    def __init__(self, matrix: Floats, rhs: Floats, lower: Floats, upper: Floats, always: int = 0) -> None:
        """Of `matrix z <= rhs`, `lower <= z <= upper` (finite bounds).

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
        first = np.arange(m)
        if m > _ALL:  # the rows with the least room at the origin are the likeliest to matter
            likeliest = always + np.argsort(self._rhs[always:], kind="stable")[: _FIRST * n]
            first = np.concatenate([np.arange(always), np.sort(likeliest)])
        self._first, self._fresh = first, True

    def minimize(self, objective: Floats) -> LinearSolution:
        return next(self.each(objective[None], np.full(1, -1)))[1]

    def each(
        self, objectives: Floats, near: Indices, deadline: float = math.inf
    ) -> Iterator[tuple[int, LinearSolution]]:
        """The numbers of the objectives (P, n) and the solutions; none begins after the `deadline`.

        Number 0 comes first, then each time the one that the vertex before is nearest to. Objective k is the column
        `near[k]` or its negative (-1: neither); it is left out where a vertex before lies next to its least value in
        [-1, 1].
        """
        count, n = objectives.shape
        reach = np.repeat([[np.inf], [-np.inf]], n, axis=1)
        (order, sizes), status = np.zeros((2, count), np.intp), np.full(count, _WAITING)
        points, lowest = np.empty((count, n)), np.empty(count)
        rows, weights = np.empty((count, n + 1), np.intp), np.empty((count, n + 1))
        program = self._vertex, self._columns, self._rhs, objectives, near, _PIVOTS * n, self._first
        out: tuple[Any, ...] = (status, order, points, sizes, rows, weights, lowest)
        together = count if self._columns.size <= _QUICK else 1
        done = 0
        while done < count and not time.monotonic() > deadline:
            before, done = done, _solved(*program, self._fresh, done, min(done + together, count), reach, *out)
            self._fresh = bool(status[order[done - 1]] == FAILED)
            found, each_size, each_lowest = status.tolist(), sizes.tolist(), lowest.tolist()
            for k in sorted(order[before:done].tolist()):
                if found[k] == _LEFT_OUT:
                    continue
                carrying = k, slice(each_size[k])
                solution = LinearSolution(_SAID[found[k]], points[k], rows[carrying], weights[carrying], each_lowest[k])
                yield k, self._by_highs(objectives[k]) if found[k] == FAILED else solution

    def _by_highs(self, objective: Floats) -> LinearSolution:
        """Where there is no point, `min t : rows z <= rhs + t`, whose multipliers are a Farkas ray."""
        from scipy import optimize  # here: it takes half a second to load, and is rarely needed

        linprog: Any = optimize.linprog  # typed for other arguments than these
        rows, n = self._columns.T, len(objective)
        bounds = np.stack([self._vertex.lower, self._vertex.upper], axis=1)
        elastic = np.hstack([rows, np.full((len(rows), 1), -1.0)])
        programs = (
            (LinearStatus.OPTIMAL, objective, rows, bounds),
            (LinearStatus.INFEASIBLE, np.eye(n + 1)[n], elastic, np.concatenate([bounds, [[0.0, np.inf]]])),
        )
        for status, cost, matrix, reach in programs if all_finite(rows) and all_finite(self._rhs) else ():
            options = {"presolve": False, "maxiter": _PIVOTS * n}  # a program that cycles is lost
            found = linprog(cost, A_ub=matrix, b_ub=self._rhs, bounds=reach, method="highs", options=options)
            if found.status == 0:
                weights = -np.asarray(found.ineqlin.marginals)
                carrying = np.flatnonzero(weights > 0.0)
                aim = objective if status is LinearStatus.OPTIMAL else np.zeros(n)
                multipliers, columns = weights[carrying], IntervalArray(*bounds.T)
                lowest = lower_bound(rows, self._rhs, carrying, multipliers, aim, columns)
                return LinearSolution(status, np.asarray(found.x[:n]), carrying, multipliers, lowest)
        return LinearSolution(LinearStatus.FAILED, np.zeros(n), np.zeros(0, np.intp), np.zeros(0))


@ahead
def _smallest() -> None:
    Dense(np.ones((1, 1)), *np.ones((3, 1))).minimize(np.ones(1))


# ------------------------------------------------------------------------------------------------------------------
# Bound tightening: two linear programs for each variable of a box, each bound proved from its multipliers.


@dataclass(eq=False)
class Programs(ABC):
    """The linear programs of one polyhedron around the solutions in a bounded box: many objectives, of some columns.

    `columns` says which column is the coordinate u = (x - mid) / rad of a variable; there are `size`. A class
    that derives from it makes the `engine` and says what multipliers prove.
    """

    name = ""  # of the contractor
    box: Box
    columns: Mapping[int, int]
    size: int
    engine: Dense = field(init=False, repr=False)

    def lowest(self, objective: Floats, solution: LinearSolution) -> float:
        """A proved lower bound of an objective (size,) from the multipliers; here the program's numbers are exact."""
        return solution.lowest

    @abstractmethod
    def reached(self, variable: int, side: str, solution: LinearSolution) -> float:
        """The bound of a variable on a side, "lo" or "hi", that the multipliers prove; infinite or NaN: none."""

    @abstractmethod
    def carriers(self, solution: LinearSolution) -> tuple[tuple[Row, ...], StepWeights | None]:
        """The rows that carry a proof, and their weights where these can be checked."""

    def empty(self, solution: LinearSolution) -> Step | None:
        """The proof that no solution lies in the box, if the multipliers give one."""
        if not self.lowest(np.zeros(self.size), solution) > 0.0:
            return None
        return Step(self.name, None, "", math.nan, *self.carriers(solution))

    def tightened(self, first: int | None, deadline: float = math.inf, tells: bool = True) -> Contraction:
        """The box around the polyhedron, the lower bound of variable `first` (the objective) before all others.

        After the `deadline` no program begins. `point` is the optimum of the first program. A bound that a vertex shows
        to move by next to nothing is left alone. Without `tells` the steps are left out, but for that of an empty box.
        """
        box, radius, ends = self.box, self.box.rad, {"lo": self.box.lo.tolist(), "hi": self.box.hi.tolist()}
        point, steps, count = None, list[Step](), 0
        order = [(v, side) for v in sorted(self.columns) for side in ("lo", "hi") if v != first and radius[v] != 0.0]
        if first is not None and first in self.columns and radius[first] != 0.0:
            order = [(first, "lo"), *order, (first, "hi")]  # the vertices before mostly meet the upper bound
        near = np.array([self.columns[v] for v, _ in order], np.intp)
        objectives = np.zeros((len(order), self.size))
        objectives[np.arange(len(order)), near] = [1.0 if side == "lo" else -1.0 for _, side in order]
        for k, solution in self.engine.each(objectives, near, deadline):
            (variable, side), count = order[k], count + 1
            proof = self.empty(solution) if solution.status is LinearStatus.INFEASIBLE else None
            if proof is not None:
                return Contraction(Box.empty(box.names), (*steps, proof), None, count)
            if solution.status is not LinearStatus.OPTIMAL:
                continue
            point = solution.point if point is None else point
            if solution.lowest < -1.0 + _WORTHWHILE:
                continue
            new, old = self.reached(variable, side, solution), ends[side][variable]
            if not (new > old if side == "lo" else new < old):
                continue
            ends[side][variable] = new
            if tells:
                steps.append(Step(self.name, box.names[variable], side, new, *self.carriers(solution)))
            if ends["lo"][variable] > ends["hi"][variable]:
                return Contraction(Box.empty(box.names), tuple(steps), None, count)
        left = box.with_bounds(np.array(ends["lo"]), np.array(ends["hi"]))
        if point is not None:
            u = np.zeros(len(box))  # 0 for variables without a column
            u[list(self.columns)] = point[list(self.columns.values())]
            with np.errstate(over="ignore"):  # beside the ends of float64
                point = np.clip(box.mid + radius * u, left.lo, left.hi)
        return Contraction(left, tuple(steps), point, count)
