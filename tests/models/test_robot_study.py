"""Frames of a parallel robot's own study, and its legs' joints in the robot's frames."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.models.hand_eye_fit import classical_answer
from cpcal.models.hand_eye_sources import platform_poses, study_of_robot, with_half_widths
from cpcal.questions.hand_eye import Within, certify_hand_eye, legs_in_frames
from cpcal.robot import Pose, inverse, quaternion_conjugate, quaternion_product, rotation_vector, transformed
from cpcal.simulate import simulate_study
from cpcal.solver.interval import Box
from tests.changed import mobile_in_base


@pytest.fixture(scope="module")
def case():
    """Five configurations, with half-widths that hold what the drawing is off; and the truth."""
    robot_study = simulate_study(runs=1, random_poses=1, deviation=0.1, seed=2)
    truth, table = robot_study.truth, robot_study.calibration
    whole = study_of_robot(robot_study)
    study = whole.part(np.linspace(0, len(whole.images) - 1, 5).astype(int))
    true = mobile_in_base(truth, table)
    rows = [name.replace("/", "-") for name in table.row_ids]
    chosen = [rows.index(name) for name in study.images]
    off = np.abs(true.position[chosen] - study.poses.position).max()
    turn = quaternion_product(true.quaternion[chosen], quaternion_conjugate(study.poses.quaternion))
    angle = np.degrees(np.abs(rotation_vector(turn)).max())
    return robot_study, with_half_widths(study, f"{1.1 * off + 0.1},{1.1 * angle + 0.01}"), truth


@pytest.fixture(scope="module")
def frames(case):
    return certify_hand_eye(case[1], within=Within(50.0, 2.0), tolerance=0.1)


def test_what_four_configurations_leave_open_is_said_and_has_no_negative_variance(case):
    whole = study_of_robot(case[0])
    four = with_half_widths(whole.part(np.linspace(0, len(whole.images) - 1, 4).astype(int)), "1,0.1")
    found = classical_answer(four)
    assert (np.diagonal(found.covariance) > 0.0).all()
    assert [said for said in found.remarks if "not at all" in said] == list(found.remarks)
    assert len(found.remarks) == 2
    assert not any("--off estimated" in said for said in classical_answer(four.exactly()).remarks)


def test_the_frames_of_the_simulation_lie_in_the_ranges(case, frames):
    camera, target = inverse(case[2].camera), case[2].target
    x = np.concatenate([camera.rotation.ravel(), camera.position, target.rotation.ravel(), target.position])
    assert not frames.ranges.empty
    assert (np.array(frames.ranges.lo)[:24] <= x).all()
    assert (x <= np.array(frames.ranges.hi)[:24]).all()


def test_joints_in_the_robots_frames_hold_the_true_ones(case, frames):
    truth = case[2]
    seen = transformed(truth.camera, truth.robot.base)  # base joints in the camera frame
    carried = transformed(inverse(truth.target), truth.robot.mobile)  # mobile joints in the target frame
    legs = []
    for k, (a, b) in enumerate(zip(seen, carried, strict=True)):
        middle = np.concatenate([a, b, [0.0]])
        box = Box(("ax", "ay", "az", "bx", "by", "bz", "l"), middle - 0.01, middle + 0.01)
        legs.append(SimpleNamespace(leg=k + 1, ranges=SimpleNamespace(box=box)))
    found = legs_in_frames(SimpleNamespace(legs=legs), frames)
    assert list(found) == [1, 2, 3, 4, 5, 6]
    for (low, high), a, b in zip(found.values(), truth.robot.base, truth.robot.mobile, strict=True):
        true = np.concatenate([a, b])
        assert (low <= true).all()
        assert (true <= high).all()


def test_frames_of_a_camera_on_the_hand_and_legs_without_ranges_are_refused(frames):
    with pytest.raises(InputError, match="ranges"):
        legs_in_frames(SimpleNamespace(legs=[SimpleNamespace(leg=1, ranges=None)]), frames)
    with pytest.raises(InputError, match="eye-in-hand"):
        legs_in_frames(SimpleNamespace(legs=[]), replace(frames, setup="eye-in-hand"))


@pytest.mark.parametrize("text", ["1", "a,b", "-1,0.1", "1,90"])
def test_half_widths_that_are_none_are_refused(case, text):
    with pytest.raises(InputError, match="off"):
        with_half_widths(case[1], text)


def test_rows_have_the_pose_of_the_drawing(case):
    robot_study = case[0]
    poses = platform_poses(robot_study)
    assert list(poses) == robot_study.calibration.row_ids
    values = np.array(list(poses.values()))[:3]
    mobile = transformed(Pose(values[:, :3], values[:, 3:]), robot_study.robot.mobile)
    length = np.linalg.norm(mobile - robot_study.robot.base, axis=-1) - robot_study.robot.offset
    assert length == pytest.approx(robot_study.calibration.length[:3])
