"""Steps by linear programs end in a vertex where there is one, and say so where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local import linear_steps


def lens() -> ConstraintNetwork:
    """Two discs of radius 1 with centres at (-0.5, 0) and (0.5, 0): they meet in (0, +-sqrt(3) / 2)."""
    net = ConstraintNetwork()
    x = net.variable("x", 2, ((-2.0, -2.0), (2.0, 2.0)))
    net.add([(x[0] + 0.5) ** 2 + x[1] ** 2 <= 1.0, (x[0] - 0.5) ** 2 + x[1] ** 2 <= 1.0])
    return net


def steps(cost: list[float], start: list[float], margin: float = 0.0):  # type: ignore[no-untyped-def]
    net = lens()
    given = np.array(cost), net.domain, np.array(start)
    return linear_steps(Rows(net), *given, scale=np.ones(2), margin=margin)


@pytest.mark.parametrize("start", [[0.0, 0.0], [0.3, 0.1], [-1.5, -1.8]])  # inside, and outside of both
def test_they_end_in_a_vertex_from_inside_and_from_outside(start: list[float]) -> None:
    np.testing.assert_allclose(steps([0.1, 1.0], start), [0.0, -np.sqrt(0.75)], atol=1e-9)


def test_a_margin_leaves_room_in_every_row() -> None:
    found = steps([0.0, 1.0], [0.0, 0.0], margin=1e-6)
    values = Rows(lens()).linearize(found).values
    assert (values < -1e-7).all()
    assert (values > -1e-4).all()


def test_an_optimum_that_is_no_vertex_has_no_answer() -> None:
    assert steps([1.0, 0.0], [0.0, 0.1]) is None  # (-0.5, 0), on one of the circles
