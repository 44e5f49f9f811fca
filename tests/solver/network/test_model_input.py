"""Names, constraints and operators that make no model are refused in one sentence."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import cpcal
from contractors import HC4
from cpcal.common.errors import CpcalError, ModelError
from cpcal.solver.interval import Box
from cpcal.solver.model import Network
from cpcal.solver.network import Expr
from cpcal.solver.network.expression import as_expr
from tests.solver.network.test_input import model, refused


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
    for left in (
        np.ones(2),
        np.float64(1),
        np.int64(1),
        np.longdouble(1),
        np.float32(1),
        1,
        1.0,
        Fraction(1),
        Decimal(1),
    ):
        net.add([left == x, left <= x, left >= x])  # type: ignore[list-item]
        for wrong in (lambda: left != x, lambda: left < x, lambda: left > x):  # noqa: B023
            refused(wrong, "closed")  # type: ignore[arg-type]
        for made in (left + x, left - x, left * x, left / x, x - left):
            assert isinstance(made, Expr)
    assert (1.0, 1.0) in net.contract().box
    refused(lambda: np.True_ == x, "number")
    refused(lambda: min(x[0], x[1]), "closed")  # type: ignore[type-var]


def test_operators_in_place_leave_what_was_there() -> None:
    _, x = model()
    before, same = x.digest, x
    x += 1
    assert same.digest == before != x.digest
    row = np.ones(2)
    with pytest.raises((TypeError, CpcalError), match="is no operation of expressions"):
        row += same


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
    ({"strategy": "nothing"}, "no strategy"),
    ({"order": "nothing"}, "no order"),
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


def test_a_network_without_variables_answers_nothing() -> None:
    net = Network("bare")
    net.add(net.constant(1.0) <= 2.0)
    other, x = model()
    for ask in (net.solve, net.contract, lambda: net.minimize(x)):
        refused(ask, "'bare' has no variables")  # type: ignore[arg-type]
    assert other.names == ("x",)


def test_a_long_sum_is_solved() -> None:
    net, x = model((-2, 2))
    net.add(sum((k * x for k in range(1, 1500)), as_expr(0.0)) == 0)
    assert (0.0,) in net.contract(contractors=["hc4"]).box
    assert (0.0,) in HC4(net).contract(net.domain).box
    assert cpcal.evaluate(net, net.constraints[0].body, net.domain, "tightest").shape == ()


def test_a_box_of_other_variables_is_refused() -> None:
    net = Network()
    x, y = net.variable("x", domain=(0, 1)), net.variable("y", domain=(2, 3))
    net.add([x == 0.5, y == 2.5])
    for box in (Box(["y", "x"], [2, 0], [3, 1]), Box(["x"], [0], [1]), Box(["a", "b"], [0, 2], [1, 3]), "x", None):
        if box is not None:
            refused(lambda: net.contract(box), "is no box of")  # type: ignore[arg-type]  # noqa: B023
    assert (0.5, 2.5) in net.contract().box


@pytest.mark.parametrize("name", ["", " x", "x\n", "a\nb", "a\x1b[0m", 5, None], ids=repr)
def test_names_are_one_printable_line(name: Any) -> None:
    with pytest.raises(ModelError, match="is no name"):
        Network().variable(name)
