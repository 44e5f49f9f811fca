"""Bounds of elementary functions at float64 numbers, as compiled functions: exp, expm1, log, log1p, sin, cos, atan.

Each reduces its argument, evaluates a polynomial core in ordinary floating point, and widens the result by a bound of
its relative error. The cores' errors over the whole reduced range are proved in tests/solver/interval/
test_elementary.py: truncation by arb, rounding by running the very functions below on numbers that carry error bounds.
No function of the C library takes part but frexp and sqrt, which are exact or correctly rounded.
"""

from __future__ import annotations

import math

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.kernels import (
    ETA,
    MAX,
    Bounds,
    add,
    neg,
    quotient_above,
    quotient_below,
    sub,
    sum_above,
    sum_below,
)

_x = float.fromhex
LN2_HI, LN2_LO = _x("0x1.62e42feep-1"), _x("0x1.a39ef35793c76p-33")  # 32 bits: times an exponent it is exact
PIO2_1, PIO2_2, PIO2_3 = _x("0x1.921fb544p+0"), _x("0x1.0b4611a6p-34"), _x("0x1.3198a2e037073p-69")  # 33, 33 bits
PI = _x("0x1.921fb54442d18p+1"), _x("0x1.921fb54442d19p+1")
PIO2, PIO4 = (0.5 * PI[0], 0.5 * PI[1]), (0.25 * PI[0], 0.25 * PI[1])

ERROR = 2.0**-49  # a bound of every relative error below
REDUCTION = 2.0**-90  # a bound of the absolute error of an argument reduced by multiples of pi/2
FARTHEST = 1.6e6  # beyond it sin and cos are only known to lie in [-1, 1]
SMALL = 0.35  # up to it expm1 and log1p have a core of their own
TAN_PI_8 = 0.4143

EXP = tuple(1.0 / math.factorial(n) for n in range(14, -1, -1))  # of 1 + r + r^2/2 + ...
SIN = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(9, 0, -1))  # of (sin r - r) / r^3 in r^2
COS = tuple((-1.0) ** n / math.factorial(2 * n) for n in range(10, 0, -1))  # of (cos r - 1) / r^2 in r^2
ATANH = tuple(1.0 / (2 * n + 1) for n in range(16, 0, -1))  # of (atanh s - s) / s^3 in s^2
ATAN = tuple((-1.0) ** n / (2 * n + 1) for n in range(24, 0, -1))  # of (atan t - t) / t^3 in t^2


@compiled
def exp_core(r: float) -> float:
    """exp for |r| <= 0.36."""
    total = EXP[0]
    for c in EXP[1:]:
        total = total * r + c
    return total


@compiled
def expm1_core(r: float) -> float:
    """exp - 1 for |r| <= 0.36."""
    total = EXP[0]
    for c in EXP[1:13]:
        total = total * r + c
    return r + r * r * total


@compiled
def log_core(s: float) -> float:
    """log((1 + s) / (1 - s)) for |s| <= 0.22."""
    z = s * s
    total = ATANH[0]
    for c in ATANH[1:]:
        total = total * z + c
    return 2.0 * (s + s * z * total)


@compiled
def sin_core(r: float, tail: float) -> float:
    """sin(r + tail) for |r| <= 0.79 and a tail below r's last place."""
    z = r * r
    total = SIN[0]
    for c in SIN[1:]:
        total = total * z + c
    return r + (r * z * total + tail * (1.0 - 0.5 * z))


@compiled
def cos_core(r: float, tail: float) -> float:
    z = r * r
    total = COS[0]
    for c in COS[1:]:
        total = total * z + c
    return 1.0 + (z * total - tail * r)


@compiled
def atan_core(t: float) -> float:
    """atan for |t| <= 0.4143."""
    z = t * t
    total = ATAN[0]
    for c in ATAN[1:]:
        total = total * z + c
    return t + t * z * total


@compiled
def widened(v: float) -> Bounds:
    """All numbers from which v differs by a relative error of at most ERROR."""
    room = abs(v) * (ERROR * 1.0000001) + ETA
    return v - room, v + room


@compiled
def _power_of_two(n: int) -> float:
    """2^n for -1000 <= n <= 1000."""
    result, base = 1.0, 2.0 if n >= 0 else 0.5
    n = abs(n)
    while n:
        if n & 1:
            result *= base
        base *= base
        n >>= 1
    return result


@compiled
def exp_at(x: float) -> Bounds:
    if x != x:
        return x, x
    if x > 709.7:
        return MAX if x > 709.79 else 8.1e307, math.inf
    if x < -745.2:
        return 0.0, ETA
    k = math.floor(x * 1.4426950408889634 + 0.5)
    low, high = widened(exp_core((x - k * LN2_HI) - k * LN2_LO))
    half = k // 2
    one, two = _power_of_two(half), _power_of_two(k - half)
    low, high = low * one * two, high * one * two
    if k < -1000:  # the last product may be subnormal, and rounded
        low, high = max(low - ETA, 0.0), high + ETA
    return low, high


@compiled
def expm1_at(x: float) -> Bounds:
    if abs(x) <= SMALL:
        return widened(expm1_core(x))
    low, high = exp_at(x)
    return max(sum_below(low, -1.0), -1.0), sum_above(high, -1.0)


@compiled
def log_at(x: float) -> Bounds:
    """For x >= 0."""
    if x == 0.0:
        return -math.inf, -math.inf
    if x == math.inf:
        return MAX, math.inf
    m, k = math.frexp(x)
    if m < 0.7071067811865476:
        m, k = 2.0 * m, k - 1
    f = m - 1.0
    return widened(k * LN2_HI + (k * LN2_LO + log_core(f / (2.0 + f))))


@compiled
def log1p_at(x: float) -> Bounds:
    """For x >= -1."""
    if abs(x) < 1e-300:  # x / 2 may be subnormal, and rounded
        return widened(x)
    if abs(x) <= SMALL:
        return widened(log_core(x / (2.0 + x)))
    low, _ = log_at(max(sum_below(1.0, x), 0.0))
    _, high = log_at(sum_above(1.0, x))
    return low, high


@compiled
def two_sum(a: float, b: float) -> tuple[float, float]:
    """The rounded sum and its error, exactly (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@compiled
def reduced(x: float) -> tuple[int, float, float]:
    """k, r, tail with x = k pi/2 + r + tail, |r| <= 0.79, up to REDUCTION; for |x| <= FARTHEST."""
    k = math.floor(x * 0.6366197723675814 + 0.5)
    if k == 0:
        return 0, x, 0.0
    t, first = two_sum(x, -k * PIO2_1)  # the products with 33 bits are exact
    r, second = two_sum(t, -k * PIO2_2)
    r, tail = two_sum(r, (first + second) - k * PIO2_3)
    return k, r, tail


@compiled
def _wave_at(x: float, shift: int) -> Bounds:
    """The sine of x plus so many quarters of a turn."""
    if not abs(x) <= FARTHEST:
        return -1.0, 1.0
    k, r, tail = reduced(x)
    quarter = (k + shift) % 4
    v = cos_core(r, tail) if quarter % 2 else sin_core(r, tail)
    low, high = widened(-v if quarter >= 2 else v)
    if k != 0:
        low, high = low - REDUCTION, high + REDUCTION
        low, high = low - abs(low) * 2.0**-52, high + abs(high) * 2.0**-52
    return max(low, -1.0), min(high, 1.0)


@compiled
def sin_at(x: float) -> Bounds:
    return _wave_at(x, 0)


@compiled
def cos_at(x: float) -> Bounds:
    return _wave_at(x, 1)


@compiled
def atan_at(x: float) -> Bounds:
    return neg(_atan_positive(-x)) if x < 0.0 else _atan_positive(x)


@compiled
def _atan_positive(x: float) -> Bounds:
    """Of x, of (x - 1) / (x + 1) = tan(atan x - pi/4), or of 1 / x, whichever is small; x >= 0."""
    if x <= 0.4142:
        return widened(atan_core(x))
    if x <= 2.4142:
        less, more = sum_below(x, 1.0), sum_above(x, 1.0)
        low, _ = widened(atan_core(quotient_below(sum_below(x, -1.0), more if x >= 1.0 else less)))
        _, high = widened(atan_core(quotient_above(sum_above(x, -1.0), less if x >= 1.0 else more)))
        return add(PIO4, (low, high))
    if x == math.inf:
        return PIO2
    low, _ = widened(atan_core(quotient_below(1.0, x)))
    _, high = widened(atan_core(quotient_above(1.0, x)))
    return sub(PIO2, (low, high))
