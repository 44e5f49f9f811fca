"""What undoes elementary functions, as compiled functions on intervals: for the backward sweep."""

from __future__ import annotations

import math

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.elementary import FARTHEST, PI_HI, PI_LO, PIO2_HI, PIO2_LO
from cpcal.solver.interval.functions import asin, atan, log, log1p, odd
from cpcal.solver.interval.kernels import Bounds, add, div, hull, meet, mul, neg, sqr, sqrt, sub


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
