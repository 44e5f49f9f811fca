"""What is left of an operation's arguments where its result is known: the backward part of hc4."""

from __future__ import annotations

import math

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.elementary import PI_HI, PIO2_HI
from cpcal.solver.interval.functions import (
    acosh,
    asinh,
    atanh,
    cos,
    exp,
    expm1,
    log,
    log1p,
    of_cosine,
    of_sine,
    of_tangent,
    sin,
    tan,
)
from cpcal.solver.interval.kernels import (
    Bounds,
    add,
    ceil,
    div,
    factor,
    floor,
    hull,
    meet,
    mul,
    neg,
    root,
    sqr,
    sqrt,
    sub,
    sum_above,
)
from cpcal.solver.network.operations import (
    ABS,
    ACOS,
    ADD,
    ASIN,
    ATAN,
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


@compiled
def either_sign(x_lo: float, x_hi: float, r_lo: float, r_hi: float) -> Bounds:
    """The part of x in r or in -r, as a hull (r >= 0)."""
    one_lo, one_hi = meet(x_lo, x_hi, r_lo, r_hi)
    two_lo, two_hi = meet(x_lo, x_hi, -r_hi, -r_lo)
    return hull(one_lo, one_hi, two_lo, two_hi)


@compiled
def _power_argument(n: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float) -> Bounds:
    if n == 0:
        return a_lo, a_hi
    if n < 0:
        z_lo, z_hi = div(1.0, 1.0, z_lo, z_hi)
        n = -n
    r_lo, r_hi = root(z_lo, z_hi, n)
    return (r_lo, r_hi) if n % 2 else either_sign(a_lo, a_hi, r_lo, r_hi)


@compiled
def _at_least(z_lo: float, z_hi: float, other_lo: float) -> Bounds:
    """An argument of a minimum in z: at least z, and in z where the other argument can not be the minimum."""
    return z_lo, z_hi if other_lo > z_hi else math.inf


@compiled
def _of_function(code: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """The first argument of an elementary function; of atan2 nothing is concluded."""
    if code == EXP:
        return log(z_lo, z_hi)
    if code == EXPM1:
        return log1p(z_lo, z_hi)
    if code == LOG:
        return exp(z_lo, z_hi)
    if code == LOG1P:
        return expm1(z_lo, z_hi)
    if code == SIN:
        return of_sine(z_lo, z_hi, a_lo, a_hi)
    if code == COS:
        return of_cosine(z_lo, z_hi, a_lo, a_hi)
    if code == TAN:
        return of_tangent(z_lo, z_hi, a_lo, a_hi)
    if code == ASIN:
        z_lo, z_hi = meet(z_lo, z_hi, -PIO2_HI, PIO2_HI)
        return sin(z_lo, z_hi)
    if code == ACOS:
        z_lo, z_hi = meet(z_lo, z_hi, 0.0, PI_HI)
        return cos(z_lo, z_hi)
    if code == ATAN:
        z_lo, z_hi = meet(z_lo, z_hi, -PIO2_HI, PIO2_HI)
        if not z_lo <= z_hi:
            return math.nan, math.nan
        least, most = min(z_lo, 1.57079), max(z_hi, -1.57079)
        return -math.inf if least < -1.57079 else tan(least, least)[0], math.inf if most > 1.57079 else tan(most, most)[
            1
        ]
    if code == SINH:
        return asinh(z_lo, z_hi)
    if code == COSH:
        r_lo, r_hi = acosh(z_lo, z_hi)
        return either_sign(a_lo, a_hi, max(r_lo, 0.0), r_hi) if r_lo <= r_hi else (math.nan, math.nan)
    if code == TANH:
        return atanh(z_lo, z_hi)
    if code == POW:
        return _base(z_lo, z_hi, b_lo, b_hi)
    if code == FLOOR:
        return ceil(z_lo, z_hi)[0], _next_whole(floor(z_lo, z_hi)[1])
    if code == CEIL:
        return -_next_whole(-ceil(z_lo, z_hi)[0]), floor(z_lo, z_hi)[1]
    if code == SIGN:
        return (0.0 if z_lo > -1.0 else -math.inf), (0.0 if z_hi < 1.0 else math.inf)
    return a_lo, a_hi


@compiled
def _next_whole(n: float) -> float:
    """At least n + 1, which beyond 2^53 no float equals."""
    return n + 1.0 if abs(n) < 4503599627370496.0 else sum_above(n, 1.0)


@compiled
def _base(z_lo: float, z_hi: float, p_lo: float, p_hi: float) -> Bounds:
    """x >= 0 with x^p in z: exp(log z / p), where p has a sign."""
    if z_hi < 0.0:
        return math.nan, math.nan
    if p_lo <= 0.0 <= p_hi or z_hi == 0.0:
        return 0.0, math.inf
    low, high = log(max(z_lo, 0.0), z_hi)
    low, high = div(low, high, p_lo, p_hi)
    return exp(low, high)


@compiled
def first_argument(
    code: int, n: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float, b_lo: float, b_hi: float
) -> Bounds:
    """A set that holds all points of a for which some point of b gives a result in z (to be intersected with a)."""
    if code == MUL:
        return factor(z_lo, z_hi, b_lo, b_hi, a_lo, a_hi)
    if code == ADD:
        return sub(z_lo, z_hi, b_lo, b_hi)
    if code == SUB:
        return add(z_lo, z_hi, b_lo, b_hi)
    if code == SQR:
        r_lo, r_hi = sqrt(z_lo, z_hi)
        return either_sign(a_lo, a_hi, r_lo, r_hi)
    if code == NEG:
        return neg(z_lo, z_hi)
    if code == SQRT:
        return sqr(max(z_lo, 0.0), z_hi)
    if code == DIV:
        return mul(z_lo, z_hi, b_lo, b_hi)
    if code == POWER:
        return _power_argument(n, z_lo, z_hi, a_lo, a_hi)
    if code == ABS:
        return either_sign(a_lo, a_hi, max(z_lo, 0.0), z_hi)
    if code == MIN:
        return _at_least(z_lo, z_hi, b_lo)
    if code == MAX:
        low, high = _at_least(-z_hi, -z_lo, -b_hi)
        return -high, -low
    return _of_function(code, z_lo, z_hi, a_lo, a_hi, b_lo, b_hi)


@compiled
def second_argument(
    code: int, n: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float, b_lo: float, b_hi: float
) -> Bounds:
    """The same for b."""
    if code == MUL:
        return factor(z_lo, z_hi, a_lo, a_hi, b_lo, b_hi)
    if code == ADD:
        return sub(z_lo, z_hi, a_lo, a_hi)
    if code == SUB:
        return sub(a_lo, a_hi, z_lo, z_hi)
    if code == DIV:
        return factor(a_lo, a_hi, z_lo, z_hi, b_lo, b_hi)
    if code == MIN:
        return _at_least(z_lo, z_hi, a_lo)
    if code == MAX:
        low, high = _at_least(-z_hi, -z_lo, -a_hi)
        return -high, -low
    if code == POW and z_lo > 0.0 and (a_lo > 1.0 or 0.0 < a_hi < 1.0):
        low, high = log(z_lo, z_hi)
        u_lo, u_hi = log(a_lo, a_hi)
        return div(low, high, u_lo, u_hi)
    return b_lo, b_hi
