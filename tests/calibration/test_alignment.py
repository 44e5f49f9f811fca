"""Frames that joint centres define: the paper's own, and the drawing's with covariances that cover."""

from __future__ import annotations

import numpy as np
import pytest

from cpcal import InputError
from cpcal.calibration import aligned, calibrate_study, in_own_frame, own_frame_covariance
from cpcal.report.study_page import TABLE_4, TABLE_5
from cpcal.robot import DELTALAB, inverse, transformed
from cpcal.simulate import simulate_study


@pytest.mark.parametrize("table", [TABLE_4, TABLE_5])
def test_the_papers_tables_are_in_the_frames_of_their_own_centres(table):
    assert np.abs(in_own_frame(np.array(table)) - np.array(table)).max() < 2e-5


def test_most_of_the_difference_between_the_papers_fits_is_the_frame():
    one, other = (np.array(table)[:, :3] for table in (TABLE_4, TABLE_5))
    assert np.abs(one - other).max() == pytest.approx(19.16, abs=0.01)
    assert np.abs(aligned(other, one, np.zeros((18, 18))).residual).max() == pytest.approx(6.34, abs=0.01)


def test_own_frames_do_not_depend_on_where_the_centres_were_measured():
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = DELTALAB.parameters.copy()
    moved[:, :3] = moved[:, :3] @ turn.T + rng.normal(size=3)
    assert np.allclose(in_own_frame(moved), in_own_frame(DELTALAB.parameters), atol=1e-9)


def test_the_covariance_in_an_own_frame_is_that_of_draws():
    rng = np.random.default_rng(1)
    root = 1e-3 * rng.normal(size=(42, 42))
    drawn = DELTALAB.parameters + (rng.normal(size=(4000, 42)) @ root.T).reshape(-1, 6, 7)
    seen = np.cov(in_own_frame(drawn).reshape(4000, 42).T)
    told = own_frame_covariance(DELTALAB.parameters, root @ root.T)
    assert np.allclose(np.diagonal(seen), np.diagonal(told), rtol=0.15, atol=1e-12)


def test_frames_are_known_as_well_as_is_said():
    """Five studies, 12 numbers each, of the drawing's frame: the drawing's errors are in it."""
    inside = []
    for seed in range(5):
        study = simulate_study(seed=seed, runs=2, validation_runs=1, random_poses=2)
        found, truth = calibrate_study(study), study.truth
        for frame, true in ((found.base_frame, inverse(truth.camera)), (found.mobile_frame, truth.target)):
            error = np.abs(frame.motion.position - true.position)
            inside.append(error < frame.coverage_factor * frame.drawing_sigma[:3])
            centres = truth.robot.base if frame is found.base_frame else truth.robot.mobile
            measured = transformed(inverse(true), centres)
            drawn = study.robot.base if frame is found.base_frame else study.robot.mobile
            ideal = aligned(measured, drawn, np.zeros((18, 18)))
            assert np.abs(frame.motion.position - ideal.motion.position).max() < 5 * frame.sigma[:3].max()
    assert np.mean(inside) > 0.8


def test_no_frame_of_centres_on_a_line():
    line = np.outer(np.arange(6.0), [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="line"):
        aligned(line, line, np.zeros((18, 18)))
    with pytest.raises(InputError, match="line"):
        in_own_frame(np.concatenate([line, line, line[:, :1]], axis=1))
