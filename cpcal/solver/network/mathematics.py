"""Elementary functions of expressions, element by element."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.solver.interval import IntervalArray
from cpcal.solver.network.expression import SELECTS, Expr, Operand, Shape, as_expr, binary

_LARGEST = 2**31  # of a whole exponent


def _named(op: str, meaning: str) -> Callable[[Operand], Expr]:
    def function(x: Operand) -> Expr:
        arg = as_expr(x)
        return Expr(op, (arg,), arg.shape)

    function.__name__ = function.__qualname__ = op
    function.__doc__ = meaning
    return function


sqr = _named("sqr", "Square (tighter than `x * x` over intervals).")
sqrt = _named("sqrt", "Square root, defined where the argument is not negative.")
exp = _named("exp", "e to the power of x.")
expm1 = _named("expm1", "exp(x) - 1, exact to the last places near 0.")
log = _named("log", "Natural logarithm, defined where x > 0.")
log1p = _named("log1p", "log(1 + x), defined where x > -1.")
sin = _named("sin", "Sine of an angle in radians.")
cos = _named("cos", "Cosine of an angle in radians.")
tan = _named("tan", "Tangent of an angle in radians, defined between its poles.")
asin = _named("asin", "Angle in [-pi/2, pi/2] of a sine, defined on [-1, 1].")
acos = _named("acos", "Angle in [0, pi] of a cosine, defined on [-1, 1].")
atan = _named("atan", "Angle in (-pi/2, pi/2) of a tangent.")
sinh = _named("sinh", "Hyperbolic sine.")
cosh = _named("cosh", "Hyperbolic cosine.")
tanh = _named("tanh", "Hyperbolic tangent.")
floor = _named("floor", "The greatest integer that is at most x.")
ceil = _named("ceil", "The least integer that is at least x.")
sign = _named("sign", "-1, 0 or 1.")


def norm(x: Operand) -> Expr:
    """Euclidean length along the last axis."""
    return sqrt(sqr(x).sum(-1))


def minimum(x: Operand, y: Operand) -> Expr:
    """The smaller of two, element by element."""
    return binary("min", x, y)


def maximum(x: Operand, y: Operand) -> Expr:
    """The larger of two, element by element."""
    return binary("max", x, y)


def atan2(y: Operand, x: Operand) -> Expr:
    """Angle of the point (x, y), in (-pi, pi]."""
    return binary("atan2", y, x)


def hypot(x: Operand, y: Operand) -> Expr:
    """Length of the vector (x, y)."""
    return sqrt(sqr(x) + sqr(y))


def power(x: Operand, exponent: Operand) -> Expr:
    """`x ** exponent`: products for a whole number, roots for a half, else exp(exponent log(x)), defined where x > 0.

    (0 to a positive power is 0.) Each element of an array of exponents means its own power.
    """
    base = as_expr(x)
    try:
        other = as_expr(exponent)
        shape = np.broadcast_shapes(base.shape, other.shape)
    except (ModelError, ValueError) as error:
        raise ModelError(f"{exponent!r} is no exponent: {error}") from None
    values = np.full(shape, np.nan)
    if isinstance(other.data, IntervalArray):  # a constant or reading: its elements that are one number
        values[...] = np.where(other.data.lo == other.data.hi, other.data.lo, np.nan)
    values = np.where((values == np.rint(values)) | (values == 0.5), values, np.nan)
    if np.any(np.abs(values) >= _LARGEST):
        raise ModelError(f"{exponent!r} is no exponent: whole ones are less than 2^31")
    parts = [(_to_the(base, float(value)), values == value) for value in np.unique(values[~np.isnan(values)])]
    if np.isnan(values).any():
        parts.append((binary("pow", base, other), np.isnan(values)))
    if len(parts) == 1:
        return _spread(parts[0][0], shape)
    chosen = [
        Expr("mul", (_spread(part, shape), as_expr(mine.astype(np.float64))), shape, parameter=SELECTS)
        for part, mine in parts
    ]
    return reduce(lambda one, two: one + two, chosen)


def _to_the(base: Expr, value: float) -> Expr:
    """A whole power, or the square root."""
    if value == 0.5:
        return sqrt(base)
    return sqr(base) if value == 2.0 else Expr("power", (base,), base.shape, parameter=int(value))


def _spread(expr: Expr, shape: Shape) -> Expr:
    """Broadcast."""
    if expr.shape == shape:
        return expr
    return expr.reshape(-1)[np.broadcast_to(np.arange(math.prod(expr.shape)).reshape(expr.shape), shape)]


# ------------------------------------------------------------------------------------------------------------------
# Rotation matrices (3, 3) as expressions: building blocks of networks, from quaternions, axes, vectors and angles.
#
# A point p of the turned frame is `matrix @ p` in the fixed one. Angles in radians, quaternions scalar first.

_CROSS = np.zeros((3, 3, 3))  # (i, j, k): the part of v_k in row i and column j of the matrix of `v x`
_CROSS[0, 1, 2] = _CROSS[1, 2, 0] = _CROSS[2, 0, 1] = -1.0
_CROSS[0, 2, 1] = _CROSS[1, 0, 2] = _CROSS[2, 1, 0] = 1.0


def rotation_from_quaternion(q: Operand) -> Expr:
    """Of a quaternion (4,), w first, of any length but 0: its rational matrix divided by |q|^2."""
    q = _vector(q, 4)
    w, v = q[0], q[1:]
    size = sqr(q).sum()
    square = sqr(w) - sqr(v).sum()
    return (_scaled_identity(square) + 2.0 * _outer(v) + 2.0 * w * _cross(v)) / size


def rotation_from_axis(axis: Operand, angle: Operand) -> Expr:
    """About a unit vector (3,) by an angle (Rodrigues). That the axis has length 1 is for the network to say."""
    n, t = _vector(axis, 3), as_expr(angle)
    return _scaled_identity(cos(t)) + sin(t) * _cross(n) + (1.0 - cos(t)) * _outer(n)


def rotation_from_vector(vector: Operand) -> Expr:
    """Of a rotation vector (3,), axis times angle; defined where it is not 0."""
    v = _vector(vector, 3)
    angle = norm(v)
    return rotation_from_axis(v / angle, angle)


def rotation_from_euler(sequence: str, angles: Operand) -> Expr:
    """Of three angles (3,) in the order of the letters: small ones turn about the fixed axes, capitals about the
    turned ones, as in scipy. Raises ModelError for other letters.
    """
    a = _vector(angles, 3)
    if len(sequence) != 3 or sequence not in (sequence.lower(), sequence.upper()) or set(sequence.lower()) - set("xyz"):
        raise ModelError(f"{sequence!r} is no sequence of axes: give three of x, y, z, all small or all capitals")
    one, two, three = (rotation_from_axis(np.eye(3)["xyz".index(s)], a[k]) for k, s in enumerate(sequence.lower()))
    return one @ two @ three if sequence.isupper() else three @ two @ one


def _vector(value: Operand, size: int) -> Expr:
    found = as_expr(value)
    if found.shape != (size,):
        raise ModelError(f"{size} numbers are needed here, not an array of shape {found.shape}")
    return found


def _scaled_identity(factor: Expr) -> Expr:
    return factor * as_expr(np.eye(3))


def _outer(v: Expr) -> Expr:
    return v[:, None] * v[None, :]


def _cross(v: Expr) -> Expr:
    """The matrix of `v x`."""
    return (v * _CROSS).sum(-1)
