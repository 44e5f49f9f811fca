"""Guaranteed pose sets on simulated dots: do they hold the true pose, how wide are they, how long does it take.

    python -m benchmarks.pose_sets [--trials 500] [--half-width 0.03 0.1] [--outliers 0] [--json FILE]

Each trial is another pose: 550 to 850 mm away, tilted by up to 30 degrees, all dots that the image shows. The dots
are projected exactly and moved within the pixel box: every second trial at random ("uniform"), the others to its
corners, so that all of them push the pose the same way in a direction that is drawn anew each time ("adversarial").
"exact" are trials of their own, a tenth as many: boxes around the true pixels, the widest sets. With outliers, as many
dots are displaced by 10 to 40 pixels besides.

Widths are half-widths of the set, medians over the trials; beside them 3 sigma of least squares when the errors of the
same boxes are uniform and independent (sigma = half-width / sqrt 3), which holds the truth by statistics, not always.
The time is that of one processor.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.values import Floats
from cpcal.robot import Pose, normalised, quaternion_from_rotation_vector, quaternion_product, transformed
from cpcal.solver.contract import Verdict
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.pose_sets import PixelBoxes, enclose_pose
from cpcal.vision.target import DELTALAB_TARGET, Target

COLUMNS = ("x", "y", "z", "rx", "ry", "rz")
_INSIDE = 1.0 - 1e-9  # errors end short of the box, for the projection itself is rounded
_FACING = np.array([0.0, 1.0, 0.0, 0.0])  # z of the target towards the camera


def drawn_pose(rng: np.random.Generator) -> Pose:
    """A pose of the target in front of the camera, turned anyhow, tilted by up to 30 degrees."""
    distance, about = rng.uniform(550.0, 850.0), rng.uniform(-np.pi, np.pi)
    position = np.array([*(0.05 * distance * rng.uniform(-1.0, 1.0, 2)), distance])
    tilt = rng.uniform(0.0, np.radians(30.0)) * np.array([np.cos(about), np.sin(about), 0.0])
    turn = quaternion_from_rotation_vector([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    upright = quaternion_product(_FACING, turn)
    return Pose(position, normalised(quaternion_product(quaternion_from_rotation_vector(tilt), upright)))


def pixels_and_slopes(target: Target, camera: Camera, pose: Pose) -> tuple[Floats, Floats]:
    """Projections (n, 2) and their derivatives (n, 2, 6) by position (mm) and rotation vector (rad, camera frame)."""
    points = transformed(pose, target.points)
    depth = points[:, 2]
    direction = points[:, :2] / depth[:, None]
    by_point = np.zeros((len(points), 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = 1.0 / depth
    by_point[:, :, 2] = -direction / depth[:, None]
    lens = camera.focal[:, None] * camera.distortion_jacobian(direction)
    arm, zero = points - pose.position, np.zeros(len(points))
    x, y, z = arm.T
    turn = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)  # of w x arm by w
    by_pose = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=2)
    return camera.project(points), lens @ by_point @ by_pose


def errors(kind: str, slopes: Floats, half_width: float, rng: np.random.Generator) -> Floats:
    """Displacements (m, 2) within the box."""
    size = _INSIDE * half_width
    if kind == "exact":
        return np.zeros(slopes.shape[:2])
    if kind == "uniform":
        return rng.uniform(-size, size, slopes.shape[:2])
    scale = np.sqrt((slopes**2).sum(axis=(0, 1)))
    pushed: Floats = size * np.sign(slopes @ (rng.standard_normal(6) / scale))
    return pushed


def trial(kind: str, half_width: float, outliers: int, rng: np.random.Generator) -> dict[str, Any]:
    """One image: whether its set holds the truth, half-widths, 3 sigma, seconds."""
    target, camera = DELTALAB_TARGET, DELTALAB_CAMERA
    pose = drawn_pose(rng)
    pixels, slopes = pixels_and_slopes(target, camera, pose)
    numbers = np.flatnonzero(((pixels > 1.0) & (pixels < [camera.width - 2.0, camera.height - 2.0])).all(axis=1))
    slopes = slopes[numbers]
    centers = pixels[numbers] + errors(kind, slopes, half_width, rng)
    wrong = rng.choice(len(numbers), outliers, replace=False)
    away = rng.choice([-1.0, 1.0], (outliers, 2)) * rng.uniform(10.0, 40.0, (outliers, 2))
    centers[wrong] = np.clip(centers[wrong] + away, 0.0, [camera.width - 1.0, camera.height - 1.0])
    begin = time.process_time()
    found = enclose_pose(PixelBoxes.around(numbers, centers, half_width), target, camera, outliers=outliers)
    seconds = time.process_time() - begin
    rows = slopes.reshape(-1, 6)
    sigma = half_width / np.sqrt(3.0) * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    nothing = np.full(3, np.nan)
    radii = (nothing if r is None else r for r in (found.position_radius, found.rotation_radius))
    return {
        "verdict": found.verdict.value,
        "inside": found.verdict is not Verdict.REFUTED and (found.pose is None or pose in found),
        "half-widths": np.concatenate(list(radii)).tolist(),
        "three sigma": (3.0 * sigma).tolist(),
        "seconds": seconds,
    }


def studied(trials: int, half_width: float, outliers: int = 0, seed: int = 0) -> dict[str, list[dict[str, Any]]]:
    """All trials of one half-width, by the kind of their errors."""
    rng = np.random.default_rng(seed)
    out: dict[str, list[dict[str, Any]]] = {"uniform": [], "adversarial": [], "exact": []}
    for k in range(trials):
        kind = ("uniform", "adversarial")[k % 2]
        out[kind].append(trial(kind, half_width, outliers, rng))
    for _ in range(trials // 10):
        out["exact"].append(trial("exact", half_width, outliers, rng))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--half-width", type=float, nargs="+", default=[0.03, 0.1], help="pixels")
    parser.add_argument("--outliers", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    told = {}
    for half_width in options.half_width:
        found = told[str(half_width)] = studied(options.trials, half_width, options.outliers, options.seed)
        print(f"boxes of +-{half_width} px, {options.outliers} outliers; half-widths in um and urad")
        print(f"{'errors':<12} {'trials':>6} {'inside':>6} {'proved':>6} {'s':>6} {'s max':>6}", end=" ")
        print(" ".join(f"{name:>7}" for name in COLUMNS))
        for kind, rows in found.items():
            _print(kind, rows)
        every = [row for rows in found.values() for row in rows]
        print(f"{'3 sigma':<46} {_numbers([row['three sigma'] for row in every])}\n")
    if options.json:
        options.json.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


def _print(kind: str, rows: list[dict[str, Any]]) -> None:
    if not rows:
        return
    inside, proved = sum(row["inside"] for row in rows), sum(row["verdict"] == "proved" for row in rows)
    seconds = [row["seconds"] for row in rows]
    print(f"{kind:<12} {len(rows):6} {inside:6} {proved:6} {np.median(seconds):6.2f} {max(seconds):6.2f}", end=" ")
    print(_numbers([row["half-widths"] for row in rows]))


def _numbers(rows: list[list[float]]) -> str:
    return " ".join(f"{value:7.1f}" for value in 1e3 * np.nanmedian(rows, axis=0) * [1, 1, 1, 1e3, 1e3, 1e3])


if __name__ == "__main__":
    main()
