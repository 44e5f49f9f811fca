"""`Interval`: one interval as users handle it."""

import math
import operator
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.common.errors import ModelError
from cpcal.solver.interval import Interval

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
