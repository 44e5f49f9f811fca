"""numpy's functions on expressions: `np.sin(x)`, `np.linalg.norm(x)`, `np.stack([x, y])` give expressions again."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.solver.network import mathematics
from cpcal.solver.network.expression import SELECTS, Expr, Operand, as_expr, binary
from cpcal.solver.network.mathematics import maximum, minimum, sqr, sqrt

_Function = Callable[..., Any]

_UFUNCS: dict[str, _Function] = {
    **{
        op: getattr(mathematics, op)
        for op in ("exp", "expm1", "log", "log1p", "sin", "cos", "tan", "sinh", "cosh", "tanh", "floor", "ceil", "sign")
    },
    "arcsin": mathematics.asin,
    "arccos": mathematics.acos,
    "arctan": mathematics.atan,
    "arctan2": mathematics.atan2,
    "hypot": mathematics.hypot,
    "sqrt": sqrt,
    "square": sqr,
    "minimum": minimum,
    "maximum": maximum,
    "absolute": lambda x: abs(as_expr(x)),
    "fabs": lambda x: abs(as_expr(x)),
    "negative": lambda x: -as_expr(x),
    "positive": as_expr,
    "reciprocal": lambda x: 1.0 / as_expr(x),
    "add": lambda x, y: binary("add", x, y),
    "subtract": lambda x, y: binary("sub", x, y),
    "multiply": lambda x, y: binary("mul", x, y),
    "divide": lambda x, y: binary("div", x, y),
    "power": lambda x, y: as_expr(x) ** y,
    "float_power": lambda x, y: as_expr(x) ** y,
    "matmul": lambda x, y: as_expr(x) @ y,
    "equal": lambda x, y: as_expr(x) == y,
    "less_equal": lambda x, y: as_expr(x) <= y,
    "greater_equal": lambda x, y: as_expr(x) >= y,
    "not_equal": lambda x, y: as_expr(x) != y,
    "less": lambda x, y: as_expr(x) < y,
    "greater": lambda x, y: as_expr(x) > y,
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
    sizes = [expr.shape[axis] for expr in exprs]
    whole: Expr | None = None
    for k, expr in enumerate(exprs):
        before, length = sum(sizes[:k]), sum(sizes)
        place = np.clip(np.arange(length) - before, 0, sizes[k] - 1)
        mine = ((np.arange(length) >= before) & (np.arange(length) < before + sizes[k])).astype(np.float64)
        spread = expr[(slice(None),) * axis + (place,)]
        mask = as_expr(mine.reshape((length,) + (1,) * (expr.ndim - axis - 1)))
        part = Expr("mul", (spread, mask), spread.shape, parameter=SELECTS)
        whole = part if whole is None else whole + part
    assert whole is not None
    return whole


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
