"""From the rows of a relaxation to the matrix of a linear program: scaled, without what cannot matter on the box."""

from __future__ import annotations

import math

import numpy as np

from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.compiled import compiled

_UNIT = 2.0**-53
_SMALLEST = 1e-290  # coefficients below it are left out


@compiled
def scaled(rows: Floats, rhs: Floats) -> tuple[Indices, Floats]:
    """Divide rows (M, K) and right sides by powers of two, to a largest coefficient of about 1; the exponents.

    And the largest coefficient of each monomial. Nothing is rounded: coefficients that become too small for that are
    left out, and right sides pay for them.
    """
    size, count = rows.shape
    largest, paid, exponents = np.zeros(count), np.zeros(count), np.zeros(count, np.intp)
    highest = np.zeros(size)
    for m in range(size):
        for k in range(count):
            largest[k] = max(largest[k], abs(rows[m, k]))
    for k in range(count):
        exponents[k] = min(max(math.frexp(largest[k])[1], -900), 900) if np.isfinite(largest[k]) else 0
        largest[k] = math.ldexp(1.0, -exponents[k])
    for m in range(size):
        for k in range(count):
            value = rows[m, k] * largest[k]
            small = abs(value) < _SMALLEST
            paid[k] += _SMALLEST if small and rows[m, k] != 0.0 else 0.0
            rows[m, k] = 0.0 if small else value
            highest[m] = max(highest[m], abs(value))
    for k in range(count):
        side = rhs[k] * largest[k]
        if paid[k] > 0.0 or abs(side) < _SMALLEST:
            side += paid[k]
            side += 4.0 * _UNIT * abs(side) + _SMALLEST
        rhs[k] = side
    return exponents, highest


@compiled
def reach(rows: Floats, rhs: Floats, has_column: Bools, lower: Floats, upper: Floats) -> Bools:
    """Which rows some point of the box may violate; right sides pay for the monomials without a column.

    Rows that overflowed say nothing.
    """
    size, count = rows.shape
    highest, beside = np.zeros(count), np.zeros(count)
    for m in range(size):
        for k in range(count):
            value = rows[m, k]
            if has_column[m]:
                highest[k] += max(value * lower[m], value * upper[m])
            else:
                beside[k] += abs(value)
    up = 1.0 + 4.0 * (size + 4) * _UNIT
    matters = np.zeros(count, np.bool_)
    for k in range(count):
        if beside[k] != 0.0:  # NaN goes to the right side, which then says nothing
            more = beside[k] * up
            rhs[k] += more + 4.0 * _UNIT * (abs(rhs[k]) + more)
        matters[k] = np.isfinite(highest[k]) and np.isfinite(rhs[k]) and highest[k] > rhs[k]
    return matters


@compiled
def packed(products: Floats, rows: Floats, columns: Indices, kept: Indices) -> Floats:
    """Products (P, n) and the kept rows of (M, K) in the columns' monomials, as an array (n, P + kept)."""
    first = products.shape[0]
    out = np.empty((columns.size, first + kept.size))
    for j in range(columns.size):
        m = columns[j]
        for k in range(first):
            out[j, k] = products[k, j]
        for k in range(kept.size):
            out[j, first + k] = rows[m, kept[k]]
    return out
