"""Directed rounding, interval arrays, sums, products and factors, exactly; `Box`: named bounds that searches share."""

import copy
import ctypes
import math
import pickle
import platform
from collections.abc import Callable, Iterator
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.common.errors import ModelError, RoundingError
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box, Interval, IntervalArray, kernels
from cpcal.solver.interval.kernels import check_rounding
from tests.networks import network

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
    net, x = network(x=(0.0, 2.0))
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
    net, x = network(x=(0.5, 2.0))
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

    net, x = network(x=(0.0, 2.0))
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


NAMES = ("x", "y", "z")
FLOATS = st.sampled_from([0.0, -0.0, 1.0, -1.0, 2.0, math.inf, -math.inf]) | st.floats(allow_nan=False)
PAIRS = st.tuples(FLOATS, FLOATS).map(sorted).filter(lambda p: p[0] < math.inf and p[1] > -math.inf)
FULL = st.tuples(PAIRS, PAIRS, PAIRS).map(lambda ps: Box(NAMES, [p[0] for p in ps], [p[1] for p in ps]))
BOXES = FULL | st.just(Box.empty(NAMES))


def unit() -> Box:
    return Box.from_dict({"x": (0, 1), "y": Interval(2, 3), "z": 4})


def test_what_a_box_tells() -> None:
    box = unit()
    assert box.names == NAMES
    assert list(box) == list(NAMES)
    assert len(box) == 3
    assert box["y"] == Interval(2, 3)
    assert box.index("z") == 2
    np.testing.assert_array_equal(box.lo, [0, 2, 4])
    np.testing.assert_array_equal(box.hi, [1, 3, 4])
    np.testing.assert_array_equal(box.mid, [0.5, 2.5, 4])
    np.testing.assert_allclose(box.rad, [0.5, 0.5, 0], rtol=1e-15)
    np.testing.assert_allclose(box.width, [1, 1, 0], rtol=1e-15)
    assert box.array.lo is box.lo
    assert box.is_bounded
    assert not box.is_empty
    assert not box.replace("x", hi=math.inf).is_bounded


def test_a_box_is_immutable_and_independent_of_its_source() -> None:
    lo = np.zeros(3)
    box = Box(NAMES, lo, np.ones(3))
    lo[0] = -5.0
    assert box.lo[0] == 0.0
    for kept in (box.lo, box.hi, box.mid, box.rad, box.width):
        with pytest.raises(ValueError, match="read-only"):
            kept[0] = 1.0
    with pytest.raises(AttributeError, match="immutable"):
        box.lo = lo  # type: ignore[misc]
    with pytest.raises(AttributeError, match="immutable"):
        del box.names
    for same in (pickle.loads(pickle.dumps(box)), copy.deepcopy(box), copy.copy(box)):
        assert not same.lo.flags.writeable
        assert same == box


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: Box(["x", "y", "x"], [0, 0, 0], [1, 1, 1]), "repeated: x"),
        (lambda: Box("xy", [0, 0], [1, 1]), "'xy' are not names"),
        (lambda: Box([1, 2], [0, 0], [1, 1]), "1 is no name"),  # type: ignore[list-item]
        (lambda: Box(["x"], [0, 0], [1, 1]), "1 names, but bounds|1 variables?, but bounds"),
        (lambda: Box(["x"], [[0]], [[1]]), r"not \[\[0\]\]"),
        (lambda: Box(["x"], 0, 1), "not 0"),
        (lambda: Box(["x"], [2], [1]), r"\[2.0, 1.0\] is no interval"),
        (lambda: Box(["x"], [math.nan], [1]), r"\[nan, 1.0\] is no interval"),
        (lambda: Box(["x"], [math.inf], [math.inf]), r"\[inf, inf\] is no interval"),
        (lambda: Box.from_dict({"x": (2, 1)}), r"\[2.0, 1.0\] is not an interval"),
        (lambda: Box.from_dict({"x": (1, 2, 3)}), "too many values"),  # type: ignore[dict-item]
        (lambda: Box.from_dict({"x": "ab"}), "'ab' is no real number"),  # type: ignore[dict-item]
        (lambda: Box.empty([]), "a box without variables is never empty"),
        (lambda: unit()["q"], "no variable 'q'"),
        (lambda: unit().index("q"), "no variable 'q'"),
        (lambda: unit().replace("q", lo=0), "no variable 'q'"),
        (lambda: unit().with_bounds([0], [1]), "3 variables, but bounds"),
        (lambda: unit().with_bounds([0, 0, math.nan], [1, 1, 1]), "one bound is NaN"),
        (lambda: unit() & Box(["x"], [0], [1]), "boxes of different variables"),
        (lambda: unit() | Box(["y", "x", "z"], [0, 0, 0], [1, 1, 1]), "boxes of different variables"),
        (lambda: unit().subset(Box(["x"], [0], [1])), "boxes of different variables"),
        (lambda: {"x": 1} in unit(), "no value for y, z"),
        (lambda: [1, 2] in unit(), r"\[1, 2\] is no point of 3 variables"),
        (lambda: "x" in unit(), "'x' is no point of 3 variables"),
    ],
)
def test_misuse_is_a_model_error(make: Callable[[], object], reason: str) -> None:
    with pytest.raises(ModelError, match=reason):
        make()


@settings(max_examples=100, deadline=None)
@given(a=BOXES, b=BOXES)
def test_set_algebra_is_that_of_the_components(a: Box, b: Box) -> None:
    for name in NAMES:
        assert (a | b)[name] == a[name] | b[name]
        assert (a & b).is_empty or (a & b)[name] == a[name] & b[name]
    assert (a & b).is_empty == any((a[name] & b[name]).is_empty for name in NAMES)
    assert a.subset(b) == (a & b == a)
    assert a | Box.empty(NAMES) == a
    assert (a & Box.empty(NAMES)).is_empty


def test_text_of_few_and_many_variables() -> None:
    assert repr(Box.from_dict({"x": (0, 1.5)})) == "Box.from_dict({'x': (0, 1.5)})"
    assert str(unit()) == "x in [0, 1], y in [2, 3], z in [4, 4]"
    assert str(Box.empty(["x", "y"])) == "empty box of x, y"
    assert repr(Box.empty(["x"])) == "Box.empty(['x'])"
    leg = Box.from_dict(dict.fromkeys(("ax", "ay", "az", "bx", "by", "bz", "l"), (-1, 1)))
    assert str(leg).splitlines()[5:] == ["bz in [-1, 1]", "l  in [-1, 1]"]
    assert len(repr(leg).splitlines()) == 9
    assert eval(repr(leg)) == leg
    assert max(map(len, repr(leg).splitlines())) < 60


def test_a_box_without_variables_holds_one_point() -> None:
    box = Box((), [], [])
    assert not box.is_empty
    assert {} in box
    assert box & box == box
    assert box.with_bounds(np.zeros(0), np.zeros(0)) == box


def test_equality_goes_by_names_and_bounds() -> None:
    assert unit() == unit()
    assert hash(unit()) == hash(unit())
    assert unit() != unit().replace("x", hi=math.nextafter(1.0, 2.0))
    assert Box(["x"], [0.0], [0.0]) == Box(["x"], [-0.0], [-0.0])
    assert Box(["x"], [0], [1]) != Box(["y"], [0], [1])
    assert unit() != "box"
    with pytest.raises(TypeError, match="is_empty"):
        bool(unit())
