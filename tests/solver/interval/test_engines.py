"""Interval arithmetic against point values computed by arb with more bits than any of these operations needs.

The oracle knows nothing of interval formulas: it evaluates an operation at points of the operands. Bounds
must never exclude such a value, and must lie within a few floats of the extreme ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import product

import flint
import numpy as np
import pytest
from flint import arb
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.solver.interval import IntervalArray
from cpcal.solver.interval.kernels import root
from cpcal.solver.interval.operations import CODES, POWER

MAX = 1.7976931348623157e308
TINY = 5e-324
NASTY = [0.0, TINY, 1e-310, 2.0**-1022, 2.0**-1021, 1e-200, 1e-160, 0.5, 1.0, 3.0, 1e16, 1e160, 1e300, MAX]
NASTY += [math.nextafter(1.0, 0.0), math.nextafter(1.0, 2.0), math.nextafter(2.0**-1021, 1.0)]
FINITE = st.sampled_from(NASTY + [-v for v in NASTY]) | st.floats(allow_nan=False, allow_infinity=False)
Pair = tuple[float, float]
EMPTY: Pair = (math.nan, math.nan)


def ordered(ends: Pair) -> Pair:
    return min(ends), max(ends)


BOUNDED = st.tuples(FINITE, FINITE).map(ordered) | FINITE.map(lambda v: (v, v))
HALF_LINES = FINITE.map(lambda v: (-math.inf, v)) | FINITE.map(lambda v: (v, math.inf))
UNBOUNDED = HALF_LINES | st.just((-math.inf, math.inf))
ANY = BOUNDED | UNBOUNDED | st.just(EMPTY)

UNARY: dict[str, Callable[[arb], arb]] = {
    "neg": lambda a: -a,
    "abs": abs,
    "sqr": lambda a: a * a,
    "sqrt": lambda a: a.sqrt(),
}
BINARY: dict[str, Callable[[arb, arb], arb]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "min": lambda a, b: a.min(b),
    "max": lambda a, b: a.max(b),
}
EXACT = {"neg", "abs", "min", "max"}


@pytest.fixture(scope="module", autouse=True)
def _many_bits() -> Iterator[None]:
    """Sums of any two floats are exact with 2200 bits."""
    before = flint.ctx.prec
    flint.ctx.prec = 2400
    yield
    flint.ctx.prec = before


def array(pairs: list[Pair]) -> IntervalArray:
    return IntervalArray(np.array([p[0] for p in pairs], float), np.array([p[1] for p in pairs], float))


def points(pair: Pair) -> list[float]:
    """Some floats of an interval: finite bounds and what lies between them."""
    lo, hi = pair
    candidates = [lo, hi, 0.0, TINY, -TINY, 1.0, -1.0, MAX, -MAX, lo / 2 + hi / 2]
    return [v for v in candidates if math.isfinite(v) and lo <= v <= hi]


def moved(bound: float, ulps: int) -> float:
    """The float this many places above (below if negative)."""
    for _ in range(abs(ulps)):
        bound = math.nextafter(bound, math.copysign(math.inf, ulps))
    return bound


def assert_contains(lo: float, hi: float, value: arb) -> None:
    assert not value < arb(lo), (lo, hi, value)
    assert not value > arb(hi), (lo, hi, value)


def assert_tight(lo: float, hi: float, values: list[arb], ulps: int) -> None:
    """The bounds, moved inward by some floats, no longer enclose the values."""
    for value in values:
        assert_contains(lo, hi, value)
    assert any(not arb(moved(lo, ulps + 1)) <= v for v in values), (lo, values, ulps)
    assert any(not arb(moved(hi, -ulps - 1)) >= v for v in values), (hi, values, ulps)


def results(x: IntervalArray) -> Iterator[Pair]:
    for lo, hi in zip(x.lo.tolist(), x.hi.tolist(), strict=True):
        assert math.isnan(lo) == math.isnan(hi)
        assert lo < math.inf or math.isnan(lo)
        assert hi > -math.inf or math.isnan(hi)
        yield lo, hi


def batch(*strategies: st.SearchStrategy[Pair]) -> st.SearchStrategy[list[tuple[Pair, ...]]]:
    """Several operand tuples at once, so that an element's neighbours take other paths of the code."""
    return st.lists(st.tuples(*strategies), min_size=1, max_size=8)


@pytest.mark.parametrize("name", BINARY)
@settings(max_examples=30, deadline=None)
@given(data=batch(ANY, ANY))
def test_binary_contains_every_point_and_is_tight(name: str, data: list[tuple[Pair, Pair]]) -> None:
    ulps = 0 if name in EXACT else 3
    got = array([x for x, _ in data]).apply(CODES[name], array([y for _, y in data]))
    for (x, y), (lo, hi) in zip(data, results(got), strict=True):
        pairs = [(a, b) for a, b in product(points(x), points(y)) if name != "div" or b != 0.0]
        assert math.isnan(lo) == (not pairs)
        for a, b in pairs:
            assert_contains(lo, hi, BINARY[name](arb(a), arb(b)))
        if pairs and all(map(math.isfinite, (*x, *y))) and not (name == "div" and y[0] <= 0.0 <= y[1]):
            assert_tight(lo, hi, [BINARY[name](arb(a), arb(b)) for a, b in product(x, y)], ulps)


@pytest.mark.parametrize("name", UNARY)
@settings(max_examples=30, deadline=None)
@given(data=st.lists(ANY, min_size=1, max_size=8))
def test_unary_contains_every_point_and_is_tight(name: str, data: list[Pair]) -> None:
    for x, (lo, hi) in zip(data, results(array(data).apply(CODES[name])), strict=True):
        inside = [a for a in points(x) if name != "sqrt" or a >= 0.0]
        values = [UNARY[name](arb(a)) for a in inside]
        assert math.isnan(lo) == (not values)
        for value in values:
            assert_contains(lo, hi, value)
        if values and math.isfinite(x[0]) and math.isfinite(x[1]):
            assert_tight(lo, hi, values, 0 if name in EXACT else 3)
        assert name == "neg" or not lo < 0.0


@pytest.mark.parametrize("n", [-5, -2, -1, 0, 1, 2, 3, 4, 7, 10])
@settings(max_examples=20, deadline=None)
@given(data=st.lists(ANY, min_size=1, max_size=8))
def test_power(n: int, data: list[Pair]) -> None:
    ulps = (3 if n >= 0 else 5) * abs(n)
    for x, (lo, hi) in zip(data, results(array(data).apply(POWER, n=n)), strict=True):
        inside = [a for a in points(x) if n > 0 or a != 0.0 or (n == 0 and x != EMPTY)]
        values = [arb(a) ** n if a else arb(0 if n else 1) for a in inside]
        assert math.isnan(lo) == (not values)
        for value in values:
            assert_contains(lo, hi, value)
        if values and math.isfinite(x[0]) and math.isfinite(x[1]) and (n >= 0 or not x[0] <= 0.0 <= x[1]):
            assert_tight(lo, hi, values, ulps)
        assert n % 2 or not lo < 0.0


@pytest.mark.parametrize("n", [1, 2, 3, 17, 2000])
@settings(max_examples=20, deadline=None)
@given(data=st.lists(ANY, min_size=1, max_size=8))
def test_root(n: int, data: list[Pair]) -> None:
    roots = np.array([root(tuple(map(np.float64, x)), n) for x in data]).T
    for x, (lo, hi) in zip(data, results(IntervalArray(*roots)), strict=True):
        inside = [a for a in points(x) if n % 2 or a >= 0.0]
        values = [arb(abs(a)).root(n) * (1 if a > 0.0 else -1) if a else arb(0) for a in inside]
        assert math.isnan(lo) == (not values)
        for value in values:
            assert_contains(lo, hi, value)
        if values and math.isfinite(x[0]) and math.isfinite(x[1]) and n < 1000:
            assert_tight(lo, hi, values, 6)
        assert n % 2 or not lo < 0.0


@settings(max_examples=30, deadline=None)
@given(data=batch(ANY, ANY))
def test_zeros_stay_exact(data: list[tuple[Pair, Pair]]) -> None:
    x, zero = array([x for x, _ in data]), IntervalArray.point(np.zeros(len(data)))
    full = ~x.empty
    for got in (
        (x * zero),
        (zero * x),
        zero.apply(POWER, n=3),
        zero.apply(CODES["sqrt"]),
        zero.sqr(),
    ):
        rows = full if len(got.lo) == len(full) else slice(None)
        assert not got.lo[rows].any()
        assert not got.hi[rows].any()
    for got in (
        (x + zero),
        (zero + x),
        (x - zero),
        -(zero - x),
    ):
        np.testing.assert_array_equal(got.lo, x.lo)
        np.testing.assert_array_equal(got.hi, x.hi)


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [
        ((1, 2), (-1, 1), (-math.inf, math.inf)),
        ((0, 0), (-1, 1), (0, 0)),
        ((1, 2), (0, 4), (0.25, math.inf)),
        ((1, 2), (-4, 0), (-math.inf, -0.25)),
        ((-2, -1), (-0.0, 4), (-math.inf, -0.25)),
        ((-2, -1), (-4, 0), (0.25, math.inf)),
        ((-1, 1), (0, 4), (-math.inf, math.inf)),
        ((0, 1), (0, 4), (0, math.inf)),
        ((1, 2), (0, 0), EMPTY),
        ((0, 0), (0, 0), EMPTY),
        ((1, 1), (2, math.inf), (0, 0.5)),
        ((-math.inf, math.inf), (1, math.inf), (-math.inf, math.inf)),
        ((-math.inf, -1), (0, math.inf), (-math.inf, 0)),
    ],
)
def test_division_by_intervals_with_zero_or_infinity(x: Pair, y: Pair, expected: Pair) -> None:
    got = array([x]) / array([y])
    np.testing.assert_allclose([got.lo[0], got.hi[0]], expected, rtol=1e-15, atol=0.0)


def test_overflow_widens_to_infinity() -> None:
    big, small = array([(MAX, MAX), (-MAX, -MAX)]), array([(TINY, TINY), (TINY, TINY)])
    ten = IntervalArray.point(10.0)
    for got in ((big + big), (big * ten), (big / small), big.apply(POWER, n=3)):
        assert 0.999 * MAX < got.lo[0] < math.inf
        assert got.hi[0] == math.inf
        assert got.lo[1] == -math.inf
        assert -math.inf < got.hi[1] < -0.999 * MAX


def test_underflow_of_a_product_is_not_an_exact_zero() -> None:
    tiny = IntervalArray.point(np.array([1e-200, -1e-200]))
    got = tiny * IntervalArray.point(1e-200)
    assert (got.lo == [0.0, -TINY]).all()
    assert (got.hi == [TINY, 0.0]).all()
    assert ((array([(-1e-200, 0.0)]) * array([(0.0, 1e-200)])).lo == -TINY).all()


def test_operands_broadcast_and_may_have_no_dimension() -> None:
    column, row = array([(1, 2), (3, 4)]).reshape((2, 1)), array([(5, 6), (-1, 1), (0, 0)])
    scalar = IntervalArray.point(2.0)
    for name in BINARY:
        operands = ((column, row), (scalar, scalar), (row, scalar))
        assert [pair[0].apply(CODES[name], pair[1]).shape for pair in operands] == [(2, 3), (), (3,)]
    assert scalar.apply(POWER, n=-3).shape == scalar.sqr().shape == ()
