"""The uncertainty budget: what repeats cannot show is propagated, and simulated studies agree with it."""

from __future__ import annotations

import math

import pytest

from cpcal import InputError
from cpcal.calibration import calibrate_study
from cpcal.calibration.budget import Inputs, budget, monte_carlo
from cpcal.simulate import simulate_study


@pytest.fixture(scope="module")
def found():
    return calibrate_study(simulate_study(seed=1, runs=4, validation_runs=1, random_poses=4))


def test_a_scale_of_the_camera_scales_the_joint_centres(found):
    made = budget(found, Inputs(camera_scale=1e-4))
    camera = next(one for one in made.contributions if one.source == "camera_scale")
    assert camera.largest == pytest.approx(1e-4 * 270.0, rel=0.2)  # the joints are 270 mm from their centroid
    assert made.largest**2 <= made.contributions[0].largest ** 2 + camera.largest**2 + 1e-12
    assert "Not in it, as nothing was stated: target_scale, lens, sensor_scale, temperature" in made.sentence
    assert "single camera" in made.sentence


def test_simulated_studies_agree_with_the_budget(found):
    inputs = Inputs(lens=0.01)
    made, simulated = budget(found, inputs), monte_carlo(found, inputs, trials=20)
    # 20 studies tell an interval to some 20 %, and their 2.5 % quantiles lie inside
    assert 0.5 < simulated.rms / (2.0 * made.rms) < 1.3
    assert "GUM Supplement 1, 20 studies" in simulated.sentence


@pytest.mark.parametrize("values", [{"humidity": 1.0}, {"lens": -1.0}, {"lens": math.nan}])
def test_senseless_inputs_are_refused(values):
    with pytest.raises(InputError, match="budget"):
        Inputs.of(values)


def test_few_trials_are_refused(found):
    with pytest.raises(InputError, match="trials"):
        monte_carlo(found, Inputs(), trials=3)
