"""Arrays of intervals: two float64 arrays of the same shape. The plain data that the engines work on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import ModelError
from cpcal.solver.interval.number import float_bounds


@dataclass(frozen=True, eq=False)
class IntervalArray:
    """Intervals `[lo, hi]`, elementwise. NaN in both bounds is the empty interval, and propagates.

    Bounds may be infinite; `lo` is never +inf and `hi` never -inf.
    """

    lo: Floats
    hi: Floats

    @classmethod
    def point(cls, values: npt.ArrayLike) -> IntervalArray:
        """The degenerate intervals `[v, v]`. Raises ModelError for numbers that no float64 equals."""
        lo, hi = float_bounds(values)
        if lo is not hi:
            raise ModelError("no float64 equals one of these numbers: enclose them by IntervalArray.around(v, 0)")
        return cls(lo, lo)

    @classmethod
    def around(cls, center: npt.ArrayLike, radius: npt.ArrayLike) -> IntervalArray:
        """Enclosure of `[center - radius, center + radius]`; shapes broadcast, radius >= 0."""
        (lowest, highest), (_, reach) = float_bounds(center), float_bounds(radius)
        lowest, highest, reach = np.broadcast_arrays(lowest, highest, reach)
        exact = reach == 0.0
        with np.errstate(over="ignore"):
            lo = np.where(exact, lowest, np.nextafter(lowest - reach, -np.inf))
            hi = np.where(exact, highest, np.nextafter(highest + reach, np.inf))
        return cls(lo, hi)

    @property
    def shape(self) -> tuple[int, ...]:
        return self.lo.shape

    @property
    def ndim(self) -> int:
        return self.lo.ndim

    @property
    def empty(self) -> npt.NDArray[np.bool_]:
        """Which elements are the empty interval."""
        return np.isnan(self.lo)

    @property
    def mid(self) -> Floats:
        """A finite float64 in each interval, near its middle (NaN where empty)."""
        if self.lo is self.hi and np.isfinite(self.lo).all():
            return self.lo
        if np.isfinite(self.lo).all() and np.isfinite(self.hi).all():
            mid = np.asarray(0.5 * self.lo + 0.5 * self.hi)
            np.maximum(mid, self.lo, out=mid)  # halves of subnormal numbers round
            return np.asarray(np.minimum(mid, self.hi, out=mid))
        lo_infinite, hi_infinite = np.isinf(self.lo), np.isinf(self.hi)
        biggest = np.finfo(np.float64).max
        with np.errstate(invalid="ignore"):
            mid = 0.5 * self.lo + 0.5 * self.hi
            mid = np.where(lo_infinite & hi_infinite, 0.0, mid)
            mid = np.where(lo_infinite & ~hi_infinite, np.minimum(self.hi, -biggest), mid)
            mid = np.where(hi_infinite & ~lo_infinite, np.maximum(self.lo, biggest), mid)
            return np.clip(mid, self.lo, self.hi)

    @property
    def rad(self) -> Floats:
        """An upper bound of the distance from `mid` to either end."""
        mid = self.mid
        with np.errstate(over="ignore"):
            rad = np.maximum(self.hi - mid, mid - self.lo)
            return np.asarray(np.where(rad == 0.0, 0.0, np.nextafter(rad, np.inf)))

    @property
    def mag(self) -> Floats:
        """The largest absolute value in each interval."""
        return np.maximum(np.abs(self.lo), np.abs(self.hi))

    def intersect(self, other: IntervalArray) -> IntervalArray:
        """Elementwise intersection (broadcasts); disjoint intervals give the empty one."""
        lo = np.maximum(self.lo, other.lo)
        hi = np.minimum(self.hi, other.hi)
        empty = ~(lo <= hi)
        if empty.any():
            lo, hi = np.where(empty, np.nan, lo), np.where(empty, np.nan, hi)
        return IntervalArray(lo, hi)

    def hull(self, other: IntervalArray) -> IntervalArray:
        """Elementwise convex hull of the union; the empty interval is neutral."""
        return IntervalArray(np.fmin(self.lo, other.lo), np.fmax(self.hi, other.hi))

    def subset(self, other: IntervalArray) -> npt.NDArray[np.bool_]:
        """Which elements lie inside those of `other`; the empty interval lies inside all."""
        return np.asarray(self.empty | ((self.lo >= other.lo) & (self.hi <= other.hi)))

    def __getitem__(self, index: Any) -> IntervalArray:
        return IntervalArray(self.lo[index], self.hi[index])

    def reshape(self, shape: tuple[int, ...]) -> IntervalArray:
        return IntervalArray(self.lo.reshape(shape), self.hi.reshape(shape))

    def broadcast_to(self, shape: tuple[int, ...]) -> IntervalArray:
        if self.lo.shape == shape:
            return self
        lo = np.broadcast_to(self.lo, shape)
        return IntervalArray(lo, lo if self.hi is self.lo else np.broadcast_to(self.hi, shape))
