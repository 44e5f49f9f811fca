"""Boxes proved to hold nothing but solutions, or exactly one, do so; nothing is proved that is not so."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.solver.existence.operators import Equalities, inside, newton_image
from cpcal.solver.existence.unique import Inside, ReadingConstraint, UniquenessProver, prove_unique
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, Expr, norm, sqr, sqrt
from tests.networks import network


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_every_point_of_a_proved_box_is_a_solution(seed: int) -> None:
    """Distances to beacons, read with an error: a point solves when each |distance - centre| <= eps + radius."""
    rng = np.random.default_rng(seed)
    beacons, radius = rng.uniform(-5, 5, (4, 2)), float(rng.choice([0.0, 0.5]))
    truth = rng.uniform(-1, 1, 2)
    read = np.linalg.norm(beacons - truth, axis=1) + rng.uniform(-0.3, 0.3, 4)
    net, p = network(2, p=(-2, 2))
    eps = float(rng.uniform(0, 1))
    net.add((norm(beacons - p) - net.reading(read, np.full(4, radius))).within((-eps, eps)))
    middle, reach = truth + rng.uniform(-0.3, 0.3, 2), 10.0 ** rng.uniform(-4, 0)
    box = Box(net.names, middle - reach, middle + reach)
    points = rng.uniform(box.lo, box.hi, (50, 2))
    worst = np.abs(np.linalg.norm(beacons - points[:, None], axis=2) - read).max()
    proved = Inside(net)(box)
    if proved:
        assert worst <= eps + radius + 1e-12
        assert box.subset(net.domain)
    tiny = Box(net.names, truth, truth)
    room = eps + radius - np.abs(np.linalg.norm(beacons - truth, axis=1) - read).max()
    assert Inside(net)(tiny) or room < 1e-9


def test_what_is_not_proved_to_be_inside() -> None:
    net, x = network(2, x=(-2, 2))
    net.add([sqr(x[0]) <= 1, sqrt(x[1]) <= 1])
    inside = Inside(net)
    assert inside(Box(net.names, [-0.9, 0.0], [0.9, 0.5]))
    assert not inside(Box(net.names, [-0.9, -0.5], [0.9, 0.5]))  # the root is not defined everywhere
    assert not inside(Box(net.names, [-0.9, 0.0], [1.1, 0.5]))
    assert not inside(Box.empty(net.names))
    net.add(x[0] == 0.5)
    assert not Inside(net)(Box(net.names, [0.0, 0.0], [0.9, 0.5]))
    assert Inside(net)(Box(net.names, [0.5, 0.0], [0.5, 0.5]))


def test_outside_of_the_domain_nothing_is_inside() -> None:
    net = ConstraintNetwork()
    net.variable("x", (), (0, 1))
    assert Inside(net)(net.domain)
    assert not Inside(net)(Box(net.names, [0.0], [1.5]))


@pytest.mark.parametrize("shared", [False, True])
def test_readings_must_serve_all_constraints_at_once(shared: bool) -> None:
    """x = r and x = 1 - r each hold for some r in [0, 1]; for a common one only x = 1/2 does."""
    net = ConstraintNetwork()
    x, r = net.variable("x", (), (0, 1)), net.reading(0.5, 0.5)
    net.add(x == r)
    if shared:
        net.add(x == 1 - r)
    assert Inside(net)(Box(net.names, [0.25], [0.375])) is not shared


def test_no_value_between_those_of_a_jump_is_taken() -> None:
    net = ConstraintNetwork()
    x, r = net.variable("x", (), (-2, 2)), net.reading(0.0, 0.5)
    net.add(np.arctan2(r, x - 2.0) / 4.0 + x == 1.0)  # up to -0.66, and from 0.66 on, beside x = 1
    at = np.ones(1)
    constraint, box = ReadingConstraint(net, net.constraints[0]), IntervalArray.point(at[None])
    assert not constraint.for_all(box).any()
    assert not (constraint.excesses(box, at) <= 0.0).any()


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_known_solution_of_a_random_system_is_in_the_box(seed: int) -> None:
    """Quadratic systems with a dyadic solution, so that its residual is exactly zero."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    solution = rng.integers(-8, 9, n) / 4.0
    a, b = rng.integers(-4, 5, (2, n, n)) / 2.0
    net, x = network(n, x=(-10, 10))
    net.add(a @ x + b @ sqr(x) == a @ solution + b @ solution**2)
    reach = 10.0 ** rng.uniform(-8, 0)
    near = Box(net.names, solution - reach * rng.random(n), solution + reach * rng.random(n))
    found = UniquenessProver(net).prove(near)
    jacobian = a + 2.0 * b * solution
    regular = abs(np.linalg.det(jacobian)) > 1e-6
    if regular and reach * np.abs(np.linalg.inv(jacobian)).sum() * np.abs(b).sum() < 0.01:  # Newton converges
        assert found is not None
        assert solution in found.region
    if found is not None and solution in found.region:
        assert solution in found.box


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_region_holds_exactly_one_of_all_the_known_zeros(seed: int) -> None:
    """A (p(x_1), ..., p(x_n)) = 0 for a regular A and a cubic p with known, sometimes close, zeros: 3^n of them."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    roots = rng.integers(-8, 9, (n, 3)) / 4.0
    roots[:, 1] = np.where(rng.random(n) < 0.5, roots[:, 0] + 2.0 ** -rng.integers(1, 30, n), roots[:, 1])
    mixing = np.eye(n) + rng.integers(-1, 2, (n, n)) / 4.0
    net, x = network(n, x=(-10, 10))
    cubic = (x - roots[:, 0]) * (x - roots[:, 1]) * (x - roots[:, 2])
    net.add(mixing @ cubic == 0)
    middle = roots[np.arange(n), rng.integers(0, 3, n)] + rng.uniform(-1, 1, n) * 10.0 ** -rng.uniform(0, 9)
    reach = 10.0 ** -rng.uniform(0, 9) * rng.random(n)
    found = UniquenessProver(net).prove(Box(net.names, middle - reach, middle + reach))
    if found is None or abs(np.linalg.det(mixing)) < 0.05:
        return
    for k in range(n):  # a double zero can be in no region
        zeros, counts = np.unique(roots[k], return_counts=True)
        held = (zeros >= found.region.lo[k]) & (zeros <= found.region.hi[k])
        assert held.sum() == 1
        assert counts[held].tolist() == [1]
        assert found.box.lo[k] <= zeros[held][0] <= found.box.hi[k]


def refused(build: Callable[[ConstraintNetwork, Expr, Expr], object], at: tuple[float, float]) -> None:
    net, x, y = network(x=(-2, 2), y=(-2, 2))
    build(net, x, y)
    assert prove_unique(net, at) is None


def test_what_is_not_proved() -> None:
    refused(lambda net, x, y: net.add([sqr(x) == 0, y == 1]), (0, 1))  # a double zero
    refused(lambda net, x, y: net.add(x == y), (1, 1))  # a line of solutions
    refused(lambda net, x, y: net.add([x == 1, y == 1, x * y == 1]), (1, 1))  # one equation too many
    refused(lambda net, x, y: net.add([x == 1, y == 1, x + y <= 1.9]), (1, 1))  # an inequality is violated
    refused(lambda net, x, y: net.add([3 * x == 1, y == 1, 3 * x <= 1]), (1 / 3, 1))  # and one not decided
    refused(lambda net, x, y: net.add([x == 3, y == 1]), (2, 1))  # outside of the domain
    refused(lambda net, x, y: net.add([x == 2.0 + 1e-9, y == 1]), (2, 1))  # and just outside
    refused(lambda net, x, y: net.add([x + 1 / x == 0, y == 1]), (0, 1))  # a pole
    refused(lambda net, x, y: net.add([x + sqr(y) == 2, y + sqr(x) == 3, sqrt(x - 5) >= 0]), (1, 1))  # not defined
    refused(lambda net, x, y: net.add([x == net.reading(1.0, 0.1), y == 1]), (1, 1))  # many, one for each reading
    refused(lambda net, x, y: None, (1, 1))


def test_a_box_is_inside_another_only_if_each_of_its_ends_is() -> None:
    outer, columns = IntervalArray(np.zeros(3), np.ones(3)), np.array([0, 2])
    lo, hi = np.full(3, 0.25), np.full(3, 0.75)
    assert inside(IntervalArray(lo, hi), outer, columns)
    for k in range(3):
        at = np.eye(3)[k]
        touching = (IntervalArray(lo - 0.25 * at, hi), IntervalArray(lo, hi + 0.25 * at))
        assert [inside(one, outer, columns) for one in touching] == [k == 1, k == 1]  # of which nothing is asked


def test_no_zero_of_a_linearised_system_is_lost() -> None:
    """F(c) + A (x - c) = 0 at an x of the box, for an A in J; some components are fixed."""
    rng = np.random.default_rng(5)
    narrowed = 0
    for _ in range(300):
        columns = np.sort(rng.choice(4, int(rng.integers(1, 4)), replace=False))
        center, half = rng.normal(size=4), np.zeros(4)
        half[columns] = rng.uniform(0.1, 1.0, len(columns))
        matrix = rng.normal(size=(len(columns), 4))
        matrix[:, columns] += 4.0 * np.eye(len(columns))
        spread = rng.uniform(0.0, 0.2, matrix.shape)
        x = center + half * rng.uniform(-0.9, 0.9, 4)
        value = -((matrix + spread * rng.uniform(-1.0, 1.0, matrix.shape)) @ (x - center))
        values = np.stack([value - 1e-12, value + 1e-12], axis=-1)
        slopes = np.stack([matrix - spread, matrix + spread], axis=-1)
        box, found = np.stack([center - half, center + half], axis=-1), np.full((4, 2), np.nan)
        square = (center, np.arange(len(columns)), columns)
        if newton_image(values, slopes, *square, box, found) >= 0:
            narrowed += bool((np.ptp(found, axis=1) < np.ptp(box, axis=1))[columns].all())
            assert ((found[:, 0] <= x) & (x <= found[:, 1]))[columns].all()
    assert narrowed > 100


@pytest.mark.parametrize("operation", [lambda x: x**1.5, lambda x: 1 / x, lambda x: np.arctan2(x, x - 1)])
def test_nothing_is_linear_where_an_operation_is_not_continuous(operation: Callable[[Expr], Expr]) -> None:
    net, x = network(x=(-2, 2))
    net.add(x + operation(x) == -0.1)
    box = Box(net.names, np.array([-0.2]), np.array([0.2]))
    at = np.array([0.005])
    assert Equalities.of(net).image(box, at, np.array([0])) is None
