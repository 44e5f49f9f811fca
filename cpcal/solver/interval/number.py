"""Real numbers as users write them, enclosed by float64 bounds: exact where a float64 equals them, else outward."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Sequence
from decimal import Decimal
from fractions import Fraction
from numbers import Rational
from typing import Any, SupportsFloat, TypeAlias

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import ModelError

Number: TypeAlias = int | float | Rational | SupportsFloat

_EXACT_INTEGERS = 2**53  # every integer up to here is a float64


def round_down(value: Number) -> float:
    """The greatest float64 that is at most value. NaN stays NaN; ModelError for what is no real number."""
    real = _comparable(value)
    nearest = _nearest(real)
    return math.nextafter(nearest, -math.inf) if nearest > real else nearest


def round_up(value: Number) -> float:
    """The least float64 that is at least value. NaN stays NaN; ModelError for what is no real number."""
    real = _comparable(value)
    nearest = _nearest(real)
    return math.nextafter(nearest, math.inf) if nearest < real else nearest


def float_bounds(values: object) -> tuple[Floats, Floats]:
    """The greatest float64s below and the least above an array of numbers; one array where both agree.

    Takes numbers, nested sequences of them and arrays. A string is no number and neither is a bool: both are
    refused, as complex numbers and arrays with a meaning beyond their numbers (masks, units) are. Raises ModelError.
    An array of float64 comes back as it is, not copied.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values, values
    if type(values) is float:
        array = np.asarray(values)
        return array, array
    array = _as_array(values)
    if _fits(array):
        exact = array.astype(np.float64)
        return exact, exact
    if array.dtype.kind not in "iufO":
        raise ModelError(
            f"{reprlib.repr(values)} holds no real numbers ({array.dtype}): give ints, floats or fractions"
        )
    numbers = array.ravel().tolist()
    lo, hi = (np.array([rounded(v) for v in numbers], np.float64) for rounded in (round_down, round_up))
    lo, hi = lo.reshape(array.shape), hi.reshape(array.shape)
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


def _nearest(value: Any) -> float:
    """The float64 nearest to value, infinite beyond their range."""
    try:
        return float(value)
    except OverflowError:  # an int or a fraction
        return math.inf if value > 0 else -math.inf


def _as_array(values: object) -> np.ndarray[Any, Any]:
    """The numbers as they were given: numpy alone would round a list that mixes types."""
    if isinstance(values, np.ndarray) and type(values) not in (np.ndarray, np.memmap):
        kind = type(values).__name__
        raise ModelError(f"a {kind} is more than its numbers: pass what it means as a plain array (numpy.asarray)")
    if hasattr(values, "__array__"):
        return np.asarray(values)
    if not isinstance(values, Sequence) or isinstance(values, (str, bytes)):
        scalar = np.empty((), dtype=object)
        scalar[()] = values
        return scalar
    try:
        array = np.array(values, dtype=object)
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
