"""Expressions: shapes as numpy has them, functions without clipped domains, what they mean is fixed; refusals."""

import contextlib
import copy
import math
import multiprocessing
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import cpcal
from contractors import HC4, Lifted
from cpcal import Network, Verdict
from cpcal.common.errors import ModelError
from cpcal.solver.existence import prove_unique
from cpcal.solver.interval import Interval, IntervalArray
from cpcal.solver.interval.box import component_names
from cpcal.solver.network import ConstraintNetwork, Expr, norm
from cpcal.solver.network.expression import as_expr
from tests.networks import network


@pytest.fixture
def net() -> ConstraintNetwork:
    return ConstraintNetwork()


def circle(radius: float = 1.0, name: str = "x", domain: tuple[float, float] = (-2, 2)) -> ConstraintNetwork:
    net = ConstraintNetwork()
    x = net.variable(name, 2, domain)
    net.add(norm(x - net.reading([0.0, 0.0], 0.1)) + Interval(0, 1e-9) <= radius)
    return net


def test_network_digests_are_equal_for_equal_networks_only() -> None:
    base = circle().digest
    assert base == circle().digest
    assert base == pickle.loads(pickle.dumps(circle())).digest
    assert len({base, circle(2.0).digest, circle(name="y").digest, circle(domain=(-2, 3)).digest}) == 4
    more = circle()
    more.add(more.variables[0][0] >= 0)
    assert more.digest != base
    one, two = ConstraintNetwork(), ConstraintNetwork()
    for net, shared in ((one, True), (two, False)):
        x = net.variable("x", 2)
        first = net.reading(0.0, 1.0)
        net.add([x[0] == first, x[1] == (first if shared else net.reading(0.0, 1.0))])
    assert one.digest != two.digest


@pytest.mark.parametrize("contractor", [HC4, Lifted])
def test_equal_reading_sets_hold_different_readings(net: ConstraintNetwork, contractor: type) -> None:
    x, y = net.variable("x", (), (-3, 3)), net.variable("y", (), (-3, 3))
    net.add([net.reading(0.0, 1.0) == x, net.reading(0.0, 1.0) == y])
    z = net.variable("z", (), (-3, 3))
    net.add(net.reading(0.0, 1.0) - net.reading(0.0, 1.0) == z)
    assert (-0.9, 0.9, 1.9) in contractor(net).contract(net.domain).box
    part = net.domain.replace("x", hi=-0.5).replace("y", lo=0.5)
    assert not contractor(net).contract(part).box.is_empty


def test_truth_values_and_chained_comparisons_are_refused(net: ConstraintNetwork) -> None:
    x = net.variable("x")
    with pytest.raises(ModelError, match="truth value"):
        bool(x)
    with pytest.raises(ModelError, match="within"):
        bool(x <= 1)
    with pytest.raises(ModelError, match="within"):
        0 <= x <= 1  # noqa: B015
    with pytest.raises(ModelError, match="truth value"):
        not x  # noqa: B018
    with pytest.raises(ModelError, match="closed"):
        x != 1  # noqa: B015


def test_shape_errors_are_model_errors(net: ConstraintNetwork) -> None:
    x, m = net.variable("x", 3), np.zeros((2, 4))
    wrong = [
        lambda: x + np.zeros(2), lambda: m @ x, lambda: x @ m, lambda: x[0] @ x, lambda: x[3], lambda: x[0, 0],
        lambda: x["a"], lambda: x.sum(1), lambda: x[0].sum(), lambda: norm(x[0]),
        lambda: x.within(([0, 0], [1, 1])), lambda: x.within((np.zeros((2, 3)), 1.0)),
        lambda: x + [[1], [1, 2]], lambda: net.reading(0.0, -1.0), lambda: net.component(x),
        lambda: net.component(x[0] + 1), lambda: net.add(ConstraintNetwork().variable("x") <= 1),
    ]  # fmt: skip
    accepted = []
    for k, build in enumerate(wrong):
        with contextlib.suppress(ModelError):
            build()
            accepted.append(k)
    assert accepted == []


INDICES = [0, -1, slice(1, None), slice(None, None, -1), [2, 0, 0], np.array([True, False, True]), None, ...]
INDICES += [(slice(None), 1), (..., [0, 0]), (1, slice(2)), ([0, 1], [1, 0]), (None, ..., None)]


SHAPES = [((3,), (3,)), ((2, 3), (3,)), ((3,), (3, 4)), ((2, 3), (3, 4)), ((5, 2, 3), (3,)), ((5, 2, 3), (5, 3, 4))]
SHAPES += [((2, 3), (5, 3, 4)), ((1, 2, 3), (6, 3, 4)), ((3,), (5, 3, 2))]


def test_names_of_components(net: ConstraintNetwork) -> None:
    x, y = net.variable("x", (2, 2), (0, 1)), net.variable("y")
    assert net.names == ("x[0,0]", "x[0,1]", "x[1,0]", "x[1,1]", "y")
    assert net.component(x[1, 0]) == "x[1,0]"
    assert net.component(y) == "y"
    assert component_names(y) == ("y",)
    assert not net.domain.is_bounded
    assert repr(net).endswith("5 unknowns, 0 constraints>")


BOTH = ["hc4", "newton"]


def test_a_transcendental_system_is_solved_and_counted() -> None:
    """Kepler's equation, and all crossings of a sine with a line: sin x = x / 10 has seven solutions."""
    net, e = network(e=(0, 2 * math.pi))
    net.add(e - 0.9 * np.sin(e) == 1.5)
    (only,) = net.solve(contractors=BOTH).solutions
    assert only.verdict is Verdict.PROVED
    found = only[e]
    assert isinstance(found, Interval)
    assert abs(found.mid - 0.9 * math.sin(found.mid) - 1.5) < 1e-12
    net, x = network(x=(-20, 20))
    net.add(cpcal.sin(x) == x / 10)
    paving = net.solve(contractors=BOTH)
    assert [s.verdict for s in paving.solutions] == [Verdict.PROVED] * 7
    assert paving.complete


@pytest.mark.parametrize("make", [cpcal.log, cpcal.sqrt, lambda x: x**1.5, lambda x: cpcal.asin(1 - x)])
def test_no_proof_rests_on_a_domain_that_was_cut_off(make) -> None:
    """The only zero, x = -1e-9, lies just outside of where the function is defined."""
    net, x = network(x=(-1, 1))
    net.add(x * 3 + make(x) - make(x) == -3e-9)
    for at in (-1e-9, 1e-9):
        assert prove_unique(net, (at,)) is None


def test_numpy_gives_expressions_and_says_what_it_has_not() -> None:
    net = Network()
    x = net.variable("x", (2, 3))
    assert np.linalg.norm(x, axis=-1).shape == (2,)
    assert np.sum(x).shape == ()
    assert np.stack([x[0], x[1]], axis=1).shape == (3, 2)
    assert (np.eye(2) @ x).shape == (2, 3)
    assert x.T.shape == (3, 2)
    assert x.reshape(3, 2).shape == x.reshape((3, -1)).shape == (3, 2)
    assert [e.shape for e in x] == [(3,), (3,)]
    with pytest.raises(TypeError, match="has no length"):
        len(x[0, 0])
    with pytest.raises(ModelError, match="there are exp"):
        np.logaddexp(x, x)
    with pytest.raises(ModelError, match="takes no expressions"):
        np.median(x)
    with pytest.raises(ModelError, match=r"write cpcal\.sin"):
        math.sin(x[0, 0])
    with pytest.raises(ModelError, match="write `<=` or `>=`"):
        x < 1  # noqa: B015
    with pytest.raises(ModelError, match="write `<=` or `>=`"):
        np.ones(3) > x  # noqa: B015
    with pytest.raises(ModelError, match="can not be reshaped"):
        x.reshape(4, 2)


def test_expressions_constraints_and_networks_print_as_mathematics() -> None:
    net = Network("ring")
    x, y = net.variable("x", 2, (-1, 1)), net.variable("y", domain=(0, 3))
    assert str(2 * (x[0] - y) ** 2 - (y - (x[1] - 1)) / -y) == "2 * (x[0] - y)^2 - (y - (x[1] - 1)) / (-y)"
    assert str(np.sin(y) ** 3 * y**0.5 - y**1.5) == "sin(y)^3 * sqrt(y) - exp(1.5 * log(y))"
    assert str((x[0] + y).within((0, 2))) == "0 <= x[0] + y <= 2"
    assert str((x[0] + y).within((3, 3))) == "x[0] + y = 3"
    net.add(cpcal.norm(x) <= y)
    assert str(net).splitlines() == [
        "ring:", "x[0] in [-1, 1]", "x[1] in [-1, 1]", "y in [0, 3]", "sqrt(sum(x^2, axis=0)) - y <= 0",
    ]  # fmt: skip
    long = y
    for _ in range(3000):
        long = long + y
    assert len(str(long)) < 1000


def test_boxes_are_asked_by_variables() -> None:
    net = Network()
    x, y = net.variable("x", (2, 2), (-1, 1)), net.variable("y", domain=(0, 3))
    assert net.domain[y] == Interval(0, 3)
    found = net.domain[x]
    assert isinstance(found, IntervalArray)
    assert found.hi.tolist() == [[1, 1], [1, 1]]
    with pytest.raises(ModelError, match="not for"):
        net.domain[x + 1]


# A caller's arrays -----------------------------------------------------------------------------------------


DOORS: dict[str, Callable[[Network, Expr, Any], Any]] = {
    "constant": lambda net, x, a: x + a <= 1,
    "interval array": lambda net, x, a: x + IntervalArray(a, a) <= 1,
    "bounds": lambda net, x, a: x.within((a, a)),
    "domain": lambda net, x, a: net.variable("y", 2, (a, a + 1)) <= x,
    "upper domain": lambda net, x, a: net.variable("y", 2, (-1, a)) <= x,
    "reading": lambda net, x, a: net.reading(a, 0.1) == x,
    "exact reading": lambda net, x, a: net.reading(a, 0.0) == x,
    "matrix": lambda net, x, a: a @ x == 0.25,
    "index": lambda net, x, a: x[a > 0.3] == 1.0,
}


@pytest.mark.parametrize("door", DOORS)
def test_no_door_keeps_its_callers_array(door: str) -> None:
    net, values = Network(), np.array([0.25, 0.5])
    net.add(DOORS[door](net, net.variable("x", 2, (-5, 5)), values))
    domain, digest, box = net.domain, net.digest, HC4(net).contract(net.domain).box
    values[:] = 4.0
    assert net.domain == domain
    assert net.digest == digest
    assert HC4(net).contract(net.domain).box == box


def test_the_data_of_an_expression_cannot_be_written() -> None:
    net, x = network(2, x=(-5, 5))
    for node in (as_expr(np.ones(2)), net.reading([0.0, 1.0], 0.1), x[[1, 0]]):
        arrays = (node.data.lo, node.data.hi, node.places)
        for again in (node, pickle.loads(pickle.dumps(node)), copy.deepcopy(node), copy.copy(node)):
            for mine, array in zip(arrays, (again.data.lo, again.data.hi, again.places), strict=True):
                np.testing.assert_array_equal(mine, array)
                with pytest.raises(ValueError, match="read-only"):
                    array[...] = 7


# One variable, one network ---------------------------------------------------------------------------------


def test_variables_of_two_networks_do_not_mix() -> None:
    a, b = Network("left"), Network("right")
    xa, xb = a.variable("x", domain=(0, 10)), b.variable("x", domain=(0, 1))
    for constraint in (xb + xa == 10.5, xa + xb == 10.5, xb.within((xa, 20)), xa == 1, cpcal.sqr(xb - xa) <= 1):
        with pytest.raises(ModelError, match="'x' belongs to another network, 'left', not to 'right'"):
            b.add(constraint)
    with pytest.raises(ModelError, match="'left'"):
        b.add([xb == 1, xa == 1])
    assert b.constraints == ()
    with pytest.raises(ModelError, match="'left'"):
        b.component(xa)
    with pytest.raises(ModelError, match="'left'"):
        b.minimize(xa)
    with pytest.raises(ModelError, match="'left'"):
        cpcal.evaluate(b, xb + xa, b.domain)


# Copies and processes --------------------------------------------------------------------------------------


def example() -> tuple[Network, Expr]:
    net = Network("example")
    x = net.variable("x", 2, (-5, 5))
    net.add(x[0] == net.reading(1.0, 0.5))
    return net, x


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda net: pickle.loads(pickle.dumps(net))])
def test_a_copy_and_its_original_go_their_own_ways(copied: Any) -> None:
    net, x = example()
    before, digest = net.contract().box, net.digest
    other = copied(net)
    assert other.digest == digest
    other.add(x[1] == 2.0)  # the variables are those of both
    other.add(other.variable("y", domain=(0, 1)) == 0.5)
    assert net.digest == digest
    assert net.contract().box == before
    assert (1.0, 2.0, 0.5) in other.contract().box
    assert (1.0, 2.5, 0.5) not in other.contract().box
    net.variable("y", domain=(0, 1))
    with pytest.raises(ModelError, match="another network"):
        net.add(other.variables[-1] == 0.5)


def _reading_elsewhere(_: int) -> Expr:
    return Network.reading(0.0, 1.0)


def test_readings_made_in_several_processes_are_different_numbers() -> None:
    with multiprocessing.get_context("fork").Pool(2) as pool:
        first, second, *_ = pool.map(_reading_elsewhere, range(4), chunksize=1)
    mine = _reading_elsewhere(0)
    assert len({first.digest, second.digest, mine.digest}) == 3


def test_a_reading_that_comes_back_from_pickle_is_the_same_number() -> None:
    net, x = example()
    reading = net.reading(0.5, 0.5)
    net.add([x[0] == reading, x[1] == pickle.loads(pickle.dumps(reading))])
    part = net.domain.replace("x[0]", hi=0.2).replace("x[1]", lo=0.8)
    assert net.contract(part, contractors=["hc4"]).box.is_empty


def test_long_expressions_go_through_pickle_and_copy() -> None:
    net, x = network(x=(-2, 2))
    total = x
    for k in range(1, 1200):  # deeper than Python's own stack
        total = total + k * x
    again = pickle.loads(pickle.dumps(total))
    assert again.digest == total.digest
    assert copy.deepcopy(total) is total
    net.add(again <= 0)
    assert pickle.loads(pickle.dumps(net)).digest == net.digest == copy.deepcopy(net).digest
    for contractor in (HC4(net), Lifted(net)):
        assert (-1.0,) in pickle.loads(pickle.dumps(contractor)).contract(net.domain).box
