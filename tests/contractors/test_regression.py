"""regression: what the equations' tolerances alone say of each variable, and when they say nothing."""

import numpy as np
import pytest

from contractors import Regression
from cpcal.models import leg_box, leg_network
from cpcal.robot import Campaign
from cpcal.simulate import simulate, true_robot
from cpcal.solver.network import ConstraintNetwork


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
