"""Guaranteed pose sets: the true pose is inside, the set is hardly wider than it must be, and nothing is guessed."""

import numpy as np
import pytest

from benchmarks.pose_sets import drawn_pose
from cpcal.common.errors import InputError
from cpcal.models.sight import PixelBoxes, PoseSet, enclose_pose
from cpcal.robot import Pose, normalised, quaternion_from_rotation_vector, quaternion_product, transformed
from cpcal.solver.contract import Verdict
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.projection import predicted_centers
from cpcal.vision.target import DELTALAB_TARGET, Target

ALL = np.arange(len(DELTALAB_TARGET.dots))
NOMINAL = Pose(
    np.array([10.0, -5.0, 700.0]),
    normalised(quaternion_product(quaternion_from_rotation_vector([0.2, -0.1, 0.3]), [0.0, 1.0, 0.0, 0.0])),
)


def shown(pose: Pose = NOMINAL, camera: Camera = DELTALAB_CAMERA) -> np.ndarray:
    return camera.project(transformed(pose, DELTALAB_TARGET.points))


def moved(pose: Pose, step: np.ndarray) -> Pose:
    turn = np.array([1.0, *(0.5 * step[3:])])
    return Pose(pose.position + step[:3], normalised(quaternion_product(turn, pose.quaternion)))


def radii(found: PoseSet) -> np.ndarray:
    assert found.position_radius is not None
    assert found.rotation_radius is not None
    return np.concatenate([found.position_radius, found.rotation_radius])


def slopes_of(pose: Pose) -> np.ndarray:
    """(2 n, 6) of all pixels by position (mm) and rotation vector (rad)."""
    steps = 1e-4 * np.diag([10.0, 10.0, 10.0, 0.1, 0.1, 0.1])
    by = [(shown(moved(pose, step)) - shown(moved(pose, -step))) / (2.0 * step.max()) for step in steps]
    return np.stack([one.ravel() for one in by], axis=1)


@pytest.mark.parametrize("kind", ["uniform", "adversarial", "exact"])
def test_the_true_pose_is_inside(kind: str) -> None:
    """Adversarial: all dots push the pose the same way."""
    rng = np.random.default_rng(["uniform", "adversarial", "exact"].index(kind))
    for half_width in (0.03, 0.5):
        pose = drawn_pose(rng)
        slopes = slopes_of(pose)
        pushed = np.sign(slopes @ (rng.standard_normal(6) / np.linalg.norm(slopes, axis=0)))
        errors = {"uniform": rng.uniform(-1.0, 1.0, len(slopes)), "adversarial": pushed, "exact": 0.0 * pushed}[kind]
        pixels = shown(pose)
        inside = ((pixels > 1.0) & (pixels < [1022.0, 766.0])).all(axis=1)
        seen = (pixels + 0.999999 * half_width * errors.reshape(-1, 2))[inside]
        found = enclose_pose(PixelBoxes.around(ALL[inside], seen, half_width), DELTALAB_TARGET, DELTALAB_CAMERA)
        assert found.verdict is Verdict.PROVED
        assert pose in found


def test_a_dot_in_the_wrong_place_refutes() -> None:
    for displacement in (0.5, 20.0):
        pixels = shown()
        pixels[40, 0] += displacement
        found = enclose_pose(PixelBoxes.around(ALL, pixels, 0.1), DELTALAB_TARGET, DELTALAB_CAMERA)
        assert found.verdict is Verdict.REFUTED
        assert found.pose is None
        assert NOMINAL not in found
        assert "No pose" in found.status


def test_where_nothing_bounded_is_known_it_says_so() -> None:
    pixels = shown()
    line = list(range(7))
    for chosen in (line, [0, 6]):
        boxes = PixelBoxes.around(chosen, pixels[chosen], 0.1)
        found = enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA)
        assert found.verdict is Verdict.UNKNOWN
        assert found.reason
        assert found.status.startswith("Nothing is proved")
        assert NOMINAL not in found


def test_measured_centres_are_freed_of_their_bias() -> None:
    outlines = predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, NOMINAL)
    half_width = 0.005  # the bias is four times as large
    boxes = PixelBoxes.around(ALL, outlines, half_width, of_images=True)
    found = enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA)
    assert NOMINAL in found
    biased = enclose_pose(PixelBoxes.around(ALL, outlines, half_width), DELTALAB_TARGET, DELTALAB_CAMERA)
    assert NOMINAL not in biased


def test_bad_input_is_refused() -> None:
    pixels = shown()
    for numbers, centers, half_width, reason in (
        ([1, 1], pixels[:2], 0.1, "name a dot twice"),
        ([1, 2], pixels[:3], 0.1, "have shapes"),
        ([1, 2], pixels[:2], -0.1, "half_width: is negative or NaN"),
        ([1, 2], pixels[:2], np.nan, "half_width: is negative or NaN"),
        ([1, 2], pixels[:2] * np.nan, 0.1, "pixel box 0: has no points"),
        ([1, 2], pixels[:2], [0.1, 0.1, 0.1], r"half_width: is \(3,\)"),
    ):
        with pytest.raises(InputError, match=reason):
            PixelBoxes.around(numbers, centers, half_width)
    good = PixelBoxes.around(ALL, pixels, 0.1)
    small = Target("three", DELTALAB_TARGET.dots[:30], 6.0)
    outside = PixelBoxes.around(ALL, pixels + [2000.0, 0.0], 0.1)
    with pytest.raises(InputError, match="dot 30"):
        enclose_pose(good, small, DELTALAB_CAMERA)
    with pytest.raises(InputError, match="field of view"):
        enclose_pose(outside, DELTALAB_TARGET, DELTALAB_CAMERA)
    with pytest.raises(InputError, match="outliers"):
        enclose_pose(good, DELTALAB_TARGET, DELTALAB_CAMERA, outliers=-1)


# all dots but q: the true pose stays inside, outliers are named only when they are ones, and the set stays useful -----

DOTS = np.arange(0, len(DELTALAB_TARGET.dots), 2)  # half of them: quicker
PIXELS = DELTALAB_CAMERA.project(transformed(NOMINAL, DELTALAB_TARGET.points[DOTS]))
HALF_WIDTH = 0.1


def noisy(seed: int) -> np.ndarray:
    return PIXELS + np.random.default_rng(seed).uniform(-HALF_WIDTH, HALF_WIDTH, PIXELS.shape)


def enclosed(pixels: np.ndarray, outliers: int) -> PoseSet:
    boxes = PixelBoxes.around(DOTS, pixels, HALF_WIDTH)
    return enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA, outliers=outliers)


@pytest.mark.parametrize(("count", "allowed", "cost"), [(1, 1, 1.3), (1, 2, 6.0), (3, 3, 1.3)])
def test_gross_outliers_are_found_and_cost_little(count: int, allowed: int, cost: float) -> None:
    pixels, rng = noisy(count), np.random.default_rng(10 + count)
    wrong = np.sort(rng.choice(len(DOTS), count, replace=False))
    clean = enclosed(pixels, 0)
    pixels[wrong] += rng.choice([-1.0, 1.0], (count, 2)) * rng.uniform(10.0, 40.0, (count, 2))
    found = enclosed(pixels, allowed)
    assert found.verdict is Verdict.PROVED
    assert NOMINAL in found
    assert found.refuted == tuple(DOTS[wrong])
    assert (radii(found) < cost * radii(clean)).all()


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


def test_too_few_dots_for_so_many_outliers() -> None:
    boxes = PixelBoxes.around(DOTS[:20], PIXELS[:20], HALF_WIDTH)
    found = enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA, outliers=2)
    assert found.verdict is Verdict.UNKNOWN
    assert "too few" in found.reason


@pytest.mark.parametrize("count", [3, 8])
def test_few_dots_and_other_lenses(count: int) -> None:
    rng = np.random.default_rng(count)
    wide = Camera(
        1024, 768, np.array([600.0, 601.0]), np.array([511.0, 380.0]), np.array([-0.33, 0.15, 1e-3, -1e-3, -0.03])
    )
    plain = Camera(1024, 768, np.array([900.0, 901.0]), np.array([511.0, 380.0]), np.zeros(5))
    for camera in (DELTALAB_CAMERA, wide, plain):
        more = rng.choice(np.arange(13, len(ALL)), max(count - 4, 0), replace=False)
        chosen = np.array([0, 6, 12, 7][:count] + more.tolist())
        pose = drawn_pose(rng)
        pixels = shown(pose, camera)[chosen] + rng.uniform(-0.04, 0.04, (count, 2))
        found = enclose_pose(PixelBoxes.around(chosen, pixels, 0.04), DELTALAB_TARGET, camera)
        assert found.verdict is Verdict.PROVED
        assert pose in found
