"""Guaranteed pose sets: the true pose is inside, the set is hardly wider than it must be, and nothing is guessed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from benchmarks.pose_sets import drawn_pose, main, pixels_and_slopes, trial
from cpcal.common.errors import InputError
from cpcal.models.sight import Frames, PixelBoxes, PoseSet, TargetSet, enclose_pose
from cpcal.robot import (
    Pose,
    compose,
    inverse,
    normalised,
    quaternion_from_rotation_vector,
    quaternion_product,
    transformed,
)
from cpcal.simulate import simulate_study
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


@pytest.mark.parametrize("kind", ["uniform", "adversarial", "exact"])
def test_the_true_pose_is_inside(kind: str) -> None:
    rng = np.random.default_rng(["uniform", "adversarial", "exact"].index(kind))
    for half_width in (0.03, 0.5):
        row = trial(kind, half_width, 0, rng)
        assert row["verdict"] == "proved"
        assert row["inside"]


def test_the_set_is_hardly_wider_than_it_must_be() -> None:
    """In each of the twelve directions a pose of the set, found otherwise, is at 96 % of the stated half-width."""
    half_width, pixels = 0.1, shown()
    _, slopes = pixels_and_slopes(DELTALAB_TARGET, DELTALAB_CAMERA, NOMINAL)
    found = enclose_pose(PixelBoxes.around(ALL, pixels, half_width), DELTALAB_TARGET, DELTALAB_CAMERA)
    stated, rows = radii(found), slopes.reshape(-1, 6)
    assert found.pose is not None
    for k in range(6):
        for sign in (1.0, -1.0):
            goal = -sign * np.eye(6)[k] * stated
            scaled = rows * stated / half_width
            best = linprog(
                goal / stated, A_ub=np.vstack([scaled, -scaled]), b_ub=np.ones(2 * len(rows)), bounds=(-2, 2)
            )
            pose = moved(NOMINAL, 0.985 * best.x * stated)
            assert np.abs(shown(pose) - pixels).max() <= half_width
            assert pose in found
            assert sign * 0.985 * best.x[k] > 0.98 * 0.985


def test_membership_is_proved() -> None:
    found = enclose_pose(PixelBoxes.around(ALL, shown(), 0.05), DELTALAB_TARGET, DELTALAB_CAMERA)
    assert found.pose in found
    assert NOMINAL in found
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1.05 * radii(found)[k]
        assert moved(found.pose, step) not in found
        assert moved(found.pose, step / 1.1) in found
    opposite = Pose(NOMINAL.position, quaternion_product([0.0, 0.0, 0.0, 1.0], NOMINAL.quaternion))
    assert opposite not in found


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
    line = list(DELTALAB_TARGET.lines[0])
    for chosen in (line, [0, 6]):
        boxes = PixelBoxes.around(chosen, pixels[chosen], 0.1)
        found = enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA)
        assert found.verdict is Verdict.UNKNOWN
        assert found.reason
        assert found.status.startswith("Nothing is proved")
        assert NOMINAL not in found


def test_boxes_of_forty_pixels_bound_a_pose() -> None:
    found = enclose_pose(PixelBoxes.around(ALL, shown(), 40.0), DELTALAB_TARGET, DELTALAB_CAMERA)
    assert NOMINAL in found
    assert radii(found)[3:].max() < 3.0


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


def test_poses_of_the_mobile_frame_in_the_base_frame() -> None:
    truth = simulate_study(seed=1, runs=1, validation_runs=1, random_poses=1).truth
    assert truth is not None
    mobile = Pose(np.array([3.0, -4.0, 430.0]), quaternion_from_rotation_vector([0.1, 0.2, -0.05]))
    seen = compose(compose(truth.camera, mobile), truth.target)
    rng = np.random.default_rng(3)
    boxes = PixelBoxes.around(ALL, shown(seen) + rng.uniform(-0.05, 0.05, (len(ALL), 2)), 0.05)
    there = enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA, frames=Frames(truth.camera, truth.target))
    here = enclose_pose(boxes, DELTALAB_TARGET, DELTALAB_CAMERA)
    assert mobile in there
    assert seen in here
    assert seen not in there
    assert here.pose is not None
    back = compose(compose(inverse(truth.camera), here.pose), inverse(truth.target))
    assert np.abs(back.position - there.pose.position).max() < 0.02  # the middles of two boxes around one set
    assert radii(there)[:3].max() < 0.05
    assert radii(there)[3:].max() < 1e-3
    scaled = enclose_pose(
        boxes,
        TargetSet.within(DELTALAB_TARGET, 0.0, scale=1e-3),
        DELTALAB_CAMERA,
        frames=Frames(truth.camera, truth.target),
    )
    farther = Pose(1.000999 * seen.position, seen.quaternion)
    assert compose(compose(inverse(truth.camera), farther), inverse(truth.target)) in scaled
    assert (radii(scaled)[:3] - radii(there)[:3]).max() < 1.1e-3 * np.linalg.norm(seen.position)
    assert (radii(scaled)[3:] == radii(there)[3:]).all()


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
    small = Target("three", DELTALAB_TARGET.dots[:30], 6.0, ())
    outside = PixelBoxes.around(ALL, pixels + [2000.0, 0.0], 0.1)
    with pytest.raises(InputError, match="dot 30"):
        enclose_pose(good, small, DELTALAB_CAMERA)
    with pytest.raises(InputError, match="field of view"):
        enclose_pose(outside, DELTALAB_TARGET, DELTALAB_CAMERA)
    with pytest.raises(InputError, match="outliers"):
        enclose_pose(good, DELTALAB_TARGET, DELTALAB_CAMERA, outliers=-1)
    for camera in (
        Pose(np.zeros(3), np.zeros(4)),
        Pose(np.zeros((2, 3)), np.array([1.0, 0.0, 0.0, 0.0])),
        Pose(np.array([0.0, np.nan, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])),
    ):
        with pytest.raises(InputError, match="frames camera"):
            Frames(camera)


def test_the_benchmark_prints_a_table(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["pose_sets", "--trials", "2", "--half-width", "0.1", "--outliers", "1"])
    main()
    told = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in told[2:4]] == [["uniform", "1/1"], ["adversarial", "1/1"]]
    assert told[4].startswith("3 sigma")
