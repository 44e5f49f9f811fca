"""A camera from rendered images: files and arrays; what cannot be used is left out with its reason."""

import cv2
import numpy as np
import pytest

from benchmarks.vision_scenes import facing_poses, normalised_errors, one
from cpcal.vision.calibrate import NotCalibratedError, calibrate_from_images
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.render import render
from cpcal.vision.target import DELTALAB_TARGET


def test_a_camera_is_calibrated_from_images_and_others_are_left_out(tmp_path):
    every = facing_poses(np.random.default_rng(5), 6)
    poses = [one(every, k) for k in range(6)]
    images = [render(DELTALAB_TARGET, DELTALAB_CAMERA, pose, seed=i) for i, pose in enumerate(poses)]
    cv2.imwrite(str(tmp_path / "view.png"), images[5])
    (tmp_path / "broken.png").write_bytes((tmp_path / "view.png").read_bytes()[:5000])
    black = np.zeros((768, 1024), dtype=np.uint8)
    given = [
        black,
        *images[:5],
        images[0][:, :1000],
        tmp_path / "view.png",
        str(tmp_path / "broken.png"),
        np.zeros((3, 3)),
    ]
    result = calibrate_from_images(given, DELTALAB_TARGET)
    assert np.abs(normalised_errors(result, DELTALAB_CAMERA)[0]).max() < 4.0
    assert result.rms < 0.01
    assert result.scale == pytest.approx(1.0, abs=0.15)
    assert [bool(view.reason) for view in result.views] == [True] + [False] * 5 + [True, False, True, True]
    reasons = [result.views[row].reason for row in (0, 6, 8, 9)]
    for reason, said in zip(
        reasons, ("too few", "has 1000 x 768 pixels, most have 1024 x 768", "truncated", ""), strict=True
    ):
        assert said in reason
    assert result.views[7].name == str(tmp_path / "view.png")
    for view, pose in zip([result.views[row] for row in (1, 2, 3, 4, 5, 7)], poses, strict=True):
        assert view.used.sum() == len(DELTALAB_TARGET.dots)
        assert np.abs(view.pose.position - pose.position).max() < 1.0


def test_images_without_a_target_are_refused_with_their_reasons(tmp_path):
    black = np.zeros((90, 120), dtype=np.uint8)
    with pytest.raises(NotCalibratedError, match="there are no views") as caught:
        calibrate_from_images([black, black, black], DELTALAB_TARGET)
    assert str(caught.value).count("too few") == 3
    with pytest.raises(NotCalibratedError, match="no image that can be used"):
        calibrate_from_images([tmp_path / "nothing.png"], DELTALAB_TARGET)
    with pytest.raises(NotCalibratedError, match="no image that can be used"):
        calibrate_from_images([], DELTALAB_TARGET)
