"""The table of operations on intervals: what each means, where it is defined, and its inverse and derivatives.

Every operation on scalars has a code. `value` is its interval extension and `quality` says where it is defined and
continuous; `first_argument` and `second_argument` undo it, and `partials` and `slopes` are its derivatives. All are
compiled functions on bounds; `in_arithmetic` lets the same definitions compute with other primitives.
"""

from __future__ import annotations

import math
import re

from cpcal.common.values import Floats
from cpcal.solver.compiled import compiled
from cpcal.solver.interval.elementary import PI_HI, PIO2_HI
from cpcal.solver.interval.functions import (
    acos,
    acosh,
    asin,
    asinh,
    atan,
    atan2,
    atanh,
    cos,
    cosh,
    exp,
    expm1,
    has_pole,
    log,
    log1p,
    of_cosine,
    of_sine,
    of_tangent,
    pow_real,
    sin,
    sinh,
    tan,
    tanh,
)  # fmt: skip
from cpcal.solver.interval.kernels import MAX as LARGEST
from cpcal.solver.interval.kernels import (
    Bounds,
    absolute,
    add,
    ceil,
    div,
    factor,
    floor,
    hull,
    larger,
    meet,
    mul,
    neg,
    power,
    root,
    sign,
    smaller,
    sqr,
    sqrt,
    sub,
    sum_above,
    total_above,
    total_below,
)  # fmt: skip

NEG, ADD, SUB, MUL, DIV, SQR, SQRT, POWER, ABS, MIN, MAX = range(11)
EXP, EXPM1, LOG, LOG1P, SIN, COS, TAN, ASIN, ACOS, ATAN, SINH, COSH, TANH, POW, ATAN2, FLOOR, CEIL, SIGN = range(11, 29)

# What is known of an operation on all points of its arguments, as the decorations of IEEE 1788.
ANYTHING, DEFINED, CONTINUOUS = range(3)
_NAMES = """
    neg add sub mul div sqr sqrt power abs min max
    exp expm1 log log1p sin cos tan asin acos atan sinh cosh tanh pow atan2 floor ceil sign
"""
CODES = {name: code for code, name in enumerate(re.findall(r"\w+", _NAMES))}
BINARY = frozenset(("add", "sub", "mul", "div", "min", "max", "pow", "atan2"))


@compiled
def _function(code: int, a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    if code == EXP:
        return exp(a_lo, a_hi)
    if code == EXPM1:
        return expm1(a_lo, a_hi)
    if code == LOG:
        return log(a_lo, a_hi)
    if code == LOG1P:
        return log1p(a_lo, a_hi)
    if code == SIN:
        return sin(a_lo, a_hi)
    if code == COS:
        return cos(a_lo, a_hi)
    if code == TAN:
        return tan(a_lo, a_hi)
    if code == ASIN:
        return asin(a_lo, a_hi)
    if code == ACOS:
        return acos(a_lo, a_hi)
    if code == ATAN:
        return atan(a_lo, a_hi)
    if code == SINH:
        return sinh(a_lo, a_hi)
    if code == COSH:
        return cosh(a_lo, a_hi)
    if code == TANH:
        return tanh(a_lo, a_hi)
    if code == FLOOR:
        return floor(a_lo, a_hi)
    if code == CEIL:
        return ceil(a_lo, a_hi)
    if code == SIGN:
        return sign(a_lo, a_hi)
    if code == POW:
        return pow_real(a_lo, a_hi, b_lo, b_hi)
    if code == ATAN2:
        return atan2(a_lo, a_hi, b_lo, b_hi)
    return math.nan, math.nan


@compiled
def value(code: int, n: int, a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """Enclosure of the operation over its arguments (b: the second, if there is one); n is a power's exponent."""
    if code == MUL:
        return mul(a_lo, a_hi, b_lo, b_hi)
    if code == ADD:
        return add(a_lo, a_hi, b_lo, b_hi)
    if code == SUB:
        return sub(a_lo, a_hi, b_lo, b_hi)
    if code == SQR:
        return sqr(a_lo, a_hi)
    if code == NEG:
        return neg(a_lo, a_hi)
    if code == SQRT:
        return sqrt(a_lo, a_hi)
    if code == DIV:
        return div(a_lo, a_hi, b_lo, b_hi)
    if code == POWER:
        return power(a_lo, a_hi, n)
    if code == ABS:
        return absolute(a_lo, a_hi)
    if code == MIN:
        return smaller(a_lo, a_hi, b_lo, b_hi)
    if code == MAX:
        return larger(a_lo, a_hi, b_lo, b_hi)
    return _function(code, a_lo, a_hi, b_lo, b_hi)


@compiled
def _function_quality(code: int, a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> int:
    if code == LOG:
        return CONTINUOUS if a_lo > 0.0 else ANYTHING
    if code == LOG1P:
        return CONTINUOUS if a_lo > -1.0 else ANYTHING
    if code in (ASIN, ACOS):
        return CONTINUOUS if a_lo >= -1.0 and a_hi <= 1.0 else ANYTHING
    if code == TAN:
        return ANYTHING if has_pole(a_lo, a_hi) else CONTINUOUS
    if code == POW:
        return CONTINUOUS if a_lo > 0.0 or (a_lo == 0.0 and b_lo > 0.0) else ANYTHING
    if code == ATAN2:
        if b_lo > 0.0 or a_lo > 0.0 or a_hi < 0.0:
            return CONTINUOUS
        return DEFINED if b_hi < 0.0 else ANYTHING
    if code in (FLOOR, CEIL, SIGN):
        low, high = _function(code, a_lo, a_hi, b_lo, b_hi)
        return CONTINUOUS if low == high and a_lo < a_hi else DEFINED
    return CONTINUOUS


@compiled
def quality(code: int, n: int, a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> int:
    """Whether the operation is CONTINUOUS at all points of its arguments, or at least DEFINED there, or ANYTHING."""
    if not (a_lo <= a_hi and b_lo <= b_hi):
        return ANYTHING
    if code == SQRT:
        return CONTINUOUS if a_lo >= 0.0 else ANYTHING
    if code == DIV:
        return CONTINUOUS if b_lo > 0.0 or b_hi < 0.0 else ANYTHING
    if code == POWER:
        return CONTINUOUS if n >= 0 or a_lo > 0.0 or a_hi < 0.0 else ANYTHING
    if code > MAX:
        return _function_quality(code, a_lo, a_hi, b_lo, b_hi)
    return CONTINUOUS


# ------------------------------------------------------------------------------------------------------------------
# What is left of an operation's arguments where its result is known: the backward part of hc4.


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
    if code in (MUL, ADD, MIN, MAX):  # neither argument is the first
        return first_argument(code, n, z_lo, z_hi, b_lo, b_hi, a_lo, a_hi)
    if code == SUB:
        return sub(a_lo, a_hi, z_lo, z_hi)
    if code == DIV:
        return factor(a_lo, a_hi, z_lo, z_hi, b_lo, b_hi)
    if code == POW and z_lo > 0.0 and (a_lo > 1.0 or 0.0 < a_hi < 1.0):
        low, high = log(z_lo, z_hi)
        u_lo, u_hi = log(a_lo, a_hi)
        return div(low, high, u_lo, u_hi)
    return b_lo, b_hi


# ------------------------------------------------------------------------------------------------------------------
# Partial derivatives of operations, and their slopes.
#
# What the derivative is to the mean value form, the slope is to the slope form. For an operation phi with arguments
# u(c) at a centre c and u(x) anywhere, numbers p_j with
#
#     phi(u(x)) - phi(u(c)) = sum_j p_j (u_j(x) - u_j(c))                       (Krawczyk and Neumaier)
#
# are enclosed. That is algebra, not calculus: it holds wherever both sides are defined, next to poles and kinks, and
# the enclosure is about half as wide as that of the derivative. Operations without a slope of their own use their
# derivative over the hull of both values: it holds all such slopes.

Partials = tuple[float, float, float, float]  # bounds of the derivatives by the first and the second argument


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
def _derivative(code: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float) -> Bounds:
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
        low, high = min(2.0 * a_lo, LARGEST), max(2.0 * a_hi, -LARGEST)
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
        low, high = 1.0 if a_lo >= 0.0 and a_hi > 0.0 else -1.0, -1.0 if a_hi <= 0.0 and a_lo < 0.0 else 1.0
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
        low, high = _derivative(code, z_lo, z_hi, a_lo, a_hi)
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


# ------------------------------------------------------------------------------------------------------------------
# The same on arrays: one loop for each shape of operation.


@compiled
def elementwise(
    code: int, n: int, a_lo: Floats, a_hi: Floats, b_lo: Floats, b_hi: Floats, lo: Floats, hi: Floats
) -> None:
    for k in range(lo.size):
        lo[k], hi[k] = value(code, n, a_lo[k], a_hi[k], b_lo[k], b_hi[k])


@compiled
def factors(
    z_lo: Floats, z_hi: Floats, y_lo: Floats, y_hi: Floats, x_lo: Floats, x_hi: Floats, lo: Floats, hi: Floats
) -> None:
    for k in range(lo.size):
        lo[k], hi[k] = factor(z_lo[k], z_hi[k], y_lo[k], y_hi[k], x_lo[k], x_hi[k])


@compiled
def totals(x_lo: Floats, x_hi: Floats, lo: Floats, hi: Floats) -> None:
    """Sums of the rows (m, n)."""
    for k in range(lo.size):
        lo[k], hi[k] = total_below(x_lo[k]), total_above(x_hi[k])


@compiled
def products(x_lo: Floats, x_hi: Floats, y_lo: Floats, y_hi: Floats, lo: Floats, hi: Floats) -> None:
    """A product of matrices (m, k) and (k, n)."""
    low, high = x_lo[0].copy(), x_lo[0].copy()
    for i in range(lo.shape[0]):
        for j in range(lo.shape[1]):
            for t in range(low.size):
                low[t], high[t] = mul(x_lo[i, t], x_hi[i, t], y_lo[t, j], y_hi[t, j])
            lo[i, j], hi[i, j] = total_below(low), total_above(high)
