"""The Newton contractor: quadratic near a zero, refuting far from one, on square parts of any network."""

import time

from contractors import HC4, Newton
from cpcal.solver.contract import Repeat
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork, sqr


def circle_and_parabola() -> ConstraintNetwork:
    net = ConstraintNetwork()
    x, y = net.variable("x", (), (-3, 3)), net.variable("y", (), (-3, 3))
    net.add([sqr(x) + sqr(y) == 4, y == sqr(x) - 1])
    return net


def test_a_zero_in_one_call_where_hc4_is_stuck() -> None:
    """Two curves that cross at right angles, neither along an axis, at (1, 1)."""
    net = ConstraintNetwork()
    x, y = net.variable("x", (), (0.5, 1.5)), net.variable("y", (), (0.5, 1.5))
    net.add([10 * x + 10 * y + x * y == 21, 10 * x - 10 * y + sqr(x) - sqr(y) == 0])
    assert Repeat(HC4(net), 0.999).contract(net.domain).box.width.min() > 0.9
    box = Newton(net).contract(net.domain).box
    assert (1.0, 1.0) in box
    assert box.width.max() < 1e-14


def test_after_the_deadline_boxes_stay_as_they_are() -> None:
    net = circle_and_parabola()
    near = Box(net.names, [1.2, 1.2], [1.6, 1.4])
    assert Newton(net).contract(near, time.monotonic()).box == near
    assert Newton(net).contract(near).box.width.max() < 1e-12
