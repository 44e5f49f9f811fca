"""Images of the world around a target, by a renderer that shares nothing with cpcal's: poses are as good as stated."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")

from benchmarks.vision_scenes import FACING, facing_poses, true_centers
from benchmarks.vision_world import CONDITIONS, World, measured, photograph
from cpcal.robot import Pose, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.batch.detect import SCALE, detection
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.measure import measure_pose
from cpcal.vision.projection import predicted_centers
from cpcal.vision.target import DELTALAB_TARGET


def some(quick, *others):
    """The others nightly."""
    return pytest.mark.parametrize("name", [quick, *(pytest.param(name, marks=pytest.mark.nightly) for name in others)])


@pytest.mark.parametrize(
    ("numbers", "bend"), [([9.0, 9.0, 0.0, 0.0], 0.0), ([0.0, 0.0, 3.0, 0.0], 0.0), ([0.0, 0.0, 0.0, 0.0], 0.2)]
)
def test_a_wrong_camera_and_a_bent_plate_are_doubted(numbers, bend):
    """A focal length off by 1 % moves the pose by 7 mm, a centre off by 3 pixels by 2 mm, a bend by 0.1 mm."""
    rng = np.random.default_rng(7)
    tilt = quaternion_product(quaternion_from_rotation_vector(np.array([0.4, 0.1, 0.0])), FACING)
    pose = Pose(np.array([5.0, -8.0, 620.0]), tilt)
    image = photograph(DELTALAB_TARGET, DELTALAB_CAMERA, pose, World(bent=bend), rng)
    camera = DELTALAB_CAMERA.with_numbers(DELTALAB_CAMERA.numbers + np.array([*numbers, 0.0, 0.0, 0.0, 0.0, 0.0]))
    found = measure_pose(image, DELTALAB_TARGET, camera)
    assert "times as large as stated" in found.doubt
    row = detection("a.png", found)
    assert row.doubt == found.doubt
    assert row.values[SCALE] > 2.0


@pytest.mark.parametrize(("name", "said"), [("two targets", "twice"), ("a mirrored copy", "mirror image")])
def test_a_second_target_and_a_mirrored_one_are_ambiguous(name, said):
    figures = measured(CONDITIONS[name], 1, 9)
    assert figures["found"] == 0
    assert all(said in reason for reason in figures["reasons"])


def test_nothing_is_doubted_where_all_is_as_stated():
    figures = measured(World(gradient=(0.3, 0.2), noise=3.0), 2, 8)
    assert figures["found"] == 2
    assert figures["doubtful"] == 0


def test_two_renderers_and_two_models_of_a_dots_centre_agree():
    rng = np.random.default_rng(3)
    pose = facing_poses(rng, 1, depth=(600.0, 600.0)).rows(0)
    centers = true_centers(DELTALAB_TARGET, DELTALAB_CAMERA, pose)
    np.testing.assert_allclose(centers, predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, pose), atol=2e-4)
    image = photograph(DELTALAB_TARGET, DELTALAB_CAMERA, pose, World(noise=0.0), rng)
    found = measure_pose(image, DELTALAB_TARGET, DELTALAB_CAMERA)
    assert np.sqrt(np.mean((found.centers - centers[found.numbers]) ** 2)) < 0.0015  # rounding to grey levels is half


@pytest.mark.nightly
def test_a_bent_plates_pose_is_doubtful_and_its_deviations_hold_what_the_residuals_show():
    figures = measured(CONDITIONS["bent by 0.2 mm"], 3, 5)
    assert figures["doubtful"] == 3
    assert figures["NEES/6"] < 5.0  # 60 if dots were taken to be off each by itself


@some("clutter: texture and discs", "clutter: texture")
def test_a_plate_is_found_among_many_more_specks_than_dots(name):
    figures = measured(CONDITIONS[name], 3, 6)
    assert figures["found"] == 3
    assert figures["wrong"] == 0
    assert figures["NEES/6"] < 2.2


@some("shadow, 15 px soft", "shadow, 40 px soft", "motion, 3 px", "motion, 6 px")
def test_a_shadows_edge_and_motion_leave_poses_as_good_as_stated(name):
    figures = measured(CONDITIONS[name], 3, 5)
    assert figures["found"] == 3
    assert figures["doubtful"] == 0
    assert 0.3 < figures["NEES/6"] < 2.2  # 18 degrees of freedom
