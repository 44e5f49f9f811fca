"""Real numbers as users write them, enclosed by float64 bounds: exact where a float64 equals them, else outward."""

from __future__ import annotations

import math
import re
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from numbers import Rational
from typing import Any, ClassVar, NoReturn, SupportsFloat, TypeAlias

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.numbers import rounded_down, rounded_up
from cpcal.common.values import ArrayLike, ArrayPair, Bools, Floats, Shape, all_finite, fill, floats
from cpcal.solver.compiled import in_python
from cpcal.solver.interval import kernels
from cpcal.solver.interval.operations import ADD, DIV, MUL, NEG, SQR, SQRT, SUB, elementwise, products, totals

Number: TypeAlias = int | float | Rational | SupportsFloat

_EXACT_INTEGERS = 2**53  # every integer up to here is a float64


def round_down(value: Number) -> float:
    """The greatest float64 that is at most value. NaN stays NaN; ModelError for what is no real number."""
    real, nearest = _with_nearest(value)
    return math.nextafter(nearest, -math.inf) if nearest > real else nearest


def round_up(value: Number) -> float:
    """The least float64 that is at least value. NaN stays NaN; ModelError for what is no real number."""
    real, nearest = _with_nearest(value)
    return math.nextafter(nearest, math.inf) if nearest < real else nearest


def float_bounds(values: object) -> ArrayPair:
    """The greatest float64s below and the least above an array of numbers; one array where both agree.

    Takes numbers, nested sequences of them and arrays. A string is no number and neither is a bool: both are
    refused, as complex numbers and arrays with a meaning beyond their numbers (masks, units) are. Raises ModelError.
    An array of float64 comes back as it is, not copied.
    """
    if type(values) is float:
        values = np.asarray(values)
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values, values
    array = _as_array(values)
    if _fits(array):
        exact = array.astype(np.float64)
        return exact, exact
    if array.dtype.kind not in "iufO":
        raise ModelError(
            f"{reprlib.repr(values)} holds no real numbers ({array.dtype}): give ints, floats or fractions"
        )
    numbers = array.ravel().tolist()
    rounded = (np.array(list(map(side, numbers)), np.float64) for side in (round_down, round_up))
    lo, hi = (bounds.reshape(array.shape) for bounds in rounded)
    return (lo, lo) if np.array_equal(lo, hi, equal_nan=True) else (lo, hi)


def _comparable(value: object) -> Any:
    """The same number, of a type that compares with floats exactly."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool)):
        return value
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, np.floating):  # a longdouble may lie between two float64s
        return Fraction(*value.as_integer_ratio()) if np.isfinite(value) else float(value)
    if isinstance(value, Decimal):
        return math.nan if value.is_nan() else value
    if isinstance(value, Rational) and not isinstance(value, bool):
        return Fraction(int(value.numerator), int(value.denominator))
    raise ModelError(f"{reprlib.repr(value)} is no real number: give an int, a float, a Fraction or a Decimal")


def _with_nearest(value: object) -> tuple[Any, float]:
    """The same number, comparable with floats, and the float64 nearest to it, infinite beyond their range."""
    real = _comparable(value)
    try:
        return real, float(real)
    except OverflowError:  # an int or a fraction
        return real, math.inf if real > 0 else -math.inf


def _as_array(values: object) -> np.ndarray[Any, Any]:
    """The numbers as they were given: numpy alone would round a list that mixes types."""
    if isinstance(values, np.ndarray) and type(values) not in (np.ndarray, np.memmap):
        kind = type(values).__name__
        raise ModelError(f"a {kind} is more than its numbers: pass what it means as a plain array (numpy.asarray)")
    if hasattr(values, "__array__"):
        return np.asarray(values)
    if not isinstance(values, Sequence) or isinstance(values, (str, bytes)):
        scalar = np.empty((), object)
        scalar[()] = values
        return scalar
    try:
        array = np.array(values, object)
    except ValueError as error:
        raise ModelError(f"{reprlib.repr(values)} is no array: {error}") from None
    plain = all(type(v) is float for v in array.ravel().tolist())
    return array.astype(np.float64) if plain else array


def _fits(array: np.ndarray[Any, Any]) -> bool:
    """Whether float64 holds every element exactly."""
    kind, size = array.dtype.kind, int(array.dtype.itemsize)
    if kind == "f":
        return size <= 8
    if kind not in "iu":
        return False
    least, most = int(array.min(initial=0)), int(array.max(initial=0))
    return size <= 4 or (least >= -_EXACT_INTEGERS and most <= _EXACT_INTEGERS)


# ------------------------------------------------------------------------------------------------------------------
# Arrays of intervals: two float64 arrays of the same shape.


def _operation(code: int, reflected: bool = False) -> Callable[..., IntervalArray]:
    def operate(x: IntervalArray, other: Intervals | None = None) -> IntervalArray:
        y = x if other is None else IntervalArray.of(other)
        return y.apply(code, x) if reflected else x.apply(code, y)

    return operate


class HasBounds:
    """What follows from arrays of lower and upper bounds, element by element."""

    __slots__ = ()

    lo: Floats
    hi: Floats

    @property
    def mid(self) -> Floats:
        """A finite float64 in each interval, near its middle (NaN where empty)."""
        if all_finite(self.lo) and all_finite(self.hi):
            mid = np.asarray(0.5 * self.lo + 0.5 * self.hi)
            np.maximum(mid, self.lo, out=mid)  # halves of subnormal numbers round
            return np.minimum(mid, self.hi, out=mid)
        lo_infinite, hi_infinite = np.isinf(self.lo), np.isinf(self.hi)
        with np.errstate(invalid="ignore"):
            mid = 0.5 * self.lo + 0.5 * self.hi
            mid = np.where(lo_infinite & hi_infinite, 0.0, mid)
            mid = np.where(lo_infinite & ~hi_infinite, np.minimum(self.hi, -kernels.MAX), mid)
            mid = np.where(hi_infinite & ~lo_infinite, np.maximum(self.lo, kernels.MAX), mid)
            return np.clip(mid, self.lo, self.hi)

    @property
    def rad(self) -> Floats:
        """An upper bound of the distance from `mid` to either end."""
        mid = self.mid
        with np.errstate(over="ignore"):
            rad = np.maximum(self.hi - mid, mid - self.lo)
            return np.where(rad == 0.0, 0.0, np.nextafter(rad, np.inf))

    @property
    def mag(self) -> Floats:
        """The largest absolute value in each interval."""
        return np.maximum(np.abs(self.lo), np.abs(self.hi))

    @property
    def width(self) -> Floats:
        """An upper bound of `hi - lo`, exact where one of them is zero."""
        with np.errstate(all="ignore"):
            width = self.hi - self.lo
            exact = (self.lo == 0.0) | (self.hi == 0.0)
            return np.where(exact, width, width + np.abs(width) * kernels.PHI)


@dataclass(frozen=True, eq=False)
class IntervalArray(HasBounds):
    """Intervals `[lo, hi]`, elementwise. NaN in both bounds is the empty interval, and propagates.

    Bounds may be infinite; `lo` is never +inf and `hi` never -inf. Arithmetic broadcasts as in numpy and takes arrays
    for exact numbers. Every result contains the exact image of the operands' points, where the operation is defined
    there: rounded to nearest by the processor, then moved outward; overflow gives an infinite bound.
    """

    lo: Floats
    hi: Floats

    __array_ufunc__: ClassVar[None] = None  # so that numpy leaves array + intervals to these

    __add__, __sub__, __mul__, __truediv__ = map(_operation, (ADD, SUB, MUL, DIV))
    __radd__, __rsub__, __rmul__, __rtruediv__ = (_operation(code, reflected=True) for code in (ADD, SUB, MUL, DIV))
    __neg__, sqr, sqrt = map(_operation, (NEG, SQR, SQRT))  # the square root is of the part that is >= 0

    def apply(self, code: int, other: IntervalArray | None = None, n: int = 0) -> IntervalArray:
        """Any operation of the table, element by element; n is a power's exponent."""
        operands = (self, self if other is None else other)
        shape = np.broadcast_shapes(*(x.shape for x in operands))
        lo, hi = np.zeros((2, math.prod(shape)))
        a, b = (x.broadcast_to(shape).reshape((-1,)).copied() for x in operands)
        elementwise(code, n, a, b, (lo, hi))
        return IntervalArray(lo, hi).reshape(shape)

    def sum(self, axis: int) -> IntervalArray:
        """Along one axis, which disappears."""
        lo, hi = (np.array(np.moveaxis(bound, axis, -1), np.float64, order="C") for bound in (self.lo, self.hi))
        shape, count = lo.shape[:-1], lo.shape[-1]
        size = math.prod(shape)
        below, above = np.zeros((2, size))
        totals((lo.reshape(size, count), hi.reshape(size, count)), (below, above))
        return IntervalArray(below, above).reshape(shape)

    def __matmul__(self, other: Intervals) -> IntervalArray:
        """Of shapes (..., k) and (k, n)."""
        y = IntervalArray.of(other)
        shape, count = (*self.shape[:-1], y.shape[1]), math.prod(self.shape[:-1])
        lo, hi = np.zeros((2, count, y.shape[1]))
        if self.lo.size:
            products(self.reshape((count, self.shape[-1])).copied(), y.copied(), (lo, hi))
        return IntervalArray(lo, hi).reshape(shape)

    def copied(self) -> ArrayPair:
        """The bounds in arrays of their own: kernels are compiled for arrays that may be written."""
        return np.array(self.lo, np.float64, order="C"), np.array(self.hi, np.float64, order="C")

    @classmethod
    def of(cls, values: Intervals) -> IntervalArray:
        """Intervals as they are; exact numbers as degenerate ones."""
        return values if isinstance(values, IntervalArray) else cls.point(floats(values))

    @classmethod
    def point(cls, values: ArrayLike) -> IntervalArray:
        """The degenerate intervals `[v, v]`. Raises ModelError for numbers that no float64 equals."""
        lo, hi = float_bounds(values)
        if lo is not hi:
            raise ModelError("no float64 equals one of these numbers: enclose them by IntervalArray.around(v, 0)")
        return cls(lo, lo)

    @classmethod
    def around(cls, center: ArrayLike, radius: ArrayLike) -> IntervalArray:
        """Enclosure of `[center - radius, center + radius]`; shapes broadcast, radius >= 0."""
        (lowest, highest), (_, reach) = float_bounds(center), float_bounds(radius)
        lowest, highest, reach = np.broadcast_arrays(lowest, highest, reach)
        exact = reach == 0.0
        with np.errstate(over="ignore"):
            lo = np.where(exact, lowest, np.nextafter(lowest - reach, -np.inf))
            hi = np.where(exact, highest, np.nextafter(highest + reach, np.inf))
        return cls(lo, hi)

    @property
    def shape(self) -> Shape:
        return self.lo.shape

    @property
    def empty(self) -> Bools:
        """Which elements are the empty interval."""
        return np.isnan(self.lo)

    def intersect(self, other: IntervalArray) -> IntervalArray:
        """Elementwise intersection (broadcasts); disjoint intervals give the empty one."""
        lo = np.maximum(self.lo, other.lo)
        hi = np.minimum(self.hi, other.hi)
        empty = ~(lo <= hi)
        if empty.any():
            lo, hi = np.where(empty, np.nan, lo), np.where(empty, np.nan, hi)
        return IntervalArray(lo, hi)

    def __getitem__(self, index: Any) -> IntervalArray:
        return IntervalArray(self.lo[index], self.hi[index])

    def reshape(self, shape: Shape) -> IntervalArray:
        return IntervalArray(self.lo.reshape(shape), self.hi.reshape(shape))

    def broadcast_to(self, shape: Shape) -> IntervalArray:
        if self.lo.shape == shape:
            return self
        lo = np.broadcast_to(self.lo, shape)
        return IntervalArray(lo, lo if self.hi is self.lo else np.broadcast_to(self.hi, shape))


Intervals = IntervalArray | ArrayLike


# ------------------------------------------------------------------------------------------------------------------
# One closed interval of real numbers, for users and for reading single components of boxes.

_KERNELS = in_python(kernels)
_NUMBERS = (int, float, Rational, Decimal, np.integer, np.floating)


def format_bound(value: float) -> str:
    """The shortest text that reads back as the same float, without a trailing `.0`."""
    return repr(float(value)).removesuffix(".0")


def _operator(kernel: str, swapped: bool = False) -> Callable[..., Interval]:
    def operate(self: Interval, other: Interval | Number | None = None) -> Interval:
        if other is None:
            return _computed(kernel, self)
        if not isinstance(other, Interval):
            if not isinstance(other, _NUMBERS):
                return NotImplemented  # type: ignore[no-any-return]  # as Python's operators do
            other = Interval(other)
        return _computed(kernel, other, self) if swapped else _computed(kernel, self, other)

    return operate


@dataclass(frozen=True, slots=True, init=False, eq=False, repr=False)
class Interval:
    """The closed interval `[lo, hi]`, possibly unbounded or empty; `Interval(v)` is `[v, v]`.

    Arithmetic with intervals and numbers on either side is rounded outward. An interval has no truth value
    and no order: ask `in`, `subset`, `is_empty`, or compare bounds.
    """

    lo: float
    hi: float

    __array_ufunc__: ClassVar[None] = None  # so that numpy scalars on the left leave the operation to us

    def __init__(self, lo: Number, hi: Number | None = None) -> None:
        lower, upper = round_down(lo), round_up(lo if hi is None else hi)
        if not lower <= upper:
            raise ModelError(f"[{lower}, {upper}] is not an interval: give numbers lo <= hi, or Interval.empty()")
        if lower == math.inf or upper == -math.inf:
            raise ModelError(f"[{lower}, {upper}] holds no real number: infinity can only be the far end")
        # Adding zero turns -0.0 into 0.0, so that equal intervals have equal bits (Box, hash, JSON).
        fill(self, lo=lower + 0.0, hi=upper + 0.0)

    @classmethod
    def _raw(cls, lo: float, hi: float) -> Interval:
        interval = object.__new__(cls)
        fill(interval, lo=lo + 0.0, hi=hi + 0.0)
        return interval

    @classmethod
    def empty(cls) -> Interval:
        """The interval without points; its bounds are NaN."""
        return cls._raw(math.nan, math.nan)

    @property
    def is_empty(self) -> bool:
        return math.isnan(self.lo)

    @property
    def is_bounded(self) -> bool:
        """Whether it lies between two numbers, as the empty interval does."""
        return not (math.isinf(self.lo) or math.isinf(self.hi))

    @property
    def mid(self) -> float:
        """A float of the interval near its middle; NaN if empty."""
        return float(self._array().mid)

    @property
    def rad(self) -> float:
        """An upper bound of the distance from `mid` to either end; NaN if empty."""
        return float(self._array().rad)

    @property
    def width(self) -> float:
        """An upper bound of `hi - lo`; NaN if empty."""
        return float(self._array().width)

    @property
    def mag(self) -> float:
        """The largest absolute value; NaN if empty."""
        return max(abs(self.lo), abs(self.hi))

    def __contains__(self, value: Number) -> bool:
        return self.lo <= round_down(value) and round_up(value) <= self.hi

    def subset(self, other: Interval) -> bool:
        """Whether every point of this interval is one of other; the empty interval lies in all."""
        return self.is_empty or (other.lo <= self.lo and self.hi <= other.hi)

    def intersect(self, other: Interval) -> Interval:
        """The points in both; `&` for short."""
        return _computed("meet", self, other)

    def hull(self, other: Interval) -> Interval:
        """The smallest interval that contains both; `|` for short. The empty interval is neutral."""
        return _computed("hull", self, other)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Interval):
            return NotImplemented
        return (self.lo == other.lo and self.hi == other.hi) or (self.is_empty and other.is_empty)

    def __hash__(self) -> int:
        return hash((Interval, None if self.is_empty else (self.lo, self.hi)))

    def __bool__(self) -> NoReturn:
        raise TypeError("an interval has no truth value: test .is_empty, .subset(other) or `x in interval`")

    def _array(self) -> IntervalArray:
        return IntervalArray(np.array(self.lo), np.array(self.hi))

    # A quotient is the hull of those by the divisor's nonzero points; the square root is of the part that is >= 0.
    __add__, __sub__, __mul__, __truediv__, __and__, __or__ = map(
        _operator, ("add", "sub", "mul", "div", "meet", "hull")
    )
    __radd__, __rsub__, __rmul__, __rtruediv__ = (
        _operator(name, swapped=True) for name in ("add", "sub", "mul", "div")
    )
    __neg__, __abs__, sqrt = map(_operator, ("neg", "absolute", "sqrt"))

    def __pow__(self, exponent: int) -> Interval:
        if not isinstance(exponent, int | np.integer):
            return NotImplemented
        return _computed("power", self, n=(int(exponent),))

    def __repr__(self) -> str:
        return "Interval.empty()" if self.is_empty else f"Interval({self.lo!r}, {self.hi!r})"

    def __str__(self) -> str:
        return "[empty]" if self.is_empty else f"[{format_bound(self.lo)}, {format_bound(self.hi)}]"

    def __format__(self, spec: str) -> str:
        """`f"{x:.6f}"`: six decimals, the lower bound rounded down and the upper one up; other specs are refused."""
        if not spec or self.is_empty:
            return str(self)
        if not re.fullmatch(r"\.\d+f", spec):
            raise ValueError(f"an Interval is formatted by '.6f' and the like, not by {spec!r}")
        decimals = int(spec[1:-1])
        lo = str(self.lo) if math.isinf(self.lo) else rounded_down(self.lo, decimals)
        hi = str(self.hi) if math.isinf(self.hi) else rounded_up(self.hi, decimals)
        return f"[{lo}, {hi}]"


def joined(parts: Sequence[IntervalArray], axis: int = -1) -> IntervalArray:
    """One after the other along an axis."""
    return IntervalArray(np.concatenate([p.lo for p in parts], axis), np.concatenate([p.hi for p in parts], axis))


def _computed(kernel: str, *operands: Interval, n: Shape = ()) -> Interval:
    """By a kernel in plain Python, without numba."""
    bounds = [(np.float64(x.lo), np.float64(x.hi)) for x in operands]
    with np.errstate(all="ignore"):
        lo, hi = _KERNELS[kernel](*bounds, *n)
    return Interval._raw(float(lo), float(hi))
