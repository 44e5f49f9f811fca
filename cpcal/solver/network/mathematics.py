"""Elementary functions of expressions, element by element."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.solver.network.expression import Expr, Operand, as_expr, binary


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


def power(x: Operand, exponent: object) -> Expr:
    """`x ** exponent`: products for an integer, roots for a half, else exp(exponent log(x)), defined where x > 0.

    (0 to a positive power is 0.)
    """
    base = as_expr(x)
    if isinstance(exponent, (int, np.integer)) and not isinstance(exponent, bool):
        return sqr(base) if exponent == 2 else Expr("power", (base,), base.shape, parameter=int(exponent))
    if isinstance(exponent, (float, np.floating)):
        number = float(exponent)
        if number.is_integer() and abs(number) < 2**31:
            return power(base, int(number))
        if number == 0.5:
            return sqrt(base)
    try:
        return binary("pow", base, as_expr(exponent))  # type: ignore[arg-type]  # it says what it takes
    except ModelError as error:
        raise ModelError(f"{exponent!r} is no exponent: {error}") from None
