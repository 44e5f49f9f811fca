"""Identification, pose and the chain for one image, on synthetic dots and rendered images of the DeltaLab target.

    python -m benchmarks.vision_accuracy [--lists 2000] [--shown 0] [--images 200] [--seed 0] [--json FILE]

`--images 0` leaves out 2 and 3.

1. Identification: lists of predicted centres with noise, in random order, up to 10 dots missing and false ones added,
   anywhere or on the very rows that identify the target; and a target that is partly out of the image. Counted: right,
   refused, wrong (a single wrong pair is wrong). Nothing is rendered here: these are lists, not images. With --shown
   so many rendered images have such dots missing, and false ones printed on the plate, and are measured as images are.
2. Poses from rendered images, at the nominal setting (700 mm, blur 0.8 px, noise 2 grey levels) and over the whole
   range (550 to 850 mm, tilt to 30 degrees, blur 0.5 to 1.2 px, noise 1 to 4): root mean square and largest errors per
   axis, mean square of the errors normalised by the stated covariance (should be 1), time per stage on one core.
3. Images that show no target, or not enough of it: the reason for each.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.vision_scenes import facing_poses, found_dots, one, spoiled_dots
from cpcal.common.values import Floats
from cpcal.robot import Pose, quaternion_conjugate, quaternion_product, rotation_vector
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.identify import Unidentified, identify
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.opencv import opencv
from cpcal.vision.pose import PoseEstimate
from cpcal.vision.projection import predicted_centers
from cpcal.vision.render import Scene, render
from cpcal.vision.target import DELTALAB_TARGET

MOST = 10  # false and missing dots
WRONG = 3.0  # pixels between a dot and where the truth sees the one that it is taken for
KINDS = ("none", "anywhere", "missing on the rows", "false on the rows", "both on the rows")
ASIDE = "partly out of view"
AXES = ("x mm", "y mm", "z mm", "about x deg", "about y deg", "about z deg")


def spoiled(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """How many dots are missing and false: at most MOST in all."""
    total = int(rng.integers(1, MOST + 1))
    missing = int(rng.integers(0, total + 1))
    return {
        "none": {},
        ASIDE: {"missing": missing // 2, "false": (total - missing) // 2},
        "anywhere": {"missing": missing, "false": total - missing},
        "missing on the rows": {"missing": total, "on_rows": True},
        "false on the rows": {"false": total, "on_rows": True},
        "both on the rows": {"missing": missing, "false": total - missing, "on_rows": True},
    }[kind]


@dataclass(frozen=True)
class Attempt:
    """One list or image: `right` None where it was refused, for the reason `why`; dots that were left out, and how long
    it took, s."""

    right: bool | None
    seconds: float
    left_out: int = 0
    why: str = ""


def counted(
    count: int, seed: int, tried: Callable[[np.random.Generator, Pose, str, int], Attempt]
) -> dict[str, dict[str, Any]]:
    """For each kind: right, refused by reason, wrong, dots left out, median and largest ms; so many trials in all."""
    rng = np.random.default_rng(seed)
    result = {}
    for kind in (*KINDS, ASIDE):
        each = count // (len(KINDS) + 1)
        poses = facing_poses(rng, each)
        if kind == ASIDE:
            poses.position[:, :2] += rng.uniform(-200.0, 200.0, (each, 2))
        attempts = [tried(rng, one(poses, k), kind, k) for k in range(each)]
        times = [1e3 * attempt.seconds for attempt in attempts]
        result[kind] = {
            "right": sum(attempt.right is True for attempt in attempts),
            "refused": sum(attempt.right is None for attempt in attempts),
            "wrong": sum(attempt.right is False for attempt in attempts),
            "left out": sum(attempt.left_out for attempt in attempts),
            "median ms": float(np.median(times)),
            "largest ms": float(np.max(times)),
            "reasons": dict(Counter(attempt.why for attempt in attempts if attempt.right is None)),
        }
    return result


def identified(lists: int, seed: int) -> dict[str, dict[str, Any]]:
    """Lists of dots, without images."""

    def tried(rng: np.random.Generator, pose: Pose, kind: str, _: int) -> Attempt:
        centers, labels = found_dots(rng, DELTALAB_TARGET, DELTALAB_CAMERA, pose, noise=0.02, **spoiled(rng, kind))
        begin = perf_counter()
        try:
            found = identify(centers, DELTALAB_TARGET, DELTALAB_CAMERA)
        except Unidentified as refusal:
            return Attempt(None, perf_counter() - begin, why=str(refusal))
        seconds = perf_counter() - begin
        right = np.array_equal(labels[found.found], found.numbers)
        return Attempt(right, seconds, int((labels >= 0).sum()) - len(found.found))

    return counted(lists, seed, tried)


def shown(images: int, seed: int) -> dict[str, dict[str, Any]]:
    """The same of rendered images, blur 0.5 to 1.2 px and noise 1 to 4: from pixels to pose."""

    def tried(rng: np.random.Generator, pose: Pose, kind: str, k: int) -> Attempt:
        how = {"missing": 0, "false": 0, "on_rows": False, **spoiled(rng, kind)}
        kept, places = spoiled_dots(rng, DELTALAB_TARGET, DELTALAB_CAMERA, pose, **how, apart=2.5)
        plate = replace(DELTALAB_TARGET, dots=np.concatenate([DELTALAB_TARGET.dots, places]))
        hidden = tuple(np.setdiff1d(np.arange(len(DELTALAB_TARGET.dots)), kept).tolist())
        scene = Scene(blur=rng.uniform(0.5, 1.2), noise=rng.uniform(1.0, 4.0))
        image = render(plate, DELTALAB_CAMERA, pose, scene, seed=seed + k, hidden=hidden)
        begin = perf_counter()
        try:
            found = measure_pose(image, DELTALAB_TARGET, DELTALAB_CAMERA)
        except NotMeasured as refusal:
            why = "".join("#" if c.isdigit() else c for c in str(refusal))
            return Attempt(None, perf_counter() - begin, why=why)
        seconds = perf_counter() - begin
        told = found.dots.centers[found.identification.found]
        true = predicted_centers(DELTALAB_TARGET, DELTALAB_CAMERA, pose)[found.identification.numbers]
        right = not np.linalg.norm(told - true, axis=1).max() > WRONG
        return Attempt(bool(right), seconds, len(kept) - len(told))

    return counted(images, seed, tried)


def pose_error(true: Pose, estimate: PoseEstimate) -> Floats:
    """(6,): true minus estimated position (mm), and the rotation vector (rad) from the estimate to the truth."""
    turn = quaternion_product(true.quaternion, quaternion_conjugate(estimate.pose.quaternion))
    return np.concatenate([true.position - estimate.pose.position, rotation_vector(turn)])


def measured(images: int, seed: int, *, nominal: bool) -> dict[str, Any]:
    """Errors, normalised squares and times over rendered images."""
    rng = np.random.default_rng(seed)
    poses = facing_poses(rng, images, depth=(700.0, 700.0) if nominal else (550.0, 850.0))
    errors, squares, pixels, times = [], [], [], []
    refused: Counter[str] = Counter()
    for k in range(images):
        scene = Scene() if nominal else Scene(blur=rng.uniform(0.5, 1.2), noise=rng.uniform(1.0, 4.0))
        image = render(DELTALAB_TARGET, DELTALAB_CAMERA, one(poses, k), scene, seed=seed + k)
        try:
            found = measure_pose(image, DELTALAB_TARGET, DELTALAB_CAMERA)
        except NotMeasured as reason:
            refused[str(reason)] += 1
            continue
        error = pose_error(one(poses, k), found.estimate)
        errors.append(error)
        squares.append(np.linalg.solve(np.linalg.cholesky(found.covariance), error) ** 2)
        pixels.append(found.estimate.rms)
        times.append(found.seconds)
    error_table = np.array(errors) * np.repeat([1.0, np.degrees(1.0)], 3)
    return {
        "measured": len(errors),
        "refused": dict(refused),
        "rms": np.sqrt((error_table**2).mean(axis=0)).tolist(),
        "largest": np.abs(error_table).max(axis=0).tolist(),
        "normalised": np.mean(squares, axis=0).tolist(),
        "residual px": float(np.mean(pixels)),
        "median ms": {stage: 1e3 * float(np.median([t[stage] for t in times])) for stage in times[0]},
    }


def degenerate_images(seed: int) -> dict[str, npt.NDArray[np.generic]]:
    """Images without a target that could be measured, 1024 x 768 unless their name says otherwise."""
    rng = np.random.default_rng(seed)
    camera, target = DELTALAB_CAMERA, DELTALAB_TARGET
    poses = facing_poses(rng, 1, depth=(700.0, 700.0))
    pose = one(poses, 0)
    plain = render(target, camera, pose)
    shape = plain.shape
    beside, below = (Pose(pose.position + shift, pose.quaternion) for shift in ([420.0, 0.0, 0.0], [0.0, 400.0, 0.0]))
    on_rows = tuple(i for line in target.lines for i in line)
    checks = 200 * (np.add.outer(np.arange(shape[0]) // 40, np.arange(shape[1]) // 40) % 2)
    discs = np.full(shape, 20, dtype=np.uint8)
    y, x = np.indices(shape)
    discs[(x % 32 - 16) ** 2 + (y % 32 - 16) ** 2 < 64] = 220
    return {
        "black": np.zeros(shape, dtype=np.uint8),
        "white": np.full(shape, 255, dtype=np.uint8),
        "saturated": np.where(plain > 25, 255, plain).astype(np.uint8),
        "noise": rng.integers(0, 256, shape).astype(np.uint8),
        "blurred by 15 pixels": opencv().GaussianBlur(plain, (0, 0), 15.0),
        "half out, to the right": render(target, camera, beside),
        "half out, below": render(target, camera, below),
        "mirrored": np.ascontiguousarray(plain[:, ::-1]),
        "without its rows": render(target, camera, pose, hidden=on_rows),
        "chessboard": checks.astype(np.uint8),
        "a regular grid of dots": opencv().GaussianBlur(discs, (0, 0), 0.8),
        "1 x 1": np.zeros((1, 1), dtype=np.uint8),
        "100 megapixels": np.zeros((10_001, 10_000), dtype=np.uint8),
    }


def reasons(seed: int) -> dict[str, str]:
    """What is said about each of the degenerate images."""
    result = {}
    for name, image in degenerate_images(seed).items():
        try:
            found = measure_pose(image, DELTALAB_TARGET, DELTALAB_CAMERA)
            result[name] = f"measured: {len(found.identification.found)} dots, rms {found.estimate.rms:.4f} pixels"
        except NotMeasured as reason:
            result[name] = str(reason)
    return result


def print_identified(figures: dict[str, dict[str, Any]]) -> None:
    print(
        f"{'dots missing and false':24} {'right':>6} {'refused':>8} {'wrong':>6} {'left out':>9} {'ms':>6} {'most':>7}"
    )
    for kind, row in figures.items():
        counts = f"{row['right']:6} {row['refused']:8} {row['wrong']:6} {row['left out']:9}"
        print(f"{kind:24} {counts} {row['median ms']:6.1f} {row['largest ms']:7.1f}")


def print_measured(title: str, figures: dict[str, Any]) -> None:
    print(f"\n{title}: {figures['measured']} measured, refused {figures['refused'] or 0},", end=" ")
    print(f"residuals {figures['residual px']:.4f} pixels rms")
    print(f"{'':12}" + " ".join(f"{axis:>12}" for axis in AXES))
    for row in ("rms", "largest", "normalised"):
        print(f"{row:12}" + " ".join(f"{value:12.5f}" for value in figures[row]))
    times = figures["median ms"]
    print("median ms:  " + ", ".join(f"{stage} {value:.1f}" for stage, value in times.items()), end="")
    print(f"; in all {sum(times.values()):.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lists", type=int, default=2000, help="of dots, for the identification")
    parser.add_argument("--shown", type=int, default=0, help="rendered images with dots missing and false")
    parser.add_argument("--images", type=int, default=200, help="rendered, for each of the two settings; 0: none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    opencv().setNumThreads(1)
    figures: dict[str, Any] = {"identification": identified(options.lists, options.seed)}
    print_identified(figures["identification"])
    if options.shown:
        figures["shown"] = shown(options.shown, options.seed)
        print_identified(figures["shown"])
        print(*(f"{kind}: {row['reasons']}" for kind, row in figures["shown"].items() if row["reasons"]), sep="\n")
    if not options.images:
        return
    for title, nominal in (("nominal setting", True), ("whole range", False)):
        figures[title] = measured(options.images, options.seed, nominal=nominal)
        print_measured(title, figures[title])
    figures["degenerate"] = reasons(options.seed)
    print()
    for name, reason in figures["degenerate"].items():
        print(f"{name:24} {reason}")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
