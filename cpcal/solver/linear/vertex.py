"""A vertex of a polyhedron in a box, given by its n tight constraints, and the moves of a simplex method on it.

The constraints are `a.z <= b`: the working rows, and the bounds of the n columns. At a vertex n of them are tight;
`inverse` is the inverse of their matrix, so its column k is the edge along which only constraint k gets worse. All
moves keep the inverse up to date; `refactored` computes it anew. The functions compile; all loops that matter run
along contiguous memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.compiled import compiled

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
