"""The fast engine: interval arithmetic with IEEE float64 operations, vectorised, rounded outward.

Every operation is rounded to nearest by the processor and then moved outward to the next float (see
`rounding`), unless its result is known to be exact: zeros of a polynomial's coefficients stay zeros.
"""

from __future__ import annotations

from math import ceil, log2

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import RoundingError
from cpcal.common.values import Bools, Floats
from cpcal.solver.interval.numbers import IntervalArray

# ------------------------------------------------------------------------------------------------------------------
# Directed rounding on top of round-to-nearest: bounds of sums, totals, powers and roots of float64 arrays.
#
# Functions expect their caller to have silenced floating-point warnings (`np.errstate(all="ignore")`). NaN goes
# through all of them. A `_down` result is never +inf and an `_up` result never -inf: overflow becomes the
# largest float on its safe side.

MAX = float(np.finfo(np.float64).max)
ETA = 5e-324  # the least positive float

# Subtracting |v| * PHI from a normal v moves it one float down, as np.nextafter does but six times faster: in
# [2^k, 2^(k+1)) it is at least 0.75 and less than 1.5 units in the last place, which rounds to one (to two at
# some of the smallest normal numbers). Zero and subnormal numbers stay: sums that small are exact, and the
# other operations add ETA.
_PHI = 0.75 * 2.0**-52

_SEQUENTIAL = 8  # the longest axis that is added term by term
_LARGE = 2000  # from this size on a comparison beats `count_nonzero`


_ONE, _SMALLEST, _HALF = 1.0, 2.0**-60, 0.5
_NORMAL = float(np.finfo(np.float64).smallest_normal)


def check_rounding() -> None:
    """Raises RoundingError where this thread does not compute as IEEE 754 has it, which all float64 bounds rest on.

    Some interval libraries switch the rounding, and leave it so: codac and others on gaol, filib or boost. Libraries
    that were compiled with -ffast-math switch subnormal numbers off for whoever loads them: results that small are
    zero then, and bounds of them false.
    """
    nearest = _ONE + _SMALLEST == _ONE and _ONE - _SMALLEST == _ONE
    if not nearest or _NORMAL * _HALF == 0.0 or ETA / _NORMAL == 0.0:
        raise RoundingError(
            "another library in this process has changed how the processor rounds, or switched small numbers off: no "
            "bound in float64 can be trusted. Run that library in a process of its own"
        )


def has_zero(a: Floats) -> bool:
    """Whether any element is zero."""
    if a.size < _LARGE:
        return bool(np.count_nonzero(a) < a.size)
    return bool((a == 0.0).any())


def has_nan(a: Floats) -> bool:
    """Whether any element is NaN."""
    return bool(np.isnan(np.minimum.reduce(a, axis=None, initial=0.0)))


def is_nonnegative(a: Floats) -> bool:
    """Whether all elements are at least zero, none NaN."""
    return bool(np.minimum.reduce(a, axis=None, initial=0.0) >= 0.0)


def next_down(v: Floats, eta: float, exact: Bools | None = None) -> Floats:
    """A lower bound of every number that rounds to v; v itself where exact. Overwrites v.

    With eta == 0, subnormal v must be exact.
    """
    v = np.asarray(v)
    np.minimum(v, MAX, out=v)
    v -= _step(v, eta, exact)
    return v


def next_up(v: Floats, eta: float, exact: Bools | None = None) -> Floats:
    """An upper bound of every number that rounds to v; v itself where exact. Overwrites v.

    With eta == 0, subnormal v must be exact.
    """
    v = np.asarray(v)
    np.maximum(v, -MAX, out=v)
    v += _step(v, eta, exact)
    return v


def _step(v: Floats, eta: float, exact: Bools | None) -> Floats:
    step = np.asarray(np.abs(v))
    step *= _PHI
    if eta:
        step += eta
    if exact is not None:
        np.copyto(step, 0.0, where=exact)
    return step


def sum_down(a: Floats, b: Floats) -> Floats:
    """A lower bound of a + b; exact where a, b or the sum is zero."""
    exact = (a == 0.0) | (b == 0.0) if has_zero(a) or has_zero(b) else None
    return next_down(a + b, 0.0, exact)


def sum_up(a: Floats, b: Floats) -> Floats:
    """An upper bound of a + b; exact where a, b or the sum is zero."""
    exact = (a == 0.0) | (b == 0.0) if has_zero(a) or has_zero(b) else None
    return next_up(a + b, 0.0, exact)


def total_down(a: Floats, axis: int) -> Floats:
    """A lower bound of the sum along an axis."""
    a = np.moveaxis(a, axis, 0)
    if 0 < len(a) <= _SEQUENTIAL:
        total = np.asarray(a[0])
        for term in a[1:]:
            total = sum_down(total, term)
        return total
    total, error = _tree_sum(a)
    down = np.where(np.isinf(total) | np.isinf(error), -np.inf, next_down(total - error, 0.0))
    return np.where(error == 0.0, total, down)


def total_up(a: Floats, axis: int) -> Floats:
    """An upper bound of the sum along an axis."""
    return -total_down(-a, axis)


def _tree_sum(a: Floats) -> tuple[Floats, Floats]:
    """The sum along axis 0 rounded to nearest, and a bound of its error.

    Pairs are added, then pairs of pairs: a term takes part in only d = ceil(log2(n)) additions. So the error
    is at most (d u + O(u^2)) sum |a|, without an underflow term because tiny sums are exact. The computed sum
    of magnitudes may be short by n u (relatively), and the bound is itself rounded: 2^-20 covers both.
    """
    if len(a) == 0:
        zero = np.zeros(a.shape[1:])
        return zero, zero
    depth = ceil(log2(len(a)))
    size = np.abs(a).sum(axis=0)
    while len(a) > 1:
        half = len(a) // 2
        paired = a[:half] + a[half : 2 * half]
        a = paired if len(a) % 2 == 0 else np.concatenate([paired, a[-1:]])
    error = size * (depth * 2.0**-53 * (1.0 + 2.0**-20)) + ETA
    return a[0], np.where(size == 0.0, 0.0, error)


def power(m: Floats, n: int, away: Floats | float) -> Floats:
    """A bound of m ** n for m >= 0, n >= 1: upper where `away` (from zero) is 1, lower where it is -1."""
    result: Floats | None = None
    bits = n
    while True:
        if bits & 1:
            result = m if result is None else _product(result, m, away)
        bits >>= 1
        if not bits:
            assert result is not None
            break
        m = _product(m, m, away)
    return result


def _product(a: Floats, b: Floats, away: Floats | float) -> Floats:
    """A bound, on the side `away`, of the product of numbers >= 0; zero stays zero."""
    v = np.asarray(a * b)
    np.minimum(v, MAX, out=v)  # an upper bound grows back to inf below
    step = _step(v, ETA, (a == 0.0) | (b == 0.0) if has_zero(v) else None)
    step *= away
    v += step
    return np.asarray(np.maximum(v, 0.0))


def root(m: Floats, n: int, away: Floats | float) -> Floats:
    """A bound of the n-th root of m >= 0, upper or lower as in `power`, and proved by its n-th power."""
    scaled, exponent = _scale(m, n)
    away = np.asarray(away)
    width = _PHI
    bound = scaled ** (1.0 / n) * (1.0 + 2.0 * width * away)
    while (wrong := (power(bound, n, -away) - scaled) * away < 0.0).any():
        if width > 1.0:  # only if n is in the hundreds and scaled near the ends of the float range
            bound = np.where(wrong, np.where(away > 0.0, np.maximum(scaled, 1.0), np.minimum(scaled, 1.0)), bound)
            break
        width *= 2.0
        bound = np.where(wrong, bound + width * away * bound, bound)
    infinite = np.where(away > 0.0, np.inf, MAX)
    return np.where(m == np.inf, infinite, np.ldexp(bound, exponent))


def _scale(m: Floats, n: int) -> tuple[Floats, npt.NDArray[np.int64]]:
    """`(s, q)` with m == s * 2^(n q) exactly and s near 1, where float powers are accurate; s = 1 for inf."""
    mantissa, exponent = np.frexp(np.where(m == np.inf, 1.0, m))
    quotient = np.trunc(exponent / n).astype(np.int64)
    return np.ldexp(mantissa, exponent - n * quotient), quotient


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
