"""Rigorous arithmetic on arrays of intervals, and the one place where an engine is chosen by name.

"float64" runs the compiled operations: every result is rounded to nearest by the processor, then moved outward. "arb"
runs the same source on arb's primitives, each computed at 128 bits and rounded outward once: slow, and an oracle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from cpcal.common.errors import RoundingError, unusable
from cpcal.solver.compiled import ready, rebound
from cpcal.solver.interval import functions, kernels, operations
from cpcal.solver.interval.numbers import IntervalArray
from cpcal.solver.interval.operations import ADD, DIV, MUL, NEG, SQR, SQRT, SUB


def _unary(code: int) -> Callable[[Arithmetic, IntervalArray], IntervalArray]:
    return lambda engine, x: engine.apply(code, x)


def _binary(code: int) -> Callable[[Arithmetic, IntervalArray, IntervalArray], IntervalArray]:
    return lambda engine, x, y: engine.apply(code, x, y)


class Arithmetic:
    """Operands broadcast as in numpy.

    Every result contains the exact image of the operands' points (where the operation is defined there); the empty
    interval gives the empty interval; overflow gives an infinite bound.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    add, sub, mul = map(_binary, (ADD, SUB, MUL))
    # The hull of `{a / b : a in x, b in y, b != 0}`: a zero of y at an end gives a half line, y == [0, 0] nothing.
    div = _binary(DIV)
    neg, sqr, sqrt = map(_unary, (NEG, SQR, SQRT))  # the square root is of the part that is >= 0

    def apply(self, code: int, x: IntervalArray, y: IntervalArray | None = None, n: int = 0) -> IntervalArray:
        """Any operation of the table, element by element; n is a power's exponent."""
        operands = (x, x if y is None else y)
        shape = np.broadcast_shapes(*(operand.shape for operand in operands))
        out = np.zeros(math.prod(shape)), np.zeros(math.prod(shape))
        # in arrays of their own: loops are compiled for those that may be written
        given = [(x.lo.flatten(), x.hi.flatten()) for x in (operand.broadcast_to(shape) for operand in operands)]
        in_arithmetic(self.name).elementwise(np.int32(code), np.int32(n), *given, out)
        return IntervalArray(*out).reshape(shape)

    def sum(self, x: IntervalArray, axis: int) -> IntervalArray:
        """Sum along one axis, which disappears."""
        lo, hi = (np.array(np.moveaxis(bound, axis, -1), np.float64, order="C") for bound in (x.lo, x.hi))
        shape, count = lo.shape[:-1], lo.shape[-1]
        size = math.prod(shape)
        out = np.zeros(size), np.zeros(size)
        in_arithmetic(self.name).totals((lo.reshape(size, count), hi.reshape(size, count)), out)
        return IntervalArray(*out).reshape(shape)

    def dot(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        """Matrix product of shapes (..., k) and (k, n)."""
        shape, count = (*x.shape[:-1], y.shape[1]), math.prod(x.shape[:-1])
        lo, hi = np.zeros((2, count, y.shape[1]))
        if x.lo.size:
            rows = x.reshape((count, x.shape[-1]))
            given = [tuple(np.array(bound, np.float64, order="C") for bound in (v.lo, v.hi)) for v in (rows, y)]
            in_arithmetic(self.name).products(*given, (lo, hi))
        return IntervalArray(lo, hi).reshape(shape)


def get_arithmetic(name: str) -> Arithmetic:
    """The engine called `name`: "float64" (fast) or "arb" (slow, tight).

    Raises InputError for another name, RoundingError where float64 numbers are not rounded to nearest.
    """
    check_rounding()
    if name not in ("float64", "arb"):
        raise unusable("arithmetic", f"{name!r} is not an engine", 'use "float64" or "arb"')
    return Arithmetic(name)


_TABLE = (kernels, functions, operations)


@cache
def in_arithmetic(name: str, *sources: ModuleType) -> Any:
    """The table's functions and those of modules of kernels, by name, in the arithmetic of that name."""
    found = [function for module in (*_TABLE, *sources) for function in _defined_in(module)]
    if name == "float64":
        made = {function.__name__: ready(function) for function in found}
        return SimpleNamespace(**{k: f if hasattr(f, "py_func") else _quiet(f) for k, f in made.items()})
    from cpcal.solver.interval.arb import PRIMITIVES, in_arb

    return SimpleNamespace(**{k: in_arb(f) for k, f in rebound(found, PRIMITIVES).items()})


def _defined_in(source: ModuleType) -> list[Callable[..., Any]]:
    """The compiled functions of a module, in the order of the file."""
    found = [v for v in vars(source).values() if getattr(v, "kernel", False)]
    return [function for function in found if function.__module__ == source.__name__]


def _quiet(function: Callable[..., Any]) -> Callable[..., Any]:
    """Plain Python on numpy's numbers, without its warnings."""

    def silent(*args: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*args)

    return silent


_ONE, _SMALLEST, _HALF, _LEAST = 1.0, 2.0**-60, 0.5, 5e-324
_NORMAL = float(np.finfo(np.float64).smallest_normal)


def check_rounding() -> None:
    """Raises RoundingError where this thread does not compute as IEEE 754 has it, which all float64 bounds rest on.

    Some interval libraries switch the rounding, and leave it so: codac and others on gaol, filib or boost. Libraries
    that were compiled with -ffast-math switch subnormal numbers off for whoever loads them: results that small are
    zero then, and bounds of them false.
    """
    nearest = _ONE + _SMALLEST == _ONE and _ONE - _SMALLEST == _ONE
    if not nearest or _NORMAL * _HALF == 0.0 or _LEAST / _NORMAL == 0.0:
        raise RoundingError(
            "another library in this process has changed how the processor rounds, or switched small numbers off: no "
            "bound in float64 can be trusted. Run that library in a process of its own"
        )
