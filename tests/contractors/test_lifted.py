"""lifted and its rows: they hold at every solution, exactly; its half-spaces; what it must do that hc4 cannot."""

import copy
from fractions import Fraction
from itertools import combinations_with_replacement
from math import prod

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import Lifted
from contractors.lifted import Directions, over_box
from contractors.relaxation import CentredRows, Relaxation, Shift, Structure, centred, column_bounds, product_rows
from cpcal.models import fit_model, leg_box, leg_network, model_residuals
from cpcal.simulate import simulate
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.linear import Dense, LinearSolution, LinearStatus
from cpcal.solver.network import ConstraintNetwork, PolynomialForms, norm, sqrt
from cpcal.solver.network.polynomial import Monomial
from cpcal.solver.network.rows import DecisiveReadings
from cpcal.solver.testing import Case, cases
from tests.networks import network

SEEDS = st.integers(0, 2**32 - 1)


def all_monomials(variables: int, degree: int) -> tuple[Monomial, ...]:
    return tuple(m for d in range(degree + 1) for m in combinations_with_replacement(range(variables), d))


def value(monomial: Monomial, point: list[Fraction]) -> Fraction:
    product = Fraction(1)
    for i in monomial:
        product *= point[i]
    return product


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
@settings(max_examples=4, deadline=None)
@given(seed=SEEDS)
def test_monomials_in_a_boxs_coordinates_lie_within_the_widening(degree: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    monomials = all_monomials(3, degree)
    center, radius = rng.normal(0, 100, 3), 10.0 ** rng.uniform(-8, 3, 3)
    each = IntervalArray.point(np.eye(len(monomials))[None])
    shift = Shift(monomials, 3)
    matrix, widening = centred(tuple(CentredRows.of(shift, each)), shift.rounded(center, radius))
    u = [Fraction(v) for v in rng.uniform(-1, 1, 3)]
    x = [Fraction(c) + Fraction(r) * v for c, r, v in zip(center, radius, u, strict=True)]
    for row, alpha in enumerate(monomials):
        terms = [Fraction(matrix[j, row]) * value(beta, u) for j, beta in enumerate(monomials)]
        assert abs(sum(terms) - value(alpha, x)) <= widening[row]
    assert (widening <= 1e-11 * np.maximum(np.abs(matrix).sum(axis=0), 1e-270)).all()


@pytest.mark.parametrize(("variables", "degree"), [(1, 4), (2, 2), (3, 3), (2, 4)])
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_product_rows_hold_for_every_point_of_the_cube(variables: int, degree: int, data: st.DataObject) -> None:
    monomials = all_monomials(variables, degree)
    rows = product_rows(monomials, np.ones(len(monomials) - 1, dtype=bool).tobytes())
    assert len(rows.rhs) > 0
    coordinate = st.sampled_from([-1.0, -0.5, 0.0, 0.25, 1.0]) | st.floats(-1, 1, allow_subnormal=False)
    u = [Fraction(v) for v in data.draw(st.lists(coordinate, min_size=variables, max_size=variables))]
    w = [value(m, u) for m in monomials[1:]]
    bounds = column_bounds(monomials)
    assert all(lo <= v <= hi for lo, v, hi in zip(bounds.lo, w, bounds.hi, strict=True))
    for row, rhs in zip(rows.matrix, rows.rhs, strict=True):
        assert sum(Fraction(c) * v for c, v in zip(row, w, strict=True) if c) <= Fraction(rhs)


def test_a_measurement_decides_at_neither_end_across_a_pole_or_a_missing_root() -> None:
    """1/m falls on either side of zero, and yet is smallest at neither end of [-1, 1]."""
    net = ConstraintNetwork()
    x, m = net.variable("x", (), (-20, 20)), net.reading(np.zeros(1), 1.0)
    net.add(m**-1 + x <= 0)
    assert 10.0 in Lifted(net).contract(net.domain).box["x"]  # m = -0.1
    net = ConstraintNetwork()
    x, m = net.variable("x", (), (-1, 1)), net.reading(np.array([1.5]), 1.5)
    net.add(sqrt(m - 1) + (0.05 - 0.1 * m) + x <= 0)
    assert 0.05 in Lifted(net).contract(net.domain).box["x"]  # m = 1, where the root begins


def test_rows_made_before_are_used_again_only_where_the_same_ends_of_the_readings_decide() -> None:
    """Whatever boxes came before, the contraction is the same."""
    anchors = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]])
    net, x = network(2, x=([-5.0, -5.0], [5.0, 5.0]))
    net.add((norm(net.reading(anchors, 0.1) - x) - 2.5).within((-0.1, 0.1)))
    boxes = [net.domain, net.domain.replace("x[0]", lo=1.0), net.domain.replace("x[0]", hi=2.0), net.domain]
    reused = Lifted(net)
    for box in boxes:
        assert reused.contract(box).box == Lifted(net).contract(box).box


def holds(directions, bounds, point):
    """Whether every half-space holds a point, decided over the rationals wherever float64 could be wrong."""
    directions, bounds, point = np.asarray(directions), np.asarray(bounds), np.asarray(point)
    doubt = 1e-12 * (np.abs(directions) @ np.abs(point)) + 1e-300
    near = np.flatnonzero(directions @ point + doubt > bounds)
    exact = (sum(Fraction(d) * Fraction(x) for d, x in zip(directions[k], point, strict=True)) for k in near)
    return all(value <= Fraction(bounds[k]) for value, k in zip(exact, near, strict=True))


def test_a_strip_is_much_thinner_than_its_box() -> None:
    """Two unknowns whose sum is known a hundred times better than either, on a disc."""
    net, x, y = network(x=(-2, 2), y=(-2, 2))
    net.add([(x + y).within((-0.01, 0.01)), x * x + y * y <= 2])
    lifted = Lifted(net)
    box = lifted.contract(net.domain).box
    directions = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, 0.0], [1.0, -1.0], [0.0, 0.0]])
    bounds = lifted.support_function(box, directions)
    assert 0.01 <= min(bounds[:2]) <= max(bounds[:2]) < 0.0100001
    assert bounds[2] <= box.hi[0] + 1e-12
    assert 2.0 <= bounds[3] < 2.5
    assert 0.0 <= bounds[4] < 1e-300
    assert all(holds(directions, bounds, point) for point in ((1.0, -1.0), (-0.5, 0.5)))


def test_weights_that_nobody_has_looked_at_yet_are_copied() -> None:
    net, x, y = network(x=(-2, 2), y=(-2, 2))
    net.add(x * x + y * y <= 2)
    steps = Lifted(net).contract(net.domain).steps
    assert [step.weights for step in copy.deepcopy(steps)] == [copy.copy(step.weights) for step in steps] != []


@settings(max_examples=2, deadline=None)
@given(seed=SEEDS)
def test_they_hold_every_sampled_solution_of_a_leg(seed: int) -> None:
    rng = np.random.default_rng(seed)
    campaign = simulate(seed=int(rng.integers(1000)), joint_error=1.0, factor=0.0, random_poses=12, extremal=False)
    leg, eps = int(rng.integers(1, 7)), 10.0 ** rng.uniform(-1, 1.5)
    center = fit_model(campaign, leg)
    eps += float(np.abs(model_residuals(campaign, leg, center)).max())
    net = leg_network(campaign, leg, leg_box(center, 10.0 * eps), eps=(eps, eps))
    directions = rng.normal(0, 1, (12, 8)) * 10.0 ** rng.uniform(-6, 6, (12, 1)) * rng.integers(0, 2, (12, 8))
    bounds = Lifted(net).support_function(net.domain, directions)
    assert (bounds <= over_box(net.domain, directions)).all()
    near = center + eps * rng.normal(0, 1, (500, 7)) * 10.0 ** rng.uniform(-2, 0.3, (500, 1))
    solved = [x for x in near if np.abs(model_residuals(campaign, leg, x)).max() < eps * (1 - 1e-9)]
    for x in [center, *solved]:
        point = np.append(x, eps)
        assert point not in net.domain or holds(directions, bounds, point)


def test_where_no_program_helps_the_box_does(monkeypatch: pytest.MonkeyPatch) -> None:
    net, x, y = network(x=(-np.inf, 2), y=(-1, 3))
    net.add(x * y <= 1)
    directions = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [-1.0, 0.0]])
    bounds = Lifted(net).support_function(net.domain, directions)
    assert bounds[:3] == pytest.approx([2, 3, 5])
    assert bounds[3] == np.inf

    def failing(engine: Dense, objective: np.ndarray) -> LinearSolution:
        return LinearSolution(LinearStatus.FAILED, np.zeros(len(objective)), np.zeros(0, np.intp), np.zeros(0))

    monkeypatch.setattr(Dense, "minimize", failing)
    bounded = net.domain.replace("x", lo=-5.0)
    assert Lifted(net).support_function(bounded, directions) == pytest.approx([2, 3, 5, 5])


@pytest.mark.parametrize("power", [-320, -300, 0, 290])
def test_directions_of_any_size_lose_nothing(power: int) -> None:
    """Against the box itself, whose coordinates u are all that the programs bound here."""
    box = Box(("x", "y", "z"), [-3.0, 1e-9, 5.0], [7.0, 3e-9, 5.0])
    direction = np.array([[0.1, -3e8, 1.0], [0.3, 1e-17, 0.7], [0.1, 1e-20, 1e-300]]) * 10.0**power
    asked = Directions(box, {0: 1, 1: 0}, 2, direction)
    found = asked.highest(-np.abs(asked.objectives).sum(axis=1) * (1 + 1e-15))
    for d, bound in zip(direction, found, strict=True):
        highest = sum(
            max(Fraction(c) * Fraction(lo), Fraction(c) * Fraction(hi))
            for c, lo, hi in zip(d, box.lo, box.hi, strict=True)
        )
        assert highest <= Fraction(bound)


def test_of_an_empty_set_they_are_empty() -> None:
    net, x, y = network(x=(-2, 2), y=(-2, 2))
    net.add([x * x + y * y <= 1, x + y >= 1.6])
    lifted = Lifted(net)
    assert (lifted.support_function(net.domain, np.eye(2)) == -np.inf).all()
    assert (lifted.support_function(Box.empty(net.names), np.eye(2)) == -np.inf).all()
    assert lifted.support_function(net.domain, np.zeros((0, 2))).shape == (0,)


def rows_hold(net: ConstraintNetwork, box: Box, point: list[float]) -> list[bool]:
    """For every row of the linear programs, in exact arithmetic, whether the point's monomials satisfy it."""
    system = PolynomialForms(net).on(DecisiveReadings(net).on(box))
    relaxation = Relaxation(Structure(system), box)
    scaled = zip(point, relaxation.center, relaxation.radius, strict=True)
    u = [(Fraction(x) - Fraction(c)) / Fraction(r) if r else Fraction(0) for x, c, r in scaled]
    monomials = [system.monomials[1 + k] for k in relaxation.columns]
    w = [prod((u[i] for i in m), start=Fraction(1)) for m in monomials]
    rows = zip(relaxation.matrix.tolist(), relaxation.rhs.tolist(), strict=True)
    return [sum((Fraction(a) * v for a, v in zip(row, w, strict=True) if a), Fraction(0)) <= side for row, side in rows]


CASES = [case for case in cases(5) if case.network.domain.is_bounded]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
@settings(max_examples=2, deadline=None)
@given(data=st.data())
def test_rows_hold_at_solutions(case: Case, data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    point = case.solutions[rng.integers(len(case.solutions))]
    domain = case.network.domain
    size = 10.0 ** rng.uniform(-6, 2) * rng.random((2, len(point))) * rng.integers(0, 2, (2, len(point)))
    lo, hi = np.maximum(domain.lo, point - size[0]), np.minimum(domain.hi, point + size[1])
    for box in (domain, domain.with_bounds(lo, hi)):
        assert all(rows_hold(case.network, box, point.tolist()))


def test_a_guard_that_may_fail_is_paid_for() -> None:
    """sqrt(x) >= y holds for every y < 0, where y^2 <= x does not; where y > 0 on the box nothing is paid."""
    net, x, y = network(x=(0, 1), y=(-3, 1))
    net.add(sqrt(x) >= y)
    assert all(rows_hold(net, net.domain, [0.25, -3.0]))
    inside = net.domain.replace("y", lo=0.125)
    assert all(rows_hold(net, inside, [0.25, 0.5]))
    assert rows_hold(net, inside, [0.25, 0.5009]).count(False) == 1


def test_columns_are_capped_and_the_rows_still_hold() -> None:
    """A product of degree 11 of each three of five unknowns has hundreds of divisors; what has no column is bounded."""
    net, x = network(5, x=(-1, 1))
    point = np.array([0.5, -0.25, 0.75, -0.5, 0.125])
    for k in range(5):
        a, b, c = x[k], x[(k + 1) % 5], x[(k + 2) % 5]
        row = a - 0.5 * a**3 * b**4 * c**4 + b**5 * c**6
        value = Fraction(0)
        i, j, m = (Fraction(v) for v in (point[k], point[(k + 1) % 5], point[(k + 2) % 5]))
        value = i - Fraction(1, 2) * i**3 * j**4 * m**4 + j**5 * m**6
        net.add(row <= float(np.nextafter(float(value), np.inf)))
    structure = Structure(PolynomialForms(net).on())
    assert len(structure.system.monomials) > 300
    assert structure.used.sum() <= 150
    assert len(structure.positions) == 5
    for size in (2.0, 0.1, 1e-3):
        box = net.domain.with_bounds(np.maximum(point - size, -1.0), np.minimum(point + size, 1.0))
        assert all(rows_hold(net, box, point.tolist()))


def test_rows_with_too_many_products_are_left_over_and_named() -> None:
    net, x = network(30, x=(-1, 1))
    product = x[0]
    for k in range(1, 30):
        product = product * x[k]  # a billion divisors
    net.add([product == 0.5, x.sum() == 1, (x.sum() + 1) ** 12 <= 3])
    system = PolynomialForms(net).on()
    assert {constraint for constraint, _ in system.leftover} == {0, 2}
    assert set(system.origin[:, 0].tolist()) == {1}
