"""The camera: projection and distortion against OpenCV's, derivatives, centres of dots, and what makes no camera."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.vision_scenes import facing_poses, one
from cpcal.common.errors import InputError
from cpcal.common.values import Floats
from cpcal.robot import Pose, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.projection import centers_by_pose, predicted_centers
from cpcal.vision.render import contours
from cpcal.vision.target import DELTALAB_TARGET

STRONG = Camera(
    2000, 1500, np.array([1500.0, 1480.0]), np.array([980.0, 760.0]), np.array([-0.3, 0.15, 2e-3, -1e-3, -0.03])
)
RATIONAL = replace(STRONG, distortion=np.array([0.4, 0.2, 2e-3, -1e-3, 0.02, 0.6, 0.25, 0.03]), model="rational")
FISHEYE = Camera(1600, 1200, [750.0, 748.0], [801.0, 598.0], [-0.03, 0.01, -4e-3, 5e-4], "fisheye")
CAMERAS = [DELTALAB_CAMERA, STRONG, replace(STRONG, distortion=np.zeros(5)), RATIONAL]
LENSES = [*CAMERAS, FISHEYE]


def matrix(camera):
    (fx, fy), (cx, cy) = camera.focal, camera.center
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def image_grid(camera):
    x, y = np.meshgrid(np.linspace(0.0, camera.width - 1.0, 21), np.linspace(0.0, camera.height - 1.0, 17))
    return np.stack([x, y], axis=-1)


@pytest.mark.parametrize("camera", CAMERAS)
def test_points_are_projected_as_opencv_does(camera):
    rng = np.random.default_rng(0)
    points = np.stack([*rng.uniform(-0.6, 0.6, (2, 500)), np.ones(500)], axis=1) * rng.uniform(100.0, 2000.0, (500, 1))
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix(camera), camera.distortion)
    np.testing.assert_allclose(camera.project(points), theirs[:, 0], atol=1e-9)
    np.testing.assert_array_equal(camera.project(points.reshape(5, 100, 3)), camera.project(points).reshape(5, 100, 2))


def test_a_fisheye_projects_as_opencvs():
    rng = np.random.default_rng(0)
    points = np.stack([*rng.uniform(-3.0, 3.0, (2, 500)), np.ones(500)], axis=1) * rng.uniform(100.0, 2000.0, (500, 1))
    points[0] = [0.0, 0.0, 500.0]
    origin = np.zeros((3, 1))
    theirs, _ = cv2.fisheye.projectPoints(points[:, None], origin, origin, matrix(FISHEYE), FISHEYE.distortion)
    np.testing.assert_allclose(FISHEYE.project(points), theirs[:, 0], atol=1e-9)


@pytest.mark.parametrize("camera", LENSES)
def test_each_derivative_of_the_lens_is_that_of_differences(camera):
    rng = np.random.default_rng(3)
    points = rng.uniform(-0.5, 0.5, (200, 2)) * rng.uniform(0.0, 1.0, (200, 1))
    points[0] = 0.0  # the axis, and just about where a fisheye's series ends
    points[1:3] = [[0.0999, 0.0], [0.1001, 0.0]]
    points = np.concatenate([points, camera.normalised(image_grid(camera)).reshape(-1, 2)])
    found, step = camera.jets(points), 1e-5
    for axis in range(2):
        move = step * np.eye(2)[axis]
        slope = (camera.jets(points + move) - camera.jets(points - move)) / (2.0 * step)
        for first, below, count in ((2, 0, 2), (5, 2, 3)):  # xx, xy are the slopes of d, and so on
            derived = found[:, first + axis : first + axis + count]
            np.testing.assert_allclose(derived, slope[:, below : below + count], atol=3e-7)


@pytest.mark.parametrize("camera", LENSES)
def test_pixels_show_the_directions_that_make_them(camera):
    pixels = image_grid(camera)
    directions = camera.normalised(pixels)
    np.testing.assert_allclose(camera.pixels(directions), pixels, atol=1e-9)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"focal": np.array([900.0])}, "camera focal"),
        ({"focal": np.array([900.0, np.nan])}, "camera focal"),
        ({"focal": np.array([900.0, 0.0])}, "no positive size or focal length"),
        ({"center": np.zeros(3)}, "camera center"),
        ({"distortion": np.zeros(4)}, "camera distortion"),
        ({"distortion": np.array([np.inf, 0.0, 0.0, 0.0, 0.0])}, "camera distortion"),
        ({"width": 0}, "no positive size or focal length"),
    ],
)
def test_what_is_no_camera_is_refused(changed, said):
    with pytest.raises(InputError, match=said):
        replace(DELTALAB_CAMERA, **changed)


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
