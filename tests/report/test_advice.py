"""What to do next: the cause that was put in is the one that is named."""

import dataclasses

import pytest

import cpcal
from cpcal.models import PLAIN
from cpcal.report.section import html
from cpcal.report.words import advise, leg_lines
from cpcal.robot import Campaign

CAMPAIGN = cpcal.simulate(seed=7, joint_error=0.0, factor=0.0, noise=0.2)


def advised(campaign, **asked):
    result = cpcal.certify(campaign, legs=[2], **asked)
    leg = result.legs[0]
    found = advise(campaign, result, leg, PLAIN)
    return found, cpcal.verdict_of(result, leg)


def test_nothing_is_said_of_a_leg_that_passes():
    found, verdict = advised(CAMPAIGN, tolerance=3.0)
    assert verdict.passes
    assert (found.short, found.wrong) == ("", ())


def test_the_readings_and_not_the_leg_are_blamed_where_no_error_of_it_is_proved():
    good = cpcal.simulate(seed=1, joint_error=0.0)  # each reading may be off by three deviations
    result = cpcal.certify(good, legs=[2], tolerance=0.1)
    (leg,) = result.legs
    found = advise(good, result, leg, PLAIN)
    assert cpcal.verdict_of(result, leg).kind == "undecided"
    assert leg.bracket.lo == 0.0
    assert found.short == "because the readings are too uncertain: measure them more precisely"
    assert "sensors" not in html(leg_lines(result, leg, found))


@pytest.mark.parametrize("rows", [(5,), (40,), (5, 40)])
def test_wrong_readings_are_the_ones_that_are_named(rows):
    length = CAMPAIGN.length.copy()
    length[list(rows), 1] += 4.0
    found, _ = advised(dataclasses.replace(CAMPAIGN, length=length), tolerance=0.5)
    assert sorted(found.wrong) == list(rows)
    assert found.short.startswith(f"because of measurement{'s' * (len(rows) > 1)} {found.wrong[0] + 1}")
    assert found.short.endswith(f": measure {'it' if len(rows) == 1 else 'them'} again")


def test_a_wrong_scale_of_the_sensor_calls_for_the_model_gain():
    found, _ = advised(dataclasses.replace(CAMPAIGN, length=1.02 * CAMPAIGN.length), tolerance=0.1)
    assert found.short == "because of the leg model: use --model gain"
    assert found.wrong == ()


def test_poses_are_asked_for_where_parameters_are_open():
    few = [0] * 9
    same = Campaign.of(
        CAMPAIGN.robot, CAMPAIGN.position[few], CAMPAIGN.quaternion[few], CAMPAIGN.length[few], exact=True
    )
    found, verdict = advised(same, tolerance=1.0)
    assert found.short.endswith("add poses")
    assert "Add poses that show" in found.more
    assert verdict.names
