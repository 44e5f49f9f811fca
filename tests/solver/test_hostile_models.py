"""Models that are asked too much, or wrongly: a right answer, checked by hand, or a clear error."""

from __future__ import annotations

import numpy as np
import pytest

import cpcal
from cpcal.common.errors import ModelError
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Interval, get_arithmetic
from cpcal.solver.limits import Limits
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.equations import Equations
from cpcal.solver.optimize.local_search import LocalSearch


def test_points_of_whole_numbers_that_solve_nothing_are_not_kept() -> None:
    """6 a + 10 b + 15 c = 29 has no solution in whole numbers of at least 0: 29 is the largest such number."""
    for total, count in ((29, 0), (30, 3), (31, 1)):
        net = cpcal.Network()
        n = net.variable("n", 3, domain=(0, 50), integer=True)
        net.add(6 * n[0] + 10 * n[1] + 15 * n[2] == total)
        paving = net.solve()
        assert len(paving.solutions) == count, total
        assert paving.complete


def test_a_domain_of_nanometres_is_divided_too() -> None:
    net = cpcal.Network()
    x = net.variable("x", domain=(-1e-9, 1e-9))
    net.add(x**2 == 1e-20)
    paving = net.solve()
    assert [s.verdict for s in paving.solutions] == [Verdict.PROVED] * 2
    assert sorted(round(s.box["x"].mid * 1e10, 9) for s in paving.solutions) == [-1.0, 1.0]


@pytest.mark.parametrize("width", [5e-324, 1e-310, 1e-9, 1e-4])
def test_a_region_in_a_tiny_domain_is_divided_as_one_in_a_large_domain(width: float) -> None:
    net = cpcal.Network()
    x, y = net.variable("x", domain=(0, width)), net.variable("y", domain=(0, width))
    net.add(x >= y)
    paving = net.solve(contractors=["hc4"], node_limit=2000)
    assert paving.complete
    assert net.minimize(x).verdict is Verdict.PROVED


def test_boxes_inside_hold_whole_numbers_alone() -> None:
    """0 <= k <= 9 with k^2 <= 50 holds for 8 whole numbers."""
    net = cpcal.Network()
    k = net.variable("k", domain=(0, 9), integer=True)
    net.add(k * k <= 50)
    found = [box["k"] for box in net.solve(inner=True).inside]
    assert sorted(found, key=lambda one: one.lo) == [Interval(n) for n in range(8)]
    assert not net.solve(inner=True, width=20.0).inside


def test_an_objective_that_is_defined_nowhere_has_no_point() -> None:
    for function in (cpcal.sqrt, cpcal.log, lambda x: cpcal.log(x) ** 2):
        net = cpcal.Network()
        x = net.variable("x", domain=(-2, -1))
        net.add(x <= 1)
        assert net.minimize(function(x)).verdict is Verdict.REFUTED


def test_limits_have_the_names_of_the_command_too() -> None:
    net = cpcal.Network()
    x = net.variable("x", 2, (-4, 4))
    net.add(cpcal.sqr(x).sum() >= 1)
    assert net.solve(node_limit=3).nodes == net.solve(limits=Limits(nodes=3)).nodes == 3
    assert net.minimize(x[0] + x[1], gap=0.5, time_limit=60).verdict is Verdict.PROVED
    with pytest.raises(ModelError, match=r"by limits=cpcal.Limits\(...\) or by their names, not both"):
        net.solve(limits=Limits(nodes=3), time_limit=1.0)
    with pytest.raises(ModelError, match="seconds, nodes and gaps are numbers of at least 0"):
        net.minimize(x[0], gap=-1.0)


def test_an_objective_without_a_finite_bound_at_first_is_closed() -> None:
    """1/x^2 on [-4, 4] is least at the ends; 1/x has no least value, and points show how far down it goes."""
    net = cpcal.Network()
    x = net.variable("x", domain=(-4, 4))
    best = net.minimize(1 / (x * x))
    assert best.verdict is Verdict.PROVED
    assert best.lo <= 1 / 16 <= best.hi
    down = net.minimize(1 / x, limits=Limits(nodes=30))
    assert down.lo == -np.inf
    assert down.hi < -0.25


def test_variables_without_bounds_are_named() -> None:
    net = cpcal.Network()
    x, y = net.variable("x"), net.variable("y", domain=(0, 1))
    with pytest.raises(ModelError, match="has none for x: give one"):
        net.minimize((x - 3) ** 2 + y)


def test_an_equation_that_no_step_mends_ends_the_local_search() -> None:
    """x^2 = 1e10 at x = 0: the derivative vanishes."""
    net = cpcal.Network()
    x, y = net.variable("x", domain=(-1e8, 1e8)), net.variable("y", domain=(-1, 1))
    net.add([x * x == 1e10, y >= x])
    search = LocalSearch(net, Rows(net), 1, Equations(net, get_arithmetic("float64")))
    assert search.inside(np.zeros(2), 1e-9, np.ones(2)) is None


def test_an_element_of_an_array_does_not_ask_the_others_to_be_defined() -> None:
    net = cpcal.Network()
    v, y = net.variable("v", 2, ([0, -1], [1, -0.5])), net.variable("y", domain=(0, 1))
    net.add([np.sqrt(v)[0] == 0.5, np.stack([np.log(v[1]), y])[1] == 0.25])
    net.add(np.concatenate([1 / np.stack([y - 0.25, v[0]]), v])[2] >= 0.1)
    assert (0.25, -0.75, 0.25) in net.contract().box
    assert net.solve(width=0.25).solutions
    net.add(np.sqrt(v) >= 0)
    assert not net.solve().solutions  # here both are asked for


def test_reductions_are_those_of_numpy() -> None:
    net = cpcal.Network()
    v = net.variable("v", (2, 3), (-2, 2))
    at = np.array([[0.5, -1.25, 2.0], [1.5, 0.25, -0.75]])
    point = net.domain.with_bounds(at.ravel(), at.ravel())
    for function in (np.sum, np.mean, np.prod, np.max, np.min):
        for axis in (None, 0, 1):
            found = cpcal.evaluate(net, function(v, axis=axis), point)
            assert np.allclose(found.lo, function(at, axis=axis), rtol=1e-12)
            assert (found.lo <= found.hi).all()
