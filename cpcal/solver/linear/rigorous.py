"""Rigorous bounds from the approximate multipliers of a linear program (DESIGN section 5, Rigour).

For rows `U z <= u` over a box of z, any y >= 0 gives, with r = c + U^T y,

    min c.z  >=  -y.u + sum_j min(r_j lo_j, r_j hi_j)

whatever the solver that proposed y did. With c = 0 a positive value proves that the polyhedron is empty.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.solver.compiled import compiled
from cpcal.solver.interval import Arithmetic, IntervalArray

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
