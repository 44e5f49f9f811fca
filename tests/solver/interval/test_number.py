"""Numbers and intervals as users write and handle them: enclosed, computed with, refused where they are none."""

import math
import operator
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
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


OPERATIONS = [operator.add, operator.sub, operator.mul, operator.truediv]


MAX = 1.7976931348623157e308
FLOATS = st.sampled_from([0.0, -0.0, 5e-324, 1.0, -1.0, MAX, -MAX]) | st.floats(allow_nan=False, allow_infinity=False)
ENTIRE = Interval(-math.inf, math.inf)
BOUNDED = st.tuples(FLOATS, FLOATS).map(lambda p: Interval(min(p), max(p)))
INTERVALS = BOUNDED | st.sampled_from([Interval.empty(), ENTIRE, Interval(0, math.inf), Interval(-math.inf, 2)])


@pytest.mark.parametrize(
    ("lo", "hi", "reason"),
    [
        (2, 1, "is not an interval"),
        (math.nan, 1, "is not an interval"),
        (1, math.nan, "is not an interval"),
        (math.nan, math.nan, "is not an interval"),
        (math.inf, math.inf, "holds no real number"),
        (-math.inf, -math.inf, "holds no real number"),
    ],
)
def test_bounds_without_a_meaning_are_refused(lo: float, hi: float, reason: str) -> None:
    with pytest.raises(ModelError, match=reason):
        Interval(lo, hi)


@settings(max_examples=100, deadline=None)
@given(x=INTERVALS, y=INTERVALS, z=INTERVALS, value=FLOATS)
def test_set_algebra(x: Interval, y: Interval, z: Interval, value: float) -> None:
    assert x & y == y & x == x.intersect(y)
    assert x | y == y | x == x.hull(y)
    assert (x & y) & z == x & (y & z)
    assert (x | y) | z == x | (y | z)
    assert x & (x | y) == x
    assert x & x == x == x | x
    assert (value in x and value in y) == (value in (x & y))
    assert value in (x | y) or not (value in x or value in y)
    assert (x & y).subset(x)
    assert x.subset(x | y)
    assert x.subset(y) == (x & y == x)


def test_numbers_are_in_an_interval_exactly() -> None:
    assert 0 not in Interval.empty()
    assert math.nan not in ENTIRE
    assert 10**400 in Interval(0, math.inf)
    assert Fraction(1, 3) not in Interval(0.34, 1)
    assert np.int64(2**53 + 1) not in Interval(2**53)


def test_powers_roots_and_signs() -> None:
    x = Interval(-2, 3)
    assert -x == Interval(-3, 2)
    assert abs(x) == Interval(0, 3)
    assert (x**2).lo == 0.0
    assert 9 in x**2
    assert -8 in x**3
    assert x**0 == Interval(1)
    assert x ** np.int64(1) == x
    assert x**-1 == ENTIRE
    assert x.sqrt().lo == 0.0
    assert x.sqrt().hi >= math.sqrt(3)
    assert Interval(-2, -1).sqrt().is_empty
    assert (1 / Interval(0)).is_empty
    assert Interval(0) * ENTIRE == Interval(0)


def test_what_is_refused() -> None:
    x = Interval(0, 1)
    with pytest.raises(TypeError, match="is_empty"):
        bool(x)
    for refused in (lambda v: v + "1", lambda v: v**0.5, lambda v: v & "1", lambda v: v | "1"):
        with pytest.raises(TypeError, match="unsupported operand"):
            refused(x)
    for comparison in (operator.lt, operator.le, operator.gt, operator.ge):
        with pytest.raises(TypeError, match="not supported between instances of 'Interval'"):
            comparison(x, x)
    with pytest.raises(AttributeError, match="cannot assign to field 'lo'"):
        x.lo = 3.0  # type: ignore[misc]
    assert x != "x"
    assert x != 0


FINITE = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)


@given(FINITE, FINITE, st.integers(0, 12))
def test_decimals_hold_the_interval(a: float, b: float, decimals: int) -> None:
    lo, hi = min(a, b), max(a, b)
    text = f"{Interval(lo, hi):.{decimals}f}"
    printed_lo, printed_hi = (Decimal(part) for part in text.strip("[]").split(", "))
    unit = Decimal(1).scaleb(-decimals)
    assert printed_lo <= Decimal(lo) < printed_lo + unit
    assert printed_hi - unit < Decimal(hi) <= printed_hi


@pytest.mark.parametrize("number", [3, 0.1, Fraction(1, 3), 2**53 + 1, np.float64(0.7), np.int32(4)])
@pytest.mark.parametrize("operation", OPERATIONS)
def test_numbers_on_either_side_stand_for_their_exact_value(operation: object, number: object) -> None:
    x = Interval(2, 5)
    right, left = operation(x, number), operation(number, x)  # type: ignore[operator]
    assert isinstance(left, Interval)
    assert right == operation(x, Interval(number))  # type: ignore[operator, arg-type]
    assert left == operation(Interval(number), x)  # type: ignore[operator, arg-type]
