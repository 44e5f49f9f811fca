"""Numbers as users write them: enclosed where a float64 does not equal them, refused where they are none."""

import math
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpcal.common.errors import ModelError
from cpcal.solver.interval import Box, Interval, IntervalArray
from cpcal.solver.interval.numbers import float_bounds

LONG = np.longdouble(1) / 3
REALS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False), st.integers(), st.fractions(),
    st.decimals(allow_nan=False, allow_infinity=False), st.integers(-(2**63), 2**63 - 1).map(np.int64),
    st.integers(0, 2**64 - 1).map(np.uint64),
    st.floats(allow_nan=False, allow_infinity=False, width=32).map(np.float32),
    st.floats(-1e300, 1e300).map(lambda v: np.longdouble(v) / 3),
)  # fmt: skip


def exact(value: Any) -> Fraction:
    if isinstance(value, np.integer):
        return Fraction(int(value))
    return Fraction(*value.as_integer_ratio())


def encloses(lo: float, value: Any, hi: float) -> bool:
    """Whether lo and hi are the nearest floats on both sides of a number (one float if it is one)."""
    real = exact(value)
    below = lo == -math.inf or Fraction(lo) <= real
    above = hi == math.inf or Fraction(hi) >= real
    return below and above and (hi == math.nextafter(lo, math.inf) or (lo == hi and Fraction(lo) == real))


@given(st.lists(REALS, min_size=1, max_size=5))
def test_every_real_number_is_enclosed_tightly_alone_and_in_mixed_lists(values: list[Any]) -> None:
    lo, hi = float_bounds(values)
    for k, value in enumerate(values):
        assert encloses(lo[k], value, hi[k])
        assert encloses(Interval(value).lo, value, Interval(value).hi)
        assert (float(float_bounds(value)[0]), float(float_bounds(value)[1])) == (lo[k], hi[k])
    box = Box([f"x{k}" for k in range(len(values))], values, values)
    assert (box.lo.tolist(), box.hi.tolist()) == (lo.tolist(), hi.tolist())


@pytest.mark.parametrize(
    "array",
    [
        np.array([2**53 + 1, 1]),
        np.array([2**64 - 1], np.uint64),
        np.array([[1, 2], [3, 4]], np.int8),
        np.array([0.1, 1], np.float16),
        np.array([LONG, -LONG]),
        np.array([Fraction(1, 3), 0.5], dtype=object),
        range(3),
        [[1, 0.5], (Fraction(1, 3), 2)],
        [np.array([1.0, 2.0]), [LONG, 2**53 + 1]],
    ],
    ids=repr,
)
def test_arrays_of_any_real_type_are_enclosed(array: Any) -> None:
    lo, hi = float_bounds(array)
    values = np.array(array, dtype=object)
    assert lo.shape == hi.shape == values.shape
    assert all(encloses(*item) for item in zip(lo.flat, values.flat, hi.flat, strict=True))


def test_points_are_floats_and_sets_around_numbers_hold_them() -> None:
    for value in (Fraction(1, 3), [2**53 + 1, 0.5], Decimal("0.1"), np.longdouble(1) / 3):
        with pytest.raises(ModelError, match="float64"):
            IntervalArray.point(value)  # type: ignore[arg-type]
        around = IntervalArray.around(value, Fraction(1, 10))  # type: ignore[arg-type]
        for lo, real, hi in zip(around.lo.flat, np.array(value, dtype=object).flat, around.hi.flat, strict=True):
            assert Fraction(lo) <= exact(real) - Fraction(1, 10) < exact(real) + Fraction(1, 10) <= Fraction(hi)
    assert IntervalArray.point([[1, 2.5]]).lo.tolist() == [[1.0, 2.5]]


NO_NUMBERS = ["0.1", b"1", True, np.True_, 1 + 0j, None, [1], {1: 2}, np.array([1.0, 2.0]), np.datetime64("2020-01-01")]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: type(value).__name__)
def test_what_is_no_number_makes_no_interval(value: Any) -> None:
    for build in (lambda: Interval(value), lambda: Interval(value, 1), lambda: Box.from_dict({"x": (0, value)})):
        with pytest.raises(ModelError, match="is no real number"):
            build()


def test_decimals_far_beyond_the_floats_are_enclosed_at_once() -> None:
    assert float_bounds(Decimal("1e999999999")) == (np.finfo(float).max, np.inf)
    assert float_bounds(Decimal("-1e-999999999")) == (-5e-324, 0.0)
    assert all(np.isnan(bound) for bound in float_bounds(Decimal("nan")))
