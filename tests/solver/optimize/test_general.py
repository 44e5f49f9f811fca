"""Minimisation of general problems: equations, active inequalities, divisions, curved valleys; known optima."""

from collections.abc import Callable

import numpy as np
import pytest

import cpcal
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.network.forms import with_products

Problem = tuple[cpcal.Network, cpcal.Expr]


def himmel11() -> Problem:
    net = cpcal.Network("himmel11")
    x = net.variable("x", 5, ([78, 33, 27, 27, 27], [102, 45, 45, 45, 45]))
    one = 85.334407 + 0.0056858 * x[1] * x[4] + 0.0006262 * x[0] * x[3] - 0.0022053 * x[2] * x[4]
    two = 80.51249 + 0.0071317 * x[1] * x[4] + 0.0029955 * x[0] * x[1] + 0.0021813 * x[2] ** 2
    three = 9.300961 + 0.0047026 * x[2] * x[4] + 0.0012547 * x[0] * x[2] + 0.0019085 * x[2] * x[3]
    net.add([one.within((0, 92)), two.within((90, 110)), three.within((20, 25))])
    return net, 5.3578547 * x[2] ** 2 + 0.8356891 * x[0] * x[4] + 37.293239 * x[0] - 40792.141


def rosenbrock() -> Problem:
    net = cpcal.Network("rosenbrock")
    x, y = net.variable("x", domain=(-10, 10)), net.variable("y", domain=(-10, 10))
    return net, (1 - x) ** 2 + 100 * (y - x**2) ** 2


def ratio() -> Problem:
    """The least x/y + y/x on a box without x = y: 3/2 + 2/3."""
    net = cpcal.Network("ratio")
    x, y = net.variable("x", domain=(1, 2)), net.variable("y", domain=(3, 4))
    return net, x / y + y / x


@pytest.mark.parametrize(("problem", "value"), [(himmel11, -30665.53867), (rosenbrock, 0.0), (ratio, 13 / 6)])
def test_a_known_optimum_is_bracketed_and_the_gap_closes(problem: Callable[[], Problem], value: float) -> None:
    net, objective = problem()
    best = net.minimize(objective, limits=Limits(nodes=300))
    assert best.verdict is Verdict.PROVED
    assert best.lo <= value + 1e-7 * abs(value)
    assert best.hi >= value - 1e-6 * abs(value)
    assert best.hi - best.lo <= max(1e-6 * abs(best.hi), 1e-9)


def test_a_division_by_an_expression_of_one_sign_is_multiplied_out() -> None:
    net = cpcal.Network()
    x, y = net.variable("x", domain=(1, 2)), net.variable("y", domain=(-3, -2))
    net.add([x / y / x + 3 / (x * y) <= 1, (x / (y - 1)).within((-1, -0.25)), x + y == 0])
    products, origin = with_products(net, instead=True)
    assert origin == [0, 1, 1, 2]
    assert products.constraints[-1] is net.constraints[-1]
    assert with_products(net)[1] == [0, 0, 1, 1, 1, 2]
    rng = np.random.default_rng(0)
    for point in rng.uniform([1, -3], [2, -2], (50, 2)):
        held = [_holds(net, c, point) for c in products.constraints]
        assert [held[0], held[1] and held[2]] == [_holds(net, c, point) for c in net.constraints[:2]]


def test_a_division_by_an_expression_of_unknown_sign_stays() -> None:
    net = cpcal.Network()
    x, y = net.variable("x", domain=(1, 2)), net.variable("y", domain=(-3, 2))
    net.add(x / y <= 1)
    assert with_products(net)[0] is net


def _holds(net: cpcal.Network, constraint: cpcal.Constraint, point: np.ndarray) -> bool:
    box = cpcal.Box(net.names, point, point)
    body, low, high = (cpcal.evaluate(net, e, box) for e in (constraint.body, constraint.lower, constraint.upper))
    return bool(low.mid <= body.mid <= high.mid)
