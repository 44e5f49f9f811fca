"""The catalogue of robots: every one has a source, and can be simulated."""

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.robot import PoseRange, known_robot
from cpcal.simulate import simulate


def campaign_of(name, **options):
    known = known_robot(name)
    where = {"stroke": known.stroke} if known.workspace is None else {"workspace": known.workspace}
    return simulate(known.robot, **where, **options)


def test_what_a_planar_robot_cannot_do_is_fixed_and_exact():
    campaign = campaign_of("planar-3rpr", seed=2, random_poses=30)
    assert len(campaign) == 38
    assert not campaign.position[:, 2].any()
    assert not campaign.quaternion[:, 1:3].any()
    assert np.array_equal(campaign.position_radius[0] > 0, [True, True, False])
    assert np.array_equal(campaign.rotation_radius[0] > 0, [False, False, True])


@pytest.mark.parametrize(("low", "turn"), [([2, 0, 0], [0, 0, 0]), ([0, 0, 0], [-1, 0, 0]), ([0, 0], [0, 0, 0])])
def test_an_empty_workspace_is_refused(low, turn):
    with pytest.raises(InputError, match="no box of poses"):
        PoseRange(low, [1, 1, 1], turn)
