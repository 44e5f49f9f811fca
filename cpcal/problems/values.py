"""What an expression of a problem file is worth: numbers, intervals, expressions of a network, alone or in arrays.

A scalar is a Fraction (exact), an Interval (it encloses one number), a `Data` or an Expr. An array is a numpy array of
objects; a column vector has one axis, a row vector two, as in Minibex.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial, reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import ModelError
from cpcal.solver import network as functions
from cpcal.solver.interval import Interval, IntervalArray
from cpcal.solver.interval.numbers import float_bounds
from cpcal.solver.model import Network
from cpcal.solver.network import Expr, sqr, sqrt
from cpcal.solver.network import expression as mathematics
from cpcal.solver.network.expression import as_expr, topological


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

# Minibex's name -> cpcal's; those that this version has are found when they are asked for
_NAMES = {"ln": "log", "max": "maximum", "min": "minimum", "abs": "abs"}
FUNCTIONS = (
    *("sqr", "sqrt", "exp", "ln", "log", "cos", "sin", "tan", "acos", "asin", "atan", "cosh", "sinh", "tanh"),
    *("abs", "max", "min", "atan2", "pow"),
)


def array_of(values: list[Any], shape: tuple[int, ...]) -> Array:
    out = np.empty(len(values), dtype=object)
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
    called = _NAMES.get(name, name)
    function = getattr(mathematics, called, None) or getattr(functions, called, None)
    if function is None:
        raise ModelError(f"the solver has no function {name}")
    try:
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
    left, right = _blocks(left, right), _blocks(right, left)
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


def _blocks(value: Value, other: Value) -> Value:
    """An array of matrices beside a matrix of as many numbers: its blocks one below the other."""
    if isinstance(value, np.ndarray) and isinstance(other, np.ndarray) and (value.ndim, other.ndim) == (3, 2):
        return value.reshape(-1, value.shape[2])
    return value


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


# ------------------------------------------------------------------------------------------------------------------
# Vectors and matrices of Minibex: put together from parts, and taken apart by indices.
#
# A column vector has one axis, a row vector two: (1, n). An array of matrices has three.

Place = int | slice  # from 0


def stacked(parts: list[Value], row: bool) -> Array:
    """(a, b) or (a; b): of numbers a vector, of vectors and matrices a matrix. Raises ModelError where none fits.

    Numbers, and rows where columns stand, count as matrices. Matrices of one shape, one below the other, are an array
    of matrices.
    """
    if not any(isinstance(part, np.ndarray) for part in parts):
        return array_of(list(parts), (1, len(parts)) if row else (len(parts),))
    blocks = [_matrix(part) for part in parts]
    shapes = {block.shape for block in blocks}
    if not row and len(shapes) == 1 and all(side > 1 for side in blocks[0].shape):
        return np.stack(blocks)
    if len({block.shape[0 if row else 1] for block in blocks}) > 1:
        raise ModelError(f"parts of the shapes {', '.join(map(str, sorted(shapes)))} do not fit together")
    return flattened(np.concatenate(blocks, axis=1 if row else 0))


def _matrix(value: Value) -> Array:
    if not isinstance(value, np.ndarray):
        return array_of([value], (1, 1))
    if value.ndim == 3:
        raise ModelError("an array of matrices stands in a matrix")
    return value[:, None] if value.ndim == 1 else value


def flattened(matrix: Array) -> Array:
    """A matrix of one column as a vector."""
    return matrix[:, 0] if matrix.ndim == 2 and matrix.shape[1] == 1 else matrix


def indexed(array: Array, places: tuple[Place, ...]) -> Value:
    """One number, or the part of an array: a row of a matrix is a row, and one index of a row is a number."""
    if len(places) == 1 and is_row(array):
        places = (0, *places)
    kept = tuple(slice(p, p + 1) if isinstance(p, int) and array.ndim == 2 else p for p in places)
    found: Any = array[kept]
    if len(places) == array.ndim and all(isinstance(p, int) for p in places):
        return np.ravel(found)[0] if isinstance(found, np.ndarray) else found  # type: ignore[no-any-return]
    return flattened(found)


def is_row(array: Array) -> bool:
    return array.ndim == 2 and array.shape[0] == 1


# ------------------------------------------------------------------------------------------------------------------
# Derivatives of expressions as expressions: what `diff` of Minibex means.
#
# diff(e, x) is defined where the formula of the derivative is; expressions with a kink (abs, min, max) have no such
# formula and are refused.

# of the node and its arguments: the partial derivative by each argument
_PARTIALS: dict[str, Callable[[Expr, Sequence[Expr]], tuple[Any, ...]]] = {
    "neg": lambda z, a: (-1.0,),
    "add": lambda z, a: (1.0, 1.0),
    "sub": lambda z, a: (1.0, -1.0),
    "mul": lambda z, a: (a[1], a[0]),
    "div": lambda z, a: (1.0 / a[1], -a[0] / sqr(a[1])),
    "sqr": lambda z, a: (2.0 * a[0],),
    "sqrt": lambda z, a: (0.5 / z,),
    "power": lambda z, a: (z.parameter * a[0] ** (z.parameter - 1),),
    "exp": lambda z, a: (z,),
    "log": lambda z, a: (1.0 / a[0],),
    "sin": lambda z, a: (mathematics.cos(a[0]),),
    "cos": lambda z, a: (-mathematics.sin(a[0]),),
    "tan": lambda z, a: (1.0 + sqr(z),),
    "asin": lambda z, a: (1.0 / sqrt(1.0 - sqr(a[0])),),
    "atan": lambda z, a: (1.0 / (1.0 + sqr(a[0])),),
    "atan2": lambda z, a: (a[1] / (sqr(a[0]) + sqr(a[1])), -a[0] / (sqr(a[0]) + sqr(a[1]))),
}


def gradient(expression: Expr, by: Sequence[Expr]) -> list[Expr]:
    """Of a scalar expression, by components of variables. Raises ModelError for an operation without a formula."""
    order = topological((expression,))
    wanted = {component.digest for component in by}
    holding: set[bytes] = set()  # what depends on one of them
    for node in order:
        if node.digest in wanted or any(arg.digest in holding for arg in node.args):
            holding.add(node.digest)
    total: dict[bytes, Expr] = {expression.digest: as_expr(1.0)}
    for node in reversed(order):
        if node.digest in wanted or node.digest not in holding or node.digest not in total:
            continue
        if node.op not in _PARTIALS:
            raise ModelError(f"the derivative of {node.op!r} has no formula here")
        for arg, slope in zip(node.args, _PARTIALS[node.op](node, node.args), strict=True):
            if arg.digest in holding:
                step = _times(total[node.digest], slope)
                total[arg.digest] = total[arg.digest] + step if arg.digest in total else step
    return [total.get(component.digest, as_expr(0.0)) for component in by]


def _times(factor: Expr, partial: Any) -> Expr:
    """Without factors of 1, which would lengthen every derivative."""
    if isinstance(partial, float) and abs(partial) == 1.0:
        return factor if partial > 0.0 else -factor
    one = factor.op == "constant" and bool(np.all(factor.data.lo == 1.0) and np.all(factor.data.hi == 1.0))
    return as_expr(partial) if one else factor * partial


# ------------------------------------------------------------------------------------------------------------------
# What Minibex has besides functions of numbers: diff, ends of an interval, and inverse hyperbolic functions.


def _diff(*arguments: Value) -> Value:
    """A number for one component, else a row, one entry a component; of a vector a row for each entry."""
    if len(arguments) < 2:
        raise ModelError("diff takes an expression, and the variables to differentiate it by")
    of, *variables = arguments
    by: list[Any] = [entry for variable in variables for entry, _ in pairs(variable, Fraction(0))]
    leaves = [e.args[0] if isinstance(e, Expr) and e.op == "index" else e for e in by]
    if not all(isinstance(leaf, Expr) and leaf.op == "variable" for leaf in leaves):
        raise ModelError("diff differentiates by variables: name them, or entries of them")
    parts = [as_operand(entry) for entry, _ in pairs(of, Fraction(0))]
    rows = [gradient(e, by) if isinstance(e, Expr) else [Interval(0.0, 0.0)] * len(by) for e in parts]
    if len(parts) == len(by) == 1:
        return rows[0][0]
    return flattened(array_of([entry for row in rows for entry in row], (len(parts), len(by))))


def _middle(value: Value) -> Interval:
    interval = interval_of(value)
    if not interval.is_bounded:
        raise ModelError("an interval without bounds has no middle")
    return Interval(interval.mid)


def _asinh(x: Value) -> Value:
    """The same on both sides of 0, where log(x + sqrt(x^2 + 1)) alone would cancel for x < 0."""
    sides = (applied("max", [part, Fraction(0)]) for part in (x, negative(x)))
    up, down = (applied("log", [plus(s, applied("sqrt", [plus(power(s, Fraction(2)), Fraction(1))]))]) for s in sides)
    return minus(up, down)


def _form(name: str, takes: str, count: int, of: Callable[..., Any]) -> Callable[..., Value]:
    """A function of so many numbers, entry by entry of arrays."""

    def found(*arguments: Value) -> Value:
        if len(arguments) != count:
            raise ModelError(f"{name} takes {takes}" + (f", not {len(arguments)}" if count == 1 else ""))
        return entrywise(of, *arguments)

    return found


_OF_ONE: dict[str, Callable[[Value], Any]] = {
    "inf": lambda x: Interval(interval_of(x).lo),
    "sup": lambda x: Interval(interval_of(x).hi),
    "mid": _middle,
    "acosh": lambda x: applied("log", [plus(x, applied("sqrt", [minus(power(x, Fraction(2)), Fraction(1))]))]),
    "asinh": _asinh,
    "atanh": lambda x: times(
        Fraction(1, 2), minus(applied("log", [plus(Fraction(1), x)]), applied("log", [minus(Fraction(1), x)]))
    ),
}
FORMS = {name: _form(name, "one argument", 1, of) for name, of in _OF_ONE.items()} | {
    "diff": _diff,
}
RESERVED = (*FUNCTIONS, *FORMS, "sum")
