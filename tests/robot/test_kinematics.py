"""Robots: quaternions, inverse and forward kinematics against one another, the assembly branch, the catalogue."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cpcal.common.errors import InputError
from cpcal.robot import (
    DELTALAB,
    KinematicsError,
    Pose,
    PoseRange,
    Robot,
    central_pose,
    forward_kinematics,
    inverse_kinematics,
    known_robot,
    leg_vectors,
    normalised,
    pose_jacobian,
    quaternion_from_rotation_vector,
    quaternion_product,
)
from cpcal.robot.kinematics import (
    quaternion_conjugate,
    quaternion_from_matrix,
    rotation_matrix,
    rotation_vector,
    small_rotation,
)
from cpcal.simulate import simulate

MIDDLE = np.full(6, 70.0)


def centre(robot=DELTALAB):
    return central_pose(robot, MIDDLE)


def test_the_inverse_kinematics_is_the_papers_equation_1():
    pose = Pose(np.array([10.0, -20.0, 350.0]), np.array([0.9, 0.1, -0.2, 0.3]))
    for leg, reading in enumerate(inverse_kinematics(DELTALAB, pose)):
        a, b, offset = DELTALAB.base[leg], DELTALAB.mobile[leg], DELTALAB.offset[leg]
        vector = pose.position + pose.rotation @ b - a
        assert vector @ vector == pytest.approx((reading + offset) ** 2, rel=1e-14)
        assert_allclose(leg_vectors(DELTALAB, pose)[leg], vector, rtol=1e-14)


def test_the_jacobian_is_the_derivative():
    rng = np.random.default_rng(1)
    pose = Pose(np.array([10.0, -20.0, 350.0]), normalised(np.array([0.9, 0.1, -0.2, 0.3])))
    step = rng.uniform(-1, 1, 6) * np.array([1, 1, 1, 0.01, 0.01, 0.01])

    def moved(t):
        turn = quaternion_from_rotation_vector(t * step[3:])
        return inverse_kinematics(
            DELTALAB, Pose(pose.position + t * step[:3], quaternion_product(turn, pose.quaternion))
        )

    numeric = (moved(1e-4) - moved(-1e-4)) / 2e-4
    assert_allclose(pose_jacobian(DELTALAB, pose) @ step, numeric, rtol=1e-7, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(0, 140), min_size=6, max_size=6), st.integers(0, 1000))
def test_forward_then_inverse_gives_the_readings_for_any_parameters(readings, seed):
    deviation = np.random.default_rng(seed).normal(0, 5, (6, 7))
    robot = Robot.from_parameters("r", DELTALAB.parameters + deviation)
    pose = forward_kinematics(robot, readings, centre(robot))
    assert_allclose(inverse_kinematics(robot, pose), readings, atol=1e-10)
    assert pose.position[2] > 200


def test_more_than_six_legs_give_the_least_squares_pose():
    extra = np.concatenate([DELTALAB.parameters, [[0.0, -280.0, 0.0, 0.0, -200.0, 0.0, 345.0]]])
    robot = Robot.from_parameters("seven", extra)
    pose = Pose(np.array([5.0, 3.0, 360.0]), quaternion_from_rotation_vector([0.05, 0.02, -0.1]))
    readings = inverse_kinematics(robot, pose)
    found = forward_kinematics(robot, readings, centre())
    assert_allclose(found.position, pose.position, atol=1e-9)
    disturbed = forward_kinematics(robot, readings + np.array([0, 0, 0, 0, 0, 0, 0.1]), centre())
    residual = readings + np.array([0, 0, 0, 0, 0, 0, 0.1]) - inverse_kinematics(robot, disturbed)
    assert_allclose(pose_jacobian(robot, disturbed).T @ residual, 0.0, atol=1e-6)


def test_what_cannot_be_assembled_is_said_and_which():
    readings = np.stack([MIDDLE, [0.0, 900.0, 0.0, 0.0, 0.0, 900.0], MIDDLE])
    with pytest.raises(KinematicsError, match=r"1 of 3 rows of readings \(row 1"):
        forward_kinematics(DELTALAB, readings, centre())


@pytest.mark.parametrize(
    ("readings", "message"),
    [([70.0] * 5, "expected"), ([float("nan")] * 6, "finite"), ([1e9] * 6, "are they in mm"), (3.0, "expected")],
)
def test_senseless_readings_are_refused(readings, message):
    with pytest.raises(KinematicsError, match=message):
        forward_kinematics(DELTALAB, readings, centre())


component = st.floats(-10, 10).map(lambda value: 0.0 if abs(value) < 1e-3 else value)
quaternions = st.tuples(component, component, component, component).filter(any)


@given(quaternions, quaternions)
def test_products_compose_conjugates_are_inverse_and_matrices_come_back(p, q):
    one, other = rotation_matrix(p), rotation_matrix(q)
    assert_allclose(rotation_matrix(quaternion_product(p, q)), one @ other, atol=1e-13)
    assert_allclose(rotation_matrix(quaternion_conjugate(q)), other.T, atol=1e-14)
    back = quaternion_from_matrix(other)
    assert back[0] >= 0
    assert_allclose(rotation_matrix(back), other, atol=1e-13)


@given(st.tuples(*[st.floats(-1.8, 1.8)] * 3))
def test_rotation_vectors_come_back_and_small_rotations_are_theirs_up_to_a_twelfth_of_their_square(v):
    v = np.array(v)
    assert_allclose(rotation_vector(quaternion_from_rotation_vector(v)), v, atol=1e-13)
    small = 1e-3 * v
    assert_allclose(rotation_vector(small_rotation(small)), small * (1 - small @ small / 12), rtol=1e-9, atol=1e-300)


def test_what_a_planar_robot_cannot_do_is_fixed_and_exact():
    known = known_robot("planar-3rpr")
    campaign = simulate(known.robot, workspace=known.workspace, seed=2, random_poses=30)
    assert len(campaign) == 38
    assert not campaign.position[:, 2].any()
    assert not campaign.quaternion[:, 1:3].any()
    assert np.array_equal(campaign.position_radius[0] > 0, [True, True, False])
    assert np.array_equal(campaign.rotation_radius[0] > 0, [False, False, True])


@pytest.mark.parametrize(("low", "turn"), [([2, 0, 0], [0, 0, 0]), ([0, 0, 0], [-1, 0, 0]), ([0, 0], [0, 0, 0])])
def test_an_empty_workspace_is_refused(low, turn):
    with pytest.raises(InputError, match="no box of poses"):
        PoseRange(low, [1, 1, 1], turn)
