"""`Box`: named bounds that searches share."""

import copy
import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.common.errors import ModelError
from cpcal.solver.interval import Box, Interval

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
    for change in (lambda: box.lo.__setitem__(0, 1.0), lambda: box.hi.__setitem__(0, 1.0)):
        with pytest.raises(ValueError, match="read-only"):
            change()
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
