"""Frames from pairs of poses: exact without noise, honest with it, and degenerate data refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cpcal.calibration import redefined
from cpcal.common.errors import InputError
from cpcal.robot import (
    DELTALAB,
    Pose,
    calibrate_frames,
    compose,
    inverse,
    inverse_kinematics,
    leg_vectors,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_vector,
)


def random_poses(rng, count, *, turn=0.4, size=300.0):
    turns = quaternion_from_rotation_vector(rng.normal(0.0, turn, (count, 3)))
    return Pose(rng.normal(0.0, size, (count, 3)), turns)


def one(rng, size=300.0):
    poses = random_poses(rng, 1, turn=2.0, size=size)
    return Pose(poses.position[0], poses.quaternion[0])


def problem(seed, count=12, **options):
    """X, Z, and poses A, B with X B = A Z."""
    rng = np.random.default_rng(seed)
    x, z = one(rng, 1000.0), one(rng)
    a = random_poses(rng, count, **options)
    return x, z, a, compose(inverse(x), compose(a, z))


def noisy(poses, seed, position, rotation):
    """Independent normal errors in the moving frame, mm and rad."""
    rng = np.random.default_rng(seed)
    shape = poses.position.shape
    turn = quaternion_from_rotation_vector(rotation * rng.standard_normal(shape))
    return compose(poses, Pose(position * rng.standard_normal(shape), turn))


def distance(found, true):
    """Between two motions: mm and rad."""
    turn = rotation_vector(quaternion_product(found.quaternion, quaternion_conjugate(true.quaternion)))
    return np.linalg.norm(found.position - true.position), np.linalg.norm(turn)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(3, 20))
def test_without_noise_the_frames_come_out_exactly(seed, count):
    x, z, a, b = problem(seed, count)
    found = calibrate_frames(a, b)
    # three poses may be ill conditioned: what can be asked depends on how far they turn
    least = np.linalg.svd(a.rotation.mean(axis=0))[1][0]
    accuracy = 1e-13 / min(2.0 * (1.0 - least), 1.0)
    for pose, true in ((found.camera_in_base, x), (found.target_in_mobile, z)):
        move, turn = distance(pose, true)
        assert move <= 1e5 * accuracy
        assert turn <= 1e2 * accuracy


def refusal(*poses):
    with pytest.raises(InputError) as caught:
        calibrate_frames(*poses)
    return str(caught.value)


AXIS = np.array([0.0, 0.6, 0.8])


def planar(seed, count=20):
    """Poses that turn about one axis only."""
    rng = np.random.default_rng(seed)
    turns = quaternion_from_rotation_vector(rng.normal(0.0, 0.5, (count, 1)) * AXIS)
    a = Pose(rng.normal(0.0, 300.0, (count, 3)), turns)
    x, z = one(rng), one(rng)
    return a, compose(inverse(x), compose(a, z))


def test_planar_motion_is_refused_and_its_axis_named():
    assert "turn about one axis only, (0.000, 0.600, 0.800)" in refusal(*planar(1)).replace("-0.000", "0.000")


def test_poses_that_hardly_turn_are_refused():
    _, _, a, b = problem(12, turn=1e-8)
    assert "hardly turn" in refusal(a, b)
    _, _, a, b = problem(12, turn=1e-3)
    assert "not determined" in refusal(a, noisy(b, 1, 0.5, 0.003))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_pairs(count):
    _, _, a, b = problem(15, count)
    assert f"hold {count} and {count} poses" in refusal(a, b)


def test_bad_arrays_are_refused():
    _, _, a, b = problem(17)
    for spoil, value in ((a.position, np.nan), (b.quaternion, 0.0)):
        kept = spoil[3].copy()
        spoil[3] = value
        assert "hold a NaN, an infinity or a zero quaternion" in refusal(a, b)
        spoil[3] = kept
    assert "12 and 11 poses" in refusal(a, Pose(b.position[:-1], b.quaternion[:-1]))
    assert "(N, 3) in mm" in refusal(a, Pose(b.position[0], b.quaternion[0]))


def test_redefined_joints_fit_the_cameras_own_poses():
    """P + R b - a has the same length whether written in base and mobile frame or in camera and target frame."""
    x, z, a, b = problem(19)
    found = calibrate_frames(a, b)
    robot = redefined(DELTALAB, found.camera_in_base, found.target_in_mobile)
    assert_allclose(inverse_kinematics(robot, b), inverse_kinematics(DELTALAB, a), atol=1e-8)
    turned = np.einsum("ij,knj->kni", x.rotation, leg_vectors(robot, b))
    assert_allclose(turned, leg_vectors(DELTALAB, a), atol=1e-8)
    back = redefined(robot, inverse(x), inverse(z))
    assert_allclose(back.parameters, DELTALAB.parameters, atol=1e-8)
