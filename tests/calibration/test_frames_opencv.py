"""Shah's and Andreff's methods against OpenCV's own; skipped without OpenCV 4 (5 has no hand-eye calibration)."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.calibration import calibrate_frames, hand_eye
from cpcal.robot import Pose, compose, inverse, quaternion_from_rotation_vector, rotation_matrix

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'opencv-python-headless<5')")
pytestmark = [
    pytest.mark.peers,
    pytest.mark.skipif(not hasattr(cv2, "calibrateRobotWorldHandEye"), reason="OpenCV 4 has hand-eye calibration"),
]


def random_poses(rng, count, turn=0.4):
    turns = quaternion_from_rotation_vector(rng.normal(0.0, turn, (count, 3)))
    return Pose(rng.normal(0.0, 300.0, (count, 3)), turns)


def noisy_problem(seed, count=15):
    """Poses A and B with X B = A Z up to 1 mm and 5 mrad."""
    rng = np.random.default_rng(seed)
    x, z, noise = (random_poses(rng, n, turn) for n, turn in ((1, 2.0), (1, 2.0), (count, 0.005)))
    a = random_poses(rng, count)
    b = compose(compose(inverse(x), compose(a, z)), Pose(noise.position / 300.0, noise.quaternion))
    return a, b


def lists(pose):
    return list(pose.rotation), list(pose.position)


@pytest.mark.parametrize("seed", range(5))
def test_shah(seed):
    """OpenCV solves (cam <- world) (world <- base) = (cam <- gripper) (gripper <- base): A Z = X B."""
    a, b = noisy_problem(seed)
    method = cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH
    turn_z, move_z, turn_x, move_x = cv2.calibrateRobotWorldHandEye(*lists(a), *lists(b), method=method)
    found = calibrate_frames(a, b, refine=False)
    for pose, turn, move in ((found.camera_in_base, turn_x, move_x), (found.target_in_mobile, turn_z, move_z)):
        assert_allclose(pose.rotation, turn, atol=1e-10)
        assert_allclose(pose.position, move[:, 0], atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_andreff(seed):
    """The same motions in the same unit of length; OpenCV keeps the translation of the linear system, so that only
    the rotation can be compared under noise."""
    a, b = noisy_problem(seed)
    back = inverse(b)  # OpenCV wants the target in the camera frame, hence the pose that B^-1 inverts
    first, second = np.triu_indices(len(a.position), 1)
    motions = [compose(inverse(pick(pose, second)), pick(pose, first)) for pose in (a, b)]
    unit = np.sqrt(np.mean(np.sum(np.concatenate([m.position for m in motions]) ** 2, axis=1)))
    scaled = [Pose(pose.position / unit, pose.quaternion) for pose in (a, back)]
    turn, _ = cv2.calibrateHandEye(*lists(scaled[0]), *lists(scaled[1]), method=cv2.CALIB_HAND_EYE_ANDREFF)
    found = hand_eye(*motions, refine=False).transform
    assert_allclose(rotation_matrix(found.quaternion), turn, atol=1e-9)


def pick(pose, index):
    return Pose(pose.position[index], pose.quaternion[index])
