"""Mixed-up campaigns are told apart from good ones, and the mix-up is named."""

import dataclasses

import numpy as np
import pytest

from cpcal.robot import Uncertainty
from cpcal.robot.mistakes import suspicions
from cpcal.simulate import simulate

GOOD = simulate(seed=1, joint_error=1.0, random_poses=20)
FEW = simulate(seed=1, joint_error=1.0, random_poses=12, extremal=False)


def changed(**changes):
    return dataclasses.replace(GOOD, **changes)


@pytest.mark.parametrize("seed", range(3))
def test_good_campaigns_raise_no_suspicion(seed):
    assert suspicions(simulate(seed=seed, joint_error=2.0, deviation=3.0)) == []


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


def test_degrees_for_radians_are_noticed():
    stated = Uncertainty([0.1] * 3, [0.5] * 3, [0.01] * 6)
    (sentence,) = suspicions(changed(uncertainty=stated, rotation_radius=np.full_like(GOOD.position, 0.5)))
    assert "degrees" in sentence


def test_a_few_odd_rows_are_named():
    length = GOOD.length.copy()
    length[[3, 7], 2] += 100.0
    (sentence,) = suspicions(changed(length=length))
    assert "2 of 84 measurements (e03/1, e07/1)" in sentence


def test_what_no_mix_up_explains_is_said_all_the_same():
    noise = np.random.default_rng(0).uniform(-300, 300, FEW.position.shape)
    (sentence,) = suspicions(dataclasses.replace(FEW, position=FEW.position + noise))
    assert "check the units" in sentence


@pytest.mark.parametrize("size", [pytest.param(1e12, marks=pytest.mark.nightly), 1e-300])
def test_absurd_sizes_raise_suspicion_and_nothing_else(size):
    same = {name: np.full_like(getattr(FEW, name), size) for name in ("position", "length")}
    assert suspicions(dataclasses.replace(FEW, **same))
