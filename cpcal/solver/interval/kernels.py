"""Interval operations on bounds, as compiled functions: `add(a_lo, a_hi, b_lo, b_hi) -> (lo, hi)`.

They mean what `Arithmetic` says of arrays. The empty interval is NaN in both bounds and gives the empty interval;
a lower bound is never +inf, an upper one never -inf.
"""

from __future__ import annotations

import math

import numpy as np

from cpcal.common.values import Floats
from cpcal.solver.compiled import compiled

# ------------------------------------------------------------------------------------------------------------------
# Directed rounding of single operations on float64 numbers, as compiled functions: a bound below, a bound above.
#
# The processor rounds to nearest; the result is then moved one float outward (two at some of the smallest normal
# numbers) as in `rounding`, which does the same for arrays. A `below` is never +inf and an `above` never -inf: overflow
# becomes the largest float on its safe side. NaN goes through.
#
# What makes them bounds: `v - |v| PHI` is at least one float below a normal v, since |v| PHI is at least 0.75 units in
# its last place; sums that are subnormal are exact; other subnormal results are moved by ETA, the least float.

MAX = 1.7976931348623157e308
ETA = 5e-324
PHI = 0.75 * 2.0**-52


@compiled
def lowered(v: float) -> float:
    """Less than every number that rounds to v, and than those one float away from it in relative terms."""
    if v > MAX:
        v = MAX
    return v - (abs(v) * PHI + ETA)


@compiled
def raised(v: float) -> float:
    if v < -MAX:
        v = -MAX
    return v + (abs(v) * PHI + ETA)


@compiled
def sum_below(a: float, b: float) -> float:
    v = a + b
    if a == 0.0 or b == 0.0:
        return v
    if v > MAX:
        v = MAX
    return v - abs(v) * PHI


@compiled
def sum_above(a: float, b: float) -> float:
    v = a + b
    if a == 0.0 or b == 0.0:
        return v
    if v < -MAX:
        v = -MAX
    return v + abs(v) * PHI


@compiled
def product_below(a: float, b: float) -> float:
    """A bound of a b, where 0 times infinity is 0."""
    v = a * b
    if a == 0.0 or b == 0.0:
        return 0.0 if a == a and b == b else v
    if v == 0.0:
        return 0.0 if (a > 0.0) == (b > 0.0) else -ETA
    return lowered(v)


@compiled
def product_above(a: float, b: float) -> float:
    v = a * b
    if a == 0.0 or b == 0.0:
        return 0.0 if a == a and b == b else v
    if v == 0.0:
        return ETA if (a > 0.0) == (b > 0.0) else 0.0
    return raised(v)


@compiled
def quotient_below(a: float, b: float) -> float:
    """A bound of a / b for b that is not 0; at least one of them is finite."""
    v = a / b
    if v == 0.0:
        return 0.0 if a == 0.0 or (a > 0.0) == (b > 0.0) else -ETA
    return lowered(v)


@compiled
def quotient_above(a: float, b: float) -> float:
    v = a / b
    if v == 0.0:
        return 0.0 if a == 0.0 or (a > 0.0) != (b > 0.0) else ETA
    return raised(v)


@compiled
def root_below(a: float) -> float:
    """A bound of the square root of a >= 0. It is never subnormal, so that zero stays zero."""
    v = min(math.sqrt(a), MAX) if a == math.inf else math.sqrt(a)
    return v - v * PHI


@compiled
def root_above(a: float) -> float:
    v = math.sqrt(a)
    return v + v * PHI


@compiled
def power_below(m: float, n: int) -> float:
    """A bound of m ** n for m >= 0 and n >= 1."""
    result, known = 1.0, False
    while True:
        if n & 1:
            result = max(product_below(result, m), 0.0) if known else m
            known = True
        n >>= 1
        if n == 0:
            return min(result, MAX)
        m = max(product_below(m, m), 0.0)


@compiled
def power_above(m: float, n: int) -> float:
    result, known = 1.0, False
    while True:
        if n & 1:
            result = product_above(result, m) if known else m
            known = True
        n >>= 1
        if n == 0:
            return result
        m = product_above(m, m)


@compiled
def reciprocal_power_below(m: float, n: int) -> float:
    """A bound of m ** -n for m > 0 and n >= 1. The reciprocal comes first: it loses no digits to underflow unless the
    power underflows as well."""
    return power_below(quotient_below(1.0, m), n)


@compiled
def reciprocal_power_above(m: float, n: int) -> float:
    return power_above(quotient_above(1.0, m), n)


@compiled
def _near_one(m: float, n: int) -> tuple[float, int]:
    """s and q with m = s 2^(n q) exactly, where powers of s neither underflow nor overflow."""
    mantissa, exponent = math.frexp(m)
    q = int(exponent / n)
    return math.ldexp(mantissa, exponent - n * q), q


@compiled
def nth_root_below(m: float, n: int) -> float:
    """A bound of the n-th root of m >= 0 for n >= 1: a floating-point guess, lowered until its n-th power proves it."""
    if m == 0.0 or n == 1:
        return min(m, MAX)
    if m == math.inf:
        return MAX
    m, q = _near_one(m, n)
    bound, step = math.exp(math.log(m) / n), 2.0 * PHI
    while step < 1.0:
        bound = bound - bound * step
        if power_above(bound, n) <= m:
            return math.ldexp(bound, q)
        step *= 2.0
    return 0.0


@compiled
def nth_root_above(m: float, n: int) -> float:
    if m == 0.0 or n == 1 or m == math.inf:
        return m
    m, q = _near_one(m, n)
    bound, step = math.exp(math.log(m) / n), 2.0 * PHI
    while step < 1.0:
        bound = bound + bound * step
        if power_below(bound, n) >= m:
            return math.ldexp(bound, q)
        step *= 2.0
    return math.inf


Bounds = tuple[float, float]


@compiled
def neg(lo: float, hi: float) -> Bounds:
    return -hi, -lo


@compiled
def add(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    return sum_below(a_lo, b_lo), sum_above(a_hi, b_hi)


@compiled
def sub(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    return sum_below(a_lo, -b_hi), sum_above(a_hi, -b_lo)


@compiled
def mul(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """By the signs of the bounds; an empty operand falls through to the last branch, whose products are NaN."""
    if b_lo >= 0.0:
        if a_lo >= 0.0:
            return product_below(a_lo, b_lo), product_above(a_hi, b_hi)
        if a_hi <= 0.0:
            return product_below(a_lo, b_hi), product_above(a_hi, b_lo)
        return product_below(a_lo, b_hi), product_above(a_hi, b_hi)
    if b_hi <= 0.0:
        if a_lo >= 0.0:
            return product_below(a_hi, b_lo), product_above(a_lo, b_hi)
        if a_hi <= 0.0:
            return product_below(a_hi, b_hi), product_above(a_lo, b_lo)
        return product_below(a_hi, b_lo), product_above(a_lo, b_lo)
    if a_lo >= 0.0:
        return product_below(a_hi, b_lo), product_above(a_hi, b_hi)
    if a_hi <= 0.0:
        return product_below(a_lo, b_hi), product_above(a_lo, b_lo)
    low = min(product_below(a_lo, b_hi), product_below(a_hi, b_lo))
    return low, max(product_above(a_lo, b_lo), product_above(a_hi, b_hi))


@compiled
def _over_positive(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """a / b for b > 0."""
    low = quotient_below(a_lo, b_hi if a_lo >= 0.0 else b_lo)
    return low, quotient_above(a_hi, b_lo if a_hi >= 0.0 else b_hi)


@compiled
def div(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """Hull of the quotients by the divisor's nonzero points."""
    if b_lo > 0.0:
        return _over_positive(a_lo, a_hi, b_lo, b_hi)
    if b_hi < 0.0:
        return _over_positive(-a_hi, -a_lo, -b_hi, -b_lo)
    if not (a_lo <= a_hi and b_lo <= b_hi) or (b_lo == 0.0 and b_hi == 0.0):
        return math.nan, math.nan
    if a_lo == 0.0 and a_hi == 0.0:
        return 0.0, 0.0
    if b_lo < 0.0 and b_hi > 0.0:
        return -math.inf, math.inf
    if b_hi == 0.0:
        a_lo, a_hi, b_hi = -a_hi, -a_lo, -b_lo
    low = -math.inf if a_lo < 0.0 else quotient_below(a_lo, b_hi)
    return low, math.inf if a_hi > 0.0 else quotient_above(a_hi, b_hi)


@compiled
def meet(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """The points of both."""
    low = a_lo if a_lo > b_lo else b_lo
    high = a_hi if a_hi < b_hi else b_hi
    if low <= high and a_lo == a_lo:
        return low, high
    return math.nan, math.nan


@compiled
def hull(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """The points between; the empty interval is neutral."""
    if not a_lo <= a_hi:
        return b_lo, b_hi
    if not b_lo <= b_hi:
        return a_lo, a_hi
    return (a_lo if a_lo < b_lo else b_lo), (a_hi if a_hi > b_hi else b_hi)


@compiled
def factor(z_lo: float, z_hi: float, y_lo: float, y_hi: float, x_lo: float, x_hi: float) -> Bounds:
    """Hull of `{a in x : a b in z for some b in y}`."""
    if y_lo > 0.0 or y_hi < 0.0:
        low, high = div(z_lo, z_hi, y_lo, y_hi)
        return meet(low, high, x_lo, x_hi)
    if not (z_lo <= z_hi and y_lo <= y_hi):
        return math.nan, math.nan
    if z_lo <= 0.0 <= z_hi:
        return x_lo, x_hi
    low, high = div(z_lo, z_hi, y_lo, 0.0)
    one_lo, one_hi = meet(low, high, x_lo, x_hi)
    low, high = div(z_lo, z_hi, 0.0, y_hi)
    two_lo, two_hi = meet(low, high, x_lo, x_hi)
    return hull(one_lo, one_hi, two_lo, two_hi)


@compiled
def mig(lo: float, hi: float) -> float:
    """The smallest absolute value."""
    if lo > 0.0:
        return lo
    return -hi if hi < 0.0 else 0.0


@compiled
def mag(lo: float, hi: float) -> float:
    """The largest absolute value."""
    return hi if hi > -lo else -lo


@compiled
def absolute(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    return mig(lo, hi), mag(lo, hi)


@compiled
def sqr(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    least, most = mig(lo, hi), mag(lo, hi)
    return product_below(least, least), product_above(most, most)


@compiled
def sqrt(lo: float, hi: float) -> Bounds:
    """Of the part that is not negative."""
    if not (lo <= hi and hi >= 0.0):
        return math.nan, math.nan
    return root_below(lo) if lo > 0.0 else 0.0, root_above(hi)


@compiled
def _positive_power(lo: float, hi: float, n: int) -> Bounds:
    if n % 2 == 0:
        return power_below(mig(lo, hi), n), power_above(mag(lo, hi), n)
    low = power_below(lo, n) if lo >= 0.0 else -power_above(-lo, n)
    return low, power_above(hi, n) if hi >= 0.0 else -power_below(-hi, n)


@compiled
def _reciprocal_power(lo: float, hi: float, n: int) -> Bounds:
    if n % 2 == 0:
        lo, hi = absolute(lo, hi)
    if lo == 0.0 == hi:
        return math.nan, math.nan
    if lo >= 0.0:
        return reciprocal_power_below(hi, n), reciprocal_power_above(lo, n) if lo > 0.0 else math.inf
    if hi <= 0.0:
        return -reciprocal_power_above(-hi, n) if hi < 0.0 else -math.inf, -reciprocal_power_below(-lo, n)
    return -math.inf, math.inf


@compiled
def power(lo: float, hi: float, n: int) -> Bounds:
    """x ** n for an integer n of any sign."""
    if not lo <= hi:
        return math.nan, math.nan
    if n == 0:
        return 1.0, 1.0
    if n < 0:
        return _reciprocal_power(lo, hi, -n)
    return (lo, hi) if n == 1 else _positive_power(lo, hi, n)


@compiled
def root(lo: float, hi: float, n: int) -> Bounds:
    """n-th root, n >= 1: for even n of the part that is not negative, for odd n with its sign."""
    if not lo <= hi or (n % 2 == 0 and hi < 0.0):
        return math.nan, math.nan
    if n == 2:
        return sqrt(lo, hi)
    if n % 2 == 0:
        return nth_root_below(max(lo, 0.0), n), nth_root_above(hi, n)
    low = nth_root_below(lo, n) if lo >= 0.0 else -nth_root_above(-lo, n)
    return low, nth_root_above(hi, n) if hi >= 0.0 else -nth_root_below(-hi, n)


@compiled
def smaller(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """The minimum."""
    if not (a_lo <= a_hi and b_lo <= b_hi):
        return math.nan, math.nan
    return (a_lo if a_lo < b_lo else b_lo), (a_hi if a_hi < b_hi else b_hi)


@compiled
def larger(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """The maximum."""
    if not (a_lo <= a_hi and b_lo <= b_hi):
        return math.nan, math.nan
    return (a_lo if a_lo > b_lo else b_lo), (a_hi if a_hi > b_hi else b_hi)


@compiled
def floor(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    return float(np.floor(lo)), float(np.floor(hi))


@compiled
def ceil(lo: float, hi: float) -> Bounds:
    low, high = floor(-hi, -lo)
    return -high, -low


@compiled
def sign(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    return (1.0 if lo > 0.0 else (0.0 if lo == 0.0 else -1.0)), (-1.0 if hi < 0.0 else (0.0 if hi == 0.0 else 1.0))


@compiled
def total_below(terms: Floats) -> float:
    """A bound of a sum. What each addition loses is exact (Knuth): added up beside it, it is small."""
    total, rest, size = 0.0, 0.0, 0.0
    for v in terms:
        more = total + v
        part = more - total
        lost = (total - (more - part)) + (v - part)
        total, rest, size = more, rest + lost, size + abs(lost)
    if size == 0.0:
        return total
    if size < math.inf:  # all that was computed is finite
        return sum_below(total, lowered(rest - size * (len(terms) * 2.0**-50)))
    total = 0.0
    for v in terms:
        total = sum_below(total, v)
    return total


@compiled
def total_above(terms: Floats) -> float:
    return -total_below(-terms)
