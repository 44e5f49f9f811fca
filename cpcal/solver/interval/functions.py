"""Elementary functions of intervals, as compiled functions. What undoes them stands in `inverse_functions`.

Each means the hull of the function's values at those points of the interval where it is defined; NaN where there is
none. They are composed of bounds at points (`elementary`) and of interval operations, so that they are as rigorous.
"""

from __future__ import annotations

import math

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.elementary import (
    FARTHEST,
    PI_HI,
    PI_LO,
    PIO2_HI,
    PIO2_LO,
    atan_at,
    cos_at,
    exp_at,
    expm1_at,
    log1p_at,
    log_at,
    sin_at,
)
from cpcal.solver.interval.kernels import (
    Bounds,
    add,
    div,
    hull,
    meet,
    mul,
    neg,
    quotient_above,
    quotient_below,
    sqr,
    sqrt,
    sub,
)


@compiled
def exp(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    return exp_at(lo)[0], exp_at(hi)[1]


@compiled
def expm1(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    return expm1_at(lo)[0], expm1_at(hi)[1]


@compiled
def log(lo: float, hi: float) -> Bounds:
    if not (lo <= hi and hi > 0.0):
        return math.nan, math.nan
    return log_at(max(lo, 0.0))[0], log_at(hi)[1]


@compiled
def log1p(lo: float, hi: float) -> Bounds:
    if not (lo <= hi and hi > -1.0):
        return math.nan, math.nan
    return log1p_at(max(lo, -1.0))[0], log1p_at(hi)[1]


@compiled
def atan(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    return atan_at(lo)[0], atan_at(hi)[1]


@compiled
def _multiples(lo: float, hi: float, offset: float) -> tuple[float, float]:
    """The first and the last integer m for which (m + offset) pi may lie in [lo, hi]."""
    least = quotient_below(lo, PI_LO if lo < 0.0 else PI_HI)
    most = quotient_above(hi, PI_HI if hi < 0.0 else PI_LO)
    return math.ceil(least - offset - 1e-9), math.floor(most - offset + 1e-9)


@compiled
def _wave(first: float, last: float, low: float, high: float) -> Bounds:
    """Bounds between two ends, where they are `low` and `high`, with the one extremum inside if `first` is `last`."""
    if first == last:
        if int(first) % 2 == 0:
            return low, 1.0
        return -1.0, high
    return low, high


@compiled
def sin(lo: float, hi: float) -> Bounds:
    """Maxima are at (m + 1/2) pi for even m, minima for odd m."""
    if not lo <= hi:
        return math.nan, math.nan
    if not (abs(lo) <= FARTHEST and abs(hi) <= FARTHEST):
        return -1.0, 1.0
    first, last = _multiples(lo, hi, 0.5)
    if last > first:
        return -1.0, 1.0
    a_lo, a_hi = sin_at(lo)
    b_lo, b_hi = sin_at(hi)
    return _wave(first, last, min(a_lo, b_lo), max(a_hi, b_hi))


@compiled
def cos(lo: float, hi: float) -> Bounds:
    """Maxima are at m pi for even m, minima for odd m."""
    if not lo <= hi:
        return math.nan, math.nan
    if not (abs(lo) <= FARTHEST and abs(hi) <= FARTHEST):
        return -1.0, 1.0
    first, last = _multiples(lo, hi, 0.0)
    if last > first:
        return -1.0, 1.0
    a_lo, a_hi = cos_at(lo)
    b_lo, b_hi = cos_at(hi)
    return _wave(first, last, min(a_lo, b_lo), max(a_hi, b_hi))


@compiled
def has_pole(lo: float, hi: float) -> bool:
    """Whether tan may have a pole in an interval."""
    if not (abs(lo) <= FARTHEST and abs(hi) <= FARTHEST):
        return True
    first, last = _multiples(lo, hi, 0.5)
    return first <= last


@compiled
def _tan_at(x: float) -> Bounds:
    s_lo, s_hi = sin_at(x)
    c_lo, c_hi = cos_at(x)
    return div(s_lo, s_hi, c_lo, c_hi)


@compiled
def tan(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    if has_pole(lo, hi):
        return -math.inf, math.inf
    return _tan_at(lo)[0], _tan_at(hi)[1]


@compiled
def _acos_at(x: float) -> Bounds:
    """2 atan sqrt((1 - x) / (1 + x))"""
    n_lo, n_hi = sub(1.0, 1.0, x, x)
    d_lo, d_hi = add(1.0, 1.0, x, x)
    if d_lo <= 0.0:
        return PI_LO, PI_HI
    q_lo, q_hi = div(n_lo, n_hi, d_lo, d_hi)
    q_lo, q_hi = sqrt(q_lo, q_hi)
    low, high = atan(q_lo, q_hi)
    return 2.0 * low, 2.0 * high


@compiled
def acos(lo: float, hi: float) -> Bounds:
    lo, hi = meet(lo, hi, -1.0, 1.0)
    if not lo <= hi:
        return math.nan, math.nan
    return max(_acos_at(hi)[0], 0.0), _acos_at(lo)[1]


@compiled
def _asin_at(x: float) -> Bounds:
    """atan(x / sqrt((1 - x) (1 + x)))"""
    n_lo, n_hi = sub(1.0, 1.0, x, x)
    d_lo, d_hi = add(1.0, 1.0, x, x)
    p_lo, p_hi = mul(n_lo, n_hi, d_lo, d_hi)
    if not p_lo > 0.0:
        return (PIO2_LO, PIO2_HI) if x > 0.0 else (-PIO2_HI, -PIO2_LO)
    p_lo, p_hi = sqrt(p_lo, p_hi)
    p_lo, p_hi = div(x, x, p_lo, p_hi)
    return atan(p_lo, p_hi)


@compiled
def asin(lo: float, hi: float) -> Bounds:
    lo, hi = meet(lo, hi, -1.0, 1.0)
    if not lo <= hi:
        return math.nan, math.nan
    return _asin_at(lo)[0], _asin_at(hi)[1]


@compiled
def _sinh_positive(x: float) -> Bounds:
    """(E + E / (E + 1)) / 2 with E = expm1 x, for x >= 0."""
    low, high = expm1_at(x)
    low = max(low, 0.0)
    if high == math.inf:
        return 0.499 * low, math.inf
    d_lo, d_hi = add(low, high, 1.0, 1.0)
    low = add(low, low, quotient_below(low, d_hi), math.inf)[0]
    high = add(-math.inf, high, -math.inf, quotient_above(high, d_lo))[1]
    return 0.5 * low, 0.5 * high


@compiled
def odd(lo: float, hi: float, negative: bool) -> Bounds:
    return (-hi, -lo) if negative else (lo, hi)


@compiled
def _sinh_at(x: float) -> Bounds:
    low, high = _sinh_positive(abs(x))
    return odd(low, high, x < 0.0)


@compiled
def sinh(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    return _sinh_at(lo)[0], _sinh_at(hi)[1]


@compiled
def _cosh_at(x: float) -> Bounds:
    low, high = exp_at(abs(x))
    i_lo, i_hi = exp_at(-abs(x))
    low, high = add(low, high, i_lo, i_hi)
    return max(0.5 * low, 1.0), 0.5 * high


@compiled
def cosh(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    a_lo, a_hi = _cosh_at(lo)
    b_lo, b_hi = _cosh_at(hi)
    low = 1.0 if lo <= 0.0 <= hi else min(a_lo, b_lo)
    return low, max(a_hi, b_hi)


@compiled
def _tanh_positive(x: float) -> Bounds:
    """E / (E + 2) with E = expm1 2x, for x >= 0: it grows with E."""
    if x > 300.0:
        return 1.0 - 2.0**-53, 1.0
    low, high = expm1_at(2.0 * x)
    low = max(low, 0.0)
    d_lo, d_hi = add(low, low, 2.0, 2.0)
    low = div(low, low, d_lo, d_hi)[0]
    d_lo, d_hi = add(high, high, 2.0, 2.0)
    return low, min(div(high, high, d_lo, d_hi)[1], 1.0)


@compiled
def _tanh_at(x: float) -> Bounds:
    low, high = _tanh_positive(abs(x))
    return odd(low, high, x < 0.0)


@compiled
def tanh(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    return _tanh_at(lo)[0], _tanh_at(hi)[1]


@compiled
def pow_real(x_lo: float, x_hi: float, p_lo: float, p_hi: float) -> Bounds:
    """x^p = exp(p log x) for x > 0, and 0^p = 0 for p > 0."""
    if not (x_lo <= x_hi and p_lo <= p_hi and x_hi >= 0.0):
        return math.nan, math.nan
    if x_hi == 0.0:
        return (0.0, 0.0) if p_hi > 0.0 else (math.nan, math.nan)
    low, high = log(x_lo, x_hi)
    low, high = mul(low, high, p_lo, p_hi)
    return exp(low, high)


@compiled
def atan2(y_lo: float, y_hi: float, x_lo: float, x_hi: float) -> Bounds:
    """The angle of the point (x, y), in (-pi, pi]."""
    if not (y_lo <= y_hi and x_lo <= x_hi):
        return math.nan, math.nan
    if x_lo > 0.0:
        low, high = div(y_lo, y_hi, x_lo, x_hi)
        return atan(low, high)
    if y_lo > 0.0 or y_hi < 0.0:
        low, high = div(x_lo, x_hi, y_lo, y_hi)
        low, high = atan(low, high)
        if y_lo > 0.0:
            return sub(PIO2_LO, PIO2_HI, low, high)
        return sub(-PIO2_HI, -PIO2_LO, low, high)
    return -PI_HI, PI_HI


# ------------------------------------------------------------------------------------------------------------------
# What undoes elementary functions, as compiled functions on intervals: for the backward sweep.


@compiled
def _asinh_at(z: float) -> Bounds:
    """log1p(z + z^2 / (1 + sqrt(z^2 + 1)))"""
    a = abs(z)
    if a > 1e150:
        low, high = log(a, a)
        low, high = add(low, high, 0.6931471805599452, 0.6931471805599454)
        return odd(low, high, z < 0.0)
    s_lo, s_hi = sqr(a, a)
    r_lo, r_hi = add(s_lo, s_hi, 1.0, 1.0)
    r_lo, r_hi = sqrt(r_lo, r_hi)
    r_lo, r_hi = add(r_lo, r_hi, 1.0, 1.0)
    r_lo, r_hi = div(s_lo, s_hi, r_lo, r_hi)
    r_lo, r_hi = add(r_lo, r_hi, a, a)
    low, high = log1p(r_lo, r_hi)
    return odd(low, high, z < 0.0)


@compiled
def asinh(lo: float, hi: float) -> Bounds:
    if not lo <= hi:
        return math.nan, math.nan
    return (lo if math.isinf(lo) else _asinh_at(lo)[0]), (hi if math.isinf(hi) else _asinh_at(hi)[1])


@compiled
def acosh(lo: float, hi: float) -> Bounds:
    """Not negative: log1p(t + sqrt(t (t + 2))), t = z - 1."""
    lo, hi = meet(lo, hi, 1.0, math.inf)
    t_lo, t_hi = sub(lo, hi, 1.0, 1.0)
    s_lo, s_hi = add(t_lo, t_hi, 2.0, 2.0)
    s_lo, s_hi = mul(t_lo, t_hi, s_lo, s_hi)
    s_lo, s_hi = sqrt(s_lo, s_hi)
    t_lo, t_hi = add(t_lo, t_hi, s_lo, s_hi)
    return log1p(t_lo, t_hi)


@compiled
def atanh(lo: float, hi: float) -> Bounds:
    """log((1 + z) / (1 - z)) / 2, by ends: log1p(2 z / (1 - z)) / 2."""
    lo, hi = meet(lo, hi, -1.0, 1.0)
    if not lo <= hi:
        return math.nan, math.nan
    return _atanh_at(lo)[0], _atanh_at(hi)[1]


@compiled
def _atanh_at(z: float) -> Bounds:
    a = abs(z)
    if a == 1.0:
        return odd(18.0, math.inf, z < 0.0)
    d_lo, d_hi = sub(1.0, 1.0, a, a)
    d_lo, d_hi = div(2.0 * a, 2.0 * a, d_lo, d_hi)
    low, high = log1p(d_lo, d_hi)
    return odd(0.5 * low, 0.5 * high, z < 0.0)


@compiled
def _piece(m: int, b_lo: float, b_hi: float, x_lo: float, x_hi: float) -> Bounds:
    """The part of x in m pi + (-1)^m b."""
    p_lo, p_hi = mul(float(m), float(m), PI_LO, PI_HI)
    if m % 2:
        b_lo, b_hi = neg(b_lo, b_hi)
    low, high = add(p_lo, p_hi, b_lo, b_hi)
    return meet(low, high, x_lo, x_hi)


@compiled
def of_sine(z_lo: float, z_hi: float, x_lo: float, x_hi: float) -> Bounds:
    """Hull of the part of x whose sine lies in z: m pi + (-1)^m asin(z)."""
    b_lo, b_hi = asin(z_lo, z_hi)
    if not b_lo <= b_hi:
        return math.nan, math.nan
    if not (abs(x_lo) <= FARTHEST and abs(x_hi) <= FARTHEST):
        return x_lo, x_hi
    first, last = math.floor(x_lo / PI_LO) - 1, math.ceil(x_hi / PI_LO) + 1
    for m in range(first, last + 1):
        low, high = _piece(m, b_lo, b_hi, x_lo, x_hi)
        if low <= high:
            for n in range(last, m - 1, -1):
                end_lo, end_hi = _piece(n, b_lo, b_hi, x_lo, x_hi)
                if end_lo <= end_hi:
                    return hull(low, high, end_lo, end_hi)
    return math.nan, math.nan


@compiled
def of_cosine(z_lo: float, z_hi: float, x_lo: float, x_hi: float) -> Bounds:
    """cos x = sin(x + pi/2)"""
    low, high = add(x_lo, x_hi, PIO2_LO, PIO2_HI)
    low, high = of_sine(z_lo, z_hi, low, high)
    return sub(low, high, PIO2_LO, PIO2_HI)


@compiled
def of_tangent(z_lo: float, z_hi: float, x_lo: float, x_hi: float) -> Bounds:
    """Hull of the part of x whose tangent lies in z: m pi + atan(z)."""
    b_lo, b_hi = atan(z_lo, z_hi)
    if not (abs(x_lo) <= FARTHEST and abs(x_hi) <= FARTHEST):
        return x_lo, x_hi
    first, last = math.floor(x_lo / PI_LO) - 1, math.ceil(x_hi / PI_LO) + 1
    low, high = math.nan, math.nan
    for m in (first, first + 1, first + 2, first + 3, last - 3, last - 2, last - 1, last):
        if first <= m <= last:
            p_lo, p_hi = mul(float(m), float(m), PI_LO, PI_HI)
            p_lo, p_hi = add(p_lo, p_hi, b_lo, b_hi)
            p_lo, p_hi = meet(p_lo, p_hi, x_lo, x_hi)
            low, high = hull(low, high, p_lo, p_hi)
    return low, high
