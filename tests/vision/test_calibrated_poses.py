"""Poses of a calibrated camera: the stated covariance holds the camera's own errors, which all images share."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.vision_scenes import facing_poses, one
from cpcal.robot import Pose, quaternion_conjugate, quaternion_product, rotation_vector
from cpcal.vision.calibrate import Calibration, calibrate_from_images
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.measure import measure_pose
from cpcal.vision.pose import PoseEstimate
from cpcal.vision.render import render
from cpcal.vision.target import DELTALAB_TARGET

CAMERAS = 3


def rendered(seed: int, count: int) -> tuple[list[np.ndarray], list[Pose]]:
    rng = np.random.default_rng(seed)
    every = facing_poses(rng, count, depth=(550.0, 850.0), tilt=30.0)
    poses = [one(every, k) for k in range(count)]
    return [render(DELTALAB_TARGET, DELTALAB_CAMERA, pose, seed=100 * seed + k) for k, pose in enumerate(poses)], poses


def difference(found: PoseEstimate, truth: Pose) -> np.ndarray:
    turned = quaternion_product(truth.quaternion, quaternion_conjugate(found.pose.quaternion))
    return np.concatenate([truth.position - found.pose.position, rotation_vector(turned)])


@pytest.fixture(scope="module")
def errors() -> list[tuple[np.ndarray, PoseEstimate]]:
    """Of two fresh images each with cameras calibrated from 18 rendered views."""
    out = []
    for seed in range(CAMERAS):
        images, _ = rendered(seed, 18)
        found: Calibration = calibrate_from_images(images, DELTALAB_TARGET)
        for image, truth in zip(*rendered(1000 + seed, 2), strict=True):
            pose = measure_pose(image, DELTALAB_TARGET, found.camera, found.covariance).estimate
            out.append((difference(pose, truth), pose))
    return out


@pytest.mark.nightly
def test_with_the_shared_part_the_stated_covariance_is_honest(errors: list[tuple[np.ndarray, PoseEstimate]]) -> None:
    counted = np.mean([e @ np.linalg.solve(pose.covariance, e) / 6.0 for e, pose in errors])
    alone = np.mean([e @ np.linalg.solve(pose.covariance - pose.shared_part, e) / 6.0 for e, pose in errors])
    assert 0.5 < counted < 2.0
    assert alone > 3.0 * counted
