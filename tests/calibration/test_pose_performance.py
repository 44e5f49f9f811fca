"""AP and RP as ISO 9283 has them, against a plain computation of the same formulas."""

from __future__ import annotations

import numpy as np
import pytest

from cpcal.calibration import calibrate_study, redefined
from cpcal.calibration.study_calibration import forward, study_rows
from cpcal.calibration.validation import pose_performance
from cpcal.robot import Pose, inverse
from cpcal.simulate import simulate_study


@pytest.fixture(scope="module")
def study():
    return simulate_study(seed=4, runs=2, validation_runs=5, random_poses=6)


@pytest.fixture(scope="module")
def runs(study):
    true = redefined(study.robot, inverse(study.truth.camera), study.truth.target)
    return study_rows(study.validation, true).runs


def test_accuracy_and_repeatability_are_those_of_the_formulas(study, runs):
    before = runs.robot.parameters
    found = pose_performance(runs, before, before + 0.01, forward)
    assert found.names == tuple(dict.fromkeys(study.validation.pose))
    assert found.cycles == (5,) * 6
    here = np.flatnonzero(np.array(runs.pose) == found.names[2])
    attained = runs.position[here]
    mean = attained.mean(axis=0)
    away = np.linalg.norm(attained - mean, axis=1)
    assert found.repeatability[2] == pytest.approx(away.mean() + 3.0 * away.std(ddof=1))
    readings = runs.length[here].mean(axis=0)[None]
    guess = Pose(mean[None], runs.quaternion[here[:1]])
    position, _, converged = forward(before, readings, guess)
    assert converged.all()
    assert found.accuracy_before[2] == pytest.approx(np.linalg.norm(mean - position[0]))


def test_exact_runs_repeat_and_attain_what_the_true_parameters_command():
    study = simulate_study(seed=4, runs=2, validation_runs=3, random_poses=4, noise=0.0)
    truth = study.truth
    true = redefined(truth.robot, inverse(truth.camera), truth.target)
    exact = study_rows(study.validation, true).runs
    found = pose_performance(exact, true.parameters, true.parameters, forward)
    assert max(found.accuracy_after) < 1e-6
    assert max(found.repeatability) < 1e-9
    assert np.max(found.angle_after) < 1e-8


def test_a_single_run_has_no_repeatability(study, runs):
    once = study_rows(simulate_study(seed=4, runs=2, validation_runs=1, random_poses=3).validation, runs.robot).runs
    assert pose_performance(once, runs.robot.parameters, runs.robot.parameters, forward) is None


def test_calibration_improves_accuracy_and_leaves_repeatability(study):
    found = calibrate_study(study).performance
    assert found is not None
    assert max(found.accuracy_after) < 0.2 * max(found.accuracy_before)
    assert "not its five poses and 30 cycles" in found.sentence
