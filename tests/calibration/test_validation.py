"""Pose errors of validation poses before and after calibration, with a Gauss-Newton iteration as forward kinematics."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.calibration import LegEquations, Noise, averaged, fit, pose_errors, validate
from cpcal.common.errors import InputError
from cpcal.robot import (
    DELTALAB,
    Campaign,
    normalised,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_matrix,
    rotation_vector,
)
from cpcal.simulate import simulate, true_robot


def forward(parameters, lengths, guess):
    """Newton on g(x, M) = 0 for the pose, from the guess."""
    position, quaternion = guess.position.copy(), guess.quaternion.copy()
    for _ in range(20):
        equations = LegEquations(position, rotation_matrix(quaternion), lengths)
        step = -np.linalg.solve(equations.by_pose(parameters), equations.values(parameters)[..., None])[..., 0]
        position = position + step[:, :3]
        quaternion = normalised(quaternion_product(quaternion_from_rotation_vector(step[:, 3:]), quaternion))
    return position, quaternion, np.abs(step).max(axis=1) < 1e-9


def but_not(*rows):
    """`forward`, failing at these rows."""

    def failing(parameters, lengths, guess):
        position, quaternion, converged = forward(parameters, lengths, guess)
        converged[list(rows)] = False
        position[list(rows)] = 1e6
        return position, quaternion, converged

    return failing


@pytest.fixture(scope="module")
def poses():
    """Validation poses of the same true robot that simulate(seed=21) has."""
    return simulate(seed=21, extremal=False, random_poses=64, noise=0.0)


def test_the_true_parameters_have_no_error_and_the_nominal_ones_have(poses):
    found = validate(poses, true_robot(poses).parameters, forward)
    assert_allclose(found.after.position, 0.0, atol=1e-9)
    assert_allclose(found.after.orientation, 0.0, atol=1e-11)
    assert found.summary_before.position_mean > 0.5
    assert_allclose(found.position_improvement, 100.0, atol=1e-6)
    assert found.failed == ()


def test_errors_are_those_that_were_put_in(poses):
    """Move and turn the measured poses by known amounts: that is what the true parameters are off by."""
    rng = np.random.default_rng(0)
    move, turn = rng.normal(0, 1, (64, 3)), rng.normal(0, 0.01, (64, 3))
    moved = Campaign.of(
        DELTALAB,
        poses.position + move,
        quaternion_product(quaternion_from_rotation_vector(turn), poses.quaternion),
        poses.length,
        exact=True,
    )
    found = pose_errors(moved, true_robot(poses).parameters, forward)
    assert_allclose(found.position, np.linalg.norm(move, axis=1), rtol=1e-9)
    assert_allclose(found.orientation, np.linalg.norm(turn, axis=1), rtol=1e-9)


def test_shifting_the_base_shifts_every_pose_by_as_much(poses):
    shifted = true_robot(poses).parameters.copy()
    shifted[:, :3] += [0.3, 0.0, -0.4]
    found = pose_errors(poses, shifted, forward)
    assert_allclose(found.position, 0.5, rtol=1e-9)
    assert_allclose(found.orientation, 0.0, atol=1e-11)


def test_calibration_improves_poses_that_it_has_not_seen():
    calibration = simulate(seed=21, runs=4)
    repeats = simulate(seed=21, extremal=False, random_poses=64, runs=4)
    found = validate(
        averaged(repeats), fit(calibration, weights="joint", noise=Noise.of(calibration)).parameters, forward
    )
    assert found.summary_after.position_mean < 0.1 * found.summary_before.position_mean
    assert found.summary_after.orientation_mean < 0.1 * found.summary_before.orientation_mean
    assert "64 of 64 poses" in found.sentence
    assert found.names[0] == "r000/mean"


def test_the_summary_and_the_sorted_improvement_are_of_the_poses_errors(poses):
    rng = np.random.default_rng(1)
    found = validate(poses, true_robot(poses).parameters + rng.normal(0, 0.8, (6, 7)), forward)
    assert found.summary_after.position_mean == pytest.approx(found.after.position.mean())
    assert found.summary_after.orientation_deviation == pytest.approx(found.after.orientation.std(ddof=1))
    names, values = zip(*found.sorted_improvement(), strict=True)
    assert list(values) == sorted(values)
    assert sorted(names) == sorted(found.names)
    worst = found.names.index(names[0])
    old, new = found.before.position[worst], found.after.position[worst]
    assert values[0] == pytest.approx(100 * (old - new) / old)
    worse = int(np.sum(found.after.position > found.before.position))
    assert f"{worse} in position" in found.sentence
    assert len(found.sorted_improvement("orientation")) == 64


def test_poses_that_did_not_converge_are_named_and_left_out_of_both_columns(poses):
    everything = validate(poses, true_robot(poses).parameters, forward)
    found = validate(poses, true_robot(poses).parameters, but_not(2, 7))
    assert found.failed == ("r002/1", "r007/1")
    assert "NOT CONVERGE for r002/1, r007/1" in found.sentence
    assert "62 of 64" in found.sentence
    assert np.isnan(found.before.position[[2, 7]]).all()
    kept = np.delete(everything.before.position, [2, 7])
    assert found.summary_before.position_mean == pytest.approx(kept.mean())
    assert len(found.sorted_improvement()) == 62
    nothing = validate(poses, true_robot(poses).parameters, but_not(*range(64)))
    assert "None of 64 poses could be compared" in nothing.sentence
    assert np.isnan(nothing.summary_after.position_mean)


def test_parameters_can_be_compared_with_any_others(poses):
    truth = true_robot(poses).parameters
    same = validate(poses, DELTALAB.parameters, forward, before=DELTALAB.parameters)
    assert_allclose(same.position_improvement, 0.0)
    back = validate(poses, DELTALAB.parameters, forward, before=truth)
    assert (back.position_improvement < -1e6).all()
    assert_allclose(back.before.position, 0.0, atol=1e-9)


def test_an_error_that_was_zero_before_cannot_be_improved(poses):
    def measured(parameters, lengths, guess):
        shift = parameters[0, 0] - DELTALAB.parameters[0, 0]
        return guess.position + shift, guess.quaternion, np.ones(len(lengths), dtype=bool)

    found = validate(poses, DELTALAB.parameters + 1.0, measured)
    assert (found.position_improvement == -np.inf).all()
    assert (found.orientation_improvement <= 0).all()


def test_the_sign_of_a_quaternion_does_not_matter(poses):
    def flipped(parameters, lengths, guess):
        position, quaternion, converged = forward(parameters, lengths, guess)
        return position, -quaternion, converged

    parameters = DELTALAB.parameters
    plain, other = (pose_errors(poses, parameters, function) for function in (forward, flipped))
    assert_allclose(other.orientation, plain.orientation, rtol=1e-12)
    found = forward(parameters, poses.length, poses)[1]
    turn = rotation_vector(quaternion_product(found, quaternion_conjugate(poses.quaternion)))
    assert_allclose(plain.orientation, np.linalg.norm(turn, axis=1))


def test_bad_input_is_refused(poses):
    with pytest.raises(InputError, match=r"\(6, 7\)"):
        validate(poses, np.zeros((5, 7)), forward)
    with pytest.raises(InputError, match="finite"):
        validate(poses, np.full((6, 7), np.nan), forward)
    with pytest.raises(InputError, match="returned the shapes"):
        validate(
            poses, DELTALAB.parameters, lambda p, lengths, g: (g.position[:3], g.quaternion, np.ones(64, dtype=bool))
        )
    with pytest.raises(InputError, match="'position' or 'orientation'"):
        validate(poses, DELTALAB.parameters, forward).sorted_improvement("angle")
