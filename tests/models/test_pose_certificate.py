"""Pose sets that are certified from pixels on: true poses inside, and nothing that does not follow accepted."""

from fractions import Fraction as F
from pathlib import Path

import numpy as np
import pytest

from benchmarks.pose_sets import drawn_pose, shown
from cpcal.checker.bounds import Bounds, number
from cpcal.checker.lens import Cameras
from cpcal.checker.sight import check_pose_set, check_pose_sets
from cpcal.common.errors import InputError
from cpcal.models.sight import CameraSet, PixelBoxes, PoseSet, TargetSet, enclose_pose
from cpcal.robot import Pose, transformed
from cpcal.solver.contract import Verdict
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.target import DELTALAB_TARGET, Target

WIDTHS = np.array([0.3, 0.3, 0.2, 0.2, 2e-4, 2e-4, 2e-5, 2e-5, 1e-4])
FEW = Target("few dots", DELTALAB_TARGET.dots[::8], 6.0)
PLATE = 0.01  # mm


def seen(rng: np.random.Generator, cameras: CameraSet, targets: TargetSet) -> tuple[Pose, PixelBoxes]:
    """A pose, and boxes of +-0.05 px that hold the dots' images' centres, of some camera and plate of the sets."""
    pose = drawn_pose(rng)
    numbers, centers = shown(rng, pose, cameras, targets)
    moved = centers + rng.uniform(-0.0499, 0.0499, centers.shape)
    return pose, PixelBoxes.around(numbers, moved, 0.05, of_images=True)


SETS = {"exact": CameraSet(DELTALAB_CAMERA), "ellipsoid": CameraSet.ellipsoid(DELTALAB_CAMERA, np.diag(WIDTHS**2), 1.0)}


@pytest.mark.parametrize("kind", list(SETS))
def test_true_poses_are_inside_with_camera_and_target_drawn_from_their_sets(kind: str) -> None:
    rng = np.random.default_rng(list(SETS).index(kind))
    targets = TargetSet(FEW, PLATE)
    pose, boxes = seen(rng, SETS[kind], targets)
    found = enclose_pose(boxes, targets, SETS[kind])
    assert found.verdict is Verdict.PROVED
    assert pose in found


def radii(found: PoseSet) -> np.ndarray:
    assert found.position_radius is not None
    assert found.rotation_radius is not None
    return np.concatenate([found.position_radius, found.rotation_radius])


def centroid(camera: Camera, pose: Pose, dot: np.ndarray, radius: float) -> np.ndarray:
    """Of the area of a dot's image: the formula of Green on its outline, 20,000 points."""
    angle = np.linspace(0.0, 2.0 * np.pi, 20_000, endpoint=False)
    ring = np.stack([dot[0] + radius * np.cos(angle), dot[1] + radius * np.sin(angle), 0.0 * angle], axis=1)
    middle = camera.project(transformed(pose, np.array([[*dot, 0.0]])))[0]
    x, y = (camera.project(transformed(pose, ring)) - middle).T
    step = x * np.roll(y, -1) - np.roll(x, -1) * y
    return np.array([((v + np.roll(v, -1)) * step).sum() for v in (x, y)]) / (3.0 * step.sum())


def exact(value: float) -> Bounds:
    return number(F(value))


def test_the_bias_holds_the_centroid_of_the_area() -> None:
    rng = np.random.default_rng(3)
    wide = Camera(
        1024, 768, np.array([600.0, 601.0]), np.array([511.0, 380.0]), np.array([-0.33, 0.15, 1e-3, -1e-3, -0.03])
    )
    for camera in (DELTALAB_CAMERA, wide):
        cameras = Cameras([F(v) for v in camera.numbers.tolist()], [()] * 9, F(6, 10))
        for _ in range(2):
            pose = drawn_pose(rng)
            points = transformed(pose, DELTALAB_TARGET.points)
            chosen = rng.choice(len(points), 4, replace=False)
            p, normal = points[chosen], pose.rotation[:, 2].tolist()
            for k, dot in enumerate(chosen):
                x, tau = [exact(v) for v in (p[k, :2] / p[k, 2]).tolist()], exact(6.0 / p[k, 2])
                bias = cameras.bias(x, tau, [exact(v) for v in normal])
                true = centroid(camera, pose, DELTALAB_TARGET.dots[dot], 6.0)
                for part, value in zip(bias, true, strict=True):
                    lo, hi = part.lo / 2.0**160, part.hi / 2.0**160
                    assert lo <= value <= hi < lo + 0.005


def test_wrong_dots_are_found_out_and_certified(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    pose, boxes = seen(rng, SETS["exact"], TargetSet(FEW))
    lo, hi = boxes.lo.copy(), boxes.hi.copy()
    lo[5], hi[5] = lo[5] + 3.0, hi[5] + 3.0
    wrong = PixelBoxes(boxes.numbers, lo, hi, of_images=True)
    found = enclose_pose(wrong, FEW, DELTALAB_CAMERA, outliers=1, certificate=tmp_path / "one")
    assert pose in found
    checked = check_pose_set(tmp_path / "one.pose.json")
    assert checked.refused is None
    assert checked.outliers == 1
    enclose_pose(wrong, FEW, DELTALAB_CAMERA, certificate=tmp_path / "none")
    none = check_pose_set(tmp_path / "none.pose.json")
    assert none.refused is None
    assert none.radii is None
    work = 8_000_000  # enough for the smaller one, which comes first: one budget holds for the folder
    first, second = check_pose_sets(tmp_path, work=work)
    assert first.refused is None
    assert f"more work than the {work}" in (second.refused or "")


def test_sets_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="focal length of zero"):
        CameraSet(DELTALAB_CAMERA, 1e3 * np.ones((9, 1)))
    with pytest.raises(InputError, match="covariance"):
        CameraSet.ellipsoid(DELTALAB_CAMERA, np.eye(8), 1.0)
    with pytest.raises(InputError, match="target half-widths"):
        TargetSet(FEW, -1.0)


def test_an_ellipsoid_of_cameras_has_the_covariance_times_the_square_of_its_factor():
    widths = np.where(WIDTHS > 0.0, WIDTHS, 1.0)
    root = np.random.default_rng(4).normal(size=(9, 9)) * widths[:, None]
    spread = CameraSet.ellipsoid(DELTALAB_CAMERA, root @ root.T, 3.0).spread / widths[:, None]
    expected = 9.0 * root @ root.T / np.outer(widths, widths)
    np.testing.assert_allclose(spread @ spread.T, expected, rtol=1e-9, atol=1e-9)
