"""A study and its calibration, for all tests that change nothing of it."""

from __future__ import annotations

import pytest

from cpcal.calibration import StudyCalibration, calibrate_study
from cpcal.robot import Study
from cpcal.simulate import simulate_study


@pytest.fixture(scope="package")
def study() -> Study:
    return simulate_study(seed=3, runs=4, validation_runs=3, random_poses=12)


@pytest.fixture(scope="package")
def found(study: Study) -> StudyCalibration:
    return calibrate_study(study)
