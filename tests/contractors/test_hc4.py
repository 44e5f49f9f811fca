"""hc4: batches are what their boxes are alone; constants lose no emptiness."""

import numpy as np
import pytest

import cpcal
from contractors import HC4
from cpcal.models import fit_model, leg_box, leg_network
from cpcal.solver.interval import Box, IntervalArray


@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_a_batch_is_its_boxes_one_by_one(factor: float) -> None:
    campaign = cpcal.simulate(seed=3, joint_error=1.0, factor=factor, runs=3)
    fit = fit_model(campaign, 2)
    net = leg_network(campaign, 2, leg_box(fit, 50.0), eps=(0.0, 2.0))
    hc4 = HC4(net)
    rng = np.random.default_rng(0)
    half = 10.0 ** rng.uniform(-2.0, 1.5, (25, 1))
    middle = fit + rng.uniform(-5.0, 5.0, (25, 7))
    lo, hi = np.hstack([middle - half, np.zeros((25, 1))]), np.hstack([middle + half, np.full((25, 1), 2.0)])
    together = hc4.contract_batch(IntervalArray(lo, hi))
    emptied = 0
    for k in range(25):
        alone = hc4.contract(Box(net.names, lo[k], hi[k])).box
        if alone.is_empty:
            emptied += 1
            assert np.isnan(together.lo[k]).any()
        else:
            assert np.array_equal(alone.lo, together.lo[k])
            assert np.array_equal(alone.hi, together.hi[k])
    assert 0 < emptied < 25


@pytest.mark.parametrize("expression", ["3 * x", "x + 3", "3 - x", "x - 3", "x / 3", "3 / x"])
def test_what_a_constant_forbids_is_found_at_the_other_argument(expression: str) -> None:
    net = cpcal.Network()
    x = net.variable("x", domain=(1.0, 2.0))
    value = eval(expression, {"x": x})
    inside, outside = eval(expression, {"x": 1.5}), eval(expression, {"x": 2.5})
    net.add(value.within((inside, inside)))
    assert HC4(net).contract(net.domain).box["x"].width < 1e-12
    net.add(value.within((outside, outside)))
    assert HC4(net).contract(net.domain).box.is_empty


def test_a_constraint_of_constants_alone_can_fail() -> None:
    net = cpcal.Network()
    x = net.variable("x", domain=(1.0, 2.0))
    one = net.constant(np.array([1.0, 1.0]))
    net.add((one + 1.0 + 0.0 * x).within((3.0, 4.0)))
    assert HC4(net).contract(net.domain).box.is_empty
