"""What an expression means is fixed when it is built: no caller, copy, process or other network changes it."""

import copy
import multiprocessing
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import cpcal
from contractors import HC4, Lifted
from cpcal.common.errors import ModelError
from cpcal.solver.interval import IntervalArray
from cpcal.solver.model import Network
from cpcal.solver.network import Expr
from cpcal.solver.network.expression import as_expr

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
    net = Network()
    x = net.variable("x", 2, (-5, 5))
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
    net = Network()
    x = net.variable("x", domain=(-2, 2))
    total = x
    for k in range(1, 1200):  # deeper than Python's own stack
        total = total + k * x
    again = pickle.loads(pickle.dumps(total))
    assert again.digest == total.digest
    assert copy.deepcopy(total) is total
    net.add(again <= 0)
    other = pickle.loads(pickle.dumps(net))
    assert other.digest == net.digest == copy.deepcopy(net).digest
    for contractor in (HC4(net), Lifted(net)):
        assert (-1.0,) in pickle.loads(pickle.dumps(contractor)).contract(net.domain).box
