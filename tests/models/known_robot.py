"""One simulated robot for several folders: its joint error is at most ERROR at every pose, so what is assumed holds."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from cpcal.models import fit_model
from cpcal.models.leg_set import AskedSet, CertifiedSet, certified_set
from cpcal.robot import Campaign, Pose, Robot, forward_kinematics, inverse_kinematics
from cpcal.simulate import simulate
from cpcal.simulate.campaigns import assembled_with, mechanisms_of, true_robot

ERROR = 0.02  # mm: amplitude of the joint error, which is never exceeded


@dataclass(frozen=True)
class Known:
    """A campaign, the controller's robot (least squares), the true one, and the certified sets at ERROR."""

    campaign: Campaign
    controller: Robot
    truth: Robot
    sets: tuple[CertifiedSet, ...]


@pytest.fixture(scope="session")
def known() -> Known:
    campaign = simulate(
        seed=3, extremal=False, random_poses=14, noise=0.05, truncate=3.0, joint_error=ERROR, deviation=0.5
    )
    fitted = np.stack([fit_model(campaign, leg) for leg in range(1, 7)])
    sets = [
        certified_set(AskedSet(campaign, leg, ERROR, center=fitted[leg - 1], delta=8.0, controller=fitted[leg - 1]))
        for leg in range(1, 7)
    ]
    truth = true_robot(campaign)
    assert truth is not None
    assert all(one is not None for one in sets)
    return Known(campaign, Robot.from_parameters("fit", fitted), truth, tuple(s for s in sets if s is not None))


def reached_poses(campaign: Campaign, controller: Robot, poses: Pose) -> Pose:
    """Where the platform of a simulated campaign really is when the controller commands K poses."""
    robot, options = true_robot(campaign), json.loads(campaign.provenance["options"])
    assert robot is not None
    perfect = dict.fromkeys(("axis_offset", "backlash", "friction", "sag", "gain"), 0.0)
    mechanisms = mechanisms_of(perfect | options)
    readings = inverse_kinematics(controller, poses)
    return assembled_with(robot, mechanisms, readings, forward_kinematics(robot, readings, poses))
