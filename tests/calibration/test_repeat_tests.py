"""Drift and play between repeats are found; good studies are left alone."""

from __future__ import annotations

import pytest

from cpcal.calibration import as_campaign, describe, redefined, repeat_tests, repeatability
from cpcal.robot import Study, inverse
from cpcal.simulate import simulate_study
from cpcal.simulate.disturbances import with_drift, with_robot_scatter


def examined(study: Study):
    truth = study.truth
    robot = redefined(study.robot, inverse(truth.camera), truth.target)
    found = repeatability(as_campaign(study.calibration, robot))
    return repeat_tests(found, study.calibration.run, describe(found.spread))


def simulated(seed, **options):
    return simulate_study(seed=seed, random_poses=1, validation_runs=1, **options)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("scatter", [0.0, 0.1])
def test_good_studies_are_left_alone(seed, scatter):
    tests, channels = examined(with_robot_scatter(simulated(seed), scatter, seed=seed))
    assert not any(tests.found(kind) for kind in ("runs", "variances"))
    assert all(one.tests == tests.count for one in channels)
    if not scatter:
        assert not any("NOT NORMAL" in one.sentence() for one in channels)


def test_drift_of_a_sensor_is_seen_in_the_runs():
    tests, _ = examined(with_drift(simulated(1), 0.02, leg=3))
    assert tests.found("runs")[0].channel == "L3"
    assert tests.found("runs")[0].corrected < 1e-6
    assert any(sentence.startswith("RUNS DIFFER") for sentence in tests.sentences)


def test_play_that_some_loads_take_up_shows_in_leg_space():
    tests, _ = examined(simulated(1, backlash=0.4))
    assert len(tests.found("variances")) == 6
    assert not tests.found("runs")


def test_the_correction_makes_words_rarer():
    _, channels = examined(simulated(0))
    one = channels[0]
    assert one.tests > 30
    assert min(one.dagostino, one.shapiro) > 0.01 / one.tests
