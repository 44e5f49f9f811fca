"""Elementary functions of intervals and what undoes them, as compiled functions.

Each means the hull of the function's values at those points of the interval where it is defined; NaN where there is
none. They are composed of bounds at points (`elementary`) and of interval operations, so that they are as rigorous.
"""

import math

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.kernels import (
    EMPTY,
    ETA,
    LINE,
    MAX,
    ONE,
    Bounds,
    add,
    div,
    hull,
    meet,
    mul,
    neg,
    quotient_above,
    quotient_below,
    sqrt,
    sub,
    sum_above,
    sum_below,
    two_sum,
)

# ------------------------------------------------------------------------------------------------------------------
# Bounds of elementary functions at float64 numbers, as compiled functions: exp, log, sin, cos, atan.
#
# Each reduces its argument, evaluates a polynomial core in ordinary floating point, and widens the result by a bound of
# its relative error. The cores' errors over the whole reduced range are proved in tests/solver/interval/
# test_elementary.py: truncation by arb, rounding by running the very functions below on numbers that carry error
# bounds.
# No function of the C library takes part but frexp, ldexp and sqrt, which are exact or correctly rounded.

_x = float.fromhex
LN2_HI, LN2_LO = _x("0x1.62e42feep-1"), _x("0x1.a39ef35793c76p-33")  # 32 bits: times an exponent it is exact
PIO2_1, PIO2_2, PIO2_3 = _x("0x1.921fb544p+0"), _x("0x1.0b4611a6p-34"), _x("0x1.3198a2e037073p-69")  # 33, 33 bits
PI = _x("0x1.921fb54442d18p+1"), _x("0x1.921fb54442d19p+1")
PIO2, PIO4 = (0.5 * PI[0], 0.5 * PI[1]), (0.25 * PI[0], 0.25 * PI[1])

ERROR = 2.0**-49  # a bound of every relative error below
REDUCTION = 2.0**-90  # a bound of the absolute error of an argument reduced by multiples of pi/2
FARTHEST = 1.6e6  # beyond it sin and cos are only known to lie in [-1, 1]

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
def exp_at(x: float) -> Bounds:
    if x > 709.7:
        return MAX if x > 709.79 else 8.1e307, math.inf
    if x < -745.2:
        return 0.0, ETA
    k = math.floor(x * 1.4426950408889634 + 0.5)
    low, high = widened(exp_core((x - k * LN2_HI) - k * LN2_LO))
    low, high = math.ldexp(low, k), math.ldexp(high, k)
    if k < -1000:  # these may be subnormal, and rounded
        low, high = max(low - ETA, 0.0), high + ETA
    return low, high


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
def wave_at(x: float, shift: int) -> Bounds:
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


ANGLES = (-PIO2[1], PIO2[1])  # of asin and atan
SINES = (-1.0, 1.0)


@compiled
def exp(x: Bounds) -> Bounds:
    if not x[0] <= x[1]:
        return EMPTY
    return exp_at(x[0])[0], exp_at(x[1])[1]


@compiled
def log(x: Bounds) -> Bounds:
    if not (x[0] <= x[1] and x[1] > 0.0):
        return EMPTY
    return log_at(max(x[0], 0.0))[0], log_at(x[1])[1]


@compiled
def atan(x: Bounds) -> Bounds:
    if not x[0] <= x[1]:
        return EMPTY
    return atan_at(x[0])[0], atan_at(x[1])[1]


@compiled
def far(x: Bounds) -> bool:
    """Whether sines and cosines are not known there."""
    return not (abs(x[0]) <= FARTHEST and abs(x[1]) <= FARTHEST)


@compiled
def _multiples(x: Bounds, offset: float) -> tuple[float, float]:
    """The first and the last integer m for which (m + offset) pi may lie in x."""
    least = quotient_below(x[0], PI[0] if x[0] < 0.0 else PI[1])
    most = quotient_above(x[1], PI[1] if x[1] < 0.0 else PI[0])
    return math.ceil(least - offset - 1e-9), math.floor(most - offset + 1e-9)


@compiled
def _wave(x: Bounds, shift: int) -> Bounds:
    """Of a sine (shift 0) or a cosine (1): maxima are at (m + (1 - shift) / 2) pi for even m, minima for odd m."""
    if not x[0] <= x[1]:
        return EMPTY
    if far(x):
        return SINES
    first, last = _multiples(x, 0.5 * (1 - shift))
    if last > first:
        return SINES
    a, b = wave_at(x[0], shift), wave_at(x[1], shift)
    low, high = min(a[0], b[0]), max(a[1], b[1])
    if first == last:
        return (low, 1.0) if int(first) % 2 == 0 else (-1.0, high)
    return low, high


@compiled
def sin(x: Bounds) -> Bounds:
    return _wave(x, 0)


@compiled
def cos(x: Bounds) -> Bounds:
    return _wave(x, 1)


@compiled
def has_pole(x: Bounds) -> bool:
    """Whether tan may have a pole in an interval."""
    if far(x):
        return True
    first, last = _multiples(x, 0.5)
    return first <= last


@compiled
def tan(x: Bounds) -> Bounds:
    if not x[0] <= x[1]:
        return EMPTY
    if has_pole(x):
        return LINE
    return div(wave_at(x[0], 0), wave_at(x[0], 1))[0], div(wave_at(x[1], 0), wave_at(x[1], 1))[1]


@compiled
def _asin_at(x: float) -> Bounds:
    """atan(x / sqrt((1 - x) (1 + x)))"""
    square = mul(sub(ONE, (x, x)), add(ONE, (x, x)))
    if not square[0] > 0.0:
        return PIO2 if x > 0.0 else neg(PIO2)
    return atan(div((x, x), sqrt(square)))


@compiled
def asin(x: Bounds) -> Bounds:
    lo, hi = meet(x, SINES)
    if not lo <= hi:
        return EMPTY
    return _asin_at(lo)[0], _asin_at(hi)[1]


@compiled
def atan2(y: Bounds, x: Bounds) -> Bounds:
    """The angle of the point (x, y), in (-pi, pi]."""
    if not (y[0] <= y[1] and x[0] <= x[1]):
        return EMPTY
    if x[0] > 0.0:
        return atan(div(y, x))
    if y[0] > 0.0:
        return sub(PIO2, atan(div(x, y)))
    if y[1] < 0.0:
        return sub(neg(PIO2), atan(div(x, y)))
    return -PI[1], PI[1]


# ------------------------------------------------------------------------------------------------------------------
# What undoes elementary functions: for the backward sweep.


@compiled
def _half_turns(m: int, b: Bounds, x: Bounds) -> Bounds:
    """The part of x in m pi + b."""
    return meet(add(mul((float(m), float(m)), PI), b), x)


@compiled
def of_sine(z: Bounds, x: Bounds) -> Bounds:
    """Hull of the part of x whose sine lies in z: m pi + (-1)^m asin(z)."""
    b = asin(z)
    if not b[0] <= b[1]:
        return EMPTY
    if far(x):
        return x
    first, last = math.floor(x[0] / PI[0]) - 1, math.ceil(x[1] / PI[0]) + 1
    for m in range(first, last + 1):
        start = _half_turns(m, neg(b) if m % 2 else b, x)
        if start[0] <= start[1]:
            for n in range(last, m - 1, -1):
                end = _half_turns(n, neg(b) if n % 2 else b, x)
                if end[0] <= end[1]:
                    return hull(start, end)
    return EMPTY


@compiled
def of_tangent(z: Bounds, x: Bounds) -> Bounds:
    """Hull of the part of x whose tangent lies in z: m pi + atan(z)."""
    if far(x):
        return x
    b, out = atan(z), EMPTY
    first, last = math.floor(x[0] / PI[0]) - 1, math.ceil(x[1] / PI[0]) + 1
    for m in (first, first + 1, first + 2, first + 3, last - 3, last - 2, last - 1, last):
        if first <= m <= last:
            out = hull(out, _half_turns(m, b, x))
    return out
