"""What is no model is refused where it is written, in one sentence that names it."""

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import cpcal
from cpcal.common.errors import ModelError, PluginError
from cpcal.solver.interval import Box, Interval, IntervalArray
from cpcal.solver.model import Network
from cpcal.solver.network import Constraint, Expr
from cpcal.solver.network.expression import as_expr


def model(domain: Any = (0, 10), shape: Any = ()) -> tuple[Network, Expr]:
    net = Network()
    return net, net.variable("x", shape, domain)


def refused(build: Callable[[], object], words: str) -> None:
    """A ModelError or PluginError of one line that says these words."""
    with pytest.raises((ModelError, PluginError), match=words) as error:
        build()
    assert "\n" not in str(error.value)


# Numbers ---------------------------------------------------------------------------------------------------

LONG = np.longdouble(1) / 3
EXACT: list[tuple[Any, Fraction]] = [
    (Decimal("0.1"), Fraction(1, 10)),
    (Fraction(1, 3), Fraction(1, 3)),
    (LONG, Fraction(*LONG.as_integer_ratio())),
    (2**53 + 1, Fraction(2**53 + 1)),
    (np.uint64(2**64 - 1), Fraction(2**64 - 1)),
]
DOORS: list[Callable[[Any], IntervalArray]] = [
    lambda value: as_expr(value).data,
    lambda value: as_expr([value, 0.5])[0].args[0].data[0],
    lambda value: (model()[1] + value).args[1].data,
    lambda value: model()[1].within((value, np.inf)).lower.data,
    lambda value: Network.reading(value, 0).data,
    lambda value: Network.reading(value, Fraction(1, 3)).data,
    lambda value: model((value, value))[0].domain.array[0],
]


@pytest.mark.parametrize(("value", "real"), EXACT, ids=repr)
@pytest.mark.parametrize("door", range(len(DOORS)))
def test_a_number_that_no_float_equals_is_enclosed_at_every_door(door: int, value: Any, real: Fraction) -> None:
    found = DOORS[door](value)
    assert Fraction(float(found.lo)) < real < Fraction(float(found.hi))


NO_NUMBERS: list[Any] = [
    "0.1", ["0.1", 1.0], 1 + 2j, np.array([1j]), True, np.array([True, False]), [1.0, True], None, {1.0, 2.0},
    b"1", np.nan, [1.0, np.nan], np.inf, [1.0, -np.inf], Interval.empty(),
    IntervalArray(np.array(2.0), np.array(1.0)), IntervalArray(np.zeros(2), np.ones(3)),
    IntervalArray(np.array(0.0), np.array(np.nan)), IntervalArray(np.array(LONG), np.array(LONG)),
    np.ma.masked_array([1.0, 2.0], [0, 1]), np.array([1, 2], dtype="m8[s]"), [Interval(0, 1), 2.0],
]  # fmt: skip


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
def test_what_is_no_real_number_is_no_operand(value: Any) -> None:
    net, x = model(shape=2)
    for build in (
        lambda: as_expr(value),
        lambda: net.constant(value),
        lambda: x == value,
        lambda: x <= value,
        lambda: x * value,
        lambda: cpcal.maximum(x, value),
    ):
        refused(build, "number|NaN|IntervalArray|numbers")


@pytest.mark.parametrize("value", [v for v in NO_NUMBERS if not isinstance(v, (Interval, IntervalArray))], ids=repr)
def test_what_is_no_real_number_is_no_reading(value: Any) -> None:
    refused(lambda: Network.reading(value, 0.1), "number|finite")
    refused(lambda: Network.reading(0.0, value), "number|finite")


def test_readings_whose_shapes_do_not_fit_are_refused() -> None:
    refused(lambda: Network.reading(np.zeros(3), np.zeros(2)), "shapes of centres")


# Shapes, domains, names ------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(0, 10), 0, (2, 0), (-10, 10), (0, 10.5), 3.0, "ab", True, None, Interval(0, 1)])
def test_what_has_no_elements_is_no_shape_and_the_domain_is_explained(shape: Any) -> None:
    refused(lambda: Network().variable("x", shape), "domain=")


def test_arrays_without_elements_are_refused_wherever_they_arise() -> None:
    net, x = model(shape=2)
    for build in (lambda: x[2:], lambda: x[[]], lambda: x + np.zeros(0), lambda: net.reading([], 1.0), lambda: x @ []):
        refused(build, "no elements|fit a matrix product|broadcast")


DOMAINS = [5, (1,), (0, 1, 2), "ab", {0, 10}, None, (1, 0), (np.nan, 1), (0, np.nan), (np.inf, np.inf)]
DOMAINS += [(-np.inf, -np.inf), Interval.empty(), (0, 1 + 1j), ("0", "1"), ([0, 0], [1, 1]), (True, 2), (None, 1)]


@pytest.mark.parametrize("domain", DOMAINS, ids=repr)
def test_what_holds_no_number_is_no_domain(domain: Any) -> None:
    net = Network()
    refused(lambda: net.variable("x", (), domain), "domain|real number")
    assert net.names == ()
    net.variable("x")  # the name is still free


BOUNDS = [(2, 1), ([0, 2], [1, 1]), (Fraction(2, 3), Fraction(1, 3)), (np.inf, np.inf), (-np.inf, -np.inf)]
BOUNDS += [(0, np.nan), Interval.empty(), 5, (1,), (1, 2, 3), "ab", {0, 1}, None, (None, 1), (0, 1j), (True, 2)]


@pytest.mark.parametrize("bounds", BOUNDS, ids=repr)
def test_bounds_that_nothing_lies_between_are_refused(bounds: Any) -> None:
    _, x = model(shape=2)
    refused(lambda: x.within(bounds), "number|pair|NaN")


def test_pairs_that_may_be_two_intervals_are_refused() -> None:
    net, x = model(shape=2)
    for pairs in ([(0, 1), (2, 3)], np.array([[0.0, 1.0], [2.0, 3.0]])):
        refused(lambda: x.within(pairs), "lower bounds first")  # type: ignore[arg-type]  # noqa: B023
        refused(lambda: net.variable("y", 2, pairs), "lower bounds first")  # type: ignore[arg-type]  # noqa: B023
    net.add(x.within(([0, 2], [1, 3])))
    assert net.contract().box == Box(net.names, [0, 2], [1, 3])


def test_a_constraint_that_is_built_by_hand_is_checked_too() -> None:
    _, x = model()
    refused(lambda: Constraint(x, as_expr(2.0), as_expr(1.0)), "no number")


@pytest.mark.parametrize("first", [("x", 2), ("x[1]", ()), ("x[0]", 1)])
@pytest.mark.parametrize("second", [("x", 2), ("x[1]", ()), ("x[0]", 1), ("x", (2, 1))])
def test_components_of_one_name_are_refused_in_any_order(first: Any, second: Any) -> None:
    together = Network()
    together.variable(*first)
    names = [*together.names, *single(second)]
    if first[0] != second[0] and len(set(names)) == len(names):
        together.variable(*second)
        assert together.names == tuple(names)
    else:
        refused(lambda: together.variable(*second), "called like|is taken")
        assert together.domain.names == single(first)


def single(of: tuple[str, Any]) -> tuple[str, ...]:
    net = Network()
    net.variable(*of)
    return net.names


# What is added, and what is asked --------------------------------------------------------------------------


def test_only_constraints_are_added_and_all_of_them_or_none() -> None:
    net, x = model(shape=2)
    for wrong in (True, np.True_, None, 5, "ab", x, [x >= 0, True], [x >= 0, [x >= 1]], {"a": x >= 0}, [x >= 0, x]):
        refused(lambda: net.add(wrong), "takes constraints")  # noqa: B023
    assert net.constraints == ()
    net.add(c for c in (x >= 0, x <= 1))
    assert len(net.constraints) == 2


def test_comparisons_from_the_left_by_numpy_are_constraints_or_refused() -> None:
    net, x = model(shape=2)
    numbers = [kind(1) for kind in (np.float64, np.int64, np.longdouble, np.float32, int, float, Fraction, Decimal)]
    for left in (np.ones(2), *numbers):
        net.add([left == x, left <= x, left >= x])  # type: ignore[list-item]
        for wrong in (lambda: left != x, lambda: left < x, lambda: left > x):  # noqa: B023
            refused(wrong, "closed")  # type: ignore[arg-type]
        for made in (left + x, left - x, left * x, left / x, x - left):
            assert isinstance(made, Expr)
    assert (1.0, 1.0) in net.contract().box
    refused(lambda: np.True_ == x, "number")
    refused(lambda: min(x[0], x[1]), "closed")  # type: ignore[type-var]


def test_axes_are_integers_and_exponents_real_numbers() -> None:
    _, x = model(shape=2)
    for axis in ((0,), 0.0, "0", 1):
        refused(lambda: x.sum(axis), "axis")  # type: ignore[arg-type]  # noqa: B023
    for exponent in (True, None, "2", 2j):
        refused(lambda: x**exponent, "exponent")  # type: ignore[operator]  # noqa: B023


ASKED: list[tuple[dict[str, Any], str]] = [
    *(({"width": width}, "is no width") for width in (0, -1, -0.0, np.nan, "1", True, 1j)),
    *(({"limits": limits}, "limits=") for limits in (5, 1.0, "5 s", {"seconds": 5})),
    *(({"limits": cpcal.Limits(seconds=value)}, "at least 0") for value in (np.nan, -1, "5", True)),
    *(({"limits": cpcal.Limits(nodes=value)}, "at least 0") for value in (np.nan, -1, "5")),
    *(({"contractors": names}, "contractors=.* is no list") for names in ("hc4", 5, {"hc4"})),
    *(({"contractors": names}, "at least one") for names in ([], ())),
    *(({"contractors": [name]}, "no contractor") for name in (True, None, 5, "nothing")),
    ({"strategy": 5}, "strategy=5"),
    ({"strategy": "nothing"}, r"no strategy .*'nothing'.*largest, smear-relative.*cpcal\.strategies"),
    ({"order": "nothing"}, "no order.*depth, breadth"),
]


@pytest.mark.parametrize(("asked", "words"), ASKED, ids=repr)
def test_options_of_solve_without_meaning_are_refused(asked: dict[str, Any], words: str) -> None:
    net, x = model()
    net.add(x * x == 2)
    refused(lambda: net.solve(**asked), words)


def test_options_of_minimize_and_contract_without_meaning_are_refused() -> None:
    net, x = model()
    net.add(x * x >= 2)
    refused(lambda: net.minimize(x, limits=5), "limits=5")  # type: ignore[arg-type]
    refused(lambda: net.minimize(x, contractors="lifted"), "is no list")
    refused(lambda: net.contract(contractors="hc4"), "is no list")
    refused(lambda: net.minimize(5), "scalar variable")  # type: ignore[arg-type]
    for start in ("a", [1, 2], [np.nan], [True], [[1.0]]):
        refused(lambda: net.minimize(x, start=start), "start|number")  # noqa: B023


def test_a_box_of_other_variables_is_refused() -> None:
    net = Network()
    x, y = net.variable("x", domain=(0, 1)), net.variable("y", domain=(2, 3))
    net.add([x == 0.5, y == 2.5])
    for box in (Box(["y", "x"], [2, 0], [3, 1]), Box(["x"], [0], [1]), Box(["a", "b"], [0, 2], [1, 3]), "x", None):
        if box is not None:
            refused(lambda: net.contract(box), "is no box of")  # type: ignore[arg-type]  # noqa: B023
    assert (0.5, 2.5) in net.contract().box


@pytest.mark.parametrize("name", ["", " x", "x ", "x\n", "a\nb", "a\x1b[2J", "\u2028", 5, None], ids=repr)
def test_names_are_one_printable_line(name: Any) -> None:
    for build in (lambda: Network().variable(name), lambda: Box([name], [0], [1])):
        with pytest.raises(ModelError, match="is no name"):
            build()


def test_a_network_without_variables_answers_nothing() -> None:
    net = Network("bare")
    net.add(net.constant(1.0) <= 2.0)
    other, x = model()
    for ask in (net.solve, net.contract, lambda: net.minimize(x)):
        refused(ask, "'bare' has no variables")  # type: ignore[arg-type]
    assert other.names == ("x",)
