"""Products and sums of coefficients (see `coefficient`) from midpoints, with one bound for all that they leave out.

A coefficient here is `c + sum_j s_j delta_j` with an error of at most e: numbers, not intervals. As |delta_j| <= 1,
what rounding does to a slope s_j is an error of that size in the value, so that e covers it. The loops have no
branches: processors do four elements at a time. With unit roundoff u a sum of n products errs by at most
n u / (1 - n u) times the sum of their sizes; `_gamma` is more than twice that, which covers the roundings of the bound
itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.compiled import compiled

_UNIT = 2.0**-53
_UNDERFLOW = 1e-300  # more than all that products lose that are too small
_WIDE = 0.03  # an error beyond this share of a coefficient: two such have a tighter product as intervals


class Centred(NamedTuple):
    """Polynomials with E elements: `mid` (1 + J, T, E); of each coefficient (T, E) a bound of its `error`,

    the sum of its slopes' sizes, and that with the value's; `moves` (1 + J, T): where slopes are not all zero.
    """

    mid: Floats
    error: Floats
    slopes: Floats
    total: Floats
    moves: Bools
    wide: Bools


@compiled
def _gamma(count: int) -> float:
    """For sums of so many products."""
    return float(4.0 * (count + 16) * _UNIT)


@compiled
def centred(lo: Floats, hi: Floats, count: int) -> Centred:
    """Of intervals (1 + J, T, E), E being `count`, or 1 for elements that are all the same."""
    slots, terms = lo.shape[0], lo.shape[1]
    mid, moves, wide = np.empty((slots, terms, count)), np.zeros((slots, terms), np.bool_), np.zeros(terms, np.bool_)
    error, slopes, total = np.zeros((terms, count)), np.zeros((terms, count)), np.zeros((terms, count))
    alike = lo.shape[2] == 1
    up = 1.0 + _gamma(slots)
    for s in range(slots):
        for t in range(terms):
            size = 0.0
            for k in range(count):
                low, high = lo[s, t, 0 if alike else k], hi[s, t, 0 if alike else k]
                middle = 0.5 * low + 0.5 * high
                mid[s, t, k] = middle
                error[t, k] += max(high - middle, middle - low) * up
                total[t, k] += abs(middle) * up
                size = max(size, abs(middle))
            moves[s, t] = s > 0 and size != 0.0
            if moves[s, t]:
                for k in range(count):
                    slopes[t, k] += abs(mid[s, t, k]) * up
    for t in range(terms):
        for k in range(count):
            if not error[t, k] <= _WIDE * total[t, k]:
                wide[t] = wide[t] or error[t, k] != 0.0
    return Centred(mid, error, slopes, total, moves, wide)


@compiled
def centred_products(x: Centred, y: Centred, pairs: Indices, size: int, square: bool) -> tuple[Floats, Floats]:
    """Bounds (slots, size, E) of the terms of a product; `pairs` and `square` as in `coefficient_kernels.products`."""
    p, q, count = x.mid.shape[0], y.mid.shape[0], x.mid.shape[2]
    value = np.zeros((max(p, q), size, count))
    extent, error, counts = np.zeros((size, count)), np.zeros((size, count)), np.zeros(size, np.intp)
    for t in range(len(pairs)):
        i, j, m = pairs[t]
        twice = 2.0 if square and i != j else 1.0
        counts[m] += 1 + max(p, q)
        a, b, v, g = x.mid[0, i], y.mid[0, j], value[0, m], extent[m]
        _errors(x, y, i, j, twice, error[m])
        for k in range(count):
            c = twice * (a[k] * b[k])
            v[k] += c
            g[k] += abs(c)
        for s in range(1, p):
            if x.moves[s, i]:
                _add_slope(x.mid[s, i], b, twice, value[s, m], g)
        for s in range(1, q):
            if y.moves[s, j]:
                _add_slope(y.mid[s, j], a, twice, value[s, m], g)
        if x.moves[:, i].any() and y.moves[:, j].any():
            _second_order(x, y, i, j, twice, v, g, error[m])
    return _bounds(value, extent, error, counts)


@compiled
def _errors(x: Centred, y: Centred, i: int, j: int, twice: float, error: Floats) -> None:
    """What the errors of two factors are in their product."""
    for k in range(error.size):
        of_x, of_y = x.total[i, k] + x.error[i, k], y.total[j, k]
        error[k] += twice * (of_x * y.error[j, k] + of_y * x.error[i, k])
        error[k] += _UNDERFLOW if of_x > 0.0 and of_y + y.error[j, k] > 0.0 else 0.0


@compiled
def _add_slope(slope: Floats, factor: Floats, twice: float, out: Floats, extent: Floats) -> None:
    for k in range(out.size):
        c = twice * (slope[k] * factor[k])
        out[k] += c
        extent[k] += abs(c)


@compiled
def _second_order(
    x: Centred, y: Centred, i: int, j: int, twice: float, value: Floats, extent: Floats, error: Floats
) -> None:
    """`sum x_s d_s sum y_s d_s` over |d| <= 1: half of all `x_s y_s`, as d_s^2 is in [0, 1]; the rest is an error."""
    both = np.zeros(value.size)
    for s in range(1, min(x.mid.shape[0], y.mid.shape[0])):
        if x.moves[s, i] and y.moves[s, j]:
            for k in range(value.size):
                c = 0.5 * twice * (x.mid[s, i, k] * y.mid[s, j, k])
                value[k] += c
                extent[k] += abs(c)
                both[k] += abs(c)
    slack = _gamma(x.mid.shape[0])
    for k in range(value.size):
        whole = twice * (x.slopes[i, k] * y.slopes[j, k])
        error[k] += max(whole - both[k], 0.0) + slack * whole


@compiled
def _bounds(value: Floats, extent: Floats, error: Floats, counts: Indices) -> tuple[Floats, Floats]:
    """Intervals: the error is that of the value; slopes are numbers. What overflowed may be anything."""
    slots, size, count = value.shape
    hi = value.copy()
    for m in range(size):
        gamma = _gamma(counts[m])
        for k in range(count):
            e = (error[m, k] + gamma * extent[m, k]) * (1.0 + gamma)
            c = value[0, m, k]
            e += 4.0 * _UNIT * abs(c) if e > 0.0 else 0.0
            value[0, m, k], hi[0, m, k] = c - e, c + e
            if not (abs(c) + e < np.inf):
                value[0, m, k], hi[0, m, k] = -np.inf, np.inf
                for s in range(1, slots):
                    value[s, m, k] = hi[s, m, k] = 0.0
    return value, hi


@compiled
def centred_sums(lo: Floats, hi: Floats) -> tuple[Floats, Floats]:
    """Sums over the last axis but one of (1 + J, T, count, after)."""
    slots, terms, count, after = lo.shape
    value = np.zeros((slots, terms, after))
    extent, error = np.zeros((terms, after)), np.zeros((terms, after))
    for s in range(slots):
        for t in range(terms):
            for k in range(after):
                total, size, radius = 0.0, 0.0, 0.0
                for i in range(count):
                    low, high = lo[s, t, i, k], hi[s, t, i, k]
                    middle = 0.5 * low + 0.5 * high
                    total, size, radius = total + middle, size + abs(middle), radius + max(high - middle, middle - low)
                value[s, t, k] = total
                extent[t, k] += size
                error[t, k] += radius
    return _bounds(value, extent, error, np.full(terms, slots * count, np.intp))
