"""The whole classical way on simulated studies: what was put in comes out."""

from __future__ import annotations

import numpy as np
import pytest

from cpcal.calibration import StudyCalibration, calibrate_study
from cpcal.robot import Robot, Study, inverse, transformed
from cpcal.simulate import simulate_study


def truth_in_camera_and_target(study: Study) -> Robot:
    """The true joint centres where the calibration has them."""
    truth = study.truth
    assert truth is not None
    base = transformed(truth.camera, truth.robot.base)
    return Robot("", base, transformed(inverse(truth.target), truth.robot.mobile), truth.robot.offset)


@pytest.fixture(scope="module")
def study() -> Study:
    return simulate_study(seed=3, runs=4, validation_runs=3, random_poses=12)


@pytest.fixture(scope="module")
def found(study: Study) -> StudyCalibration:
    return calibrate_study(study)


def test_the_true_parameters_are_found(study: Study, found: StudyCalibration) -> None:
    truth = truth_in_camera_and_target(study).parameters
    for fit in (found.x_c, found.x_c_sigma):
        lower, upper = fit.interval(0.9999)
        assert np.mean((lower <= truth) & (truth <= upper)) > 0.9
        assert np.abs(fit.parameters - truth).max() < 0.5


def test_poses_improve(found: StudyCalibration) -> None:
    for validation in (found.validation, found.validation_sigma):
        assert not validation.failed
        assert validation.summary_after.position_mean < 0.2 * validation.summary_before.position_mean
        assert validation.summary_after.orientation_mean < 0.2 * validation.summary_before.orientation_mean


def test_statistics_are_those_of_the_simulated_sensors(found: StudyCalibration) -> None:
    sigma = {channel.name: channel.sigma for channel in found.statistics}
    assert sigma["L1"] == pytest.approx(0.0077, rel=0.25)  # table 2
    assert sigma["L6"] == pytest.approx(0.0190, rel=0.25)
    assert sigma["x"] == pytest.approx(0.0633 / np.sqrt(10), rel=0.25)  # table 3; a row is the mean of ten images
    assert all(channel.dip > 1e-4 for channel in found.statistics)


def test_the_campaign_is_one_row_a_configuration(study: Study, found: StudyCalibration) -> None:
    assert len(found.campaign) == 64
    assert len(found.check) == 12
    assert found.campaign.length_radius[0, 5] == pytest.approx(3 * found.statistics[11].sigma, rel=1e-6)


def test_both_methods_of_frames_agree(study: Study, found: StudyCalibration) -> None:
    other = calibrate_study(study, method="andreff")
    assert np.abs(other.x_c.parameters - found.x_c.parameters).max() < 1e-2


def test_imperfect_legs_leave_residuals_that_noise_does_not_explain() -> None:
    study = simulate_study(seed=3, runs=4, validation_runs=3, random_poses=12, sag=3.0)
    found = calibrate_study(study)
    assert "as expected" not in found.x_c.sentence
