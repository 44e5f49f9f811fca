"""The whole classical way on simulated studies: what was put in comes out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cpcal.calibration import StudyCalibration, calibrate_study
from cpcal.calibration.study_calibration import study_rows
from cpcal.robot import PoseTable, Robot, Study, inverse, transformed
from cpcal.simulate import simulate_study
from cpcal.simulate.disturbances import with_outliers


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


def test_the_campaign_is_one_row_a_configuration(study: Study, found: StudyCalibration) -> None:
    assert len(found.campaign) == 64
    assert len(found.check) == 12
    assert found.campaign.length_radius[0, 5] == pytest.approx(3 * found.statistics[11].sigma / 2, rel=1e-6)
    single = calibrate_study(study, of="single").campaign
    assert single.length_radius[0, 5] == pytest.approx(3 * found.statistics[11].sigma, rel=1e-6)


def test_both_methods_of_frames_agree(study: Study, found: StudyCalibration) -> None:
    other = calibrate_study(study, method="andreff")
    assert np.abs(other.x_c.parameters - found.x_c.parameters).max() < 1e-2


def test_imperfect_legs_leave_residuals_that_noise_does_not_explain() -> None:
    study = simulate_study(seed=3, runs=4, validation_runs=3, random_poses=12, sag=3.0)
    found = calibrate_study(study)
    assert "as expected" not in found.x_c.sentence


def test_one_gross_error_leaves_statistics_and_validation_alone(study: Study, found: StudyCalibration) -> None:
    def spoiled(table: PoseTable) -> PoseTable:
        position = table.position.copy()
        position[5] += 100.0
        return replace(table, position=position)

    wrong = calibrate_study(
        replace(study, calibration=spoiled(study.calibration), validation=spoiled(study.validation))
    )
    assert wrong.screening.left_out == ("e01/2",)
    assert wrong.check_screening is not None
    assert wrong.check_screening.left_out == ("r001/3",)
    assert wrong.statistics[0].sigma == pytest.approx(found.statistics[0].sigma, rel=0.05)
    assert wrong.statistics_all[0].sigma > 3.0  # both figures are there
    assert wrong.validation.summary_after.position_mean < 1.2 * found.validation.summary_after.position_mean
    assert wrong.validation_all is not None
    assert wrong.validation_all.summary_after.position_mean > 1.0


def test_validation_knows_the_noise_of_its_own_readings(found: StudyCalibration) -> None:
    floor, after = found.validation_sigma.floor, found.validation_sigma.summary_after
    assert floor is not None
    assert 0.8 * floor.position_mean < after.position_mean < 1.6 * floor.position_mean
    left = found.validation_sigma.beyond_noise
    assert left is not None
    assert left[0] < after.position_mean
    assert after.position_mean < after.position_95 <= after.position_largest


def test_validation_poses_need_not_be_repeated(study: Study) -> None:
    single = calibrate_study(simulate_study(seed=3, runs=4, validation_runs=1, random_poses=6))
    assert single.check_screening is None
    assert len(single.check) == 6


def test_so_many_outliers_are_none() -> None:
    study = with_outliers(simulate_study(seed=3, runs=5, validation_runs=1, random_poses=2), 0.2, 1.0)
    rows = study_rows(study.calibration, study.robot)
    assert rows.screened.too_many
    assert rows.screened.keep.all()
    assert "TOO MANY FOR OUTLIERS" in rows.screened.sentence


def test_images_of_a_run_share_its_leg_readings() -> None:
    study = simulate_study(seed=3, runs=4, validation_runs=2, random_poses=4, images=3)
    found = calibrate_study(study)
    assert not found.screening.rows
    assert found.statistics[11].sigma == pytest.approx(0.019, rel=0.2)
    assert (found.statistics[0].readings, found.statistics[11].readings) == (768, 256)
