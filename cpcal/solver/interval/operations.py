"""The table of operations on intervals: what each means, where it is defined, and its inverse and derivatives.

Every operation on scalars has a code. `value` is its interval extension and `quality` says where it is defined and
continuous; `first_argument` and `second_argument` undo it, and `partials` and `slopes` are its derivatives. All are
compiled functions on pairs of bounds; `in_arithmetic` lets the same definitions compute with other primitives.
"""

from __future__ import annotations

import math
import re

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.functions import (
    ANGLES,
    PI,
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
from cpcal.solver.interval.kernels import (
    EMPTY,
    LINE,
    ONE,
    Arrays,
    Bounds,
    absolute,
    add,
    at,
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
    total,
)  # fmt: skip
from cpcal.solver.interval.kernels import MAX as LARGEST

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
def _function(code: int, a: Bounds, b: Bounds) -> Bounds:
    if code == EXP:
        return exp(a)
    if code == EXPM1:
        return expm1(a)
    if code == LOG:
        return log(a)
    if code == LOG1P:
        return log1p(a)
    if code == SIN:
        return sin(a)
    if code == COS:
        return cos(a)
    if code == TAN:
        return tan(a)
    if code == ASIN:
        return asin(a)
    if code == ACOS:
        return acos(a)
    if code == ATAN:
        return atan(a)
    if code == SINH:
        return sinh(a)
    if code == COSH:
        return cosh(a)
    if code == TANH:
        return tanh(a)
    if code == FLOOR:
        return floor(a)
    if code == CEIL:
        return ceil(a)
    if code == SIGN:
        return sign(a)
    if code == POW:
        return pow_real(a, b)
    if code == ATAN2:
        return atan2(a, b)
    return EMPTY


@compiled
def value(code: int, n: int, a: Bounds, b: Bounds) -> Bounds:
    """Enclosure of the operation over its arguments (b: the second, if there is one); n is a power's exponent."""
    if code == MUL:
        return mul(a, b)
    if code == ADD:
        return add(a, b)
    if code == SUB:
        return sub(a, b)
    if code == SQR:
        return sqr(a)
    if code == NEG:
        return neg(a)
    if code == SQRT:
        return sqrt(a)
    if code == DIV:
        return div(a, b)
    if code == POWER:
        return power(a, n)
    if code == ABS:
        return absolute(a)
    if code == MIN:
        return smaller(a, b)
    if code == MAX:
        return larger(a, b)
    return _function(code, a, b)


@compiled
def quality(code: int, n: int, a: Bounds, b: Bounds) -> int:
    """Whether the operation is CONTINUOUS at all points of its arguments, or at least DEFINED there, or ANYTHING."""
    if not (a[0] <= a[1] and b[0] <= b[1]):
        return ANYTHING
    known = True
    if code == SQRT:
        known = a[0] >= 0.0
    elif code == DIV:
        known = b[0] > 0.0 or b[1] < 0.0
    elif code == POWER:
        known = n >= 0 or a[0] > 0.0 or a[1] < 0.0
    elif code == LOG:
        known = a[0] > 0.0
    elif code == LOG1P:
        known = a[0] > -1.0
    elif code in (ASIN, ACOS):
        known = a[0] >= -1.0 and a[1] <= 1.0
    elif code == TAN:
        known = not has_pole(a)
    elif code == POW:
        known = a[0] > 0.0 or (a[0] == 0.0 and b[0] > 0.0)
    elif code == ATAN2:
        if b[1] < 0.0 and a[0] <= 0.0 <= a[1]:
            return DEFINED
        known = b[0] > 0.0 or a[0] > 0.0 or a[1] < 0.0
    elif code in (FLOOR, CEIL, SIGN):
        low, high = _function(code, a, b)
        return CONTINUOUS if low == high and a[0] < a[1] else DEFINED
    return CONTINUOUS if known else ANYTHING


# ------------------------------------------------------------------------------------------------------------------
# What is left of an operation's arguments where its result is known: the backward part of hc4.


@compiled
def either_sign(x: Bounds, r: Bounds) -> Bounds:
    """The part of x in r or in -r, as a hull (r >= 0)."""
    return hull(meet(x, r), meet(x, neg(r)))


@compiled
def _power_argument(n: int, z: Bounds, a: Bounds) -> Bounds:
    if n == 0:
        return a
    r = root(div(ONE, z) if n < 0 else z, abs(n))
    return r if n % 2 else either_sign(a, r)


@compiled
def _at_least(z: Bounds, other: Bounds) -> Bounds:
    """An argument of a minimum in z: at least z, and in z where the other argument can not be the minimum."""
    return z[0], z[1] if other[0] > z[1] else math.inf


@compiled
def _of_atan(z: Bounds) -> Bounds:
    low, high = meet(z, ANGLES)
    if not low <= high:
        return EMPTY
    least, most = min(low, 1.57079), max(high, -1.57079)
    low = -math.inf if least < -1.57079 else tan((least, least))[0]
    return low, math.inf if most > 1.57079 else tan((most, most))[1]


@compiled
def _of_function(code: int, z: Bounds, a: Bounds, b: Bounds) -> Bounds:
    """The first argument of an elementary function; of atan2 nothing is concluded."""
    if code == EXP:
        return log(z)
    if code == EXPM1:
        return log1p(z)
    if code == LOG:
        return exp(z)
    if code == LOG1P:
        return expm1(z)
    if code == SIN:
        return of_sine(z, a)
    if code == COS:
        return of_cosine(z, a)
    if code == TAN:
        return of_tangent(z, a)
    if code == ASIN:
        return sin(meet(z, ANGLES))
    if code == ACOS:
        return cos(meet(z, (0.0, PI[1])))
    if code == ATAN:
        return _of_atan(z)
    if code == SINH:
        return asinh(z)
    if code == COSH:
        r = acosh(z)
        return either_sign(a, (max(r[0], 0.0), r[1])) if r[0] <= r[1] else EMPTY
    if code == TANH:
        return atanh(z)
    if code == POW:
        return _base(z, b)
    if code == FLOOR:
        return ceil(z)[0], _next_whole(floor(z)[1])
    if code == CEIL:
        return -_next_whole(-ceil(z)[0]), floor(z)[1]
    if code == SIGN:
        return (0.0 if z[0] > -1.0 else -math.inf), (0.0 if z[1] < 1.0 else math.inf)
    return a


@compiled
def _next_whole(n: float) -> float:
    """At least n + 1, which beyond 2^53 no float equals."""
    return n + 1.0 if abs(n) < 4503599627370496.0 else sum_above(n, 1.0)


@compiled
def _base(z: Bounds, p: Bounds) -> Bounds:
    """x >= 0 with x^p in z: exp(log z / p), where p has a sign."""
    if z[1] < 0.0:
        return EMPTY
    if p[0] <= 0.0 <= p[1] or z[1] == 0.0:
        return 0.0, math.inf
    return exp(div(log((max(z[0], 0.0), z[1])), p))


@compiled
def first_argument(code: int, n: int, z: Bounds, a: Bounds, b: Bounds) -> Bounds:
    """A set that holds all points of a for which some point of b gives a result in z (to be intersected with a)."""
    if code == MUL:
        return factor(z, b, a)
    if code == ADD:
        return sub(z, b)
    if code == SUB:
        return add(z, b)
    if code == SQR:
        return either_sign(a, sqrt(z))
    if code == NEG:
        return neg(z)
    if code == SQRT:
        return sqr((max(z[0], 0.0), z[1]))
    if code == DIV:
        return mul(z, b)
    if code == POWER:
        return _power_argument(n, z, a)
    if code == ABS:
        return either_sign(a, (max(z[0], 0.0), z[1]))
    if code == MIN:
        return _at_least(z, b)
    if code == MAX:
        return neg(_at_least(neg(z), neg(b)))
    return _of_function(code, z, a, b)


@compiled
def second_argument(code: int, n: int, z: Bounds, a: Bounds, b: Bounds) -> Bounds:
    """The same for b."""
    if code in (MUL, ADD, MIN, MAX):  # neither argument is the first
        return first_argument(code, n, z, b, a)
    if code == SUB:
        return sub(a, z)
    if code == DIV:
        return factor(a, z, b)
    if code == POW and z[0] > 0.0 and (a[0] > 1.0 or 0.0 < a[1] < 1.0):
        return div(log(z), log(a))
    return b


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

Partials = tuple[Bounds, Bounds]  # the derivatives by the first and the second argument
Values = tuple[Bounds, Bounds, Bounds]  # of an operation and its arguments


@compiled
def _share_of_smaller(a: Bounds, b: Bounds) -> Partials:
    """Derivatives of min(a, b): of the smaller 1, of the other 0; [0, 1] for both where they overlap."""
    low, high = 1.0 if a[1] <= b[0] else 0.0, 0.0 if a[0] > b[1] else 1.0
    return (low, high), (1.0 - high, 1.0 - low)


@compiled
def _times_power(n: int, a: Bounds) -> Bounds:
    """n a^(n-1)"""
    if n == 0:
        return 0.0, 0.0
    return mul((float(n), float(n)), power(a, n - 1))


@compiled
def _of_angle(y: Bounds, x: Bounds) -> Partials:
    """x / (x^2 + y^2) and -y / (x^2 + y^2); nothing is known across the cut."""
    if not (x[0] > 0.0 or y[0] > 0.0 or y[1] < 0.0):
        return LINE, LINE
    square = add(sqr(x), sqr(y))
    return div(x, square), div(neg(y), square)


@compiled
def _derivative(code: int, n: int, z: Bounds, a: Bounds) -> Bounds:
    """Of an operation of one argument; the whole line where it jumps or has a pole."""
    if code == SQR:
        return min(2.0 * a[0], LARGEST), max(2.0 * a[1], -LARGEST)
    if code == NEG:
        return -1.0, -1.0
    if code == SQRT:
        return div((0.5, 0.5), z)
    if code == POWER:
        return _times_power(n, a)
    if code == ABS:
        return 1.0 if a[0] >= 0.0 and a[1] > 0.0 else -1.0, -1.0 if a[1] <= 0.0 and a[0] < 0.0 else 1.0
    if code == EXP:
        return z
    if code == EXPM1:
        return add(z, ONE)
    if code == LOG:
        return div(ONE, (max(a[0], 0.0), a[1]))
    if code == LOG1P:
        return div(ONE, add((max(a[0], -1.0), a[1]), ONE))
    if code == SIN:
        return cos(a)
    if code == COS:
        return neg(sin(a))
    if code == TAN:
        return LINE if has_pole(a) else add(sqr(z), ONE)
    if code == ASIN:
        return div(ONE, sqrt(sub(ONE, sqr(a))))
    if code == ACOS:
        return div(ONE, neg(sqrt(sub(ONE, sqr(a)))))
    if code == ATAN:
        return div(ONE, add(sqr(a), ONE))
    if code == SINH:
        return cosh(a)
    if code == COSH:
        return sinh(a)
    if code == TANH:
        return sub(ONE, sqr(z))
    return (0.0, 0.0) if z[0] == z[1] else LINE  # floor, ceil and sign


@compiled
def partials(code: int, n: int, z: Bounds, a: Bounds, b: Bounds) -> Partials:
    """Enclosures of the partial derivatives; of abs, min and max generalised ones. z is the operation's value."""
    if code == MUL:
        return b, a
    if code == ADD:
        return ONE, ONE
    if code == SUB:
        return ONE, (-1.0, -1.0)
    if code == DIV:
        return div(ONE, b), neg(div(z, b))
    if code == MIN:
        return _share_of_smaller(a, b)
    if code == MAX:
        return _share_of_smaller(neg(a), neg(b))
    if code == POW:
        return mul(b, pow_real(a, sub(b, ONE))), mul(z, log(a))
    if code == ATAN2:
        return _of_angle(a, b)
    return _derivative(code, n, z, a), (0.0, 0.0)


@compiled
def _power_slope(n: int, c: Bounds, u: Bounds) -> Bounds:
    """u^n - c^n = (u - c) sum_k u^k c^(n-1-k); for n < 0 that of -n, divided by -(u c)^-n."""
    if n == 0:
        return 0.0, 0.0
    m = abs(n)
    out = power(c, m - 1)
    for k in range(1, m):
        out = add(out, mul(power(u, k), power(c, m - 1 - k)))
    if n > 0:
        return meet(out, _times_power(n, hull(u, c)))
    return neg(div(out, mul(power(u, m), power(c, m))))


@compiled
def _abs_slope(c: Bounds, u: Bounds) -> Bounds:
    """1 or -1 where u and c have one sign; else, for c > 0 > u, from (c - |u|) / (c + |u|) to 1: it grows in both."""
    if u[0] >= 0.0 and c[0] >= 0.0:
        return ONE
    if u[1] <= 0.0 and c[1] <= 0.0:
        return -1.0, -1.0
    flipped = c[1] < 0.0  # the slope of |.| between -u and -c is the opposite of that between u and c
    near = -c[1] if flipped else c[0]
    far = max(u[1] if flipped else -u[0], 0.0)
    least = -1.0
    if 0.0 < near < math.inf and far < math.inf:
        least = max(div(sub((near, near), (far, far)), add((near, near), (far, far)))[0], -1.0)
    return (-1.0, -least) if flipped else (least, 1.0)


@compiled
def slopes(code: int, n: int, c: Values, u: Values) -> Partials:
    """Enclosures of the slopes from the centre to anywhere; c and u hold value and arguments there."""
    if code == MUL:  # u v - u_c v_c = v (u - u_c) + u_c (v - v_c)
        return u[2], c[1]
    if code == DIV:  # u/v - q_c = ((u - u_c) - q_c (v - v_c)) / v with q_c = u_c/v_c
        return div(ONE, u[2]), neg(div(c[0], u[2]))
    if code == SQR:
        return add(u[1], c[1]), (0.0, 0.0)
    if code == SQRT:
        return div(ONE, add(u[0], c[0])), (0.0, 0.0)
    if code == POWER:
        return _power_slope(n, c[1], u[1]), (0.0, 0.0)
    if code == ABS:
        return _abs_slope(c[1], u[1]), (0.0, 0.0)
    return partials(code, n, hull(u[0], c[0]), hull(u[1], c[1]), hull(u[2], c[2]))


# ------------------------------------------------------------------------------------------------------------------
# The same on arrays: one loop for each shape of operation.


@compiled
def elementwise(code: int, n: int, a: Arrays, b: Arrays, out: Arrays) -> None:
    for k in range(out[0].size):
        out[0][k], out[1][k] = value(code, n, at(a, k), at(b, k))


@compiled
def totals(x: Arrays, out: Arrays) -> None:
    """Sums of the rows (m, n)."""
    for k in range(out[0].size):
        out[0][k], out[1][k] = total((x[0][k], x[1][k]))


@compiled
def products(x: Arrays, y: Arrays, out: Arrays) -> None:
    """A product of matrices (m, k) and (k, n)."""
    low, high = x[0][0].copy(), x[0][0].copy()
    for i in range(out[0].shape[0]):
        for j in range(out[0].shape[1]):
            for t in range(low.size):
                low[t], high[t] = mul(at(x, (i, t)), at(y, (t, j)))
            out[0][i, j], out[1][i, j] = total((low, high))
