"""Interval operations as compiled functions on pairs of bounds: `add(a, b)`, an interval being `(lo, hi)`.

They mean what `Arithmetic` says of arrays. The empty interval is NaN in both bounds and gives the empty interval;
a lower bound is never +inf, an upper one never -inf.
"""

import math

import numpy as np

from cpcal.common.errors import RoundingError
from cpcal.common.values import Floats, Places
from cpcal.solver.compiled import compiled

# ------------------------------------------------------------------------------------------------------------------
# Directed rounding of single operations on float64 numbers: a bound below, a bound above.
#
# The processor rounds to nearest; the result is then moved one float outward (two at some of the smallest normal
# numbers). A `below` is never +inf and an `above` never -inf: overflow becomes the largest float on its safe side.
# NaN goes through.
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
def rounded_power(m: float, n: int, up: bool) -> float:
    """A bound of m ** n for n != 0 and m >= 0, m > 0 where n < 0.

    A reciprocal comes first: it loses no digits to underflow unless the power underflows as well.
    """
    if n < 0:
        m, n = quotient_above(1.0, m) if up else quotient_below(1.0, m), -n
    result, known = 1.0, False
    while True:
        if n & 1:
            if known:
                result = product_above(result, m) if up else max(product_below(result, m), 0.0)
            else:
                result, known = m, True
        n >>= 1
        if n == 0:
            return result if up else min(result, MAX)
        m = product_above(m, m) if up else max(product_below(m, m), 0.0)


@compiled
def signed_power(m: float, n: int, up: bool) -> float:
    """A bound of m ** n for an odd n and m of either sign."""
    return rounded_power(m, n, up) if m >= 0.0 else -rounded_power(-m, n, not up)


@compiled
def rounded_root(m: float, n: int, up: bool) -> float:
    """A bound of the n-th root of m >= 0 for n >= 1: a floating-point guess, moved until its n-th power proves it."""
    if m == 0.0 or n == 1 or m == math.inf:
        return m if up else min(m, MAX)
    mantissa, exponent = math.frexp(m)
    q = int(exponent / n)
    m = math.ldexp(mantissa, int(exponent - n * q))  # times 2^(n q) exactly; its powers neither underflow nor overflow
    bound, step = math.exp(math.log(m) / n), 2.0 * PHI
    while step < 1.0:
        bound = bound + bound * step if up else bound - bound * step
        if rounded_power(bound, n, True) <= m if not up else rounded_power(bound, n, False) >= m:
            return math.ldexp(bound, q)
        step *= 2.0
    return math.inf if up else 0.0


# ------------------------------------------------------------------------------------------------------------------
# Intervals.

Bounds = tuple[float, float]

Arrays = tuple[Floats, Floats]  # the bounds of many

EMPTY, LINE = (math.nan, math.nan), (-math.inf, math.inf)
ONE = (np.float64(1.0),) * 2  # numbers of numpy: plain Python divides them by zero, too


@compiled
def at(x: Arrays, k: int | Places) -> Bounds:
    """One of many."""
    return x[0][k], x[1][k]


@compiled
def neg(a: Bounds) -> Bounds:
    return -a[1], -a[0]


@compiled
def add(a: Bounds, b: Bounds) -> Bounds:
    return sum_below(a[0], b[0]), sum_above(a[1], b[1])


@compiled
def sub(a: Bounds, b: Bounds) -> Bounds:
    return sum_below(a[0], -b[1]), sum_above(a[1], -b[0])


@compiled
def mul(a: Bounds, b: Bounds) -> Bounds:
    """By the signs of the bounds; an empty operand falls through to the last branch, whose products are NaN."""
    a_lo, a_hi = a
    b_lo, b_hi = b
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
def div(a: Bounds, b: Bounds) -> Bounds:
    """Hull of the quotients by the divisor's nonzero points."""
    if b[1] < 0.0:
        a, b = neg(a), neg(b)
    a_lo, a_hi = a
    b_lo, b_hi = b
    if b_lo > 0.0:
        low = quotient_below(a_lo, b_hi if a_lo >= 0.0 else b_lo)
        return low, quotient_above(a_hi, b_lo if a_hi >= 0.0 else b_hi)
    if not (a_lo <= a_hi and b_lo <= b_hi) or (b_lo == 0.0 and b_hi == 0.0):
        return EMPTY
    if a_lo == 0.0 and a_hi == 0.0:
        return 0.0, 0.0
    if b_lo < 0.0 and b_hi > 0.0:
        return LINE
    if b_hi == 0.0:
        a_lo, a_hi, b_hi = -a_hi, -a_lo, -b_lo
    low = -math.inf if a_lo < 0.0 else quotient_below(a_lo, b_hi)
    return low, math.inf if a_hi > 0.0 else quotient_above(a_hi, b_hi)


@compiled
def meet(a: Bounds, b: Bounds) -> Bounds:
    """The points of both."""
    low = a[0] if a[0] > b[0] else b[0]
    high = a[1] if a[1] < b[1] else b[1]
    if low <= high and a[0] == a[0]:
        return low, high
    return EMPTY


@compiled
def hull(a: Bounds, b: Bounds) -> Bounds:
    """The points between; the empty interval is neutral."""
    if not a[0] <= a[1]:
        return b
    if not b[0] <= b[1]:
        return a
    return (a[0] if a[0] < b[0] else b[0]), (a[1] if a[1] > b[1] else b[1])


@compiled
def factor(z: Bounds, y: Bounds, x: Bounds) -> Bounds:
    """Hull of `{a in x : a b in z for some b in y}`."""
    if y[0] > 0.0 or y[1] < 0.0:
        return meet(div(z, y), x)
    if not (z[0] <= z[1] and y[0] <= y[1]):
        return EMPTY
    if z[0] <= 0.0 <= z[1]:
        return x
    return hull(meet(div(z, (y[0], 0.0)), x), meet(div(z, (0.0, y[1])), x))


@compiled
def absolute(a: Bounds) -> Bounds:
    if not a[0] <= a[1]:
        return EMPTY
    if a[0] > 0.0:
        return a
    return neg(a) if a[1] < 0.0 else (0.0, max(-a[0], a[1]))


@compiled
def sqr(a: Bounds) -> Bounds:
    least, most = absolute(a)
    return product_below(least, least), product_above(most, most)


@compiled
def sqrt(a: Bounds) -> Bounds:
    """Of the part that is not negative. The square root is never subnormal, so that zero stays zero."""
    if not (a[0] <= a[1] and a[1] >= 0.0):
        return EMPTY
    low, high = min(math.sqrt(a[0]), MAX) if a[0] > 0.0 else 0.0, math.sqrt(a[1])
    return low - low * PHI, high + high * PHI


@compiled
def power(a: Bounds, n: int) -> Bounds:
    """x ** n for an integer n of any sign."""
    if not a[0] <= a[1]:
        return EMPTY
    if n == 0:
        return ONE
    if n == 1:
        return a
    lo, hi = absolute(a) if n % 2 == 0 else a
    if n > 0:
        return signed_power(lo, n, False), signed_power(hi, n, True)
    if lo == 0.0 == hi:
        return EMPTY
    if lo < 0.0 < hi:
        return LINE
    low = -math.inf if hi == 0.0 else signed_power(hi, n, False)
    return low, math.inf if lo == 0.0 else signed_power(lo, n, True)


@compiled
def root(a: Bounds, n: int) -> Bounds:
    """n-th root, n >= 1: for even n of the part that is not negative, for odd n with its sign."""
    lo, hi = a
    if not lo <= hi or (n % 2 == 0 and hi < 0.0):
        return EMPTY
    if n == 2:
        return sqrt(a)
    if n % 2 == 0:
        lo = max(lo, 0.0)
    low = rounded_root(lo, n, False) if lo >= 0.0 else -rounded_root(-lo, n, True)
    return low, rounded_root(hi, n, True) if hi >= 0.0 else -rounded_root(-hi, n, False)


@compiled
def smaller(a: Bounds, b: Bounds) -> Bounds:
    """The minimum."""
    if not (a[0] <= a[1] and b[0] <= b[1]):
        return EMPTY
    return (a[0] if a[0] < b[0] else b[0]), (a[1] if a[1] < b[1] else b[1])


@compiled
def larger(a: Bounds, b: Bounds) -> Bounds:
    """The maximum."""
    return neg(smaller(neg(a), neg(b)))


@compiled
def two_sum(a: float, b: float) -> tuple[float, float]:
    """The rounded sum and its error, exactly (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@compiled
def total_below(terms: Floats) -> float:
    """A bound of a sum. What each addition loses is exact: added up beside it, it is small."""
    total, rest, size = 0.0, 0.0, 0.0
    for v in terms:
        total, lost = two_sum(total, v)
        rest, size = rest + lost, size + abs(lost)
    if size == 0.0:
        return total
    if size < math.inf:  # all that was computed is finite
        return sum_below(total, lowered(rest - size * (len(terms) * 2.0**-50)))
    total = 0.0
    for v in terms:
        total = sum_below(total, v)
    return total


@compiled
def total(terms: Arrays) -> Bounds:
    """The sum of intervals."""
    return total_below(terms[0]), -total_below(-terms[1])


# ------------------------------------------------------------------------------------------------------------------
# Whether this thread computes as IEEE 754 has it, which all bounds rest on.

_ONE, _SMALLEST, _HALF, _LEAST = 1.0, 2.0**-60, 0.5, 5e-324
_NORMAL = float(np.finfo(np.float64).smallest_normal)


def check_rounding() -> None:
    """Raises RoundingError where this thread does not compute as IEEE 754 has it.

    Some interval libraries switch the rounding, and leave it so: codac and others on gaol, filib or boost. Libraries
    that were compiled with -ffast-math switch subnormal numbers off for whoever loads them: results that small are
    zero then, and bounds of them false.
    """
    nearest = _ONE + _SMALLEST == _ONE and _ONE - _SMALLEST == _ONE
    if not nearest or _NORMAL * _HALF == 0.0 or _LEAST / _NORMAL == 0.0:
        raise RoundingError(
            "another library in this process has changed how the processor rounds, or switched small numbers off: no "
            "bound in float64 can be trusted. Run that library in a process of its own"
        )
