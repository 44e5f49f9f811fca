"""Without options: methods by structure, in turns; whole numbers, parameters for all, relaxed equations, boundaries."""

import numpy as np
import pytest

import cpcal
from contractors import HC4
from cpcal.common.errors import ModelError
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.model import choice_to_minimize, choice_to_solve
from cpcal.solver.network.polynomial import PolynomialForms
from cpcal.solver.search.passes import Divide, LargestFirst
from cpcal.solver.search.race import Contender, Race
from cpcal.solver.search.search import Search
from tests.networks import network


def circle_and_line() -> cpcal.Network:
    net, x = network(2, x=(-2, 2))
    net.add([x[0] ** 2 + x[1] ** 2 == 1, x[0] == 2 * x[1]])
    return net


def test_the_choice_follows_the_structure() -> None:
    methods = [(m.contractors, m.strategy) for m in choice_to_solve(circle_and_line()).methods]
    assert methods[-2:] == [(("hc4", "newton", "lifted"), "smear-relative"), (("lifted", "newton"), "largest")]
    net, x = network(2, x=(-2, 2))
    net.add(np.sin(x[0]) + x[1] <= 1)
    assert len(choice_to_solve(net).methods) == 1  # nothing to prove for newton
    assert "beaumont" in choice_to_minimize(net)[0]


def test_the_first_contender_that_ends_wins_and_others_take_turns_before() -> None:
    net = circle_and_line()

    def search(width: float) -> Search:
        return Search([net.domain], Divide(HC4(net), LargestFirst(width)))

    slow = Contender("slow", lambda: search(1e-9), 2)
    quick = Contender("quick", lambda: search(0.5), 2)
    race = Race([slow, quick])
    events = list(race)
    assert race.leader is quick
    assert quick.ended
    assert len(events) == slow.nodes + quick.nodes
    assert abs(slow.nodes - quick.nodes) <= 4  # a turn is 2 nodes, and one without progress costs the next
    assert race.sentence() == "quick ended first, in turns with slow."


def test_limits_hold_inside_a_long_contraction() -> None:
    net, x = network(30, x=(-5, 5))
    net.add([(x[k] ** 2 + x[(k + 1) % 30] * x[k - 1]).within((1, 1)) for k in range(30)])
    contraction_of_one_node = net.solve(contractors=["hc4", "lifted"], limits=Limits(seconds=0.0))
    assert contraction_of_one_node.nodes == 1
    assert contraction_of_one_node.solutions  # nothing is lost


def test_relaxed_equations_are_said_to_be_relaxed() -> None:
    net, x = network(2, x=(-5, 5))
    net.add(cpcal.sqr(x).sum() == 1)
    best = net.minimize(x[0] + x[1], relax=1e-8)
    assert best.relax == 1e-8
    assert best.status.endswith("Equations were relaxed to within 1e-08.")
    assert best.witness is not None
    assert best.witness.around is None  # the point itself holds
    assert best.lo <= net.minimize(x[0] + x[1]).hi
    with pytest.raises(ModelError, match="no tolerance"):
        net.minimize(x[0], relax=-1.0)


def test_a_solution_on_the_boundary_of_the_domain_is_proved() -> None:
    net, x = network(x=(0, 1))
    net.add(x**2 == 1)
    [solution] = net.solve().solutions
    assert solution.verdict is Verdict.PROVED
    assert (solution.box.lo[0], solution.box.hi[0]) == (1.0, 1.0)
    beyond, y = network(y=(0, 1))
    beyond.add(y**2 == 1.0000000000000004)
    assert not any(s.verdict is Verdict.PROVED for s in beyond.solve().solutions)


def made(unknowns: int, spheres: int = 1) -> cpcal.Network:
    """So many spheres of so many unknowns."""
    net, x = network(unknowns, x=(-2, 2))
    net.add([cpcal.sqr(x).sum() + k * x[k] == 1 for k in range(spheres)])
    return net


@pytest.mark.parametrize(("unknowns", "width"), [(2, 0.008), pytest.param(3, 0.1, marks=pytest.mark.nightly)])
def test_curves_and_surfaces_are_paved_without_options(unknowns: int, width: float) -> None:
    net = made(unknowns)
    paving = net.solve(limits=Limits(nodes=20_000))
    assert paving.complete
    assert paving.method.endswith(f"width {width} was chosen, width=... asks for another.")
    assert max(box.width.max() for box in paving.boundary) <= width
    directions = np.random.default_rng(1).normal(size=(100, unknowns))
    for point in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        assert any((box.lo - 1e-12 <= point).all() and (point <= box.hi + 1e-12).all() for box in paving.boundary)


def test_a_curve_that_runs_to_infinity_is_divided_within_100_of_zero() -> None:
    net = cpcal.Network()
    x, y = net.variable("x"), net.variable("y")
    net.add(x * y == 1)
    paving = net.solve()
    assert paving.complete
    assert "further than 100 from 0 boxes are not divided" in paving.method
    for point in ((2.0, 0.5), (-0.25, -4.0), (1e9, 1e-9), (-(2.0**-600), -(2.0**600))):
        assert any(np.array(point) in box for box in paving.boundary)
    near = [box for box in paving.boundary if (np.abs(box.mid) < 50).all()]
    assert max(box.width.max() for box in near) <= paving.width


def test_a_time_limit_holds_while_rows_are_expanded() -> None:
    net, x = network(6, x=(-1, 1))
    net.add([(x.sum() + k) ** 12 + x[k] == 1 for k in range(6)])
    forms = PolynomialForms(net, deadline=0.0).on()
    assert {constraint for constraint, _ in forms.leftover} == set(range(6))
    assert {reason for _, reason in forms.leftover} == {"the time limit came first"}
    assert net.solve(limits=Limits(seconds=0.0)).nodes <= 1


def test_turns_are_shorter_where_a_node_takes_longer() -> None:
    few, many = (choice_to_solve(made(n, n)).methods[0].slice for n in (4, 60))
    assert many < few / 10
