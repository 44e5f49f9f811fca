"""The rows that carry the proofs hold at every solution; regression: what tolerances alone say of each variable."""

from fractions import Fraction
from math import prod

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import Regression
from contractors.relaxation import Relaxation, Structure
from cpcal.models import leg_box, leg_network
from cpcal.robot import Campaign
from cpcal.simulate import simulate, true_robot
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork, PolynomialForms, sqrt
from cpcal.solver.network.rows import DecisiveReadings
from cpcal.solver.testing import Case, cases


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
    net = ConstraintNetwork()
    x, y = net.variable("x", (), (0, 1)), net.variable("y", (), (-3, 1))
    net.add(sqrt(x) >= y)
    assert all(rows_hold(net, net.domain, [0.25, -3.0]))
    inside = net.domain.replace("y", lo=0.125)
    assert all(rows_hold(net, inside, [0.25, 0.5]))
    assert rows_hold(net, inside, [0.25, 0.5009]).count(False) == 1


def test_columns_are_capped_and_the_rows_still_hold() -> None:
    """A product of degree 11 of each three of five unknowns has hundreds of divisors; what has no column is bounded."""
    net = ConstraintNetwork()
    x = net.variable("x", 5, (-1, 1))
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
    net = ConstraintNetwork()
    x = net.variable("x", 30, (-1, 1))
    product = x[0]
    for k in range(1, 30):
        product = product * x[k]  # a billion divisors
    net.add([product == 0.5, x.sum() == 1, (x.sum() + 1) ** 12 <= 3])
    system = PolynomialForms(net).on()
    assert {constraint for constraint, _ in system.leftover} == {0, 2}
    assert set(system.origin[:, 0].tolist()) == {1}


def network(campaign: Campaign, delta: float) -> tuple[ConstraintNetwork, np.ndarray]:
    truth = true_robot(campaign)
    assert truth is not None
    x = truth.parameters[0]
    net = leg_network(campaign, 1, leg_box(x + 0.3 * delta, delta), eps=(0.0, 0.01))
    return net, x


@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_it_takes_a_leg_from_100_mm_to_what_the_tolerances_say_and_keeps_the_truth(factor: float) -> None:
    campaign = simulate(seed=5, joint_error=0.0, noise=min(factor, 1.0), truncate=3.0, factor=factor)
    net, x = network(campaign, 100.0)
    left = Regression(net, objective="eps").contract(net.domain)
    assert (left.box.width[:7] < 0.65 * 200.0).all()
    assert np.append(x, 0.01) in left.box
    assert left.programs == 0


@pytest.mark.parametrize("reach", [9.0, 1000.0])
def test_tolerances_that_contradict_the_box_leave_nothing(reach: float) -> None:
    """By least squares x[0] is about 33.3, and x[1] about 5."""
    net = ConstraintNetwork()
    x = net.variable("x", 2, ((-reach, -reach), (reach, reach)))
    sides = np.array([60.0, 0.0, 70.0])
    net.add((np.array([1.0, 1.0, 1.0]) * x[0] + np.array([1.0, 2.0, 3.0]) * x[1] - sides).within((-0.1, 0.1)))
    result = Regression(net).contract(net.domain)
    assert result.steps[0].bound == pytest.approx(33.1, abs=1e-6)
    assert result.box.is_empty == (reach < 33.0)
