"""Calibration of a camera from dots: the truth within stated covariances, bad data left out, too little refused."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.vision_scenes import Setting, normalised_errors, simulated_views
from cpcal.vision.calibrate import NotCalibratedError, TargetView, calibrate_camera
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.target import two_diagonals

SIZE = (1024, 768)
FEWER = two_diagonals(  # the default target with a coarser grid: quicker
    "fewer dots", (-187.0, -96.0, -27.0, 43.0, 132.0), (-165.0, -37.0, 28.0, 153.0), side=280.0, pitch=45.0, radius=6.0
)


def views(seed, target=FEWER, setting=Setting(), camera=DELTALAB_CAMERA):  # noqa: B008
    return simulated_views(np.random.default_rng(seed), target, camera, setting)


def refused(found, target=FEWER, **options):
    with pytest.raises(NotCalibratedError) as caught:
        calibrate_camera(found, target, SIZE, **options)
    return str(caught.value)


def test_exact_centres_give_the_exact_camera_and_poses():
    found, poses = views(1)
    exact, _ = simulated_views(np.random.default_rng(1), FEWER, DELTALAB_CAMERA, replace(Setting(), noise=0.0))
    given = [view._replace(centers=e.centers) for view, e in zip(found, exact, strict=True)]
    result = calibrate_camera(given, FEWER, SIZE)
    np.testing.assert_allclose(result.camera.numbers, DELTALAB_CAMERA.numbers, rtol=1e-8, atol=1e-7)
    for view, pose in zip(result.views, poses, strict=True):
        np.testing.assert_allclose(view.pose.position, pose.position, rtol=1e-8, atol=1e-6)
        np.testing.assert_allclose(view.pose.rotation, pose.rotation, atol=1e-8)
    assert result.rms < 1e-9


def test_errors_are_those_of_the_stated_covariance():
    setting = replace(Setting(), views=10)
    found = (calibrate_camera(views(seed, setting=setting)[0], FEWER, SIZE) for seed in range(16))
    errors = [normalised_errors(one, DELTALAB_CAMERA)[1] for one in found]
    variance = np.mean(np.square(errors))
    assert 0.7 < variance < 1.3  # 144 numbers: a standard deviation of 0.12


def test_covariances_that_are_stated_too_small_are_scaled_up():
    found, _ = views(5)
    small = [view._replace(covariance=view.covariance / 9.0) for view in found]
    honest, scaled = (calibrate_camera(given, FEWER, SIZE) for given in (found, small))
    assert scaled.scale == pytest.approx(3.0 * honest.scale, rel=1e-6)
    np.testing.assert_allclose(
        scaled.standard_errors, honest.standard_errors * honest.scale / max(honest.scale, 1.0), rtol=1e-4
    )


def test_points_are_calibrated_as_opencv_does():
    points = replace(FEWER, radius=1e-3)
    found, _ = views(4, points, replace(Setting(), noise=0.1))
    result = calibrate_camera(found, points, SIZE)
    stated = [points.points[view.numbers].astype(np.float32) for view in found]
    seen = [view.centers.astype(np.float32) for view in found]
    rms, matrix, distortion, *_ = cv2.calibrateCamera(stated, seen, SIZE, None, None)
    theirs = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(distortion)[:5]])
    assert (np.abs(result.camera.numbers - theirs) < 0.05 * result.standard_errors).all()
    assert result.rms * np.sqrt(2.0) == pytest.approx(rms, rel=1e-4)


def replace_dots(view, keep):
    return TargetView(view.centers[keep], view.covariance[keep], view.numbers[keep], view.name)


def test_views_and_dots_that_do_not_fit_are_left_out_and_said():
    rng = np.random.default_rng(0)
    found, _ = views(7)
    found[2] = found[2]._replace(numbers=rng.permutation(found[2].numbers), name="shuffled")
    found[4] = found[4]._replace(centers=found[4].centers + rng.standard_normal(found[4].centers.shape), name="shaken")
    found[5] = replace_dots(found[5], np.arange(len(found[5].numbers)) < 7)._replace(name="few")
    off = found[8].centers.copy()
    off[[3, 11]] += [[2.0, 1.0], [0.0, 0.3]]
    found[8] = found[8]._replace(centers=off)
    result = calibrate_camera(found, FEWER, SIZE)
    reasons = {view.name: view.reason for view in result.views if view.reason}
    assert list(reasons) == ["shuffled", "shaken", "few"]
    assert "wrong numbers" in reasons["shuffled"]
    assert "do not fit the other views" in reasons["shaken"]
    assert "fewer than 8 dots" in reasons["few"]
    assert np.flatnonzero(~result.views[8].used).tolist() == [3, 11]
    assert sum((~view.used).sum() for view in result.views if not view.reason) == 2
    assert np.isnan(result.views[2].rms)
    assert np.abs(normalised_errors(result, DELTALAB_CAMERA)[0]).max() < 4.0
    assert "left out: shaken" in str(result)


@pytest.mark.parametrize("tilt", [0.0, 0.1, 1.0])
def test_views_that_are_fronto_parallel_are_refused(tilt):
    found, _ = views(1, setting=replace(Setting(), tilt=tilt, views=8))
    assert "tilted by 20 to 30 degrees" in refused(found)


def test_too_few_views_are_refused_with_all_reasons():
    found, _ = views(1, setting=replace(Setting(), views=4))
    assert "there are no views" in refused([])
    assert "only 2 of 2 views" in refused(found[:2])
    few = [*found[:2], *(replace_dots(view, np.arange(5)) for view in found[2:])]
    assert refused(few).count("fewer than 8 dots") == 2
    on_line = [replace_dots(view, np.isin(view.numbers, range(7))) for view in found]
    assert "only 0 of 4" in refused(on_line)
