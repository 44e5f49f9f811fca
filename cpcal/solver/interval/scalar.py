"""One closed interval of real numbers, for users and for reading single components of boxes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from numbers import Rational
from typing import ClassVar, NoReturn

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.numbers import rounded_down, rounded_up
from cpcal.common.values import fill
from cpcal.solver.compiled import rebound
from cpcal.solver.interval import kernels
from cpcal.solver.interval.numbers import IntervalArray, Number, round_down, round_up

_KERNELS = rebound([f for f in vars(kernels).values() if getattr(f, "kernel", False)], {})
_NUMBERS = (int, float, Rational, Decimal, np.integer, np.floating)


def format_bound(value: float) -> str:
    """The shortest text that reads back as the same float, without a trailing `.0`."""
    return repr(float(value)).removesuffix(".0")


def _operator(kernel: str, swapped: bool = False) -> Callable[[Interval, Interval | Number], Interval]:
    def operate(self: Interval, other: Interval | Number) -> Interval:
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
        self._set(lower, upper)

    def _set(self, lo: float, hi: float) -> None:
        # Adding zero turns -0.0 into 0.0, so that equal intervals have equal bits (Box, hash, JSON).
        fill(self, lo=lo + 0.0, hi=hi + 0.0)

    @classmethod
    def _raw(cls, lo: float, hi: float) -> Interval:
        interval = object.__new__(cls)
        interval._set(lo, hi)
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

    def __and__(self, other: Interval) -> Interval:
        return self.intersect(other) if isinstance(other, Interval) else NotImplemented

    def __or__(self, other: Interval) -> Interval:
        return self.hull(other) if isinstance(other, Interval) else NotImplemented

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

    __add__, __radd__ = _operator("add"), _operator("add", swapped=True)
    __sub__, __rsub__ = _operator("sub"), _operator("sub", swapped=True)
    __mul__, __rmul__ = _operator("mul"), _operator("mul", swapped=True)
    # Hull of the quotients by the divisor's nonzero points.
    __truediv__, __rtruediv__ = _operator("div"), _operator("div", swapped=True)

    def __neg__(self) -> Interval:
        return Interval._raw(-self.hi, -self.lo)

    def __pow__(self, exponent: int) -> Interval:
        if not isinstance(exponent, int | np.integer):
            return NotImplemented
        return _computed("power", self, n=(int(exponent),))

    def __abs__(self) -> Interval:
        return _computed("absolute", self)

    def sqrt(self) -> Interval:
        """Square root of the part that is >= 0."""
        return _computed("sqrt", self)

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


def _computed(kernel: str, *operands: Interval, n: tuple[int, ...] = ()) -> Interval:
    """By a kernel in plain Python, without numba."""
    bounds = [(np.float64(x.lo), np.float64(x.hi)) for x in operands]
    with np.errstate(all="ignore"):
        lo, hi = _KERNELS[kernel](*bounds, *n)
    return Interval._raw(float(lo), float(hi))
