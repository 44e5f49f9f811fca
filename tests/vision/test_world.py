"""Images of the world around a target, by a renderer that shares nothing with cpcal's: poses are as good as stated."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")

from benchmarks.vision_conditions import CONDITIONS, measured
from benchmarks.vision_scenes import facing_poses, one
from benchmarks.vision_world import World, photographed, true_centers
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.dot_model import predicted_centers
from cpcal.vision.files.camera_file import CameraRecord
from cpcal.vision.measure import measure_pose
from cpcal.vision.target import DELTALAB_TARGET

TRUE = CameraRecord(DELTALAB_CAMERA)


def test_two_renderers_and_two_models_of_a_dots_centre_agree():
    rng = np.random.default_rng(3)
    pose = one(facing_poses(rng, 1, depth=(600.0, 600.0)), 0)
    centers = true_centers(DELTALAB_TARGET, DELTALAB_CAMERA, pose)
    np.testing.assert_allclose(centers, predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, pose), atol=2e-4)
    image = photographed(DELTALAB_TARGET, DELTALAB_CAMERA, pose, World(noise=0.0), rng)
    found = measure_pose(image, DELTALAB_TARGET, DELTALAB_CAMERA)
    assert np.sqrt(np.mean((found.centers - centers[found.numbers]) ** 2)) < 0.0015  # rounding to grey levels is half


@pytest.mark.parametrize("name", ["clutter: texture", "clutter: texture and discs", "clutter: photograph"])
def test_a_plate_is_found_among_many_more_specks_than_dots(name):
    figures = measured(CONDITIONS[name], 3, 6, TRUE).row()
    assert figures["found"] == 3
    assert figures["wrong"] == 0
    assert figures["NEES/6"] < 2.2


@pytest.mark.parametrize(
    "name", ["clutter: 150 discs", "clutter: checkerboard", "clutter: text", "clutter: a dimmer grid beside"]
)
def test_the_light_of_a_background_does_not_move_the_target(name):
    figures = measured(CONDITIONS[name], 3, 5, TRUE).row()
    assert figures["found"] == 3
    assert figures["wrong"] == 0
    assert figures["NEES/6"] < 2.2  # 18 degrees of freedom: exceeded once in 400 if it is 1
