"""All dots but q: the true pose stays inside, outliers are named only when they are ones, and the set stays useful."""

from __future__ import annotations

import numpy as np
import pytest

from cpcal.models.sight import PixelBoxes, PoseSet, enclose_pose
from cpcal.robot import (
    Pose,
    normalised,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_product,
    transformed,
)
from cpcal.solver.contract import Verdict
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.target import DELTALAB_TARGET

DOTS = np.arange(0, len(DELTALAB_TARGET.dots), 2)  # half of them: quicker
NOMINAL = Pose(
    np.array([10.0, -5.0, 700.0]),
    normalised(quaternion_product(quaternion_from_rotation_vector([0.2, -0.1, 0.3]), [0.0, 1.0, 0.0, 0.0])),
)
PIXELS = DELTALAB_CAMERA.project(transformed(NOMINAL, DELTALAB_TARGET.points[DOTS]))
HALF_WIDTH = 0.1


def noisy(seed: int) -> np.ndarray:
    return PIXELS + np.random.default_rng(seed).uniform(-HALF_WIDTH, HALF_WIDTH, PIXELS.shape)


def enclosed(pixels: np.ndarray, outliers: int) -> PoseSet:
    boxes = PixelBoxes.around(DOTS, pixels, HALF_WIDTH)
    return enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA, outliers=outliers)


def radii(found: PoseSet) -> np.ndarray:
    assert found.position_radius is not None
    assert found.rotation_radius is not None
    return np.concatenate([found.position_radius, found.rotation_radius])


@pytest.mark.parametrize("count", [1, 3])
def test_gross_outliers_are_found_and_cost_nothing(count: int) -> None:
    pixels, rng = noisy(count), np.random.default_rng(10 + count)
    wrong = np.sort(rng.choice(len(DOTS), count, replace=False))
    clean = enclosed(pixels, 0)
    pixels[wrong] += rng.choice([-1.0, 1.0], (count, 2)) * rng.uniform(10.0, 40.0, (count, 2))
    found = enclosed(pixels, count)
    assert found.verdict is Verdict.PROVED
    assert NOMINAL in found
    assert found.refuted == tuple(DOTS[wrong])
    assert (radii(found) < 1.3 * radii(clean)).all()
    assert "but at most" in found.status


def test_fewer_outliers_than_allowed() -> None:
    pixels = noisy(4)
    clean = enclosed(pixels, 0)
    pixels[25] -= 25.0
    found = enclosed(pixels, 2)
    assert NOMINAL in found
    assert found.refuted == (50,)
    assert (radii(clean) <= radii(found)).all()
    assert (radii(found) < 6.0 * radii(clean)).all()


def test_more_outliers_than_allowed_refute() -> None:
    pixels = noisy(5)
    pixels[[1, 17, 30]] += 30.0
    found = enclosed(pixels, 2)
    assert found.verdict is Verdict.REFUTED
    assert NOMINAL not in found


def test_outliers_that_agree_on_another_pose() -> None:
    """Three dots where another pose shows them: the set holds the truth all the same."""
    other = Pose(NOMINAL.position + [5.0, 3.0, 20.0], NOMINAL.quaternion)
    pixels = noisy(6)
    wrong = [0, 3, 6]
    pixels[wrong] = DELTALAB_CAMERA.project(transformed(other, DELTALAB_TARGET.points[DOTS[wrong]]))
    found = enclosed(pixels, 3)
    assert NOMINAL in found
    assert other not in found
    assert found.refuted == (0, 6, 12)


def test_slight_outliers() -> None:
    """A dot a little outside its box, the hardest to tell: no verdict about it need be had, but the truth is inside."""
    for seed, excess in ((7, 0.01), (8, 0.1)):
        pixels = noisy(seed)
        pixels[7] = PIXELS[7] + HALF_WIDTH + excess
        found = enclosed(pixels, 1)
        assert NOMINAL in found
        assert found.refuted in ((), (14,))


def test_one_outlier_costs_no_more_than_leaving_out_any_one_dot() -> None:
    """The hull of the sets without dot 0, without dot 1, ...: inside what is stated, and hardly narrower."""
    chosen = np.sort(np.random.default_rng(9).choice(len(DOTS), 16, replace=False))
    pixels = noisy(9)
    boxes = PixelBoxes.around(DOTS[chosen], pixels[chosen], HALF_WIDTH)
    found = enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA, outliers=1)
    assert found.pose is not None
    away = []
    for dot in chosen:
        rest = chosen[chosen != dot]
        one = enclose_pose(PixelBoxes.around(DOTS[rest], pixels[rest], HALF_WIDTH), DELTALAB_TARGET, DELTALAB_CAMERA)
        assert one.pose is not None
        turn = quaternion_product(one.pose.quaternion, quaternion_conjugate(found.pose.quaternion))
        step = np.concatenate([one.pose.position - found.pose.position, 2.0 * turn[1:] / turn[0]])
        away.append([step - radii(one), step + radii(one)])
    lowest, highest = np.min(away, axis=0)[0], np.max(away, axis=0)[1]
    assert (np.maximum(-lowest, highest) <= 1.003 * radii(found)).all()  # each is itself wider than need be, a little
    assert (radii(found) <= 1.02 * np.maximum(-lowest, highest)).all()


def test_too_few_dots_for_so_many_outliers() -> None:
    boxes = PixelBoxes.around(DOTS[:20], PIXELS[:20], HALF_WIDTH)
    found = enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA, outliers=2)
    assert found.verdict is Verdict.UNKNOWN
    assert "too few" in found.reason
