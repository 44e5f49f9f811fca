"""What to do next: the cause that was put in is the one that is named."""

import dataclasses

import numpy as np
import pytest

import cpcal
from cpcal.models import PLAIN
from cpcal.report.words import advise, fitted, short_fit
from cpcal.robot import Campaign

CAMPAIGN = cpcal.simulate(seed=7, joint_error=0.0, factor=0.0, noise=0.2)


def advised(campaign, **asked):
    result = cpcal.certify(campaign, legs=[2], **asked)
    leg = result.legs[0]
    found = advise(campaign, result, leg, PLAIN, fitted(campaign, result, leg, PLAIN))
    return found, cpcal.verdict_of(result, leg)


def test_a_leg_within_the_tolerance_is_accepted():
    found, verdict = advised(CAMPAIGN, tolerance=3.0)
    assert found.short == "accept"
    assert short_fit(verdict).startswith("pass, fits to within ")


@pytest.mark.parametrize("row", [5, 40])
def test_a_wrong_reading_is_to_be_measured_again(row):
    length = CAMPAIGN.length.copy()
    length[row, 1] += 4.0
    found, _ = advised(dataclasses.replace(CAMPAIGN, length=length), tolerance=0.5)
    assert found.short == f"re-measure {row + 1}"
    assert found.first[0] == row
    assert f"Re-measure {row + 1} ({CAMPAIGN.measurement_ids[row]}): without it" in found.sentence


def test_a_wrong_scale_of_the_sensor_calls_for_the_model_gain():
    found, _ = advised(dataclasses.replace(CAMPAIGN, length=1.02 * CAMPAIGN.length), tolerance=0.1)
    assert found.short == "model “gain”"
    assert "“gain”" in found.sentence


def test_poses_are_asked_for_where_parameters_are_open():
    few = [0] * 9
    same = Campaign.of(
        CAMPAIGN.robot, CAMPAIGN.position[few], CAMPAIGN.quaternion[few], CAMPAIGN.length[few], exact=True
    )
    found, verdict = advised(same, tolerance=1.0)
    assert found.short == "add poses"
    assert "Add poses that show" in found.sentence
    assert verdict.names


def test_without_a_tolerance_one_is_asked_for():
    found, _ = advised(CAMPAIGN)
    assert found.short == "state a tolerance"


def test_the_first_to_look_at_are_those_with_the_largest_residuals_of_the_support():
    result = cpcal.certify(CAMPAIGN, legs=[2], tolerance=0.01)
    leg = result.legs[0]
    fit = fitted(CAMPAIGN, result, leg, PLAIN)
    first = advise(CAMPAIGN, result, leg, PLAIN, fit).first
    ids, sizes = CAMPAIGN.measurement_ids, np.abs(fit.residuals)
    assert {ids[k] for k in first} <= set(leg.support.ids)
    assert min(sizes[list(first)]) >= max(
        sizes[ids.index(name)] for name in leg.support.ids if ids.index(name) not in first
    )
