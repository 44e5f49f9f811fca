"""Elementary functions of expressions, element by element."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import Any

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
# numpy's functions on expressions: `np.sin(x)`, `np.linalg.norm(x)`, `np.stack([x, y])` give expressions again.

_Function = Callable[..., Any]


def _operated(operate: _Function, x: Operand, y: Operand) -> Any:
    return operate(as_expr(x), y)


_OPERATORS: dict[str, _Function] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "power": operator.pow,
    "float_power": operator.pow,
    "matmul": operator.matmul,
    "equal": operator.eq,
    "less_equal": operator.le,
    "greater_equal": operator.ge,
    "not_equal": operator.ne,
    "less": operator.lt,
    "greater": operator.gt,
}
_UFUNCS: dict[str, _Function] = {
    **{
        op: globals()[op]
        for op in ("exp", "expm1", "log", "log1p", "sin", "cos", "tan", "sinh", "cosh", "tanh", "floor", "ceil", "sign")
    },
    "arcsin": asin,
    "arccos": acos,
    "arctan": atan,
    "arctan2": atan2,
    "hypot": hypot,
    "sqrt": sqrt,
    "square": sqr,
    "minimum": minimum,
    "maximum": maximum,
    "absolute": lambda x: abs(as_expr(x)),
    "fabs": lambda x: abs(as_expr(x)),
    "negative": lambda x: -as_expr(x),
    "positive": as_expr,
    "reciprocal": lambda x: 1.0 / as_expr(x),
    **{name: partial(_operated, operate) for name, operate in _OPERATORS.items()},
}


def ufunc(function: Any, method: str, inputs: Sequence[Any], options: dict[str, Any]) -> Any:
    """What `Expr.__array_ufunc__` returns. ModelError for what has no meaning."""
    if function is np.add and method == "reduce":
        return total(inputs[0], options.get("axis", 0))
    if method != "__call__" or options or function.__name__ not in _UFUNCS:
        raise ModelError(f"numpy.{function.__name__} is no operation of expressions; there are {', '.join(_UFUNCS)}")
    return _UFUNCS[function.__name__](*inputs)


def total(x: Operand, axis: Any = None, keepdims: bool = False) -> Expr:
    """Sum along one axis, along several, or (None) of all elements."""
    expr = as_expr(x)
    axes = range(expr.ndim) if axis is None else (axis if isinstance(axis, tuple) else (axis,))
    for one in sorted((a % max(expr.ndim, 1) for a in axes), reverse=True):
        expr = expr.sum(one)[(slice(None),) * one + (None,)] if keepdims else expr.sum(one)
    return expr


def _mean(x: Operand, axis: Any = None, keepdims: bool = False) -> Expr:
    whole = total(x, axis, keepdims)
    return whole / (math.prod(as_expr(x).shape) // math.prod(whole.shape))


def _folded(two: Callable[[Expr, Expr], Expr]) -> _Function:
    """The reduction by an operation of two, along one axis or (None) of all elements."""

    def reduced(x: Operand, axis: int | None = None) -> Expr:
        expr = as_expr(x)
        expr, where = (expr.reshape(-1), 0) if axis is None else (expr, axis % expr.ndim)
        return reduce(two, (expr[(slice(None),) * where + (k,)] for k in range(expr.shape[where])))

    return reduced


def _norm(x: Operand, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Expr:
    if ord not in (None, 2) or (ord == 2 and axis is None and as_expr(x).ndim > 1):
        raise ModelError("of numpy.linalg.norm there is the Euclidean length: leave `ord` out")
    return sqrt(total(sqr(x), axis, keepdims))


def _stack(parts: Sequence[Operand], axis: int = 0) -> Expr:
    exprs = [as_expr(part) for part in parts]
    where = axis % (exprs[0].ndim + 1)
    return _concatenate([expr[(slice(None),) * where + (None,)] for expr in exprs], where)


def _concatenate(parts: Sequence[Operand], axis: int = 0) -> Expr:
    """A sum of the parts, each spread over the whole by an index and multiplied by zeros and ones.

    The product selects: where its factor is 0 it is 0, also where the part is not defined.
    """
    exprs = [as_expr(part) for part in parts]
    axis %= exprs[0].ndim
    ends = np.cumsum([0, *(expr.shape[axis] for expr in exprs)])
    place, spread = np.arange(ends[-1]), list[Expr]()
    for expr, begin, end in zip(exprs, ends, ends[1:], strict=False):
        whole = expr[(slice(None),) * axis + (np.clip(place - begin, 0, end - begin - 1),)]
        mine = ((place >= begin) & (place < end)).astype(np.float64)
        mask = as_expr(mine.reshape((-1,) + (1,) * (expr.ndim - axis - 1)))
        spread.append(Expr("mul", (whole, mask), whole.shape, parameter=SELECTS))
    return reduce(lambda one, two: one + two, spread)


_FUNCTIONS: dict[Any, _Function] = {
    np.sum: total,
    np.mean: _mean,
    np.prod: _folded(lambda x, y: x * y),
    np.max: _folded(maximum),
    np.min: _folded(minimum),
    np.linalg.norm: _norm,
    np.stack: _stack,
    np.concatenate: _concatenate,
    np.dot: lambda x, y: as_expr(x) @ y,
    np.transpose: lambda x: as_expr(x).T,
    np.reshape: lambda x, shape: as_expr(x).reshape(shape),
    np.ravel: lambda x: as_expr(x).reshape(-1),
}


def function(called: Any, args: Sequence[Any], options: dict[str, Any]) -> Any:
    """What `Expr.__array_function__` returns. ModelError for what has no meaning."""
    if called not in _FUNCTIONS:
        known = ", ".join(known.__name__ for known in _FUNCTIONS)
        raise ModelError(f"numpy.{called.__name__} takes no expressions; there are {known}")
    return _FUNCTIONS[called](*args, **options)
