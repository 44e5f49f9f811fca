"""A bounded simplex method on the vertices of a polyhedron with few columns and many rows, dense and compiled.

From any n constraints that meet in a point: a dual phase, with costs shifted to what suits that point, reaches a
vertex of the polyhedron; a primal phase follows with the true costs. After a change of the objective only the second
has work, after new rows only the first, on true costs. Right sides are a little larger than asked, each by another
amount, so that no more than n constraints meet by chance; where steps of length zero go on all the same, the first
constraint that may move does (Bland's rule), and the number of pivots is bounded. Nothing here is a proof.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cpcal.common.values import Bools, Floats, Indices
from cpcal.solver.compiled import compiled

# ------------------------------------------------------------------------------------------------------------------
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
def coefficients(v: Vertex, constraint: int, out: Floats) -> None:
    """The row of a constraint."""
    n = v.point.size
    if constraint >= 0:
        for j in range(n):
            out[j] = v.rows[j, constraint]
    else:
        out[:] = 0.0
        j = -1 - constraint
        if j < n:
            out[j] = -1.0
        else:
            out[j - n] = 1.0


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
    for i in range(count):
        v.slack[i] = v.rhs[i]
    for j in range(n):
        z = v.point[j]
        for i in range(count):
            v.slack[i] -= z * v.rows[j, i]


@compiled
def refactored(v: Vertex) -> bool:
    """Compute the inverse, point and slacks anew, by Gauss-Jordan elimination; False if the matrix is singular."""
    n = v.point.size
    work = np.zeros((n, 2 * n))
    for k in range(n):
        coefficients(v, v.tight[k], work[k, :n])
        work[k, n + k] = 1.0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(work[i, k]) > abs(work[best, k]):
                best = i
        if not abs(work[best, k]) > TOO_SMALL:
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
    for i in range(count):
        out[i] = 0.0
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
        coefficients(v, v.tight[k], row)
        total = -side(v, v.tight[k])
        for j in range(n):
            total += row[j] * v.point[j]
        worst = max(worst, abs(total))
    return worst


@compiled
def exact_point(v: Vertex, rhs: Floats, out: Floats) -> None:
    """Where the tight constraints meet, their right sides as they are."""
    out[:] = 0.0
    for k in range(out.size):
        constraint = v.tight[k]
        b = rhs[v.number[constraint]] if constraint >= 0 else side(v, constraint)
        for j in range(out.size):
            out[j] += b * v.inverse[j, k]


@compiled
def spread(k: int) -> float:
    """Numbers in [1, 2) that look like random ones."""
    value = k * 0.6180339887498949 + 0.5
    return float(1.0 + value - np.floor(value))


OPTIMAL, INFEASIBLE, FAILED = 0, 1, 2

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
        coefficients(v, entering, row)
        times_inverse(v, row, alpha)
        k = _leaving(alpha, y, bland)
        if k < 0:
            if v.counters[2] > 0:  # be sure of it
                if not refactored(v):
                    return FAILED
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
        if v.counters[2] >= _REFACTOR and not refactored(v):
            return FAILED
    return FAILED


@compiled
def _edge(v: Vertex, bland: bool) -> int:
    """The edge along which the objective falls most steeply, from the multipliers; -1 if it falls along none."""
    n = v.point.size
    best, found = 0.0, -1
    for k in range(n):
        y = v.multipliers[k]
        if y < -_DUAL:
            if bland:
                return int(k)
            length = 0.0
            for j in range(n):
                length += v.inverse[j, k] * v.inverse[j, k]
            if y * y > best * length:
                best, found = y * y / length, k
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
    row, alpha, growth = np.empty(n), np.empty(n), np.empty(v.rhs.size)
    stalled = 0
    while v.counters[1] < limit:
        times_inverse(v, objective, v.multipliers)
        for k in range(n):
            v.multipliers[k] = -v.multipliers[k]
        bland = stalled > _STALLED
        k = _edge(v, bland)
        if k < 0:
            return OPTIMAL
        along(v, k, growth)
        entering = _blocking(v, k, growth, bland)
        if entering == v.counters[0]:
            return FAILED
        coefficients(v, entering, row)
        times_inverse(v, row, alpha)
        if not abs(alpha[k]) > TOO_SMALL:
            return FAILED
        step = max(-_excess(v, entering), 0.0) / alpha[k]
        stalled = stalled + 1 if step > -1e-14 else 0
        exchange(v, k, entering, alpha, growth, step)
        if v.counters[2] >= _REFACTOR and not refactored(v):
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
