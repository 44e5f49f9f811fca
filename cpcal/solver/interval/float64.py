"""The fast engine: interval arithmetic with IEEE float64 operations, vectorised, rounded outward.

Every operation is rounded to nearest by the processor and then moved outward to the next float (see
`rounding`), unless its result is known to be exact: zeros of a polynomial's coefficients stay zeros.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.interval.array import IntervalArray
from cpcal.solver.interval.rounding import (
    ETA,
    has_nan,
    has_zero,
    is_nonnegative,
    next_down,
    next_up,
    power,
    root,
    sum_down,
    sum_up,
    total_down,
    total_up,
)

_UNIT = 2.0**-53  # the largest relative error of one rounding
_TINY = 2.0**-1022  # covers an underflow, gradual or flushed to zero


class Float64:
    """`Arithmetic` in float64, without a Python loop over elements. Stateless: share it between threads."""

    name = "float64"

    def neg(self, x: IntervalArray) -> IntervalArray:
        return IntervalArray(-x.hi, -x.lo)

    def add(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        with np.errstate(all="ignore"):
            return IntervalArray(sum_down(x.lo, y.lo), sum_up(x.hi, y.hi))

    def sub(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        with np.errstate(all="ignore"):
            return IntervalArray(sum_down(x.lo, -y.hi), sum_up(x.hi, -y.lo))

    def mul(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        with np.errstate(all="ignore"):
            lo, hi = _extreme_products(x, y)
            if has_nan(lo) or has_nan(hi):  # an empty operand, or [0, 0] times a half line or line
                empty = x.empty | y.empty
                lo, hi = np.where(np.isnan(lo) & ~empty, 0.0, lo), np.where(np.isnan(hi) & ~empty, 0.0, hi)
            return _widen(lo, hi, x, y)

    def div(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        with np.errstate(all="ignore"):
            return _div(x, y)

    def sqr(self, x: IntervalArray) -> IntervalArray:
        with np.errstate(all="ignore"):
            mig, mag = _mig(x), np.maximum(-x.lo, x.hi)
            hi = next_up(mag * mag, ETA, mag == 0.0 if has_zero(mag) else None)
            return IntervalArray(np.maximum(next_down(mig * mig, ETA), 0.0), hi)

    def sqrt(self, x: IntervalArray) -> IntervalArray:
        with np.errstate(all="ignore"):
            x = _nonnegative_part(x)
            # A root of a float is never subnormal, so that no ETA is needed and zero stays zero.
            return IntervalArray(next_down(np.sqrt(x.lo), 0.0), next_up(np.sqrt(x.hi), 0.0))

    def power(self, x: IntervalArray, n: int) -> IntervalArray:
        if n == 1:
            return x
        if n == 2:
            return self.sqr(x)
        with np.errstate(all="ignore"):
            if n == 0:
                one = np.where(x.empty, np.nan, 1.0)
                return IntervalArray(one, one)
            if n > 0:
                return _power(x, n)
            # The reciprocal first: it loses no digits to underflow unless the power underflows as well.
            return _power(_div(IntervalArray.point(1.0), x if n % 2 else self.abs(x)), -n)

    def root(self, x: IntervalArray, n: int) -> IntervalArray:
        if n < 1:
            raise ValueError(f"the order of a root is at least 1, not {n}")
        if n == 1:
            return x
        if n == 2:
            return self.sqrt(x)
        with np.errstate(all="ignore"):
            if n % 2 == 0:
                x = _nonnegative_part(x)
                return IntervalArray(root(x.lo, n, -1.0), root(x.hi, n, 1.0))
            lo, hi = np.sign(x.lo), np.sign(x.hi)
            return IntervalArray(lo * root(np.abs(x.lo), n, -lo), hi * root(np.abs(x.hi), n, hi))

    def abs(self, x: IntervalArray) -> IntervalArray:
        return IntervalArray(_mig(x), np.asarray(np.maximum(-x.lo, x.hi)))

    def minimum(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return IntervalArray(np.minimum(x.lo, y.lo), np.minimum(x.hi, y.hi))

    def maximum(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return IntervalArray(np.maximum(x.lo, y.lo), np.maximum(x.hi, y.hi))

    def factor(self, z: IntervalArray, y: IntervalArray, x: IntervalArray) -> IntervalArray:
        with np.errstate(all="ignore"):
            zero_in_y = (y.lo <= 0.0) & (y.hi >= 0.0)
            if not zero_in_y.any():
                return _quotient(z, y).intersect(x)
            split = _outside_gap(z, y, x)
            divisor = IntervalArray(np.where(zero_in_y, 1.0, y.lo), np.where(zero_in_y, 1.0, y.hi))
            plain = _quotient(z, divisor).intersect(x)
            free = zero_in_y & (z.lo <= 0.0) & (z.hi >= 0.0)
            lo = np.where(free, x.lo, np.where(zero_in_y, split.lo, plain.lo))
            hi = np.where(free, x.hi, np.where(zero_in_y, split.hi, plain.hi))
            return IntervalArray(lo, hi)

    def sum(self, x: IntervalArray, axis: int) -> IntervalArray:
        with np.errstate(all="ignore"):
            return IntervalArray(total_down(x.lo, axis), total_up(x.hi, axis))

    def dot(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        """Midpoints and radii through BLAS; valid for any order of summation, with or without FMA.

        With u = 2^-53 and gamma = k u / (1 - k u) (k < 2^26 terms), the computed product of the midpoints
        errs by at most gamma |mx| @ |my| plus underflows, and a computed product of nonnegative matrices is
        at most gamma (relatively) plus underflows below the exact one.
        """
        with np.errstate(all="ignore"):
            count = x.shape[-1]
            gamma = (count + 2) * _UNIT
            mx, rx = _mid_rad(x)
            my, ry = _mid_rad(y)
            center = mx @ my
            size_y = np.abs(my)
            thick_y = gamma * size_y
            thick_y += ETA  # an underflow here would count |mx| times
            if ry is not None:
                thick_y += ry
            radius = np.abs(mx) @ thick_y
            if rx is not None:
                radius += rx @ (size_y if ry is None else size_y + ry)
            radius *= 1.0 + (4 * count + 64) * _UNIT  # covers every rounding of the lines above, twice over
            size = np.abs(center)
            size *= 2.0 * _UNIT
            radius += size
            radius += (8 * count + 64) * _TINY
            lo = center - radius  # the lines above paid for this rounding, too
            hi = np.add(center, radius, out=center)
            if not np.isfinite(np.maximum.reduce(radius, axis=None, initial=0.0)):  # overflow
                known = np.isfinite(radius)
                lo, hi = np.where(known, lo, -np.inf), np.where(known, hi, np.inf)
            return IntervalArray(lo, hi)


def _mid_rad(x: IntervalArray) -> tuple[Floats, Floats | None]:
    """Midpoints, and radii before their (relative) rounding error; None for radii that are all zero."""
    if x.lo is x.hi:
        return x.lo, None
    mid = 0.5 * x.lo + 0.5 * x.hi
    return mid, np.maximum(x.hi - mid, mid - x.lo)


def _mig(x: IntervalArray) -> Floats:
    """The smallest absolute value in each interval."""
    return np.asarray(np.maximum(np.maximum(x.lo, -x.hi), 0.0))


def _extreme_products(x: IntervalArray, y: IntervalArray) -> tuple[Floats, Floats]:
    """The least and the greatest product of bounds, rounded to nearest.

    0 * inf gives NaN, which `fmin` skips: the value 0 that it should have is another of the products, unless
    one operand is [0, 0]; that leaves NaN for the caller to mend.
    """
    if x.lo is x.hi or y.lo is y.hi:
        point, other = (x.lo, y) if x.lo is x.hi else (y.lo, x)
        first = point * other.lo
        if other.lo is other.hi:
            return first, first
        second = point * other.hi
        return np.fmin(first, second), np.fmax(first, second)
    if not is_nonnegative(x.lo) and is_nonnegative(y.lo):
        x, y = y, x
    if is_nonnegative(x.lo):
        if is_nonnegative(y.lo):
            return x.lo * y.lo, x.hi * y.hi
        return np.fmin(x.lo * y.lo, x.hi * y.lo), np.fmax(x.lo * y.hi, x.hi * y.hi)
    return _extremes(x.lo * y.lo, x.lo * y.hi, x.hi * y.lo, x.hi * y.hi)


def _extremes(a: Floats, b: Floats, c: Floats, d: Floats) -> tuple[Floats, Floats]:
    return np.fmin(np.fmin(a, b), np.fmin(c, d)), np.fmax(np.fmax(a, b), np.fmax(c, d))


def _quotient(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Hull of the quotients of bounds, where y does not contain zero or only as a bound of the right sign."""
    lo, hi = _extremes(x.lo / y.lo, x.lo / y.hi, x.hi / y.lo, x.hi / y.hi)
    return _widen(lo, hi, x, y)


def _div(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """`Float64.div` for callers that have silenced floating-point warnings."""
    zero_in_y = (y.lo <= 0.0) & (y.hi >= 0.0)
    if not zero_in_y.any():
        return _quotient(x, y)
    # Dividing by a zero bound must give the limit from inside y: +0 as lower bound, -0 as upper bound.
    quotient = _quotient(x, IntervalArray(y.lo + 0.0, -(0.0 - y.hi)))
    zero = (y.lo == 0.0) & (y.hi == 0.0)
    line = (y.lo < 0.0) & (y.hi > 0.0) & ((x.lo != 0.0) | (x.hi != 0.0)) & ~x.empty
    lo, hi = np.where(line, -np.inf, quotient.lo), np.where(line, np.inf, quotient.hi)
    return IntervalArray(np.where(zero, np.nan, lo), np.where(zero, np.nan, hi))


def _outside_gap(z: IntervalArray, y: IntervalArray, x: IntervalArray) -> IntervalArray:
    """`Float64.factor` where y contains zero and z does not: x without the gap of factors that are too small.

    The factors are (-inf, below] and [above, inf); a bound of y that is zero leaves out its half line.
    """
    nearest = np.where(z.lo > 0.0, z.lo, z.hi)
    from_lo, from_hi = -(nearest / np.abs(y.lo)), nearest / np.abs(y.hi)
    below = np.minimum(next_up(np.minimum(from_lo, from_hi), ETA), 0.0)
    above = np.maximum(next_down(np.maximum(from_lo, from_hi), ETA), 0.0)
    lo_is_negative = from_lo < from_hi
    no_below = np.where(lo_is_negative, y.lo, y.hi) == 0.0
    no_above = np.where(lo_is_negative, y.hi, y.lo) == 0.0
    reaches_below = (x.lo <= below) & ~no_below
    reaches_above = (x.hi >= above) & ~no_above
    lo = np.where(reaches_below, x.lo, np.maximum(x.lo, above))
    hi = np.where(reaches_above, x.hi, np.minimum(x.hi, below))
    empty = ~(reaches_below | reaches_above)
    return IntervalArray(np.where(empty, np.nan, lo), np.where(empty, np.nan, hi))


def _widen(lo: Floats, hi: Floats, x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Outward rounding of the extreme products or quotients of x and y.

    A zero among them is exact (a factor is zero) or an underflow. It may stay zero, as the lower bound, when
    x and y hold no two points of opposite signs; as the upper bound, when they hold none of equal signs.
    """
    exact_lo = exact_hi = None
    if has_zero(lo):
        exact_lo = (lo == 0.0) & ~(((x.lo < 0.0) & (y.hi > 0.0)) | ((x.hi > 0.0) & (y.lo < 0.0)))
    if has_zero(hi):
        exact_hi = (hi == 0.0) & ~(((x.lo < 0.0) & (y.lo < 0.0)) | ((x.hi > 0.0) & (y.hi > 0.0)))
    if lo is hi:
        hi = lo.copy()
    return IntervalArray(next_down(lo, ETA, exact_lo), next_up(hi, ETA, exact_hi))


def _nonnegative_part(x: IntervalArray) -> IntervalArray:
    if is_nonnegative(x.lo):
        return x
    kept = x.hi >= 0.0
    return IntervalArray(np.where(kept, np.maximum(x.lo, 0.0), np.nan), np.where(kept, x.hi, np.nan))


def _power(x: IntervalArray, n: int) -> IntervalArray:
    """`x ** n` for n >= 1, from the bounds' magnitudes."""
    if n % 2 == 0:
        return IntervalArray(power(_mig(x), n, -1.0), power(np.maximum(-x.lo, x.hi), n, 1.0))
    if is_nonnegative(x.lo):
        return IntervalArray(power(x.lo, n, -1.0), power(x.hi, n, 1.0))
    lo, hi = np.sign(x.lo), np.sign(x.hi)
    return IntervalArray(lo * power(np.abs(x.lo), n, -lo), hi * power(np.abs(x.hi), n, hi))
