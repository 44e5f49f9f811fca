"""Whose scatter it is: the robot's own counts neither in standard errors nor in sets; drift and play are found."""

import numpy as np
import pytest

from cpcal.calibration import as_campaign, redefined, repeat_tests, repeatability
from cpcal.questions import calibrate_study
from cpcal.robot import Study, inverse
from cpcal.simulate import simulate_study
from tests.changed import with_drift, with_robot_scatter


def found_of(study: Study):
    truth = study.truth
    robot = redefined(study.robot, inverse(truth.camera), truth.target)
    return repeatability(as_campaign(study.calibration, robot))


@pytest.fixture(scope="module")
def perfect():
    return simulate_study(seed=3, random_poses=4, validation_runs=2)


def test_a_robot_that_comes_back_has_no_scatter_of_its_own(perfect):
    found = found_of(perfect)
    assert found.told
    assert not found.robot_sigma.any()
    assert np.allclose(found.noise_sigma, found.spread.sigma)
    assert "comes back" in found.sentence


def test_scatter_of_the_robot_is_told_from_noise(perfect):
    quiet, found = found_of(perfect), found_of(with_robot_scatter(perfect, 0.1, seed=5))
    assert found.robot_sigma == pytest.approx(np.full(6, 0.1), rel=0.1)
    assert found.spread.sigma[0] > 5 * quiet.spread.sigma[0]
    assert np.sqrt(np.mean((found.noise_sigma / quiet.noise_sigma - 1.0) ** 2)) < 0.25
    assert found.equation_sigma == pytest.approx(quiet.equation_sigma, rel=0.02)  # in leg space nothing has changed
    assert "ROBOT ITSELF SCATTERS by 0.096" in found.sentence


def test_standard_errors_and_sets_do_not_grow_with_the_robots_scatter(perfect):
    quiet, restless = (calibrate_study(s) for s in (perfect, with_robot_scatter(perfect, 0.1, seed=5)))
    ratio = restless.x_c_sigma.standard_errors / quiet.x_c_sigma.standard_errors
    assert 0.8 < ratio.min() < ratio.max() < 1.2
    assert (restless.campaign.length_radius < 1.25 * quiet.campaign.length_radius).all()
    assert "as expected" in restless.x_c_sigma.sentence


def examined(study: Study):
    found = found_of(study)
    return repeat_tests(found, study.calibration.run)


def simulated(seed, **options):
    return simulate_study(seed=seed, random_poses=1, validation_runs=1, **options)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("scatter", [0.0, 0.1])
def test_good_studies_are_left_alone(seed, scatter):
    tests = examined(with_robot_scatter(simulated(seed), scatter, seed=seed))
    assert [says_no for says_no, _ in tests] == [False, False]
    assert "corrected for 24 tests" in tests[0][1]  # 12 readings and 6 equations by runs, 6 equations by configurations


def test_drift_of_a_sensor_is_seen_in_the_runs():
    tests = examined(with_drift(simulated(1), 0.02, leg=3))
    assert tests[0][0]
    assert tests[0][1].startswith("RUNS DIFFER: drift, or something changed between them? L3")


def test_play_that_some_loads_take_up_shows_in_leg_space():
    runs, variances = examined(simulated(1, backlash=0.4))
    assert not runs[0]
    assert variances[0]
    assert all(f"g of leg {leg}" in variances[1] for leg in range(1, 7))
