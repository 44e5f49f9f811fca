"""Boxes proved to hold nothing but solutions hold nothing else, for some readings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.solver.existence import Inside
from cpcal.solver.existence.unique import ReadingConstraint
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, norm, sqr, sqrt


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_every_point_of_a_proved_box_is_a_solution(seed: int) -> None:
    """Distances to beacons, read with an error: a point solves when each |distance - centre| <= eps + radius."""
    rng = np.random.default_rng(seed)
    beacons, radius = rng.uniform(-5, 5, (4, 2)), float(rng.choice([0.0, 0.5]))
    truth = rng.uniform(-1, 1, 2)
    read = np.linalg.norm(beacons - truth, axis=1) + rng.uniform(-0.3, 0.3, 4)
    net = ConstraintNetwork()
    p = net.variable("p", 2, (-2, 2))
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


def test_what_is_not_proved() -> None:
    net = ConstraintNetwork()
    x = net.variable("x", 2, (-2, 2))
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
    box = Box(net.names, [0.25], [0.375])
    assert Inside(net)(box) is not shared


def test_no_value_between_those_of_a_jump_is_taken() -> None:
    net = ConstraintNetwork()
    x, r = net.variable("x", (), (-2, 2)), net.reading(0.0, 0.5)
    net.add(np.arctan2(r, x - 2.0) / 4.0 + x == 1.0)  # up to -0.66, and from 0.66 on, beside x = 1
    at = np.ones(1)
    constraint, box = ReadingConstraint(net, net.constraints[0]), IntervalArray.point(at[None])
    assert not constraint.for_all(box).any()
    assert not (constraint.excesses(box, at) <= 0.0).any()
