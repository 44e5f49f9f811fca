"""Known minima, also of general problems: bracketed from both sides at every moment, whatever stops the search."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

import cpcal
from contractors import HC4, Lifted
from cpcal import Interval, Limits, Network, Verdict, maximum, norm
from cpcal.common.errors import ModelError
from cpcal.solver.network.forms import with_products
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.bound import Bracket, Minimum, minimize, status_of
from cpcal.solver.optimize.local import Incumbent, Known, fit, fit_of_many
from cpcal.solver.optimize.witness import Prepared, Witness
from tests.networks import network

Problem = tuple[Network, str, float]


def line_fit() -> Problem:
    """The best line for x^2 on [-1, 1]: 1/2."""
    t = np.linspace(-1, 1, 21)
    net = Network()
    c, e = net.variable("c", 2, (-10, 10)), net.variable("e", (), (0, 10))
    net.add((t**2 - (c[0] + c[1] * t)).within((-e, e)))
    return net, "e", 0.5


def cubic_fit() -> Problem:
    """The best parabola for x^3 on [-1, 1], whose error is the Chebyshev polynomial T3 / 4; extrema on the grid."""
    t = np.concatenate([np.linspace(-1, 1, 41), [-0.5, 0.5]])
    net = Network()
    c, e = net.variable("c", 3, (-10, 10)), net.variable("e", (), (0, 10))
    net.add((t**3 - (c[0] + c[1] * t + c[2] * t**2)).within((-e, e)))
    return net, "e", 0.25


def circle_fit() -> Problem:
    """Points at 4 and at 5 from (1, -2) in turn: the best circle has radius 4.5."""
    angles = np.arange(8) * np.pi / 4
    points = [1, -2] + (4 + np.arange(8) % 2)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    net = Network()
    a, r, e = net.variable("a", 2, (-50, 50)), net.variable("r", (), (0, 50)), net.variable("e", (), (0, 50))
    net.add([(norm(points - a) - r).within((-e, e)), r >= e])
    return net, "e", 0.5


def three_valleys() -> Problem:
    """x^4 - 3 x^2 + x: the right valley is a trap, and so is the middle of the domain."""
    net, x, z = network(x=(-2, 2), z=(-10, 10))
    net.add(z >= x**4 - 3 * x**2 + x)
    roots = np.roots([4, 0, -6, 1]).real
    return net, "z", float(np.min(roots**4 - 3 * roots**2 + roots))


def two_anchors() -> Problem:
    """A distance problem with two mirrored optima."""
    net = Network()
    p, e = net.variable("p", 2, (-20, 20)), net.variable("e", (), (0, 20))
    anchors = np.array([[-3.0, 0.0], [3.0, 0.0]])
    net.add((norm(anchors - p) - np.array([5.0, 5.0])).within((-e, e)))
    net.add((norm(np.zeros((1, 2)) - p) - 4.5).within((-e, e)))
    # |p - anchor| = 5 + s e, |p| = 4.5 - s e on the axis y: 9 + (4.5 - e)^2 = (5 + e)^2
    return net, "e", 4.25 / 19


def worst_of_three() -> Problem:
    net = Network()
    x, z = net.variable("x", 2, (-3, 3)), net.variable("z", (), (-10, 10))
    net.add(maximum(maximum(x[0] + x[1], 2 - x[0]), 1 - x[1]) <= z)
    return net, "z", 1.0


PROBLEMS: list[Callable[[], Problem]] = [line_fit, cubic_fit, circle_fit, three_valleys, two_anchors, worst_of_three]


def checked(states: Iterator[Bracket | Minimum], optimum: float) -> Minimum:
    """The minimum at the end, after every bracket was valid and none wider than the one before."""
    lo, hi = -np.inf, np.inf
    for state in states:
        assert lo <= state.lo <= optimum + 1e-12 * (1 + abs(optimum))
        assert hi >= state.hi >= optimum - 1e-12 * (1 + abs(optimum))
        lo, hi = state.lo, state.hi
        if isinstance(state, Minimum):
            return state
    raise AssertionError("no Minimum at the end")


@pytest.mark.parametrize("make", PROBLEMS)
def test_known_optima(make: Callable[[], Problem]) -> None:
    net, objective, optimum = make()
    contractor = Lifted(net, objective=objective)
    limits = Limits(nodes=400)
    found = checked(minimize(net, objective, [("", contractor)], limits=limits), optimum)
    assert found.verdict is Verdict.PROVED
    assert found.hi - found.lo <= 1.01e-6 * abs(found.hi)
    assert found.witness is not None
    assert found.witness.value == found.hi
    assert found.witness.point in found.enclosure
    assert found.witness.point in net.domain
    assert found.pending == 0
    assert all(0 <= c < len(net.constraints) for c, _ in found.rows)
    assert found.rows


@pytest.mark.parametrize("nodes", [1, 2, 3])
@pytest.mark.parametrize("make", [three_valleys, two_anchors])
def test_brackets_are_valid_when_a_limit_stops_the_search(make: Callable[[], Problem], nodes: int) -> None:
    net, objective, optimum = make()
    limits = Limits(nodes=nodes, gap=0.0, gap_absolute=0.0)
    states = minimize(net, objective, [("", HC4(net))], limits=limits)
    found = checked(states, optimum)
    assert found.nodes == nodes
    assert found.verdict is Verdict.UNKNOWN
    assert "Stopped" in found.status
    assert found.pending > 0


def test_ctrl_c_keeps_what_is_proved() -> None:
    net, _, optimum = two_anchors()
    calls = []

    def interrupt(bracket: Bracket) -> None:
        calls.append(bracket)
        if len(calls) == 2:
            raise KeyboardInterrupt

    found = net.minimize(net.variables[1], contractors=("hc4",), progress=interrupt)
    assert found.interrupted
    assert found.nodes == calls[-1].nodes
    assert found.lo <= optimum <= found.hi


def test_infeasible_networks_are_refuted() -> None:
    net, x, z = network(x=(-2, 2), z=(-10, 10))
    net.add([z >= x**2, x + z <= -0.26])
    found = net.minimize(z)
    assert found.verdict is Verdict.REFUTED
    assert found.witness is None
    assert found.enclosure.is_empty
    assert (found.lo, found.hi) == (np.inf, np.inf)
    net = Network()  # the same with room: min z on x^2 <= z <= -x - 0.24
    x, z = net.variable("x", (), (-2, 2)), net.variable("z", (), (-10, 10))
    net.add([z >= x**2, x + z <= -0.24])
    assert net.minimize(z).hi == pytest.approx(0.16, rel=1e-5)


def test_an_unclosed_bracket_is_never_proved() -> None:
    """No contractor bounds this: the answer must not be called proved."""
    net = Network()
    x, e = net.variable("x", (), (-2, 2)), net.variable("e")
    net.add(x**2 <= e)
    found = net.minimize(e, contractors=("hc4", "lifted"), limits=Limits(nodes=5))
    assert found.lo <= 0.0 <= found.hi
    net, x, e = network(x=(-2, 2), e=(-100, 100))
    net.add(norm(np.ones((3, 1)) * (x - 0.1)) - 1 <= e)  # hc4 sees it, but to lifted 3 roots are one
    net.add((1 / (2 + x**2)).within((-e, np.inf)))  # not polynomial: lifted knows nothing of it
    found = net.minimize(e, limits=Limits(nodes=30))
    assert (found.verdict is Verdict.PROVED) == (found.hi - found.lo <= 1.01e-6 * abs(found.hi))


def test_objectives_that_make_no_sense_are_refused() -> None:
    net = Network()
    x, y = net.variable("x", (), (0, 1)), net.variable("y")
    with pytest.raises(ModelError, match="not a scalar variable"):
        net.minimize(y[None])
    for expression in (x, x + 1, net.constant(2.0)):
        with pytest.raises(ModelError, match="has none for y"):
            net.minimize(expression)


def test_readings_bracket_includes_their_first_order_effect() -> None:
    """|x - r| <= e with r in [1, 3] shared with |x - 5| <= e: the optimum is (5 - 3) / 2 = 1 for r = 3."""
    net, x, e = network(x=(-10, 10), e=(0, 100))
    net.add([(x - net.reading(2.0, 1.0)).within((-e, e)), (x - 5).within((-e, e))])
    found = net.minimize(e)
    assert found.lo <= 1.0 <= found.hi + 1e-12
    assert found.hi - found.lo < 2e-6
    assert 4.0 in found.enclosure["x"]
    net.add(Interval(1, 1) * e <= 0.5)
    assert net.minimize(e).verdict is Verdict.REFUTED


@pytest.mark.parametrize(
    ("lo", "floor", "undecided", "verdict", "words"),
    [
        (1.0 - 1e-7, 0.0, 0, Verdict.PROVED, "the gap is closed"),
        (1.0 - 1e-3, 1e-2, 0, Verdict.UNKNOWN, "is open. The search ends there, because the second-order effect"),
        (1.0 - 1e-3, 1e-4, 0, Verdict.UNKNOWN, "cannot close the gap"),
        (1.0 - 1e-3, 1e-2, 3, Verdict.UNKNOWN, "Stopped at a limit with 3 undecided boxes"),
    ],
)
def test_only_the_gap_that_was_asked_for_closes_a_bracket(lo, floor, undecided, verdict, words):
    net = Network()
    net.variable("e", (), (0, 10))
    prepared = Prepared(net, "e")
    incumbent = Incumbent(prepared, Limits(gap=1e-6), np.inf, net.domain)
    incumbent.witness = Witness(np.array([1.0]), 1.0)
    said = status_of(Bracket(lo, 1.0, 1, 1, 0.0), incumbent, undecided, floor)
    assert said[0] is verdict
    assert words in said[1]
    assert ("closed" in said[1]) == (verdict is Verdict.PROVED)
    incumbent.witness = None
    for left, at, what in ((0, np.inf, Verdict.REFUTED), (1, np.inf, Verdict.UNKNOWN), (1, lo, Verdict.UNKNOWN)):
        assert status_of(Bracket(at, np.inf, 1, 1, 0.0), incumbent, left, 0.0)[0] is what


def test_a_fit_of_many_measurements_is_that_of_all_of_them() -> None:
    rng = np.random.default_rng(3)
    t = rng.uniform(-1.0, 1.0, 3000)
    values = t**2 + rng.uniform(-0.01, 0.01, 3000)
    net = Network()
    a, e = net.variable("a", 3, ([-5.0] * 3, [5.0] * 3)), net.variable("e", (), (0.0, 10.0))
    net.add((a[0] + a[1] * t + a[2] * t**2 - values).within((-e, e)))
    rows, start = Rows(net), np.array([0.0, 0.0, 0.0, 0.0])
    of_all = fit(rows, 3, net.domain, start)
    easy = np.array([0.0, 0.0, 0.0, 9.0])  # no measurement is violated there
    for begun in (start, easy, np.array([1.0, -2.0, 0.0, 0.0])):
        np.testing.assert_allclose(fit_of_many(net, rows, 3, begun, net.domain).point, of_all, atol=1e-9)


def test_what_another_search_has_learned_replaces_the_incumbent_only_where_it_is_better() -> None:
    net = Network()
    net.variable("e", (), (0, 10))
    incumbent = Incumbent(Prepared(net, "e"), Limits(), np.inf, net.domain)
    for value, kept in ((2.0, 2.0), (3.0, 2.0), (1.0, 1.0)):
        incumbent.learn(Known(Witness(np.array([value]), value), 1), Known(None, 0))
        assert incumbent.hi == kept


Asked = tuple[cpcal.Network, cpcal.Expr]


def himmel11() -> Asked:
    net = cpcal.Network("himmel11")
    x = net.variable("x", 5, ([78, 33, 27, 27, 27], [102, 45, 45, 45, 45]))
    one = 85.334407 + 0.0056858 * x[1] * x[4] + 0.0006262 * x[0] * x[3] - 0.0022053 * x[2] * x[4]
    two = 80.51249 + 0.0071317 * x[1] * x[4] + 0.0029955 * x[0] * x[1] + 0.0021813 * x[2] ** 2
    three = 9.300961 + 0.0047026 * x[2] * x[4] + 0.0012547 * x[0] * x[2] + 0.0019085 * x[2] * x[3]
    net.add([one.within((0, 92)), two.within((90, 110)), three.within((20, 25))])
    return net, 5.3578547 * x[2] ** 2 + 0.8356891 * x[0] * x[4] + 37.293239 * x[0] - 40792.141


def rosenbrock() -> Asked:
    net = cpcal.Network("rosenbrock")
    x, y = net.variable("x", domain=(-10, 10)), net.variable("y", domain=(-10, 10))
    return net, (1 - x) ** 2 + 100 * (y - x**2) ** 2


def ratio() -> Asked:
    """The least x/y + y/x on a box without x = y: 3/2 + 2/3."""
    net = cpcal.Network("ratio")
    x, y = net.variable("x", domain=(1, 2)), net.variable("y", domain=(3, 4))
    return net, x / y + y / x


@pytest.mark.parametrize(("problem", "value"), [(himmel11, -30665.53867), (rosenbrock, 0.0), (ratio, 13 / 6)])
def test_a_known_optimum_is_bracketed_and_the_gap_closes(problem: Callable[[], Asked], value: float) -> None:
    net, objective = problem()
    best = net.minimize(objective, limits=Limits(nodes=300))
    assert best.verdict is Verdict.PROVED
    assert best.lo <= value + 1e-7 * abs(value)
    assert best.hi >= value - 1e-6 * abs(value)
    assert best.hi - best.lo <= max(1e-6 * abs(best.hi), 1e-9)


def test_a_division_by_an_expression_of_one_sign_is_multiplied_out() -> None:
    net, x, y = network(x=(1, 2), y=(-3, -2))
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
    net, x, y = network(x=(1, 2), y=(-3, 2))
    net.add(x / y <= 1)
    assert with_products(net)[0] is net


def _holds(net: cpcal.Network, constraint: cpcal.Constraint, point: np.ndarray) -> bool:
    box = cpcal.Box(net.names, point, point)
    body, low, high = (cpcal.evaluate(net, e, box) for e in (constraint.body, constraint.lower, constraint.upper))
    return bool(low.mid <= body.mid <= high.mid)
