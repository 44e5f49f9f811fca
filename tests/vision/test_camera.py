"""Cameras and poses: OpenCV's projection, derivatives, covariances that hold, outliers screened, ambiguity refused."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.vision_scenes import FACING, facing_poses, pose_error
from cpcal.common.errors import InputError
from cpcal.common.values import Floats, Ints
from cpcal.robot import Pose, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.pose import NoPose, PoseEstimate, estimate_pose
from cpcal.vision.projection import centers_by_pose, predicted_centers
from cpcal.vision.render import contours
from cpcal.vision.target import DELTALAB_TARGET, Target

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
        wanted = conic_centers(contours(DELTALAB_TARGET, DELTALAB_CAMERA, poses.rows(k)))
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


def of_small(small: Target, pose: Pose, sigma: float, rng: np.random.Generator) -> PoseEstimate:
    centers = predicted_centers(small, DELTALAB_CAMERA, pose) + sigma * rng.standard_normal((133, 2))
    return estimate_pose(centers, sigma**2 * np.tile(np.eye(2), (133, 1, 1)), ALL, small, DELTALAB_CAMERA)


ALL = np.arange(len(DELTALAB_TARGET.dots))


def estimated(centers: Floats, sigma: float, numbers: Ints = ALL, camera: Camera = DELTALAB_CAMERA) -> PoseEstimate:
    return estimate_pose(centers, sigma**2 * np.tile(np.eye(2), (len(centers), 1, 1)), numbers, DELTALAB_TARGET, camera)


def tilted(x: float, y: float, z: float, degrees: float) -> Pose:
    lean = quaternion_from_rotation_vector(np.array([np.radians(degrees), 0.0, 0.0]))
    return Pose(np.array([x, y, z]), quaternion_product(lean, FACING))


@pytest.mark.parametrize(
    "pose", [tilted(0.0, 0.0, 700.0, 0.0), tilted(0.0, 0.0, 700.0, 1e-7), tilted(9.0, 5.0, 600.0, 40.0)]
)
def test_without_noise_the_pose_is_exact(pose: Pose) -> None:
    found = estimated(predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, pose), 0.01)
    error = pose_error(pose, found)
    assert np.abs(error[:3]).max() < 1e-5
    assert np.abs(error[3:]).max() < 1e-8
    assert found.rms < 1e-6
    assert found.scale == 1.0
    assert not found.outliers.any()


def normalised_squares(true: Pose, found: PoseEstimate) -> list[float]:
    """NEES/6 with all that is stated, and without what all images share."""
    error, own = pose_error(true, found), found.covariance - found.shared_part
    return [error @ np.linalg.solve(covariance, error) / 6.0 for covariance in (found.covariance, own)]


def test_an_error_of_the_camera_is_in_the_covariance_and_is_no_doubt_of_the_residuals() -> None:
    """Cameras off by what their covariance says, ten times what the dots' noise makes of a pose: NEES/6 is still 1."""
    rng = np.random.default_rng(4)
    poses = facing_poses(rng, 80)
    sigma = np.array([0.3, 0.3, 0.2, 0.2, 1e-4, 2e-4, 2e-5, 2e-5, 0.0])
    mixed = np.eye(9)
    mixed[1, 0] = 0.9  # fx and fy err together
    factor = sigma[:, None] * mixed
    squares, scales = [], []
    for k in range(80):
        true = poses.rows(k)
        centers = predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, true) + 0.005 * rng.standard_normal((133, 2))
        stated = DELTALAB_CAMERA.with_numbers(DELTALAB_CAMERA.numbers + factor @ rng.standard_normal(9))
        spread = 0.005**2 * np.tile(np.eye(2), (133, 1, 1))
        found = estimate_pose(centers, spread, ALL, DELTALAB_TARGET, stated, factor @ factor.T)
        squares.append(normalised_squares(true, found))
        scales.append(found.scale)
    whole, without = np.mean(squares, axis=0)
    assert np.abs(whole - 1.0) < 0.2  # standard deviation 0.065
    assert without > 20.0
    assert np.max(scales) < 2.0


@pytest.mark.parametrize(("scale_sigma", "dot_sigma"), [(2e-4, 0.0), (0.0, 0.02), (1e-4, 0.01)])
def test_an_error_of_the_plate_is_in_the_covariance(scale_sigma: float, dot_sigma: float) -> None:
    """Plates off by what the target says, far more than the dots' noise in the image: NEES/6 is still 1."""
    rng = np.random.default_rng(7)
    poses = facing_poses(rng, 80)
    plate = replace(DELTALAB_TARGET, scale_sigma=scale_sigma, dot_sigma=dot_sigma)
    squares, p_values = [], []
    for k in range(80):
        shape = (1.0 + scale_sigma * rng.standard_normal()) * plate.dots + dot_sigma * rng.standard_normal((133, 2))
        seen = predicted_centers(replace(plate, dots=shape), DELTALAB_CAMERA, poses.rows(k))
        spread = 0.003**2 * np.tile(np.eye(2), (133, 1, 1))
        found = estimate_pose(seen + 0.003 * rng.standard_normal((133, 2)), spread, ALL, plate, DELTALAB_CAMERA)
        squares.append(normalised_squares(poses.rows(k), found))
        p_values.append(found.p_value)
    whole, without = np.mean(squares, axis=0)
    assert np.abs(whole - 1.0) < 0.2  # standard deviation 0.065
    assert without > 2.0
    assert np.mean(np.array(p_values) < 1e-3) < 0.05  # the residuals are as stated: no doubt


def test_the_stated_covariance_holds() -> None:
    """Dots of unequal, correlated errors: the normalised errors have unit variance, the p-values are uniform."""
    rng = np.random.default_rng(1)
    poses = facing_poses(rng, 250)
    squares, p_values = [], []
    for k in range(250):
        factor = rng.uniform(0.003, 0.03, (133, 1, 1)) * np.array([[1.0, 0.0], [0.6, 0.8]])
        centers = predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, poses.rows(k))
        centers = centers + (factor @ rng.standard_normal((133, 2, 1)))[..., 0]
        spread = factor @ np.swapaxes(factor, 1, 2)
        found = estimate_pose(centers, spread, ALL, DELTALAB_TARGET, DELTALAB_CAMERA)
        error = pose_error(poses.rows(k), found)
        squares.append(np.linalg.solve(np.linalg.cholesky(found.covariance), error) ** 2)
        p_values.append(found.p_value)
        assert found.residuals.shape == (133, 2)
    assert np.abs(np.mean(squares) - 1.0) < 0.1  # standard deviation 0.037
    assert np.abs(np.mean(squares, axis=0) - 1.0).max() < 0.3  # 0.089 each
    assert np.abs(np.quantile(p_values, [0.25, 0.5, 0.75]) - [0.25, 0.5, 0.75]).max() < 0.1


def test_a_few_outliers_are_screened_and_named() -> None:
    rng = np.random.default_rng(2)
    pose = tilted(20.0, -10.0, 700.0, 15.0)
    true = predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, pose)
    centers = true + 0.01 * rng.standard_normal((133, 2))
    wrong = np.array([3, 40, 41, 90, 132])
    centers[wrong] += [[0.3, 0.0], [0.0, 0.2], [1.0, 1.0], [-5.0, 3.0], [0.15, -0.15]]
    found = estimated(centers, 0.01)
    assert np.array_equal(np.flatnonzero(found.outliers), wrong)
    error = pose_error(pose, found)
    assert error @ np.linalg.solve(found.covariance, error) < 22.5  # 99.9 % of six degrees of freedom
    assert np.abs(found.residuals[wrong[3]] - [-5.0, 3.0]).max() < 0.1  # theirs are told too


def test_a_misfit_that_neighbours_share_is_not_averaged_out() -> None:
    rng = np.random.default_rng(4)
    centers = predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, tilted(0.0, 0.0, 700.0, 10.0))
    arm = DELTALAB_TARGET.dots / np.abs(DELTALAB_TARGET.dots).max()
    alike = np.stack([arm[:, 0] * arm[:, 1], arm[:, 0] ** 2 - arm[:, 1] ** 2], axis=1)
    alike *= 0.05 / np.sqrt((alike**2).mean())
    seen = centers + 0.01 * rng.standard_normal((133, 2))
    smooth, rough = estimated(seen + alike, 0.01), estimated(seen + rng.permutation(alike), 0.01)
    assert min(smooth.scale, rough.scale) > 5.0
    alone, common = np.trace(rough.covariance) / rough.scale, np.trace(smooth.covariance) / smooth.scale
    assert 20.0 * alone < common < 50.0 * alone  # 43 times: 260 residuals, six directions of the pose


def test_too_few_dots_and_dots_on_a_line_are_refused() -> None:
    centers = predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, tilted(0.0, 0.0, 700.0, 10.0))
    with pytest.raises(NoPose, match="5 dots are too few"):
        estimated(centers[:5], 0.01, ALL[:5])
    with pytest.raises(NoPose, match="on a line"):
        estimated(centers[:7], 0.01, ALL[:7])


def test_many_outliers_are_no_pose() -> None:
    rng = np.random.default_rng(3)
    centers = predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, tilted(0.0, 0.0, 700.0, 10.0))
    centers[:40] += rng.uniform(-3.0, 3.0, (40, 2))
    with pytest.raises(NoPose, match="of 133 dots do not fit one pose"):
        estimated(centers + 0.01 * rng.standard_normal((133, 2)), 0.01)


def test_a_small_distant_target_gives_the_right_pose_or_none() -> None:
    """Its depths turned over look nearly the same: two poses that fit about equally well are refused."""
    small = Target("small", DELTALAB_TARGET.dots / 5.0, 1.2)
    rng = np.random.default_rng(6)
    poses = facing_poses(rng, 60, depth=(2000.0, 2000.0))
    right, reasons = 0, list[str]()
    for k in range(60):
        try:
            found = of_small(small, poses.rows(k), 0.07, rng)
        except NoPose as reason:
            reasons.append(str(reason))
            continue
        error = pose_error(poses.rows(k), found)
        assert error @ np.linalg.solve(found.covariance, error) < 35.0  # five in a million of six degrees of freedom
        right += 1
    assert 20 < right < 60
    assert all("two poses fit about equally well" in reason for reason in reasons)
