"""Pose errors before and after calibration, and whose scatter it is: the robot's own, drift and play are found."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.calibration import Validation, as_campaign, pose_errors, redefined, repeat_tests, repeatability, validate
from cpcal.common.errors import InputError
from cpcal.questions import calibrate_study
from cpcal.robot import DELTALAB, Campaign, Study, inverse, quaternion_from_rotation_vector, quaternion_product
from cpcal.simulate import simulate, simulate_study, true_robot
from tests.changed import with_drift, with_robot_scatter


@pytest.fixture(scope="module")
def poses():
    """Validation poses of the same true robot that simulate(seed=21) has."""
    return simulate(seed=21, extremal=False, random_poses=64, noise=0.0)


def test_the_true_parameters_have_no_error_and_the_nominal_ones_have(poses):
    found = validate(poses, true_robot(poses).parameters)
    assert_allclose(found.position[1], 0.0, atol=1e-9)
    assert_allclose(found.orientation[1], 0.0, atol=1e-11)
    assert found.figures("position")["mean"][0] > 0.5
    assert found.failed == ()


def test_errors_are_those_that_were_put_in(poses):
    """Move and turn the measured poses by known amounts: that is what the true parameters are off by."""
    rng = np.random.default_rng(0)
    move, turn = rng.normal(0, 1, (64, 3)), rng.normal(0, 0.01, (64, 3))
    turned = quaternion_product(quaternion_from_rotation_vector(turn), poses.quaternion)
    moved = Campaign.of(DELTALAB, poses.position + move, turned, poses.length, exact=True)
    apart, angle = pose_errors(moved, true_robot(poses).parameters)
    assert_allclose(apart, np.linalg.norm(move, axis=1), rtol=1e-9)
    assert_allclose(angle, np.linalg.norm(turn, axis=1), rtol=1e-9)
    _, flipped = pose_errors(replace(moved, quaternion=-moved.quaternion), true_robot(poses).parameters)
    assert_allclose(flipped, angle, rtol=1e-9)


def test_summaries_are_of_the_poses_that_both_converged_for():
    before, after = (1.0, 2.0, float("nan"), 0.0, 0.0), (0.5, 3.0, 1.0, 0.0, 1.0)
    turns = (0.1, 0.1, 0.1, 0.0, 0.0), (0.1, 0.0, 0.1, 0.0, 0.0)
    found = Validation(("a", "b", "c", "d", "e"), (before, after), turns)
    assert found.failed == ("c",)
    assert "4 of 5" in found.sentence
    assert "2 in position, 0 in orientation" in found.sentence
    assert "NOT CONVERGE for c" in found.sentence
    figures = found.figures("position")
    assert figures["mean"].tolist() == [0.75, 1.125]
    assert figures["largest"][1] == 3.0
    assert figures["std. dev."][1] == pytest.approx(np.std([0.5, 3.0, 0.0, 1.0], ddof=1))
    assert figures["rms"][1] == pytest.approx(np.sqrt((0.25 + 9.0 + 1.0) / 4))
    lost = ((float("nan"),),) * 2
    nothing = Validation(("a",), lost, lost)
    assert "None of 1 poses could be compared" in nothing.sentence
    assert np.isnan(nothing.figures("position")["mean"]).all()


def test_poses_that_cannot_be_reached_are_named():
    poses = simulate(seed=21, extremal=False, random_poses=8, noise=0.0)
    length = poses.length.copy()
    length[[2, 7], 0] += 400.0
    found = validate(replace(poses, length=length), true_robot(poses).parameters)
    assert found.failed == ("r002/1", "r007/1")


def test_bad_input_is_refused(poses):
    with pytest.raises(InputError, match=r"\(6, 7\)"):
        validate(poses, np.zeros((5, 7)))
    with pytest.raises(InputError, match="finite"):
        validate(poses, np.full((6, 7), np.nan))


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
