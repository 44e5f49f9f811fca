"""Array-valued expressions over named variables, constants and readings: the nodes of the DAG.

Expressions are plain immutable data. What an operation means stands in `cpcal.solver.interval.operations`.
"""

from __future__ import annotations

import hashlib
import math
import operator
import os
import reprlib
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial, reduce
from typing import Any, NoReturn, TypeVar, Union

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.values import AnyArray, Indices, Ints, Shape, fill
from cpcal.solver.interval import Interval, IntervalArray
from cpcal.solver.interval.box import has_points
from cpcal.solver.interval.functions import PIO2
from cpcal.solver.interval.numbers import float_bounds, format_bound

# ------------------------------------------------------------------------------------------------------------------
# What leaves of expressions hold: numbers from users, enclosed, copied and frozen where they come in.

T = TypeVar("T")


def pair(value: Any, where: str) -> tuple[Any, Any]:
    """The two members of a pair of bounds. Raises ModelError for anything else, and for what may be two intervals."""
    listed = isinstance(value, (tuple, list)) or (isinstance(value, np.ndarray) and value.ndim > 0)
    if not listed or len(value) != 2:
        raise ModelError(f"{where} takes an Interval or a pair (lower, upper), not {reprlib.repr(value)}")
    two_intervals = isinstance(value, list) and all(isinstance(bound, tuple) for bound in value)
    if two_intervals or (isinstance(value, np.ndarray) and value.ndim > 1):
        raise ModelError(
            f"{where} takes all lower bounds first: write ([lower, ...], [upper, ...]), not {reprlib.repr(value)}"
        )
    return value[0], value[1]


def _frozen(array: AnyArray) -> AnyArray:
    """A read-only copy, so that nothing that the caller does to an array changes what was proved about it."""
    array = np.array(array, order="C")
    array.flags.writeable = False
    return array


def positions(shape: Shape) -> Ints:
    """The flat index of every element."""
    return np.arange(int(np.prod(shape, dtype=np.int64))).reshape(shape)


# ------------------------------------------------------------------------------------------------------------------
# Walks over the DAG of expressions, without recursion: a sum of thousands of terms is thousands of levels deep.


def topological(roots: Iterable[Expr], known: Container[bytes] = ()) -> list[Expr]:
    """All distinct nodes under `roots`, arguments first; equal expressions are one node.

    Those that are `known`, by their digests, are left out, and what is below them alone.
    """
    order = {}
    stack = [(root, False) for root in reversed(list(roots))]
    while stack:
        node, expanded = stack.pop()
        if node.digest in order or node.digest in known:
            continue
        if expanded:
            order[node.digest] = node
        else:
            stack.append((node, True))
            stack.extend((arg, False) for arg in reversed(node.args))
    return list(order.values())


def folded(root: Expr, value: Callable[[Expr, list[T]], T], known: dict[bytes, T] | None = None) -> T:
    """What `value` makes of the root, and of what it made of its arguments, from the leaves up; `known` grows by it."""
    known = {} if known is None else known
    for node in topological((root,), known):
        known[node.digest] = value(node, [known[arg.digest] for arg in node.args])
    return known[root.digest]


Operand = Union["Expr", float, int, Fraction, Interval, IntervalArray, AnyArray, list[Any], tuple[Any, ...]]

SELECTS = 1  # parameter of a "mul" by zeros and ones: 0 wherever the factor is 0, also where the other is not defined
_LEVELS = 64  # levels of a deep expression that pickle may follow by recursion
_LARGEST_POWER = 2**31  # of a whole exponent


def _named(op: str, meaning: str = "", of: Callable[[Expr], Expr] | None = None) -> Callable[[Operand], Expr]:
    """A function of one expression: an operation, or what is made `of` others."""

    def function(x: Operand) -> Expr:
        arg = as_expr(x)
        return Expr(op, (arg,), arg.shape) if of is None else of(arg)

    function.__name__ = function.__qualname__ = op
    function.__doc__ = meaning
    return function


def _both_ways(
    operation: Callable[[Operand, Operand], Expr],
) -> tuple[Callable[[Expr, Operand], Expr], Callable[[Expr, Operand], Expr]]:
    """An operator and the reflected one, which has an expression on its right."""
    return lambda x, y: operation(x, y), lambda y, x: operation(x, y)


def binary(op: str, left: Operand, right: Operand) -> Expr:
    x, y = as_expr(left), as_expr(right)
    try:
        shape = np.broadcast_shapes(x.shape, y.shape)
    except ValueError:
        raise ModelError(f"shapes {x.shape} and {y.shape} do not broadcast in {op!r}") from None
    return Expr(op, (x, y), shape)


def _matmul(one: Operand, two: Operand) -> Expr:
    """Matrix product of stacks of matrices and vectors, written as products and sums."""
    x, y = as_expr(one), as_expr(two)
    if x.ndim == 0 or y.ndim == 0 or x.shape[-1] != y.shape[-2 if y.ndim > 1 else 0]:
        raise ModelError(f"shapes {x.shape} and {y.shape} do not fit a matrix product")
    if y.ndim == 1:
        return (x * y).sum(-1)
    if x.ndim == 1:
        return (x[:, None] * y).sum(-2)
    return (x[..., :, :, None] * y[..., None, :, :]).sum(-2)


def power(x: Operand, exponent: Operand) -> Expr:
    """`x ** exponent`: products for a whole number, a root for 0.5, else exp(exponent log(x)), where x > 0."""
    base = as_expr(x)
    try:
        other = as_expr(exponent)
    except ModelError as error:
        raise ModelError(f"{exponent!r} is no exponent: {error}") from None
    if "variable" in other.ops:
        return exp(other * log(base))
    lo, hi = other.data.lo.ravel(), other.data.hi.ravel()
    if lo.size != 1 or (lo[0] != hi[0] and math.ceil(lo[0]) <= math.floor(hi[0])):
        raise ModelError(
            f"{exponent!r} may be a whole power of a negative number, but it is no known number: write that, "
            f"or exp(exponent * log(base)), which is defined where the base is positive"
        )
    value = float(lo[0])
    if abs(value) >= _LARGEST_POWER:
        raise ModelError(f"{exponent!r} is no exponent: whole ones are less than 2^31")
    if value == 0.5 == hi[0]:
        return sqrt(base)
    if value != int(value) or value != hi[0]:
        return exp(other * log(base))
    return sqr(base) if value == 2.0 else Expr("power", (base,), base.shape, parameter=int(value))


def _compared(lower: float, upper: float) -> Callable[[Expr, Operand], Constraint]:
    """A comparison: the difference of both sides lies between two numbers."""
    return lambda x, y: (x - y).within((lower, upper))


def _refused(why: str) -> Callable[..., NoReturn]:
    def refuse(*_: object) -> NoReturn:
        raise ModelError(why)

    return refuse


_NO_PLACES = _frozen(np.zeros(0, np.intp))
_NO_DATA = IntervalArray(_frozen(np.zeros(0)), _frozen(np.zeros(0)))


@dataclass(frozen=True, eq=False, repr=False)
class Expr:
    """A node: an operation on other nodes, or a leaf ("variable", "constant", "reading").

    `data` holds the value of a constant, or the set that a reading is known to lie in, and `places` the flat indices of
    an "index", in read-only arrays of its own, empty for others; `parameter` a "power"'s exponent, a "sum"'s axis, a
    "mul"'s SELECTS; `name` a variable's name and `owner` that of its network, for messages.
    """

    op: str
    args: tuple[Expr, ...] = ()
    shape: Shape = ()
    parameter: int = 0
    name: str = ""
    data: IntervalArray = _NO_DATA
    places: Indices = field(default_factory=lambda: _NO_PLACES)
    owner: str = ""
    # SHA-256 of the structure: expressions of equal digests have equal values. Two variables, two readings or two
    # enclosures may be different numbers of the same set: each has a random identity, which pickles with it and
    # which no other process gives away again.
    digest: bytes = field(init=False)
    depth: int = field(init=False)
    size: int = field(init=False)  # how many elements
    ops: frozenset[str] = field(init=False)  # of this node and all below

    __hash__ = object.__hash__

    def __post_init__(self) -> None:
        if 0 in self.shape:
            raise ModelError(f"an array of shape {self.shape} has no elements: nothing could be asked of it")
        depth = 1 + max((arg.depth for arg in self.args), default=0)
        fill(
            self,
            depth=depth,
            size=math.prod(self.shape),
            ops=frozenset((self.op,)).union(*(arg.ops for arg in self.args)),
        )
        hasher = hashlib.sha256(repr((self.op, self.shape, self.parameter, self.name)).encode())
        if self.data is not _NO_DATA:
            lo = _frozen(self.data.lo)
            fill(self, data=IntervalArray(lo, lo if self.data.hi is self.data.lo else _frozen(self.data.hi)))
            hasher.update(lo.tobytes() + self.data.hi.tobytes())
        if self.places.size:
            fill(self, places=_frozen(self.places))
            hasher.update(self.places.tobytes())
        if self.op in ("variable", "reading") or (self.op == "constant" and np.any(self.data.lo != self.data.hi)):
            hasher.update(os.urandom(16))
        for arg in self.args:
            hasher.update(arg.digest)
        fill(self, digest=hasher.digest())

    def __deepcopy__(self, memo: object = None) -> Expr:
        return self

    __copy__ = __deepcopy__

    def __getstate__(self) -> tuple[list[Expr], dict[str, Any]]:
        """Some of the expressions below come first, from the leaves up: pickle would follow a long sum too deep."""
        if self.depth % _LEVELS:
            return [], self.__dict__
        return [node for node in topological(self.args) if node.depth % _LEVELS == 0], self.__dict__

    def __setstate__(self, state: tuple[list[Expr], dict[str, Any]]) -> None:
        self.__dict__.update(state[1])
        for array in (self.data.lo, self.data.hi, self.places):  # numpy unpickles every array writable
            array.flags.writeable = False

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @property
    def is_constant(self) -> bool:
        """Whether neither a variable nor a reading is in it."""
        return self.ops.isdisjoint(("variable", "reading"))

    # arithmetic -----------------------------------------------------------------------------------

    __neg__, __abs__ = _named("neg"), _named("abs")
    __add__, __radd__ = _both_ways(partial(binary, "add"))
    __sub__, __rsub__ = _both_ways(partial(binary, "sub"))
    __mul__, __rmul__ = _both_ways(partial(binary, "mul"))
    __truediv__, __rtruediv__ = _both_ways(partial(binary, "div"))
    __pow__, __rpow__ = _both_ways(power)
    __matmul__, __rmatmul__ = _both_ways(_matmul)

    def sum(self, axis: int | None = None) -> Expr:
        """Sum along one axis, which disappears; of all elements without one, as in numpy."""
        if axis is None and self.shape:
            return self.reshape(-1).sum(0)
        if not isinstance(axis, (int, np.integer)) or not -self.ndim <= axis < self.ndim:
            raise ModelError(f"{axis!r} is no axis of an expression of shape {self.shape}: give one of its integers")
        axis = int(axis) % self.ndim
        return Expr("sum", (self,), self.shape[:axis] + self.shape[axis + 1 :], parameter=axis)

    @property
    def T(self) -> Expr:
        """Axes in reverse order."""
        return self._gathered(positions(self.shape).T) if self.ndim > 1 else self

    def reshape(self, *shape: Any) -> Expr:
        """The same elements in another shape, in C order."""
        wanted = shape[0] if len(shape) == 1 else shape
        try:
            return self._gathered(positions(self.shape).reshape(wanted))
        except ValueError:
            raise ModelError(f"an expression of shape {self.shape} can not be reshaped to {wanted}") from None

    def __getitem__(self, index: Any) -> Expr:
        """numpy's basic and advanced indexing."""
        try:
            return self._gathered(positions(self.shape)[index])
        except IndexError as error:
            raise ModelError(f"index {index!r} does not fit shape {self.shape}: {error}") from None

    def _gathered(self, positions: Any) -> Expr:
        flat = np.asarray(positions, np.intp)
        return Expr("index", (self,), flat.shape, places=flat)

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a scalar expression has no length")
        return self.shape[0]

    def __iter__(self) -> Any:
        return (self[k] for k in range(len(self)))

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        name = ufunc.__name__
        if ufunc is np.add and method == "reduce":
            return total(inputs[0], options.get("axis", 0))
        if method != "__call__" or options or not (name in _UFUNCS or name in _OPERATORS):
            known = ", ".join((*_UFUNCS, *_OPERATORS))
            raise ModelError(f"numpy.{name} is no operation of expressions; there are {known}")
        return _UFUNCS[name](*inputs) if name in _UFUNCS else _OPERATORS[name](as_expr(inputs[0]), inputs[1])

    def __array_function__(self, called: Any, types: Any, args: Any, options: Any) -> Any:
        if called not in _FUNCTIONS:
            known = ", ".join(known.__name__ for known in _FUNCTIONS)
            raise ModelError(f"numpy.{called.__name__} takes no expressions; there are {known}")
        return _FUNCTIONS[called](*args, **options)

    __float__ = _refused("an expression is no number: write cpcal.sin(x) or numpy.sin(x) instead of math.sin(x)")

    # constraints ----------------------------------------------------------------------------------

    def within(self, bounds: Interval | tuple[Operand, Operand]) -> Constraint:
        """The constraint `lower <= self <= upper`, elementwise; bounds may be expressions, `(-eps, eps)`.

        A lower bound may be -inf, an upper one inf. Raises ModelError for bounds that no number lies between.
        """
        if isinstance(bounds, Interval):
            bounds = (bounds.lo, bounds.hi)
        lower, upper = pair(bounds, "within()")
        return Constraint(self, *(bound if isinstance(bound, Expr) else _constant(bound) for bound in (lower, upper)))

    __eq__ = _compared(0.0, 0.0)  # type: ignore[assignment]
    __le__, __ge__ = _compared(-np.inf, 0.0), _compared(0.0, np.inf)
    __ne__ = _refused("`!=` is no constraint here: the set would not be closed")
    __lt__ = __gt__ = _refused("`<` and `>` are no constraints here, the set would not be closed: write `<=` or `>=`")
    __bool__ = _refused("an expression has no truth value; build a constraint and add it to a network")

    def __repr__(self) -> str:
        return f"<Expr {self} of shape {self.shape}>"

    def __str__(self) -> str:
        """As mathematics; arrays of numbers by their shape."""

        def written(node: Expr, args: list[Written]) -> Written:
            said, rank = _written(node, args)
            half = _LONGEST // 2
            return (f"{said[:half]} ... {said[-half:]}" if len(said) > _LONGEST else said), rank

        return folded(self, written)[0]


@dataclass(frozen=True, eq=False, repr=False)
class Constraint:
    """`lower <= body <= upper`, elementwise; all three broadcast to `body`'s shape."""

    body: Expr
    lower: Expr
    upper: Expr

    def __post_init__(self) -> None:
        for bound in (self.lower, self.upper):
            try:
                np.broadcast_to(np.empty(bound.shape), self.body.shape)
            except ValueError:
                wrong = f"bounds of shape {bound.shape} do not fit a body of shape {self.body.shape}"
                raise ModelError(wrong) from None
        known = self.lower.op == self.upper.op == "constant"
        if known and not has_points(self.lower.data.lo, self.upper.data.hi).all():
            raise ModelError("no number lies between these bounds: give within((lower, upper)), lower <= upper")

    @property
    def parts(self) -> tuple[Expr, Expr, Expr]:
        return self.body, self.lower, self.upper

    @property
    def is_equation(self) -> bool:
        return self.lower.digest == self.upper.digest

    def __repr__(self) -> str:
        return f"<Constraint {self}>"

    def __str__(self) -> str:
        """Without the bounds that say nothing; `body = number` for equal ones."""
        if self.is_equation:
            return f"{self.body} = {self.lower}"
        left, right = (
            bound.op == "constant" and np.isinf(bound.data.lo).all() and np.isinf(bound.data.hi).all()
            for bound in (self.lower, self.upper)
        )
        return ("" if left else f"{self.lower} <= ") + str(self.body) + ("" if right else f" <= {self.upper}")

    __bool__ = _refused(
        "a constraint has no truth value: write `expr.within((lo, hi))` for `lo <= expr <= hi`, and "
        "`numpy.stack([x, y])` for `numpy.array([x, y])`, whose elements numpy compares one by one"
    )


def as_expr(value: Operand) -> Expr:
    """The expression itself, or a constant leaf for numbers, arrays and intervals, which are copied.

    Raises ModelError for what is no finite real number; ints and fractions that no float64 equals are enclosed.
    """
    if isinstance(value, Expr):
        return value
    try:
        leaf = _constant(value)
    except ModelError:
        parts = value.flat if isinstance(value, np.ndarray) else value if isinstance(value, (list, tuple)) else ()
        if not any(isinstance(part, Expr) for part in parts):
            raise
        raise ModelError("an array of expressions is numpy.stack([x, y]), no list and no numpy.array") from None
    if not isinstance(value, IntervalArray) and np.any((leaf.data.lo == np.inf) | (leaf.data.hi == -np.inf)):
        raise ModelError("infinity is no real number: leave that constraint out, or write within((lower, numpy.inf))")
    return leaf


def _constant(value: Operand) -> Expr:
    """A constant leaf, where infinity may stand for a bound that is not there."""
    if isinstance(value, Interval):
        value = IntervalArray(np.asarray(value.lo), np.asarray(value.hi))
    values = value if isinstance(value, IntervalArray) else IntervalArray(*float_bounds(value))
    if values.lo.dtype != np.float64 or values.hi.dtype != np.float64 or values.lo.shape != values.hi.shape:
        raise ModelError("an IntervalArray has two float64 arrays of one shape")
    if not np.all(values.lo <= values.hi):
        raise ModelError("a constant is NaN or an empty interval")
    return Expr("constant", shape=values.shape, data=values)


# ------------------------------------------------------------------------------------------------------------------
# Expressions, constraints and networks as mathematics: `sqrt(x[0]^2 + x[1]^2) - 5 = 0`.

Written = tuple[str, int]  # and how tightly it binds

_LONGEST = 400  # characters of one expression: what is longer is cut in its middle
_SIGNS = {"add": " + ", "sub": " - ", "mul": " * ", "div": " / "}
_RANK = {"add": 1, "sub": 1, "mul": 2, "div": 2, "neg": 2, "sqr": 4, "power": 4}
_TIGHT = 5


def _written(node: Expr, args: list[Written]) -> Written:
    rank = _RANK.get(node.op, _TIGHT)
    if node.op == "variable":
        return node.name, _TIGHT
    if not node.args:
        if node.data.lo.size != 1:
            return f"{node.op}{node.shape}", _TIGHT
        lo, hi = format_bound(node.data.lo.item()), format_bound(node.data.hi.item())
        return f"[{lo}, {hi}]" if lo != hi else f"({lo})" if lo.startswith("-") else lo, _TIGHT
    first = args[0][0] if args[0][1] >= rank else f"({args[0][0]})"
    if node.op in _SIGNS:
        loose = args[1][1] <= rank if node.op in ("sub", "div") else args[1][1] < rank
        return first + _SIGNS[node.op] + (f"({args[1][0]})" if loose else args[1][0]), rank
    if node.op == "neg":
        return f"-{first}", rank
    if node.op in ("sqr", "power"):
        base = first if args[0][1] > rank else f"({args[0][0]})"
        return f"{base}^{2 if node.op == 'sqr' else node.parameter}", rank
    if node.op == "index":
        shape = node.args[0].shape
        place = "..." if node.places.size != 1 else ",".join(map(str, np.unravel_index(node.places.item(), shape)))
        return f"{first}[{place}]" if shape else first, _TIGHT
    if node.op == "sum":
        return f"sum({args[0][0]}, axis={node.parameter})", _TIGHT
    return f"{node.op}({', '.join(arg for arg, _ in args)})", _TIGHT


# ------------------------------------------------------------------------------------------------------------------
# Elementary functions of expressions, element by element.

sqr = _named("sqr", "Square (tighter than `x * x` over intervals).")
sqrt = _named("sqrt", "Square root, defined where the argument is not negative.")
exp = _named("exp", "e to the power of x.")
log = _named("log", "Natural logarithm, defined where x > 0.")
sin = _named("sin", "Sine of an angle in radians.")
cos = _named("cos", "Cosine of an angle in radians.")
tan = _named("tan", "Tangent of an angle in radians, defined between its poles.")
asin = _named("asin", "Angle in [-pi/2, pi/2] of a sine, defined on [-1, 1].")
atan = _named("atan", "Angle in (-pi/2, pi/2) of a tangent.")
acos = _named("acos", "Angle in [0, pi] of a cosine, defined on [-1, 1].", lambda x: as_expr(Interval(*PIO2)) - asin(x))
sinh = _named("sinh", "Hyperbolic sine.", lambda x: 0.5 * (exp(x) - exp(-x)))
cosh = _named("cosh", "Hyperbolic cosine.", lambda x: 0.5 * (exp(x) + exp(-x)))
tanh = _named("tanh", "Hyperbolic tangent.", lambda x: 1.0 - 2.0 / (exp(2.0 * x) + 1.0))
acosh = _named("acosh", "Inverse hyperbolic cosine, >= 0, defined where x >= 1.", lambda x: log(x + sqrt(sqr(x) - 1.0)))
atanh = _named(
    "atanh", "Inverse hyperbolic tangent, defined where -1 < x < 1.", lambda x: 0.5 * (log(1.0 + x) - log(1.0 - x))
)
norm = _named("norm", "Euclidean length along the last axis.", lambda x: sqrt(sqr(x).sum(-1)))


def asinh(x: Operand) -> Expr:
    """Inverse hyperbolic sine; the same on both sides of 0, where log(x + sqrt(x^2 + 1)) would cancel for x < 0."""
    above, below = (maximum(side, 0.0) for side in (x, -as_expr(x)))
    return log(above + sqrt(sqr(above) + 1.0)) - log(below + sqrt(sqr(below) + 1.0))


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


# ------------------------------------------------------------------------------------------------------------------
# numpy's functions on expressions: `np.sin(x)`, `np.linalg.norm(x)`, `np.stack([x, y])` give expressions again.

_Function = Callable[..., Any]


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
    **{op: globals()[op] for op in ("exp", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "arcsin": asin,
    "arccos": acos,
    "arctan": atan,
    "arctan2": atan2,
    "arcsinh": asinh,
    "arccosh": acosh,
    "arctanh": atanh,
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
}


def total(x: Operand, axis: Any = None, keepdims: bool = False) -> Expr:
    """Sum along one axis, along several, or (None) of all elements."""
    expr = as_expr(x)
    axes = range(expr.ndim) if axis is None else (axis if isinstance(axis, tuple) else (axis,))
    for one in sorted((a % max(expr.ndim, 1) for a in axes), reverse=True):
        expr = expr.sum(one)[(slice(None),) * one + (None,)] if keepdims else expr.sum(one)
    return expr


def _mean(x: Operand, axis: Any = None, keepdims: bool = False) -> Expr:
    whole = total(x, axis, keepdims)
    return whole / (as_expr(x).size // whole.size)


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
    place, spread = np.arange(ends[-1]), []
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
