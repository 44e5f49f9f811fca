"""The prover of points refuses what is wrong, and proves with readings no more than the readings allow."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.solver.network import ConstraintNetwork, Expr, norm, sqrt
from cpcal.solver.optimize.witness import Witness, WitnessProver, verify_point
from tests.networks import network

MIXING = {
    "one row twice": (lambda r: r[[0, 0]] + np.array([0.0, 0.5])),
    "a matrix": (lambda r: np.array([[1.0, 0.0], [1.0, 0.0]]) @ r + np.array([0.0, 0.5])),
    "a sum": (lambda r: r.sum() + np.array([0.0, 0.5])),
    "broadcast": (lambda r: r[:1] + np.array([0.0, 0.5])),
}


def prove(net: ConstraintNetwork, point: list[float]) -> Witness | None:
    return WitnessProver(net, len(point) - 1).prove(np.array(point))


def with_eps(size: int = 1, eps: tuple[float, float] = (0.0, 10.0)) -> tuple[ConstraintNetwork, Expr, Expr]:
    net = ConstraintNetwork()
    return net, net.variable("x", size, (-10, 10)), net.variable("eps", (), eps)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_witness_holds_in_exact_arithmetic(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centers, lengths = rng.uniform(-5, 5, (6, 2)), rng.uniform(1, 6, 6)
    net, x, eps = with_eps(2)
    net.add((norm(centers - x) - lengths).within((-eps, eps)))
    net.add(lengths >= eps)
    found = prove(net, [*rng.uniform(-1, 1, 2), 0.0])
    assert found is None or found.value == found.point[2]
    worst = np.max(np.abs(np.linalg.norm(centers - found.point[:2], axis=1) - lengths)) if found else np.inf
    if found is None:
        assert np.min(lengths) < 10
        return
    assert found.value == pytest.approx(worst, rel=1e-12)
    p, e = [Fraction(v) for v in found.point[:2]], Fraction(found.value)
    for center, length in zip(centers, lengths, strict=True):
        square = sum(((Fraction(c) - v) ** 2 for c, v in zip(center, p, strict=True)), Fraction(0))
        assert (Fraction(length) - e) ** 2 <= square <= (Fraction(length) + e) ** 2


def test_wrong_points_are_refused() -> None:
    net, x, eps = with_eps()
    net.add([(x[0] - 1).within((-eps, eps)), x[0] ** 2 <= 4])
    assert prove(net, [1.75, 0.0]).value == pytest.approx(0.75)  # type: ignore[union-attr]
    assert prove(net, [2.1, 0.0]) is None  # eps cannot mend x^2 <= 4
    assert prove(net, [np.nan, 0.0]) is None
    tight, x, eps = with_eps(eps=(0.0, 0.5))
    tight.add((x[0] - 1).within((-eps, eps)))
    assert prove(tight, [2.0, 0.0]) is None  # beyond the domain of eps
    assert prove(tight, [1.4, 0.0]) is not None


def test_a_solution_of_equations_is_proved_in_a_tiny_box_around_the_point() -> None:
    net, x, eps = with_eps(2)
    net.add([x[0] ** 2 + x[1] ** 2 == 25, x[0] * x[1] - 11 <= eps])
    found = prove(net, [3.1, 4.0, 0.0])
    assert found is not None
    assert found.around is not None
    assert found.around.width[:2].max() < 1e-12
    low, high = (Fraction(v) for v in (found.around.lo[1], found.around.hi[1]))
    assert low**2 <= 25 - Fraction(found.around.lo[0]) ** 2 <= high**2  # x[0] is one number, x[1] is enclosed
    assert found.value == pytest.approx(found.point[0] * found.point[1] - 11)
    net, x, eps = with_eps()
    net.add([x[0] ** 2 == 2, x[0] - eps == 0])
    found = prove(net, [1.4, 1.4])
    assert found is not None
    assert found.around is not None
    assert Fraction(found.around.lo[1]) ** 2 < 2 <= Fraction(found.value) ** 2  # its upper end: sqrt(2) is no float


def test_equations_without_a_solution_near_the_point_are_not_proved() -> None:
    net, x, eps = with_eps(2)
    net.add([x[0] ** 2 + x[1] ** 2 == -1e-9, eps >= 0])
    assert prove(net, [0.0, 0.0, 0.0]) is None
    beyond, x, eps = with_eps(2)
    beyond.add([x[0] + x[1] == 25, eps >= 0])  # both are at most 10
    assert prove(beyond, [10.0, 10.0, 0.0]) is None


def test_an_equation_that_a_component_at_its_end_satisfies_needs_no_unknown() -> None:
    net, x, y, z = network(x=(0, 5), y=(0, 5), z=(-9, 9))
    net.add([x * y == 0.0, x + y == 1.0, y - x <= z])
    found = prove(net, [1.0, 0.0, -5.0])
    assert found is not None
    assert found.value == pytest.approx(-1.0)


def test_a_root_that_rounding_alone_defines_is_no_witness() -> None:
    """0.1 + 0.2 is 1e-17 short of 0.30000000000000004 as an exact sum of floats."""
    net, x, eps = with_eps()
    net.add(sqrt(net.constant(0.1) + 0.2 - x[0]) <= eps)
    assert prove(net, [0.30000000000000004, 0.0]) is None
    assert prove(net, [0.3, 0.0]) is not None


def test_an_undefined_element_is_no_witness_of_what_it_enters_and_of_nothing_else() -> None:
    net, x, eps = with_eps(2)
    net.add(sqrt(x)[0] <= eps)
    assert prove(net, [1.0, -1.0, 0.0]) is not None
    net.add(sqrt(x).sum() <= 9)
    assert prove(net, [1.0, -1.0, 0.0]) is None
    assert prove(net, [1.0, 1.0, 0.0]) is not None


def test_a_pole_inside_the_reading_sets_is_no_witness() -> None:
    """1/r = x takes no value in (-1, 1), though 1/r changes its sign."""
    net, x, eps = with_eps(eps=(0.0, 0.1))
    net.add((1 / net.reading(np.zeros(1), 1.0) - x).within((-eps, eps)))
    assert prove(net, [0.5, 0.0]) is None
    net, x, eps = with_eps(eps=(0.0, 0.1))
    net.add((net.reading(np.zeros(1), 1.0) ** -1 - x).within((-eps, eps)))
    assert prove(net, [0.5, 0.0]) is None


def test_readings_within_their_sets_prove_zero_and_no_more() -> None:
    net, x, eps = with_eps()
    net.add((x - net.reading([1.0, 1.5], 0.5)).within((-eps, eps)))
    assert prove(net, [1.25, 0.0]).value == 0.0  # type: ignore[union-attr]
    found = prove(net, [2.0, 0.0])
    assert found is not None
    assert found.value == pytest.approx(0.5, rel=1e-12)
    assert found.value >= 0.5


@settings(max_examples=40, deadline=None)
@given(center=st.floats(-1e6, 1e6), radius=st.sampled_from([5e-324, 1e-17, 1e-16, 3e-16, 0.1, 0.3, 1e5]))
def test_readings_outside_their_stated_sets_prove_nothing(center: float, radius: float) -> None:
    """The stored set is rounded outward; a witness must use readings of the stated one, exactly."""
    net, x, eps = network(x=(-np.inf, np.inf), eps=(0.0, 1e6))
    net.add((x - net.reading(center, radius)).within((-eps, eps)))
    for far in (Fraction(center) + Fraction(radius), Fraction(center) - Fraction(radius)):
        point = float(far)
        found = prove(net, [point, 0.0])
        assert found is not None
        distance = max(abs(Fraction(point) - Fraction(center)) - Fraction(radius), Fraction(0))
        assert Fraction(found.value) >= distance


def test_one_reading_cannot_serve_two_constraints() -> None:
    net, x, eps = with_eps(eps=(0.1, 0.1))
    r = net.reading(0.0, 1.0)
    net.add([(r + 0 * x[0]).within((-eps, eps)), (r + 0.5).within((-eps, eps))])
    assert prove(net, [0.0, 0.1]) is None
    found = verify_point(net, [0.0, 0.1])
    assert (found.holds.tolist(), found.fails.tolist()) == ([False], [False])
    shared, x, eps = with_eps(eps=(0.1, 0.1))
    r = shared.reading(np.zeros(1), 1.0)
    shared.add((r[[0, 0]] + np.array([0.0, 0.05]) + 0 * x[0]).within((-2, 2)))  # holds for every reading
    shared.add((r + 0.5 * x).within((-eps, eps)))
    assert prove(shared, [0.0, 0.1]) is not None


@pytest.mark.parametrize("beyond", [-1e-3, -1e-9, 0.0, 1e-9])
def test_a_point_fails_only_beyond_its_bound(beyond: float) -> None:
    net, x, _ = with_eps()
    net.add(x - 1.0 <= 0)
    found = verify_point(net, [1.0 + beyond, 0.0])
    assert (found.holds.tolist(), found.fails.tolist()) == ([beyond <= 0.0], [beyond > 0.0])


@pytest.mark.parametrize("name", MIXING)
def test_one_reading_cannot_serve_two_elements(name: str) -> None:
    """|r| <= 0.1 and |r + 0.5| <= 0.1 have no common r, though each has one."""
    net, x, eps = with_eps(eps=(0.1, 0.1))
    net.add((MIXING[name](net.reading(np.zeros(2), 1.0)) + 0 * x[0]).within((-eps, eps)))
    assert prove(net, [0.0, 0.1]) is None
