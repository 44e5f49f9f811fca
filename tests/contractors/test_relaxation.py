"""The rows that carry the proofs hold at every solution of the box, exactly."""

from __future__ import annotations

from fractions import Fraction
from math import prod

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors.relaxation import Relaxation, Structure
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, polynomial_form, sqrt
from cpcal.solver.network.monotone import DecisiveReadings
from cpcal.solver.sample_networks import Case, cases


def rows_hold(net: ConstraintNetwork, box: Box, point: list[float], engine: str = "float64") -> list[bool]:
    """For every row of the linear programs, in exact arithmetic, whether the point's monomials satisfy it."""
    arithmetic = get_arithmetic(engine)
    system = polynomial_form(net, arithmetic, DecisiveReadings(net, arithmetic).on(box))
    relaxation = Relaxation(Structure(system), arithmetic, box)
    scaled = zip(point, relaxation.center, relaxation.radius, strict=True)
    u = [(Fraction(x) - Fraction(c)) / Fraction(r) if r else Fraction(0) for x, c, r in scaled]
    monomials = [system.monomials[1 + k] for k in relaxation.columns]
    w = [prod((u[i] for i in m), start=Fraction(1)) for m in monomials]
    rows = zip(relaxation.matrix.tolist(), relaxation.rhs.tolist(), strict=True)
    return [sum((Fraction(a) * v for a, v in zip(row, w, strict=True) if a), Fraction(0)) <= side for row, side in rows]


CASES = [case for case in cases(5) if case.network.domain.is_bounded]


@pytest.mark.parametrize("engine", ["float64", "arb"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
@settings(max_examples=5, deadline=None)
@given(data=st.data())
def test_rows_hold_at_solutions(case: Case, engine: str, data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    point = case.solutions[rng.integers(len(case.solutions))]
    domain = case.network.domain
    size = 10.0 ** rng.uniform(-6, 2) * rng.random((2, len(point))) * rng.integers(0, 2, (2, len(point)))
    lo, hi = np.maximum(domain.lo, point - size[0]), np.minimum(domain.hi, point + size[1])
    for box in (domain, domain.with_bounds(lo, hi)):
        assert all(rows_hold(case.network, box, point.tolist(), engine))


@pytest.mark.parametrize("engine", ["float64", "arb"])
def test_a_guard_that_may_fail_is_paid_for(engine: str) -> None:
    """sqrt(x) >= y holds for every y < 0, where y^2 <= x does not; where y > 0 on the box nothing is paid."""
    net = ConstraintNetwork()
    x, y = net.variable("x", (), (0, 1)), net.variable("y", (), (-3, 1))
    net.add(sqrt(x) >= y)
    assert all(rows_hold(net, net.domain, [0.25, -3.0], engine))
    inside = net.domain.replace("y", lo=0.125)
    assert all(rows_hold(net, inside, [0.25, 0.5], engine))
    assert rows_hold(net, inside, [0.25, 0.5009], engine).count(False) == 1
