"""Measurements that do not determine the parameters are found out, however well the equations are solved."""

import numpy as np
import pytest

import cpcal
from cpcal.models import PLAIN
from cpcal.questions import verdict_of
from cpcal.questions.data_check import determination
from cpcal.robot.campaign import ARRAYS

whole = cpcal.simulate(seed=1, joint_error=0.0, runs=40)


def part(rows):
    rows = np.asarray(rows)
    radii = {name: getattr(whole, name)[rows] for name in ARRAYS[3:]}
    return cpcal.Campaign.of(whole.robot, *(getattr(whole, name)[rows] for name in ARRAYS[:3]), **radii)


def of(rows):
    campaign = part(rows)
    return determination(campaign, 1, campaign.robot.parameters[0], PLAIN)


names = whole.measurement_ids
first = [k for k, name in enumerate(names) if name.startswith(names[0].split("/")[0])]


@pytest.mark.parametrize("rows", [[0], [0] * 40, first])
def test_one_pose_read_any_number_of_times_determines_next_to_nothing(rows):
    found = of(rows)
    assert found.rank <= 2
    assert not found.tests_the_model
    assert "l" in found.undetermined


def test_identical_measurements_are_no_pass():
    result = cpcal.certify(part([0] * 40), legs=[1], tolerance=400.0, support="none")
    assert verdict_of(result, result.legs[0]).kind == "undetermined"


def test_poses_of_full_rank_that_leave_wide_ranges_are_no_pass():
    """They are not shown to determine l: at the smallest error it may lie in more than half of the box."""
    campaign = cpcal.simulate(seed=1, joint_error=0.0, extremal=False, random_poses=16)
    result = cpcal.certify(campaign, legs=[1], tolerance=400.0, support="none")
    leg = result.legs[0]
    assert leg.determination.tests_the_model
    assert leg.bracket.enclosure["l"].width > 100.0
    verdict = verdict_of(result, leg)
    assert verdict.kind == "undetermined"
    assert "l" in verdict.names
    assert "l (" in verdict.sentence
