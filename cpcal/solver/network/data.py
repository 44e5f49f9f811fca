"""What leaves of expressions hold: numbers from users, enclosed, copied and frozen where they come in."""

from __future__ import annotations

import reprlib
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import ModelError
from cpcal.solver.interval import IntervalArray
from cpcal.solver.interval.numbers import float_bounds

Data: TypeAlias = IntervalArray | npt.NDArray[np.intp]


def enclosed(value: object) -> IntervalArray:
    """Numbers as degenerate intervals; those that no float64 equals as the narrowest around them. ModelError."""
    return IntervalArray(*float_bounds(value))


def checked(value: IntervalArray) -> IntervalArray:
    """The same intervals. Raises ModelError where one is empty or NaN, or where the two arrays do not match."""
    if value.lo.dtype != np.float64 or value.hi.dtype != np.float64 or value.lo.shape != value.hi.shape:
        raise ModelError("an IntervalArray has two float64 arrays of one shape")
    if not bool(np.all(value.lo <= value.hi)):
        raise ModelError("a constant is NaN or an empty interval")
    return value


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


def own(data: Data | None) -> Data | None:
    """A read-only copy, so that nothing that the caller does to an array changes what was proved about it."""
    if isinstance(data, IntervalArray):
        lo = np.array(data.lo, order="C")
        data = IntervalArray(lo, lo if data.hi is data.lo else np.array(data.hi, order="C"))
    elif data is not None:
        data = np.array(data, dtype=np.intp, order="C")
    freeze(data)
    return data


def freeze(data: Data | None) -> None:
    if data is not None:
        for array in (data.lo, data.hi) if isinstance(data, IntervalArray) else (data,):
            array.flags.writeable = False


def is_thick(data: object) -> bool:
    return isinstance(data, IntervalArray) and bool(np.any(data.lo != data.hi))


def broadcasts(shape: tuple[int, ...], target: tuple[int, ...]) -> bool:
    """Whether an array of one shape can be repeated to fill the other."""
    try:
        return np.broadcast_shapes(shape, target) == target
    except ValueError:
        return False


def positions(shape: tuple[int, ...]) -> npt.NDArray[np.int64]:
    """The flat index of every element."""
    return np.arange(int(np.prod(shape, dtype=np.int64))).reshape(shape)
