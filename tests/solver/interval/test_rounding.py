"""Directed rounding, interval arrays, sums, products and factors, against exact rational arithmetic."""

import ctypes
import math
import platform
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cpcal
from cpcal.common.errors import RoundingError
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box, IntervalArray, kernels
from cpcal.solver.interval.kernels import check_rounding

MAX = 1.7976931348623157e308


BOUND = st.sampled_from([0.0, 5e-324, 1.0, -1.0, MAX, -MAX, math.inf, -math.inf]) | st.floats(allow_nan=False)


@settings(max_examples=100, deadline=None)
@given(a=BOUND, b=BOUND)
def test_mid_rad_and_mag_cover_the_interval(a: float, b: float) -> None:
    lo, hi = min(a, b), max(a, b)
    if lo == math.inf or hi == -math.inf:
        return
    x = IntervalArray(np.array([lo, math.nan]), np.array([hi, math.nan]))
    mid, rad = float(x.mid[0]), float(x.rad[0])
    assert lo <= mid <= hi
    assert math.isfinite(mid)
    assert x.mag[0] == max(abs(lo), abs(hi))
    if math.isfinite(lo) and math.isfinite(hi):
        assert Fraction(hi) - Fraction(mid) <= rad if rad < math.inf else True
        assert Fraction(mid) - Fraction(lo) <= rad if rad < math.inf else True
    else:
        assert rad == math.inf
    assert np.isnan(x.mid[1])
    assert np.isnan(x.rad[1])


MODES = {"x86_64": (0x400, 0x800, 0xC00), "aarch64": (0x800000, 0x400000, 0xC00000)}.get(platform.machine(), ())


@pytest.fixture
def rounding() -> Iterator[ctypes.CDLL]:
    """The C library, whose rounding mode is put right in the end."""
    library = ctypes.CDLL(None)
    yield library
    library.fesetround(0)


@pytest.mark.parametrize("mode", MODES)  # downward, upward, towards zero
def test_where_another_library_has_changed_the_rounding_no_bound_is_computed(mode: int, rounding: ctypes.CDLL) -> None:
    check_rounding()
    net = cpcal.Network()
    x = net.variable("x", domain=(0.0, 2.0))
    net.add(x * x == 2.0)
    rounding.fesetround(mode)
    with pytest.raises(RoundingError, match="process of its own"):
        net.solve()


@pytest.fixture
def environment() -> Iterator[ctypes.Array[ctypes.c_uint32]]:
    """The floating-point environment of a PC's processor, which is put right in the end; word 7 holds the switches."""
    library, words = ctypes.CDLL(None), (ctypes.c_uint32 * 16)()
    library.fegetenv(words)
    kept = bytes(words)
    yield words
    library.fesetenv(kept)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the bits are those of other processors")
@pytest.mark.parametrize("bit", [0x8000, 0x40])  # small results are zero; small operands are
def test_where_a_library_has_switched_small_numbers_off_no_bound_is_computed(bit, environment):
    """Compiled with -ffast-math, it does so when it is loaded: x = 1 was lost, and "no solution" called proved."""
    net = cpcal.Network()
    x = net.variable("x", domain=(0.5, 2.0))
    net.add((1e-160 * x * 1e-155).within((5e-316, 1.5e-315)))
    environment[7] |= bit
    ctypes.CDLL(None).fesetenv(environment)
    with pytest.raises(RoundingError, match="process of its own"):
        net.solve()


@pytest.mark.skipif(not MODES, reason="the numbers of the modes are those of other processors")
def test_a_plug_in_that_changes_it_ends_the_search(rounding: ctypes.CDLL) -> None:
    class Switching:
        gives_weights = False

        def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
            rounding.fesetround(MODES[1])
            return Contraction(box)

    net = cpcal.Network()
    x = net.variable("x", domain=(0.0, 2.0))
    net.add(x * x == 2.0)
    with pytest.raises(RoundingError, match="has changed how the processor rounds"):
        net.solve(contractors=[Switching(), "hc4"])


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
