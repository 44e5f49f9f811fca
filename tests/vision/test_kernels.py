"""The compiled pieces of detection say what the formulas that they stand for say, compiled or not."""

import cv2
import numpy as np
import pytest

from benchmarks.vision_scenes import facing_poses
from cpcal.solver.compiled import plain
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.dots.segmentation import ellipses
from cpcal.vision.pose import Pixels, fit, fit_pose
from cpcal.vision.projection import centers_by_pose, placed_centers
from cpcal.vision.target import DELTALAB_TARGET
from tests.vision.test_camera import FISHEYE, RATIONAL

DOTS, RADIUS = DELTALAB_TARGET.dots.copy(), DELTALAB_TARGET.radius  # writable, as images have them: compiled once


@pytest.mark.parametrize("camera", [DELTALAB_CAMERA, RATIONAL, FISHEYE])
def test_the_plain_python_of_a_kernel_says_the_same(camera):
    pose = facing_poses(np.random.default_rng(1), 1).rows(0)
    answers = []
    for run in (placed_centers, plain(placed_centers)):
        answers.append((np.empty((1, len(DOTS), 2)), np.empty((1, len(DOTS), 2, 6))))
        run(DOTS, RADIUS, camera.packed, pose.rotation[None], pose.position[None], *answers[-1])
    np.testing.assert_allclose(answers[0][0], answers[1][0], rtol=1e-12)
    np.testing.assert_allclose(answers[0][1], answers[1][1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("camera", [DELTALAB_CAMERA, FISHEYE])
def test_a_fit_ends_where_the_gradient_vanishes(camera):
    rng = np.random.default_rng(2)
    pose = facing_poses(rng, 1).rows(0)
    seen = centers_by_pose(DOTS, RADIUS, camera.packed, pose)[0] + 0.01 * rng.standard_normal((len(DOTS), 2))
    factors = np.tile(0.01 * np.eye(2), (len(DOTS), 1, 1))
    away = type(pose)(pose.position + [20.0, -10.0, 30.0], pose.quaternion)
    found = fit(Pixels(DOTS, seen, factors, RADIUS, camera), away)
    centers, by_pose = centers_by_pose(DOTS, RADIUS, camera.packed, found.pose)
    residuals, slope = ((seen - centers) / 0.01).ravel(), (by_pose / 0.01).reshape(-1, 6)
    step = np.linalg.solve(slope.T @ slope, slope.T @ residuals)
    assert step @ slope.T @ slope @ step < 1e-6  # of a standard deviation, squared
    assert found.chi_square == pytest.approx(float(residuals @ residuals), rel=1e-6)
    np.testing.assert_allclose(found.normal, slope.T @ slope, rtol=1e-2, atol=1e-2 * np.abs(found.normal).max())
    turn, place = away.rotation[None].copy(), away.position[None].copy()
    given = DOTS, seen, factors, RADIUS, camera.packed
    plain(fit_pose)(*given, turn, place, np.empty(2 * len(DOTS)), np.empty((6, 6)))
    np.testing.assert_allclose(place[0], found.pose.position, atol=1e-9)


def test_moments_of_outlines_are_opencvs():
    mask = np.zeros((200, 300), dtype=np.uint8)
    for x, y, axes, angle in ((60, 50, (20, 12), 30.0), (200, 120, (9, 8), 0.0), (150, 60, (30, 25), 110.0)):
        cv2.ellipse(mask, (x, y), axes, angle, 0.0, 360.0, 255, -1)
    for corner in ((30, 180), (60, 130)):
        cv2.rectangle(mask, (20, 120), corner, 255, -1)  # an angle is no ellipse
    # touches the border, is next to it, a ring about another one
    for x, y, radius, width in ((298, 30, 10, -1), (275, 150, 23, -1), (250, 60, 25, 2), (253, 61, 9, -1)):
        cv2.circle(mask, (x, y), radius, 255, width)
    theirs = [cv2.moments(one) for one in cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)[0]]
    centers = np.array([[m["m10"], m["m01"]] for m in theirs]) / np.array([[m["m00"]] for m in theirs])
    for run in (ellipses, plain(ellipses)):
        found = np.full((99, 6), np.nan)
        assert (run(mask, found[:6]), run(mask, found)) == (0, 6)
        for x, y, xx, xy, _, yy in found[:6]:
            near = theirs[int(np.abs(centers - [x, y]).sum(axis=1).argmin())]
            assert (x, y) == pytest.approx((near["m10"] / near["m00"], near["m01"] / near["m00"]), rel=1e-9)
            wanted = near["mu11"] / near["m00"], (near["mu20"] - near["mu02"]) / near["m00"]
            assert (xy, xx - yy) == pytest.approx(wanted, rel=1e-6, abs=1e-6)
