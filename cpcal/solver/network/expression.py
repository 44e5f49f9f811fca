"""Array-valued expressions over named variables, constants and readings: the nodes of the DAG.

Expressions are plain immutable data. What an operation means stands in `cpcal.solver.network.operations`.
"""

from __future__ import annotations

import hashlib
import itertools
from dataclasses import dataclass, field
from numbers import Rational
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from cpcal.errors import ModelError
from cpcal.solver.interval import Interval, IntervalArray
from cpcal.solver.interval.scalar import round_down, round_up

Operand = Union["Expr", float, int, Interval, IntervalArray, npt.NDArray[Any], list[Any], tuple[Any, ...]]
Shape = tuple[int, ...]

_identities = itertools.count()  # of numbers that are only known to lie in a set


@dataclass(frozen=True, eq=False, repr=False)
class Expr:
    """A node: an operation on other nodes, or a leaf ("variable", "constant", "reading").

    `data` holds a leaf's value (for a reading: the set it is known to lie in) or the flat indices of
    an "index"; `parameter` the exponent of a "power" or the axis of a "sum"; `name` a variable's name.
    """

    op: str
    args: tuple[Expr, ...] = ()
    shape: Shape = ()
    parameter: int = 0
    name: str = ""
    data: IntervalArray | npt.NDArray[np.intp] | None = None
    # SHA-256 of the structure: expressions of equal digests have equal values. Two readings, or two enclosures,
    # may be different numbers of the same set, so that each is equal to itself alone.
    digest: bytes = field(init=False)

    __array_ufunc__ = None  # let `ndarray @ expr` come to __rmatmul__
    __hash__ = object.__hash__

    def __post_init__(self) -> None:
        hasher = hashlib.sha256(repr((self.op, self.shape, self.parameter, self.name)).encode())
        if isinstance(self.data, IntervalArray):
            hasher.update(np.ascontiguousarray(self.data.lo).tobytes())
            hasher.update(np.ascontiguousarray(self.data.hi).tobytes())
        elif self.data is not None:
            hasher.update(np.ascontiguousarray(self.data, dtype=np.int64).tobytes())
        if self.op == "reading" or (self.op == "constant" and _is_thick(self.data)):
            hasher.update(next(_identities).to_bytes(8, "big"))
        for arg in self.args:
            hasher.update(arg.digest)
        object.__setattr__(self, "digest", hasher.digest())

    @property
    def ndim(self) -> int:
        return len(self.shape)

    # arithmetic -----------------------------------------------------------------------------------

    def __neg__(self) -> Expr:
        return Expr("neg", (self,), self.shape)

    def __add__(self, other: Operand) -> Expr:
        return _binary("add", self, other)

    def __radd__(self, other: Operand) -> Expr:
        return _binary("add", other, self)

    def __sub__(self, other: Operand) -> Expr:
        return _binary("sub", self, other)

    def __rsub__(self, other: Operand) -> Expr:
        return _binary("sub", other, self)

    def __mul__(self, other: Operand) -> Expr:
        return _binary("mul", self, other)

    def __rmul__(self, other: Operand) -> Expr:
        return _binary("mul", other, self)

    def __truediv__(self, other: Operand) -> Expr:
        return _binary("div", self, other)

    def __rtruediv__(self, other: Operand) -> Expr:
        return _binary("div", other, self)

    def __pow__(self, exponent: int) -> Expr:
        if not isinstance(exponent, (int, np.integer)):
            raise ModelError(f"the exponent of a power is an integer, not {exponent!r}")
        return sqr(self) if exponent == 2 else Expr("power", (self,), self.shape, parameter=int(exponent))

    def __abs__(self) -> Expr:
        return Expr("abs", (self,), self.shape)

    def __matmul__(self, other: Operand) -> Expr:
        return _matmul(self, as_expr(other))

    def __rmatmul__(self, other: Operand) -> Expr:
        return _matmul(as_expr(other), self)

    def sum(self, axis: int = -1) -> Expr:
        """Sum along one axis, which disappears."""
        if not -self.ndim <= axis < self.ndim:
            raise ModelError(f"axis {axis} of a sum is out of range for shape {self.shape}")
        axis %= self.ndim
        return Expr("sum", (self,), self.shape[:axis] + self.shape[axis + 1 :], parameter=axis)

    def __getitem__(self, index: Any) -> Expr:
        """numpy's basic and advanced indexing."""
        positions = np.arange(int(np.prod(self.shape, dtype=np.int64))).reshape(self.shape)
        try:
            flat = np.asarray(positions[index], dtype=np.intp)
        except IndexError as error:
            raise ModelError(f"index {index!r} does not fit shape {self.shape}: {error}") from None
        return Expr("index", (self,), flat.shape, data=flat)

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a scalar expression has no length")
        return self.shape[0]

    def __iter__(self) -> Any:
        return (self[k] for k in range(len(self)))

    # constraints ----------------------------------------------------------------------------------

    def within(self, bounds: Interval | tuple[Operand, Operand]) -> Constraint:
        """The constraint `lower <= self <= upper`, elementwise; bounds may be expressions, `(-eps, eps)`."""
        lower, upper = (bounds.lo, bounds.hi) if isinstance(bounds, Interval) else bounds
        return Constraint(self, as_expr(lower), as_expr(upper))

    def __eq__(self, other: Operand) -> Constraint:  # type: ignore[override]
        return (self - other).within((0.0, 0.0))

    def __le__(self, other: Operand) -> Constraint:
        return (self - other).within((-np.inf, 0.0))

    def __ge__(self, other: Operand) -> Constraint:
        return (self - other).within((0.0, np.inf))

    def __ne__(self, other: object) -> bool:
        raise ModelError("`!=` is no constraint here: the set would not be closed")

    def __bool__(self) -> bool:
        raise ModelError("an expression has no truth value; build a constraint and add it to a network")

    def __repr__(self) -> str:
        return f"<Expr {self.name or self.op} of shape {self.shape}>"


@dataclass(frozen=True, eq=False)
class Constraint:
    """`lower <= body <= upper`, elementwise; all three broadcast to `body`'s shape."""

    body: Expr
    lower: Expr
    upper: Expr

    def __post_init__(self) -> None:
        for bound in (self.lower, self.upper):
            if not _broadcasts(bound.shape, self.body.shape):
                raise ModelError(f"bounds of shape {bound.shape} do not fit a body of shape {self.body.shape}")

    def __bool__(self) -> bool:
        raise ModelError("a constraint has no truth value: write `expr.within((lo, hi))` for `lo <= expr <= hi`")


def as_expr(value: Operand) -> Expr:
    """The expression itself, or a constant leaf for numbers, arrays and intervals."""
    if isinstance(value, Expr):
        return value
    if isinstance(value, Interval):
        value = IntervalArray(np.asarray(value.lo), np.asarray(value.hi))
    if not isinstance(value, IntervalArray):
        value = enclosed(value)
    if bool(np.any(value.empty)):
        raise ModelError("a constant is NaN or an empty interval")
    return Expr("constant", shape=value.shape, data=value)


def enclosed(value: Any) -> IntervalArray:
    """Numbers as degenerate intervals; ints and fractions that no float64 equals as the narrowest around them."""
    try:
        array = np.asarray(value)
        if array.dtype.kind in "iuO" and array.size and all(isinstance(v, Rational) for v in array.ravel().tolist()):
            exact = array.ravel().tolist()
            lo, hi = (np.array([rounded(v) for v in exact]).reshape(array.shape) for rounded in (round_down, round_up))
            return IntervalArray(lo, lo if bool(np.all(lo == hi)) else hi)
        return IntervalArray.point(array)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{value!r} is no number or array of numbers: {error}") from None


def _is_thick(data: object) -> bool:
    return isinstance(data, IntervalArray) and bool(np.any(data.lo != data.hi))


def _broadcasts(shape: Shape, target: Shape) -> bool:
    """Whether an array of one shape can be repeated to fill the other."""
    try:
        return np.broadcast_shapes(shape, target) == target
    except ValueError:
        return False


def _binary(op: str, left: Operand, right: Operand) -> Expr:
    x, y = as_expr(left), as_expr(right)
    try:
        shape = np.broadcast_shapes(x.shape, y.shape)
    except ValueError:
        raise ModelError(f"shapes {x.shape} and {y.shape} do not broadcast in {op!r}") from None
    return Expr(op, (x, y), shape)


def _matmul(x: Expr, y: Expr) -> Expr:
    """Matrix product of stacks of matrices and vectors, written as products and sums."""
    if x.ndim == 0 or y.ndim == 0 or x.shape[-1] != y.shape[-2 if y.ndim > 1 else 0]:
        raise ModelError(f"shapes {x.shape} and {y.shape} do not fit a matrix product")
    if y.ndim == 1:
        return (x * y).sum(-1)
    if x.ndim == 1:
        return (x[:, None] * y).sum(-2)
    return (x[..., :, :, None] * y[..., None, :, :]).sum(-2)


def sqr(x: Operand) -> Expr:
    """Square (tighter than `x * x` over intervals)."""
    arg = as_expr(x)
    return Expr("sqr", (arg,), arg.shape)


def sqrt(x: Operand) -> Expr:
    """Square root, defined where the argument is not negative."""
    arg = as_expr(x)
    return Expr("sqrt", (arg,), arg.shape)


def norm(x: Operand) -> Expr:
    """Euclidean length along the last axis."""
    return sqrt(sqr(x).sum(-1))


def minimum(x: Operand, y: Operand) -> Expr:
    return _binary("min", x, y)


def maximum(x: Operand, y: Operand) -> Expr:
    return _binary("max", x, y)
