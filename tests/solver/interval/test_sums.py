"""Sums, matrix products and factors, against exact rational arithmetic."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.solver.interval import IntervalArray, kernels

MAX = 1.7976931348623157e308
NASTY = [0.0, 5e-324, -5e-324, 1e-310, -1e-160, 1e-160, 1.0, -3.0, 1e16, 1e160, 1e300, -1e300, MAX, -MAX]
FINITE = st.sampled_from(NASTY) | st.floats(allow_nan=False, allow_infinity=False)
MODERATE = st.floats(-1e3, 1e3, allow_subnormal=False)
Pair = tuple[float, float]


def intervals(ends: st.SearchStrategy[float], shape: tuple[int, ...]) -> st.SearchStrategy[IntervalArray]:
    size = math.prod(shape)
    pair = st.tuples(ends, ends).map(lambda p: (min(p), max(p))) | ends.map(lambda v: (v, v))
    return st.lists(pair, min_size=size, max_size=size).map(
        lambda pairs: IntervalArray(*np.array(pairs, dtype=float).reshape(*shape, 2).transpose(-1, *range(len(shape))))
    )


def exact_product(a: Pair, b: Pair) -> tuple[Fraction, Fraction]:
    products = [Fraction(u) * Fraction(v) for u in a for v in b]
    return min(products), max(products)


def pair(x: IntervalArray, *index: int) -> Pair:
    return float(x.lo[index]), float(x.hi[index])


@pytest.mark.parametrize("shape", [(1, 2), (2, 3), (9, 2), (67, 2)])
@settings(max_examples=10, deadline=None)
@given(data=st.data())
def test_sum_contains_the_exact_sum_and_is_tight(shape: tuple[int, int], data: st.DataObject) -> None:
    x = data.draw(intervals(data.draw(st.sampled_from([FINITE, MODERATE])), shape))
    down, across = x.sum(0), IntervalArray(x.lo.T, x.hi.T).sum(1)
    for got in (down, across):
        assert got.shape == shape[1:]
        for j in range(shape[1]):
            low, high = (sum(map(Fraction, bounds[:, j].tolist()), Fraction(0)) for bounds in (x.lo, x.hi))
            assert got.lo[j] <= low
            assert got.hi[j] >= high
            size = sum(map(abs, map(Fraction, [*x.lo[:, j].tolist(), *x.hi[:, j].tolist()])), Fraction(0))
            if size < MAX / 2:  # else rounding may overflow
                slack = size * Fraction(shape[0].bit_length() + 2, 2**52) + Fraction(2e-323)
                assert low - Fraction(float(got.lo[j])) <= slack
                assert Fraction(float(got.hi[j])) - high <= slack


@pytest.mark.parametrize(("m", "k", "n"), [(1, 1, 1), (2, 3, 2), (1, 6, 2), (3, 0, 2)])
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_dot_contains_the_exact_product(m: int, k: int, n: int, data: st.DataObject) -> None:
    ends = data.draw(st.sampled_from([FINITE, MODERATE, st.floats(-1e-150, 1e-150)]))
    x, y = data.draw(intervals(ends, (m, k))), data.draw(intervals(ends, (k, n)))
    if data.draw(st.booleans()):
        x = IntervalArray.point(x.lo)
    got = x @ y
    assert got.shape == (m, n)
    for i in range(m):
        for j in range(n):
            products = [exact_product(pair(x, i, t), pair(y, t, j)) for t in range(k)]
            assert got.lo[i, j] <= sum(low for low, _ in products)
            assert got.hi[i, j] >= sum(high for _, high in products)


def factor(*operands: Pair) -> Pair:
    low, high = kernels.factor(*(tuple(map(np.float64, pair)) for pair in operands))
    return float(low), float(high)


def test_dot_of_points_is_tight() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(6, 30)), rng.normal(size=(30, 7))
    got = IntervalArray.point(a) @ IntervalArray.point(b)
    assert (got.hi - got.lo <= 40 * 2.0**-52 * (np.abs(a) @ np.abs(b))).all()
