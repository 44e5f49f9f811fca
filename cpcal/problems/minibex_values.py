"""What an expression of Minibex is worth: numbers, intervals and expressions of a network, alone or in arrays.

A scalar is a Fraction (exact), an Interval (it encloses one number), a `Data` or an Expr. An array is a numpy array of
objects; a column vector has one axis, a row vector two, as in Minibex.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import ModelError
from cpcal.solver import network as functions
from cpcal.solver.interval import Interval, IntervalArray
from cpcal.solver.interval.number import float_bounds
from cpcal.solver.network import Expr, mathematics


@dataclass(frozen=True)
class Data:
    """A number known to lie in an interval: wherever it is written, THERE EXISTS a value of it, as ibex has it."""

    interval: Interval


Scalar = Fraction | Interval | Data | Expr
Array = npt.NDArray[np.object_]
Value = Scalar | Array

MOST = 100_000  # entries of an array
LARGEST_POWER = 1000

# Minibex's name -> cpcal's; those that this version has are found when they are asked for
_NAMES = {"ln": "log", "max": "maximum", "min": "minimum", "abs": "abs"}
FUNCTIONS = (
    *("sqr", "sqrt", "exp", "ln", "log", "cos", "sin", "tan", "acos", "asin", "atan", "cosh", "sinh", "tanh"),
    *("abs", "sign", "floor", "ceil", "max", "min", "atan2", "pow"),
)


def array_of(values: list[Any], shape: tuple[int, ...]) -> Array:
    out = np.empty(len(values), dtype=object)
    out[:] = values
    return out.reshape(shape)


def applied(name: str, arguments: list[Value]) -> Value:
    """A function of scalars, or of arrays entry by entry. Raises ModelError for one that is not there."""
    if any(isinstance(argument, np.ndarray) for argument in arguments):
        return entrywise(lambda *parts: _scalar(applied(name, list(parts))), *arguments)
    if name == "pow" and len(arguments) == 2:
        return power(arguments[0], arguments[1])
    if name in ("max", "min") and len(arguments) > 2:
        return applied(name, [applied(name, arguments[:-1]), arguments[-1]])
    if name == "abs":
        return _powered(_single(arguments, name), abs)
    called = _NAMES.get(name, name)
    function = getattr(mathematics, called, None) or getattr(functions, called, None)
    if function is None:
        raise ModelError(f"the solver has no function {name}")
    try:
        return _folded(function, arguments)
    except TypeError:
        raise ModelError(f"{name} does not take {len(arguments)} arguments") from None


def _folded(function: Callable[..., Expr], arguments: list[Value]) -> Value:
    """Of constants an enclosure, so that it can be a bound."""
    if any(isinstance(argument, Expr) for argument in arguments):
        return function(*(as_operand(argument) for argument in arguments))
    found = enclosed(function(*(interval_of(argument) for argument in arguments)))
    return Data(found) if any(isinstance(argument, Data) for argument in arguments) else found


def enclosed(expression: Expr) -> Interval:
    """The value of an expression without variables."""
    empty = functions.ConstraintNetwork("constants")
    empty.variable("none", domain=(0, 0))
    found = functions.evaluate(empty, expression, empty.domain)
    return Interval(float(found.lo.min()), float(found.hi.max()))


def as_operand(value: Value) -> Any:
    """What the network's expressions are made of."""
    if not isinstance(value, Data):
        return value
    bounds = value.interval
    if not bounds.is_bounded:
        raise ModelError("a constant without bounds stands in an expression: give it finite ones")
    return Expr("reading", data=IntervalArray(np.array(bounds.lo), np.array(bounds.hi)))


def power(base: Value, exponent: Value) -> Value:
    """Whole exponents are products; others as the solver has it, x^y where x > 0 (and 0 to a positive power is 0)."""
    if isinstance(base, np.ndarray):
        return entrywise(lambda entry: power(entry, exponent), base)
    if isinstance(exponent, Fraction) and exponent.denominator == 1 and abs(exponent) <= LARGEST_POWER:
        count = int(exponent)
        if isinstance(base, Fraction) and base == 0 and count < 0:
            raise ModelError("0 has no negative power")
        return _powered(base, lambda value: value**count)
    if isinstance(exponent, np.ndarray):
        raise ModelError("an exponent must be a scalar")
    if isinstance(exponent, Fraction) and exponent == Fraction(1, 2):
        return applied("sqrt", [base])
    return mathematics.power(as_operand(base), as_operand(exponent))


def _powered(value: Value, operation: Callable[[Any], Any]) -> Value:
    if isinstance(value, Data):
        return Data(operation(value.interval))
    return operation(value)  # type: ignore[no-any-return]


def plus(left: Value, right: Value) -> Value:
    return _of_same_shape(lambda a, b: _combined(a, b, lambda x, y: x + y), left, right)


def minus(left: Value, right: Value) -> Value:
    return plus(left, negative(right))


def negative(value: Value) -> Value:
    if isinstance(value, np.ndarray):
        return entrywise(negative, value)
    return _powered(value, lambda number: -number)


def times(left: Value, right: Value) -> Value:
    """Scalar times anything; vectors and matrices as in linear algebra; two column vectors: their dot product."""
    if not isinstance(left, np.ndarray) or not isinstance(right, np.ndarray):
        return entrywise(lambda a, b: _combined(a, b, lambda x, y: x * y), left, right)
    if left.ndim == right.ndim == 1:
        if left.shape != right.shape:
            raise ModelError(f"vectors of {len(left)} and {len(right)} entries have no product")
        return _total([_combined(a, b, lambda x, y: x * y) for a, b in zip(left, right, strict=True)])
    rows = left if left.ndim == 2 else left[:, None]
    columns = right if right.ndim == 2 else right[:, None]
    if rows.ndim != 2 or columns.ndim != 2 or rows.shape[1] != columns.shape[0]:
        raise ModelError(f"arrays of shapes {left.shape} and {right.shape} have no product")
    parts = [_scalar(times(row, column)) for row in rows for column in columns.T]
    if right.ndim == 1:
        return array_of(parts, (len(rows),)) if len(rows) > 1 else parts[0]
    shape = (len(rows), columns.shape[1])
    return parts[0] if shape == (1, 1) else array_of(parts, shape)


def over(left: Value, right: Value) -> Value:
    if isinstance(right, np.ndarray):
        raise ModelError("an array divides nothing")
    if isinstance(right, Fraction) and right == 0:
        raise ModelError("a division by 0")
    return entrywise(lambda a: _combined(a, right, lambda x, y: x / y), left)


def transposed(value: Value) -> Value:
    if not isinstance(value, np.ndarray):
        return value
    if value.ndim == 1:
        return value[None, :]
    turned = value.T
    return turned[:, 0] if value.shape[0] == 1 else turned


def entrywise(function: Callable[..., Any], *values: Value) -> Value:
    if not any(isinstance(value, np.ndarray) for value in values):
        return function(*values)  # type: ignore[no-any-return]
    arrays = np.broadcast_arrays(*(_boxed(value) for value in values))
    entries = [function(*parts) for parts in zip(*(array.ravel() for array in arrays), strict=True)]
    return array_of(entries, arrays[0].shape) if arrays[0].ndim else entries[0]


def pairs(left: Value, right: Value) -> list[tuple[Scalar, Scalar]]:
    """The entries of one beside those of another, which may be one number for all. Raises ModelError."""
    one, two = np.atleast_1d(_boxed(left)), np.atleast_1d(_boxed(right))
    if two.size > 1 and one.shape != two.shape:
        raise ModelError(f"values of shapes {one.shape} and {two.shape} do not stand side by side")
    return list(zip(one.ravel(), np.broadcast_to(two.ravel(), (one.size,)), strict=True))


def _of_same_shape(function: Callable[..., Any], left: Value, right: Value) -> Value:
    left, right = _blocks(left, right), _blocks(right, left)
    shapes = [value.shape if isinstance(value, np.ndarray) else () for value in (left, right)]
    if shapes[0] != shapes[1]:
        raise ModelError(f"values of shapes {shapes[0]} and {shapes[1]} have no sum")
    return entrywise(function, left, right)


def _blocks(value: Value, other: Value) -> Value:
    """An array of matrices beside a matrix of as many numbers: its blocks one below the other."""
    if isinstance(value, np.ndarray) and isinstance(other, np.ndarray) and (value.ndim, other.ndim) == (3, 2):
        return value.reshape(-1, value.shape[2])
    return value


def _combined(left: Scalar, right: Scalar, operation: Callable[[Any, Any], Any]) -> Scalar:
    """Exact for two fractions; an enclosure for constants; else an expression."""
    if isinstance(left, Fraction) and isinstance(right, Fraction):
        return operation(left, right)  # type: ignore[no-any-return]
    if isinstance(left, Expr) or isinstance(right, Expr):
        return operation(as_operand(left), as_operand(right))  # type: ignore[no-any-return]
    found = operation(interval_of(left), interval_of(right))
    return Data(found) if isinstance(left, Data) or isinstance(right, Data) else found


def interval_of(value: Value) -> Interval:
    """Of a constant. Raises ModelError for what holds a variable."""
    if isinstance(value, Data):
        return value.interval
    if isinstance(value, Fraction):
        return Interval(*float_bounds(value))
    if isinstance(value, Interval):
        return value
    raise ModelError("a constant must stand here, without variables")


def _boxed(value: Value) -> Array:
    if isinstance(value, np.ndarray):
        return value
    out = np.empty((), dtype=object)
    out[()] = value
    return out


def _scalar(value: Value) -> Scalar:
    if isinstance(value, np.ndarray):
        raise ModelError("an array stands where a number should")
    return value


def _single(arguments: list[Value], name: str) -> Any:
    if len(arguments) != 1:
        raise ModelError(f"{name} does not take {len(arguments)} arguments")
    return arguments[0]


def _total(parts: list[Scalar]) -> Scalar:
    total = parts[0]
    for part in parts[1:]:
        total = _combined(total, part, lambda x, y: x + y)
    return total
