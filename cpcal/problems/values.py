"""What an expression of a problem file is worth: numbers, intervals, expressions of a network, alone or in arrays.

A scalar is a Fraction (exact), an Interval (it encloses one number), a `Data` or an Expr. An array is a numpy array of
objects; a column vector has one axis, a row vector two, as in Minibex: (1, n).
"""

import operator
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial, reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import ModelError
from cpcal.solver import network as functions
from cpcal.solver.interval import Interval, IntervalArray
from cpcal.solver.model import Network
from cpcal.solver.network import Expr
from cpcal.solver.network import expression as mathematics


@dataclass(frozen=True, eq=False)
class StatedProblem:
    """objective  None: all solutions are asked for
    maximize   whether the objective is to be as large as can be
    """

    network: Network
    objective: Expr | None = None
    maximize: bool = False


@dataclass(frozen=True)
class Data:
    """A number known to lie in an interval: wherever it is written, THERE EXISTS a value of it, as ibex has it."""

    interval: Interval


Scalar = Fraction | Interval | Data | Expr
Array = npt.NDArray[np.object_]
Value = Scalar | Array

MOST = 100_000  # entries of an array
LARGEST_POWER = 1000

_NAMES = {"ln": "log", "max": "maximum", "min": "minimum"}  # Minibex's name -> cpcal's
FUNCTIONS = (
    *("sqr", "sqrt", "exp", "ln", "log", "cos", "sin", "tan", "acos", "asin", "atan", "cosh", "sinh", "tanh"),
    *("abs", "max", "min", "atan2", "pow", "acosh", "asinh", "atanh"),
)
RESERVED = (*FUNCTIONS, "sum")


def array_of(values: list[Any], shape: tuple[int, ...]) -> Array:
    out = np.empty(len(values), object)
    out[:] = values
    return out.reshape(shape)


def applied(name: str, arguments: list[Value]) -> Value:
    """A function of scalars, or of arrays entry by entry. Raises ModelError for one that is not there."""
    if any(isinstance(argument, np.ndarray) for argument in arguments):
        return entrywise(lambda *parts: applied(name, list(parts)), *arguments)
    if name == "pow" and len(arguments) == 2:
        return power(arguments[0], arguments[1])
    if name in ("max", "min") and len(arguments) > 2:
        return applied(name, [applied(name, arguments[:-1]), arguments[-1]])
    if name == "abs" and len(arguments) == 1:
        return _combined(abs, arguments[0])
    function = getattr(mathematics, _NAMES.get(name, name), None)
    try:
        if function is None:
            raise ModelError(f"the solver has no function {name}")
        if any(isinstance(argument, Expr) for argument in arguments):
            return function(*map(as_operand, arguments))  # type: ignore[no-any-return]
        known = (a if isinstance(a, Data) else interval_of(a) for a in arguments)
        return _combined(lambda *parts: enclosed(function(*parts)), *known)  # so that it can be a bound
    except TypeError:
        raise ModelError(f"{name} does not take {len(arguments)} arguments") from None


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
        return _combined(lambda value: value**count, base)
    if isinstance(exponent, np.ndarray):
        raise ModelError("an exponent must be a scalar")
    if isinstance(exponent, Fraction) and exponent == Fraction(1, 2):
        return applied("sqrt", [base])
    return mathematics.power(as_operand(base), as_operand(exponent))


def plus(left: Value, right: Value) -> Value:
    shapes = [value.shape if isinstance(value, np.ndarray) else () for value in (left, right)]
    if shapes[0] != shapes[1]:
        raise ModelError(f"values of shapes {shapes[0]} and {shapes[1]} have no sum")
    return entrywise(_sum, left, right)


def minus(left: Value, right: Value) -> Value:
    return plus(left, negative(right))


def negative(value: Value) -> Value:
    return entrywise(partial(_combined, operator.neg), value)


def times(left: Value, right: Value) -> Value:
    """Scalar times anything; vectors and matrices as in linear algebra; two column vectors: their dot product."""
    if not isinstance(left, np.ndarray) or not isinstance(right, np.ndarray):
        return entrywise(_product, left, right)
    if left.ndim == right.ndim == 1:
        if left.shape != right.shape:
            raise ModelError(f"vectors of {len(left)} and {len(right)} entries have no product")
        return reduce(_sum, map(_product, left, right))
    rows, columns = (array[:, None] if array.ndim == 1 else array for array in (left, right))
    if rows.ndim != 2 or columns.ndim != 2 or rows.shape[1] != columns.shape[0]:
        raise ModelError(f"arrays of shapes {left.shape} and {right.shape} have no product")
    parts = [times(row, column) for row in rows for column in columns.T]
    if len(parts) == 1:
        return parts[0]
    return array_of(parts, (len(rows),) if right.ndim == 1 else (len(rows), columns.shape[1]))


def divided(left: Value, right: Value) -> Value:
    if isinstance(right, np.ndarray):
        raise ModelError("an array divides nothing")
    if isinstance(right, Fraction) and right == 0:
        raise ModelError("a division by 0")
    return entrywise(partial(_combined, operator.truediv), left, right)


def entrywise(function: Callable[..., Any], *values: Value) -> Value:
    return np.frompyfunc(function, len(values), 1)(*map(_boxed, values))  # type: ignore[no-any-return]


def pairs(left: Value, right: Value) -> list[tuple[Scalar, Scalar]]:
    """The entries of one beside those of another, which may be one number for all. Raises ModelError."""
    one, two = np.atleast_1d(_boxed(left)), np.atleast_1d(_boxed(right))
    if two.size > 1 and one.shape != two.shape:
        raise ModelError(f"values of shapes {one.shape} and {two.shape} do not stand side by side")
    return list(zip(one.ravel(), np.broadcast_to(two.ravel(), (one.size,)), strict=True))


def _combined(operation: Callable[..., Any], *values: Value) -> Value:
    """Exact for fractions; an enclosure for constants; else an expression."""
    found: Value
    if any(isinstance(value, Expr) for value in values):
        found = operation(*map(as_operand, values))
    elif all(isinstance(value, Fraction) for value in values):
        found = operation(*values)
    else:
        interval: Interval = operation(*map(interval_of, values))
        found = Data(interval) if any(isinstance(value, Data) for value in values) else interval
    return found


_sum, _product = partial(_combined, operator.add), partial(_combined, operator.mul)


def interval_of(value: Value) -> Interval:
    """Of a constant. Raises ModelError for what holds a variable."""
    if isinstance(value, Data):
        return value.interval
    if isinstance(value, Fraction):
        return Interval(value)
    if isinstance(value, Interval):
        return value
    raise ModelError("a constant must stand here, without variables")


def _boxed(value: Value) -> Array:
    if isinstance(value, np.ndarray):
        return value
    out = np.empty((), object)
    out[()] = value
    return out


# ------------------------------------------------------------------------------------------------------------------
# Vectors and matrices of Minibex: put together from parts, and taken apart by indices.


def stacked(parts: list[Value], row: bool) -> Array:
    """(a, b) or (a; b): of numbers a vector, of vectors and matrices a matrix. Raises ModelError where none fits.

    Numbers, and rows where columns stand, count as matrices.
    """
    if not any(isinstance(part, np.ndarray) for part in parts):
        return array_of(list(parts), (1, len(parts)) if row else (len(parts),))
    arrays = [np.atleast_1d(_boxed(part)) for part in parts]
    blocks = [array[:, None] if array.ndim == 1 else array for array in arrays]
    if len({block.shape[0 if row else 1] for block in blocks}) > 1:
        shapes = ", ".join(sorted({str(block.shape) for block in blocks}))
        raise ModelError(f"parts of the shapes {shapes} do not fit together")
    found = np.concatenate(blocks, axis=1 if row else 0)
    return found[:, 0] if found.shape[1] == 1 else found


def indexed(array: Array, places: tuple[int, ...]) -> Value:
    """One number, or a row of a matrix, which is a row; one index of a row is a number. Indices count from 0."""
    if len(places) == array.ndim:
        return array[places]  # type: ignore[no-any-return]
    return array[0, places[0]] if is_row(array) else array[places[0] : places[0] + 1]


def is_row(array: Array) -> bool:
    return array.ndim == 2 and array.shape[0] == 1
