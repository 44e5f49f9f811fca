"""Partial derivatives of operations, and their slopes.

What the derivative is to the mean value form, the slope is to the slope form. For an operation phi with arguments
u(c) at a centre c and u(x) anywhere, numbers p_j with

    phi(u(x)) - phi(u(c)) = sum_j p_j (u_j(x) - u_j(c))                       (Krawczyk and Neumaier)

are enclosed. That is algebra, not calculus: it holds wherever both sides are defined, next to poles and kinks, and
the enclosure is about half as wide as that of the derivative. Operations without a slope of their own use their
derivative over the hull of both values: it holds all such slopes.
"""

from __future__ import annotations

import math

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.directed import MAX as FLOAT_MAX
from cpcal.solver.interval.functions import cos, cosh, has_pole, log, pow_real, sin, sinh
from cpcal.solver.interval.kernels import Bounds, add, div, hull, meet, mul, neg, power, sqr, sqrt, sub
from cpcal.solver.network.operations import (
    ABS,
    ACOS,
    ADD,
    ATAN,
    ATAN2,
    CEIL,
    COS,
    COSH,
    DIV,
    EXP,
    EXPM1,
    FLOOR,
    LOG,
    LOG1P,
    MAX,
    MIN,
    MUL,
    NEG,
    POW,
    POWER,
    SIGN,
    SIN,
    SINH,
    SQR,
    SQRT,
    SUB,
    TAN,
    TANH,
)

Partials = tuple[float, float, float, float]  # bounds of the derivatives by the first and the second argument


@compiled
def _sign(lo: float, hi: float) -> Bounds:
    """Derivative of abs: 1, -1, or anything between where zero is inside (or nothing else)."""
    return 1.0 if lo >= 0.0 and hi > 0.0 else -1.0, -1.0 if hi <= 0.0 and lo < 0.0 else 1.0


@compiled
def _share_of_smaller(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """Derivative of min(a, b) with respect to a: 1 where a is smaller, 0 where b is, else [0, 1]."""
    return 1.0 if a_hi <= b_lo else 0.0, 0.0 if a_lo > b_hi else 1.0


@compiled
def _times_power(n: int, a_lo: float, a_hi: float) -> Bounds:
    """n a^(n-1)"""
    if n == 0:
        return 0.0, 0.0
    low, high = power(a_lo, a_hi, n - 1)
    return mul(float(n), float(n), low, high)


@compiled
def _of_angle(y_lo: float, y_hi: float, x_lo: float, x_hi: float) -> Partials:
    """x / (x^2 + y^2) and -y / (x^2 + y^2); nothing is known across the cut."""
    if not (x_lo > 0.0 or y_lo > 0.0 or y_hi < 0.0):
        return -math.inf, math.inf, -math.inf, math.inf
    s_lo, s_hi = sqr(x_lo, x_hi)
    t_lo, t_hi = sqr(y_lo, y_hi)
    s_lo, s_hi = add(s_lo, s_hi, t_lo, t_hi)
    low, high = div(x_lo, x_hi, s_lo, s_hi)
    t_lo, t_hi = div(-y_hi, -y_lo, s_lo, s_hi)
    return low, high, t_lo, t_hi


@compiled
def _of_function(code: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float) -> Bounds:
    """Of an elementary function of one argument; the whole line where it jumps or has a pole."""
    if code == EXP:
        return z_lo, z_hi
    if code == EXPM1:
        return add(z_lo, z_hi, 1.0, 1.0)
    if code == SIN:
        return cos(a_lo, a_hi)
    if code == COS:
        low, high = sin(a_lo, a_hi)
        return -high, -low
    if code == SINH:
        return cosh(a_lo, a_hi)
    if code == COSH:
        return sinh(a_lo, a_hi)
    if code == TAN:
        if has_pole(a_lo, a_hi):
            return -math.inf, math.inf
        low, high = sqr(z_lo, z_hi)
        return add(low, high, 1.0, 1.0)
    if code == TANH:
        low, high = sqr(z_lo, z_hi)
        return sub(1.0, 1.0, low, high)
    if code in (FLOOR, CEIL, SIGN):
        return (0.0, 0.0) if z_lo == z_hi else (-math.inf, math.inf)
    low, high = a_lo, a_hi  # the others are 1 over something
    if code == LOG:
        low = max(low, 0.0)
    elif code == LOG1P:
        low, high = add(max(low, -1.0), high, 1.0, 1.0)
    elif code == ATAN:
        low, high = sqr(low, high)
        low, high = add(low, high, 1.0, 1.0)
    else:
        low, high = sqr(low, high)
        low, high = sub(1.0, 1.0, low, high)
        low, high = sqrt(low, high)
        if code == ACOS:
            low, high = -high, -low
    return div(1.0, 1.0, low, high)


@compiled
def partials(
    code: int, n: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float, b_lo: float, b_hi: float
) -> Partials:
    """Enclosures of the partial derivatives; of abs, min and max generalised ones. z is the operation's value."""
    if code == MUL:
        return b_lo, b_hi, a_lo, a_hi
    if code == ADD:
        return 1.0, 1.0, 1.0, 1.0
    if code == SUB:
        return 1.0, 1.0, -1.0, -1.0
    low, high, b_low, b_high = 0.0, 0.0, 0.0, 0.0
    if code == SQR:
        low, high = min(2.0 * a_lo, FLOAT_MAX), max(2.0 * a_hi, -FLOAT_MAX)
    elif code == NEG:
        low, high = -1.0, -1.0
    elif code == SQRT:
        low, high = div(0.5, 0.5, z_lo, z_hi)
    elif code == DIV:
        low, high = div(1.0, 1.0, b_lo, b_hi)
        q_lo, q_hi = div(z_lo, z_hi, b_lo, b_hi)
        b_low, b_high = neg(q_lo, q_hi)
    elif code == POWER:
        low, high = _times_power(n, a_lo, a_hi)
    elif code == ABS:
        low, high = _sign(a_lo, a_hi)
    elif code == MIN:
        low, high = _share_of_smaller(a_lo, a_hi, b_lo, b_hi)
        b_low, b_high = 1.0 - high, 1.0 - low
    elif code == MAX:
        low, high = _share_of_smaller(-a_hi, -a_lo, -b_hi, -b_lo)
        b_low, b_high = 1.0 - high, 1.0 - low
    elif code == POW:
        low, high = sub(b_lo, b_hi, 1.0, 1.0)
        low, high = pow_real(a_lo, a_hi, low, high)
        low, high = mul(b_lo, b_hi, low, high)
        b_low, b_high = log(a_lo, a_hi)
        b_low, b_high = mul(z_lo, z_hi, b_low, b_high)
    elif code == ATAN2:
        return _of_angle(a_lo, a_hi, b_lo, b_hi)
    else:
        low, high = _of_function(code, z_lo, z_hi, a_lo, a_hi)
    return low, high, b_low, b_high


@compiled
def _power_slope(n: int, c_lo: float, c_hi: float, u_lo: float, u_hi: float) -> Bounds:
    """u^n - c^n = (u - c) sum_k u^k c^(n-1-k); for n < 0 that of -n, divided by -(u c)^-n."""
    if n == 0:
        return 0.0, 0.0
    m = abs(n)
    low, high = power(c_lo, c_hi, m - 1)
    for k in range(1, m):
        p_lo, p_hi = power(u_lo, u_hi, k)
        q_lo, q_hi = power(c_lo, c_hi, m - 1 - k)
        t_lo, t_hi = mul(p_lo, p_hi, q_lo, q_hi)
        low, high = add(low, high, t_lo, t_hi)
    if n > 0:
        h_lo, h_hi = hull(u_lo, u_hi, c_lo, c_hi)
        d_lo, d_hi = _times_power(n, h_lo, h_hi)
        return meet(low, high, d_lo, d_hi)
    p_lo, p_hi = power(u_lo, u_hi, m)
    q_lo, q_hi = power(c_lo, c_hi, m)
    t_lo, t_hi = mul(p_lo, p_hi, q_lo, q_hi)
    low, high = div(low, high, t_lo, t_hi)
    return -high, -low


@compiled
def _abs_slope(c_lo: float, c_hi: float, u_lo: float, u_hi: float) -> Bounds:
    """1 or -1 where u and c have one sign; else, for c > 0 > u, from (c - |u|) / (c + |u|) to 1: it grows in both."""
    if u_lo >= 0.0 and c_lo >= 0.0:
        return 1.0, 1.0
    if u_hi <= 0.0 and c_hi <= 0.0:
        return -1.0, -1.0
    flipped = c_hi < 0.0  # the slope of |.| between -u and -c is the opposite of that between u and c
    near = -c_hi if flipped else c_lo
    far = max(u_hi if flipped else -u_lo, 0.0)
    least = -1.0
    if 0.0 < near < math.inf and far < math.inf:
        over_lo, over_hi = sub(near, near, far, far)
        under_lo, under_hi = add(near, near, far, far)
        low, _ = div(over_lo, over_hi, under_lo, under_hi)
        least = max(low, -1.0)
    return (-1.0, -least) if flipped else (least, 1.0)


@compiled
def slopes(
    code: int,
    n: int,
    c: tuple[float, float, float, float, float, float],
    u: tuple[float, float, float, float, float, float],
) -> Partials:
    """Enclosures of the slopes from the centre to anywhere; c and u hold the bounds of value and arguments there."""
    if code == MUL:  # u v - u_c v_c = v (u - u_c) + u_c (v - v_c)
        return u[4], u[5], c[2], c[3]
    if code == SQR:
        low, high = add(u[2], u[3], c[2], c[3])
    elif code == SQRT:
        low, high = add(u[0], u[1], c[0], c[1])
        low, high = div(1.0, 1.0, low, high)
    elif code == DIV:  # u/v - q_c = ((u - u_c) - q_c (v - v_c)) / v with q_c = u_c/v_c
        low, high = div(1.0, 1.0, u[4], u[5])
        q_lo, q_hi = div(c[0], c[1], u[4], u[5])
        return low, high, -q_hi, -q_lo
    elif code == POWER:
        low, high = _power_slope(n, c[2], c[3], u[2], u[3])
    elif code == ABS:
        low, high = _abs_slope(c[2], c[3], u[2], u[3])
    else:
        z_lo, z_hi = hull(u[0], u[1], c[0], c[1])
        a_lo, a_hi = hull(u[2], u[3], c[2], c[3])
        b_lo, b_hi = hull(u[4], u[5], c[4], c[5])
        return partials(code, n, z_lo, z_hi, a_lo, a_hi, b_lo, b_hi)
    return low, high, 0.0, 0.0
