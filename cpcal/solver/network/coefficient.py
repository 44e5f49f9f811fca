"""Coefficients that depend on the readings: first-order Taylor models.

Coefficients are arrays (1 + J, T, E) of T terms and E elements: entry 0 is the value at the centre of the reading sets
plus everything of second order (an interval), entry j the derivative with respect to the j-th scaled
reading `delta_j` in [-1, 1]. Without readings J is 0. One element stands for all of them.
"""

from typing import NamedTuple

import numpy as np

from cpcal.common.values import Bools, Floats, Indices
from cpcal.solver.compiled import ahead, compiled
from cpcal.solver.interval.kernels import Arrays, Bounds, add, at, div, mul, neg, sqr

# ------------------------------------------------------------------------------------------------------------------
# Products and sums of coefficients from midpoints, compiled, with one bound for all that they leave out.
#
# A coefficient here is `c + sum_j s_j delta_j` with an error of at most e: numbers, not intervals. As |delta_j| <= 1,
# what rounding does to a slope s_j is an error of that size in the value, so that e covers it. The loops have no
# branches: processors do four elements at a time. With unit roundoff u a sum of n products errs by at most
# n u / (1 - n u) times the sum of their sizes; `_gamma` is more than twice that, which covers the roundings of the
# bound itself.

_UNIT = 2.0**-53
_UNDERFLOW = 1e-300  # more than all that products lose that are too small


class Centred(NamedTuple):
    """Polynomials with E elements: `mid` (1 + J, T, E); of each coefficient (T, E) a bound of its `error`,

    the sum of its slopes' sizes, and that with the value's; `moves` (1 + J, T): where slopes are not all zero.
    """

    mid: Floats
    error: Floats
    slopes: Floats
    total: Floats
    moves: Bools


@compiled
def _gamma(count: int) -> float:
    """For sums of so many products."""
    return float(4.0 * (count + 16) * _UNIT)


@compiled
def centred(x: Arrays, count: int) -> Centred:
    """Of intervals (1 + J, T, E), E being `count`, or 1 for elements that are all the same."""
    slots, terms = x[0].shape[0], x[0].shape[1]
    mid, moves = np.empty((slots, terms, count)), np.zeros((slots, terms), np.bool_)
    error, slopes, total = np.zeros((terms, count)), np.zeros((terms, count)), np.zeros((terms, count))
    alike = x[0].shape[2] == 1
    up = 1.0 + _gamma(slots)
    for s in range(slots):
        for t in range(terms):
            size = 0.0
            for k in range(count):
                low, high = at(x, (s, t, 0 if alike else k))
                middle = 0.5 * low + 0.5 * high
                mid[s, t, k] = middle
                error[t, k] += max(high - middle, middle - low) * up
                total[t, k] += abs(middle) * up
                size = max(size, abs(middle))
            moves[s, t] = s > 0 and size != 0.0
            if moves[s, t]:
                for k in range(count):
                    slopes[t, k] += abs(mid[s, t, k]) * up
    return Centred(mid, error, slopes, total, moves)


@compiled
def products(a: Arrays, b: Arrays, pairs: Indices, size: int, count: int, square: bool) -> Arrays:
    """Terms (slots, size, count) of a product of polynomials (1 + J, terms, E).

    Of two coefficients it is `x0 y0 + (x0 y_j + y0 x_j) delta_j` and the range of `(x_j delta_j)(y_j delta_j)`.

    `pairs` (P, 3): a term of x, one of y, and the term that their product belongs to. `square`: x is y, and a pair of
    two different terms stands for both orders.
    """
    x, y = centred(a, count), centred(b, count)
    p, q = x.mid.shape[0], y.mid.shape[0]
    value = np.zeros((max(p, q), size, count))
    extent, error, counts = np.zeros((size, count)), np.zeros((size, count)), np.zeros(size, np.intp)
    for t in range(len(pairs)):
        i, j, m = pairs[t]
        twice = 2.0 if square and i != j else 1.0
        counts[m] += 1 + max(p, q)
        one, two, v, g = x.mid[0, i], y.mid[0, j], value[0, m], extent[m]
        _errors(x, y, i, j, twice, error[m])
        _add_slope(one, two, twice, v, g)
        for s in range(1, p):
            if x.moves[s, i]:
                _add_slope(x.mid[s, i], two, twice, value[s, m], g)
        for s in range(1, q):
            if y.moves[s, j]:
                _add_slope(y.mid[s, j], one, twice, value[s, m], g)
        if x.moves[:, i].any() and y.moves[:, j].any():
            _second_order(x, y, i, j, twice, v, g, error[m])
    return _bounds(value, extent, error, counts)


@ahead
def _smallest() -> None:
    one = np.ones((1, 1, 1))
    products((one, one), (one, one), np.zeros((1, 3), np.intp), 1, 1, False)


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
def _bounds(value: Floats, extent: Floats, error: Floats, counts: Indices) -> Arrays:
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
def centred_sums(x: Arrays) -> Arrays:
    """Sums over the last axis but one of (1 + J, T, count, after)."""
    slots, terms, count, after = x[0].shape
    value = np.zeros((slots, terms, after))
    extent, error = np.zeros((terms, after)), np.zeros((terms, after))
    for s in range(slots):
        for t in range(terms):
            for k in range(after):
                total, size, radius = 0.0, 0.0, 0.0
                for i in range(count):
                    low, high = at(x, (s, t, i, k))
                    middle = 0.5 * low + 0.5 * high
                    total, size, radius = total + middle, size + abs(middle), radius + max(high - middle, middle - low)
                value[s, t, k] = total
                extent[t, k] += size
                error[t, k] += radius
    return _bounds(value, extent, error, np.full(terms, slots * count, np.intp))


@compiled
def combined(x: Arrays, y: Arrays, of_x: Indices, of_y: Indices, sign: float, count: int) -> Arrays:
    """Terms of x + sign y, (slots, T, count), of polynomials (1 + J, terms, E): `of_x` and `of_y` (T,), -1 for none."""
    p, q = x[0].shape[0], y[0].shape[0]
    at_x, at_y = int(x[0].shape[2] > 1), int(y[0].shape[2] > 1)
    lo, hi = np.zeros((max(p, q), of_x.size, count)), np.zeros((max(p, q), of_x.size, count))
    for s in range(max(p, q)):
        for t in range(of_x.size):
            if of_x[t] >= 0 and s < p:
                for k in range(count):
                    lo[s, t, k], hi[s, t, k] = at(x, (s, of_x[t], k * at_x))
            if of_y[t] >= 0 and s < q:
                for k in range(count):
                    a, b = at(y, (s, of_y[t], k * at_y))
                    other = (a, b) if sign > 0.0 else (-b, -a)
                    lo[s, t, k], hi[s, t, k] = add((lo[s, t, k], hi[s, t, k]), other)
    return lo, hi


@compiled
def _moves(x: Arrays, t: int, k: int) -> Bounds:
    """What all readings together add; a share covers the rounding of it, and of what is made of it."""
    slots, reach = x[0].shape[0], 0.0
    for s in range(1, slots):
        low, high = at(x, (s, t, k))
        reach += max(abs(low), abs(high))
    reach *= 1.0 + (4.0 * slots + 128.0) * _UNIT
    return -reach, reach


@compiled
def total(x: Arrays) -> Arrays:
    """The whole range (1, T, E) over the reading sets."""
    lo, hi = x[0][:1].copy(), x[1][:1].copy()
    for t in range(lo.shape[1]):
        for k in range(lo.shape[2]):
            lo[0, t, k], hi[0, t, k] = add((lo[0, t, k], hi[0, t, k]), _moves(x, t, k))
    return lo, hi


@compiled
def reciprocal(x: Arrays) -> Arrays:
    """`1 / x = 1/m - h/m^2 + h^2 / (m^2 (m + h))` with value m and h = sum x_j delta_j."""
    slots, terms, count = x[0].shape
    lo, hi = np.empty((slots, terms, count)), np.empty((slots, terms, count))
    for t in range(terms):
        for k in range(count):
            m, h = at(x, (0, t, k)), _moves(x, t, k)
            squared = sqr(m)
            own = div((1.0, 1.0), m)
            if slots > 1:
                own = add(own, div(sqr(h), mul(squared, add(m, h))))
            lo[0, t, k], hi[0, t, k] = own
            for s in range(1, slots):
                lo[s, t, k], hi[s, t, k] = neg(div(at(x, (s, t, k)), squared))
    return lo, hi
