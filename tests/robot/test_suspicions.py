"""Campaigns that fit neither drawing nor stated deviations are told from good ones, and the mistake is named."""

import dataclasses

import numpy as np
import pytest

from benchmarks.studies import clean_campaign
from benchmarks.wrong_ways import WRONG_WAYS
from cpcal.robot import ROBOTS
from cpcal.robot.campaign import Given
from cpcal.robot.mistakes import likely_causes, suspicions
from cpcal.simulate import simulate

GOOD = simulate(seed=1, joint_error=1.0, random_poses=20)
FEW = simulate(seed=1, joint_error=1.0, random_poses=12, extremal=False)


def changed(**changes):
    return dataclasses.replace(GOOD, **changes)


@pytest.mark.parametrize("seed", [*range(5), *(pytest.param(k, marks=pytest.mark.nightly) for k in range(5, 60))])
def test_good_campaigns_raise_no_suspicion(seed):
    assert suspicions(clean_campaign(seed)) == ()


@pytest.mark.parametrize(
    ("campaign", "cause"),  # every other cause: tests/questions/test_data_check.py
    [
        (changed(position=GOOD.position / 25.4), "positions are in inches"),
        (changed(length=np.roll(GOOD.length, 2, axis=1)), "another order than the legs"),
        (changed(position=GOOD.position * [1, 1, -1]), "to be (x, y, -z)"),
    ],
)
def test_the_cause_is_named(campaign, cause):
    (sentence,) = suspicions(campaign)
    assert "likely cause: " in sentence
    assert cause in sentence


@pytest.mark.parametrize(
    ("name", "seed", "deviation", "way"),
    [
        ("rubin-camera", 2, 0.1, "radians for degrees"),  # seven forms of angles, one mistake
        ("planar-3rpr", 1, 1.0, "degrees for radians"),  # one angle that varies
        ("cogiro", 1, 1.0, "target shifted"),  # by 0.8 % of a leg
        pytest.param("cogiro", 1, 1.0, "metres and scalar last", marks=pytest.mark.nightly),
    ],
)
def test_mistakes_are_named_on_robots_of_other_sizes(name, seed, deviation, way):
    known = ROBOTS[name]
    where = {"stroke": known.stroke} if known.workspace is None else {"workspace": known.workspace}
    campaign = simulate(known.robot, seed=seed, random_poses=20, deviation=deviation, **where)
    assert suspicions(campaign) == ()
    make, expected = WRONG_WAYS[way]
    assert expected in suspicions(make(campaign))[0]


def test_no_cause_is_named_where_nothing_is_wrong_but_the_model():
    assert likely_causes(Given.of(simulate(seed=4, joint_error=5.0))) == []


@pytest.mark.parametrize("times", [0.01, 0.5, 2.0, 10.0])
def test_uncertainties_are_in_question_from_three_times_too_large_or_twenty_times_too_small(times):
    perfect = simulate(seed=2, random_poses=20)
    stated = dataclasses.replace(perfect.uncertainty, factor=3.0 / times)  # the same half-widths
    said = suspicions(dataclasses.replace(perfect, uncertainty=stated))
    words = {0.01: "times what you state: a convention, a frame or the model", 10.0: "times what the residuals show"}
    assert [words[times] in sentence for sentence in said] == [True] * (times in words)


@pytest.mark.parametrize("size", [pytest.param(1e12, marks=pytest.mark.nightly), 1e-300])
def test_absurd_sizes_raise_suspicion_and_nothing_else(size):
    same = {name: np.full_like(getattr(FEW, name), size) for name in ("position", "length")}
    assert suspicions(dataclasses.replace(FEW, **same))
