"""lifted: its matrices against exact fractions, and what it must do that hc4 cannot."""

from fractions import Fraction
from itertools import combinations_with_replacement

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import Lifted
from contractors.relaxation import CentredRows, Shift, column_bounds, product_rows
from cpcal.solver.interval import IntervalArray
from cpcal.solver.network import ConstraintNetwork, norm, sqrt
from cpcal.solver.network.polynomial import Monomial

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
    matrix, widening = CentredRows(Shift(monomials, 3), each).on(center, radius)
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
    rows = product_rows(monomials, np.ones(len(monomials) - 1, dtype=bool))
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
    net = ConstraintNetwork()
    x = net.variable("x", 2, ([-5.0, -5.0], [5.0, 5.0]))
    net.add((norm(net.reading(anchors, 0.1) - x) - 2.5).within((-0.1, 0.1)))
    boxes = [net.domain, net.domain.replace("x[0]", lo=1.0), net.domain.replace("x[0]", hi=2.0), net.domain]
    reused = Lifted(net)
    for box in boxes:
        one, other = reused.contract(box).box, Lifted(net).contract(box).box
        np.testing.assert_array_equal(one.lo, other.lo)
        np.testing.assert_array_equal(one.hi, other.hi)
