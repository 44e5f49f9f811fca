"""The table of operations on intervals: what each means, where it is defined, and its inverse and derivatives.

Every operation on scalars has a code. `value` is its interval extension and `continuous` says where it is defined and
continuous; `first_argument` and `second_argument` undo it, and `partials` are its derivatives. All are compiled
functions on pairs of bounds.
"""

import math

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.functions import (
    ANGLES,
    PIO2,
    asin,
    atan,
    atan2,
    cos,
    exp,
    has_pole,
    log,
    of_sine,
    of_tangent,
    sin,
    tan,
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
    div,
    factor,
    hull,
    larger,
    meet,
    mul,
    neg,
    power,
    root,
    smaller,
    sqr,
    sqrt,
    sub,
    total,
)  # fmt: skip
from cpcal.solver.interval.kernels import MAX as LARGEST

NEG, ADD, SUB, MUL, DIV, SQR, SQRT, POWER, ABS, MIN, MAX = range(11)
EXP, LOG, SIN, COS, TAN, ASIN, ATAN, ATAN2 = range(11, 19)

_NAMES = (
    *("neg", "add", "sub", "mul", "div", "sqr", "sqrt", "power", "abs", "min", "max"),
    *("exp", "log", "sin", "cos", "tan", "asin", "atan", "atan2"),
)
CODES = {name: code for code, name in enumerate(_NAMES)}


@compiled
def _function(code: int, a: Bounds, b: Bounds) -> Bounds:
    if code == EXP:
        return exp(a)
    if code == LOG:
        return log(a)
    if code == SIN:
        return sin(a)
    if code == COS:
        return cos(a)
    if code == TAN:
        return tan(a)
    if code == ASIN:
        return asin(a)
    if code == ATAN:
        return atan(a)
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
def continuous(code: int, n: int, a: Bounds, b: Bounds) -> bool:
    """Whether the operation is defined and continuous at all points of its arguments."""
    if not (a[0] <= a[1] and b[0] <= b[1]):
        return False
    known = True
    if code == SQRT:
        known = a[0] >= 0.0
    elif code == DIV:
        known = b[0] > 0.0 or b[1] < 0.0
    elif code == POWER:
        known = n >= 0 or a[0] > 0.0 or a[1] < 0.0
    elif code == LOG:
        known = a[0] > 0.0
    elif code == ASIN:
        known = a[0] >= -1.0 and a[1] <= 1.0
    elif code == TAN:
        known = not has_pole(a)
    elif code == ATAN2:
        known = b[0] > 0.0 or a[0] > 0.0 or a[1] < 0.0
    return known


# ------------------------------------------------------------------------------------------------------------------
# What is left of an operation's arguments where its result is known: the backward part of hc4.


@compiled
def either_sign(x: Bounds, r: Bounds) -> Bounds:
    """The part of x in r or in -r, as a hull (r >= 0)."""
    return hull(meet(x, r), meet(x, neg(r)))


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
    if code == LOG:
        return exp(z)
    if code == SIN:
        return of_sine(z, a)
    if code == COS:
        return sub(of_sine(z, add(a, PIO2)), PIO2)  # cos x = sin(x + pi/2)
    if code == TAN:
        return of_tangent(z, a)
    if code == ASIN:
        return sin(meet(z, ANGLES))
    if code == ATAN:
        return _of_atan(z)
    return a


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
    if code == POWER and n != 0:  # of x^0 nothing is concluded
        r = root(div(ONE, z) if n < 0 else z, abs(n))
        return r if n % 2 else either_sign(a, r)
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
    return b


# ------------------------------------------------------------------------------------------------------------------
# Partial derivatives of operations.

Partials = tuple[Bounds, Bounds]  # the derivatives by the first and the second argument


@compiled
def _share_of_smaller(a: Bounds, b: Bounds) -> Partials:
    """Derivatives of min(a, b): of the smaller 1, of the other 0; [0, 1] for both where they overlap."""
    low, high = 1.0 if a[1] <= b[0] else 0.0, 0.0 if a[0] > b[1] else 1.0
    return (low, high), (1.0 - high, 1.0 - low)


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
        return mul((float(n), float(n)), power(a, n - 1)) if n != 0 else (0.0, 0.0)
    if code == ABS:
        return 1.0 if a[0] >= 0.0 and a[1] > 0.0 else -1.0, -1.0 if a[1] <= 0.0 and a[0] < 0.0 else 1.0
    if code == EXP:
        return z
    if code == LOG:
        return div(ONE, (max(a[0], 0.0), a[1]))
    if code == SIN:
        return cos(a)
    if code == COS:
        return neg(sin(a))
    if code == TAN:
        return LINE if has_pole(a) else add(sqr(z), ONE)
    if code == ASIN:
        return div(ONE, sqrt(sub(ONE, sqr(a))))
    if code == ATAN:
        return div(ONE, add(sqr(a), ONE))
    return LINE


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
    if code == ATAN2:
        return _of_angle(a, b)
    return _derivative(code, n, z, a), (0.0, 0.0)


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
