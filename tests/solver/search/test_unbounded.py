"""Halving reaches a finite size in few steps, also from an unbounded domain; and reaches the objective at last."""

from __future__ import annotations

import numpy as np
import pytest

import cpcal
from cpcal.solver.interval import Box
from cpcal.solver.search import bisect


@pytest.mark.parametrize(("lo", "hi"), [(0.0, np.inf), (-np.inf, 3.0), (-np.inf, np.inf), (1e3, np.inf)])
def test_unbounded_components_are_cut_near_zero(lo: float, hi: float) -> None:
    left, right = bisect(Box(("x",), [lo], [hi]), 0)
    assert left.hi[0] == right.lo[0]
    assert abs(left.hi[0]) <= max(1.0, 2.0 * min(abs(lo), abs(hi)))


def test_where_only_the_objective_is_left_it_is_halved() -> None:
    net = cpcal.Network()
    x = net.variable("x", domain=(0.0, 10.0))
    net.add(x * x >= 2.0)
    found = net.minimize(x)
    assert found.verdict is cpcal.Verdict.PROVED
    assert found.lo <= np.sqrt(2.0) <= found.hi
    assert found.hi - found.lo <= 1e-6 * found.hi
