"""The predicted centre is the centre of the conic through the dot's contour."""

import numpy as np
import pytest

from benchmarks.vision_scenes import facing_poses, one
from cpcal.common.values import Floats
from cpcal.robot import Pose, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.projection import centers_by_pose, predicted_centers
from cpcal.vision.render import contours
from cpcal.vision.target import DELTALAB_TARGET

DOTS, RADIUS = DELTALAB_TARGET.dots, DELTALAB_TARGET.radius


def conic_centers(contour: Floats) -> Floats:
    """Centres of the algebraic least-squares conics through (n, points, 2), in coordinates where each is a circle."""
    mean = contour.mean(axis=1, keepdims=True)
    moved = contour - mean
    spread = np.linalg.cholesky(2.0 * np.swapaxes(moved, 1, 2) @ moved / contour.shape[1])
    x, y = np.moveaxis(moved @ np.swapaxes(np.linalg.inv(spread), 1, 2), -1, 0)
    rows = np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], axis=-1)
    a = np.linalg.svd(rows, full_matrices=False)[2][:, -1]
    matrix = np.stack([np.stack([2.0 * a[:, 0], a[:, 1]], -1), np.stack([a[:, 1], 2.0 * a[:, 2]], -1)], -2)
    return np.asarray(mean + np.swapaxes(spread @ np.linalg.solve(matrix, -a[:, 3:5, None]), 1, 2))[:, 0]


def test_the_centre_is_that_of_the_conic_through_the_contour() -> None:
    rng = np.random.default_rng(1)
    poses = facing_poses(rng, 12)
    predicted = predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, poses)
    for k in range(12):
        wanted = conic_centers(contours(DELTALAB_TARGET, DELTALAB_CAMERA, one(poses, k)))
        assert np.abs(predicted[k] - wanted).max() < 1e-5


@pytest.mark.parametrize("distortion", [DELTALAB_CAMERA.distortion, np.array([-0.25, 0.11, 2e-3, -3e-3, 0.05])])
def test_the_derivatives_by_the_pose_are_good_to_a_thousandth(distortion: Floats) -> None:
    camera = Camera(1024, 768, DELTALAB_CAMERA.focal, DELTALAB_CAMERA.center, distortion)
    poses = facing_poses(np.random.default_rng(2), 3)
    _, by_pose = centers_by_pose(DOTS, RADIUS, camera.packed, poses)
    for k in range(6):
        step = (1e-2 if k < 3 else 1e-5) * np.eye(6)[k]
        moved = [
            Pose(
                poses.position + s * step[:3],
                quaternion_product(quaternion_from_rotation_vector(s * step[3:]), poses.quaternion),
            )
            for s in (1.0, -1.0)
        ]
        ahead, behind = (predicted_centers(DELTALAB_TARGET, camera, pose) for pose in moved)
        slope = (ahead - behind) / (2.0 * np.abs(step).max())
        assert np.abs(by_pose[..., k] - slope).max() < 1e-3 * np.abs(slope).max()
