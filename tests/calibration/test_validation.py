"""Pose errors of validation poses before and after calibration."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.calibration import Validation, pose_errors, validate
from cpcal.common.errors import InputError
from cpcal.robot import DELTALAB, Campaign, quaternion_from_rotation_vector, quaternion_product
from cpcal.simulate import simulate, true_robot


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
