"""Guaranteed pose sets on simulated dots: do they hold the true pose, how wide are they, how long does it take.

    python -m benchmarks.pose_sets [--trials 500] [--half-width 0.03] [--outliers 0]
    python -m benchmarks.pose_sets --uncertain [--trials 60] [--half-width 0.05] [--certified 6]

Each trial is another pose: 550 to 850 mm away, tilted by up to 30 degrees, all dots that the image shows. The dots
are projected exactly and moved within the pixel box: every second trial at random ("uniform"), the others to its
corners, so that all of them push the pose the same way in a direction that is drawn anew each time ("adversarial").
"exact" are trials of their own, a tenth as many: boxes around the true pixels, the widest sets. With outliers, as many
dots are displaced by 10 to 40 pixels besides. Beside them 3 sigma of least squares when the errors of the same boxes
are uniform and independent (sigma = half-width / sqrt 3), which holds the truth by statistics, not always.

With `--uncertain` the camera is exact, known to intervals, or in the ellipsoid of a calibration from 18 views of the
same camera (factor 5); plates are exact or have dots off by up to 0.01 mm in x, y and z. Each trial draws camera and
plate from their sets, and moves the centres of the dots' images at random within the boxes. The first `--certified`
trials of each row are certified too, and checked.

Widths are half-widths of the sets, medians over the trials, um and urad; seconds are those of one processor.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.vision_scenes import Setting, facing_poses, one, simulated_views
from cpcal.checker.sight import check_pose_set
from cpcal.common.values import Floats, Indices
from cpcal.models.sight import CameraSet, PixelBoxes, PoseSet, TargetSet, enclose_pose
from cpcal.robot import Pose, transformed
from cpcal.solver.contract import Verdict
from cpcal.vision.calibrate import calibrate_camera
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.projection import predicted_centers
from cpcal.vision.target import DELTALAB_TARGET, Target

COLUMNS = ("x", "y", "z", "rx", "ry", "rz")
PLATE = 0.01  # mm
_INSIDE = 1.0 - 1e-9  # errors end short of the box, for the projection itself is rounded
_BORDER = 10.0  # pixels


def drawn_pose(rng: np.random.Generator) -> Pose:
    """A pose of the target in front of the camera, turned anyhow, tilted by up to 30 degrees."""
    return one(facing_poses(rng, 1), 0)


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
    inside = found.verdict is not Verdict.REFUTED and (found.pose is None or pose in found)
    figures = {"verdict": found.verdict.value, "inside": inside, "widths": _widths(found), "seconds": seconds}
    return figures | {"three sigma": 3.0 * sigma}


def _widths(found: PoseSet) -> Floats:
    nothing = np.full(3, np.nan)
    return np.concatenate([nothing if r is None else r for r in (found.position_radius, found.rotation_radius)])


def calibrated() -> CameraSet:
    """The ellipsoid of a calibration from 18 views with centres good to 0.005 px, about the true camera."""
    views, _ = simulated_views(np.random.default_rng(0), DELTALAB_TARGET, DELTALAB_CAMERA, Setting(18, noise=0.005))
    found = calibrate_camera(views, DELTALAB_TARGET, (DELTALAB_CAMERA.width, DELTALAB_CAMERA.height))
    return CameraSet.ellipsoid(DELTALAB_CAMERA, found.covariance, 5.0)


def shown(rng: np.random.Generator, pose: Pose, cameras: CameraSet, targets: TargetSet) -> tuple[Indices, Floats]:
    """Numbers of dots, and centres (m, 2) of their images, of a camera and a plate drawn from their sets."""
    t = rng.uniform(-1.0, 1.0, cameras.spread.shape[1])
    t /= max(1.0, float(np.linalg.norm(t)))
    camera = cameras.camera.with_numbers(cameras.camera.numbers + cameras.spread @ t)
    off = targets.half_widths * rng.uniform(-1.0, 1.0, targets.half_widths.shape)
    flat = replace(targets.target, dots=targets.target.dots + off[:, :2])
    high = transformed(pose, flat.points + [0.0, 0.0, 1.0] * off)
    centers = predicted_centers(flat, camera, pose) + camera.project(high)
    centers = centers - camera.project(transformed(pose, flat.points))
    size = np.array([camera.width, camera.height])
    numbers = np.flatnonzero(((centers > _BORDER) & (centers < size - _BORDER)).all(axis=1))
    return numbers, centers[numbers]


def uncertain_trial(
    rng: np.random.Generator, cameras: CameraSet, targets: TargetSet, half: float, certified: bool
) -> dict[str, Any]:
    """The same of one camera and plate of the sets, certified and checked where that is asked for."""
    pose = drawn_pose(rng)
    numbers, centers = shown(rng, pose, cameras, targets)
    moved = centers + 0.999 * half * rng.uniform(-1.0, 1.0, centers.shape)
    boxes = PixelBoxes.around(numbers, moved, half, of_images=True)
    begin = time.process_time()
    found = enclose_pose(boxes, targets, cameras)
    figures: dict[str, Any] = {
        "seconds": time.process_time() - begin,
        "inside": pose in found,
        "widths": _widths(found),
    }
    if certified:
        with tempfile.TemporaryDirectory() as folder:
            written = enclose_pose(boxes, targets, cameras, certificate=Path(folder) / "one")
            checked = check_pose_set(Path(folder) / "one.pose.json")
        figures["accepted"] = checked.refused is None and checked.radii is not None and pose in written
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--half-width", type=float, default=0.03, help="pixels")
    parser.add_argument("--outliers", type=int, default=0)
    parser.add_argument("--uncertain", action="store_true", help="cameras and plates of sets")
    parser.add_argument("--certified", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    print(f"boxes of +-{asked.half_width} px, {asked.outliers} outliers; half-widths in um and urad")
    print(f"{'':<18} {'inside':>7} {'s':>6}", " ".join(f"{name:>7}" for name in COLUMNS))
    if asked.uncertain:
        plates = {"": TargetSet.within(DELTALAB_TARGET), ", plate": TargetSet.within(DELTALAB_TARGET, PLATE)}
        cameras = {"exact": CameraSet(DELTALAB_CAMERA), "ellipsoid": calibrated()}
        for (name, camera), (with_, plate) in ((c, p) for c in cameras.items() for p in plates.items()):
            rng = np.random.default_rng(asked.seed)
            times = range(asked.trials)
            _print(
                name + with_,
                [uncertain_trial(rng, camera, plate, asked.half_width, k < asked.certified) for k in times],
            )
        return
    rows: dict[str, list[dict[str, Any]]] = {"uniform": [], "adversarial": [], "exact": []}
    for k in range(asked.trials):
        kind = ("uniform", "adversarial")[k % 2]
        rows[kind].append(trial(kind, asked.half_width, asked.outliers, rng))
    rows["exact"] = [trial("exact", asked.half_width, asked.outliers, rng) for _ in range(asked.trials // 10)]
    for kind, found in rows.items():
        _print(kind, found)
    print(f"{'3 sigma':<33}", _numbers([row["three sigma"] for found in rows.values() for row in found]))


def _print(kind: str, rows: list[dict[str, Any]]) -> None:
    if rows:
        inside, seconds = sum(row["inside"] for row in rows), np.median([row["seconds"] for row in rows])
        refused = sum(not row.get("accepted", True) for row in rows)
        numbers = _numbers([row["widths"] for row in rows]) + (f"  {refused} REFUSED" if refused else "")
        print(f"{kind:<18} {inside:3}/{len(rows):<3} {seconds:6.2f}", numbers, flush=True)


def _numbers(rows: list[Floats]) -> str:
    return " ".join(f"{value:7.1f}" for value in 1e3 * np.nanmedian(rows, axis=0) * [1, 1, 1, 1e3, 1e3, 1e3])


if __name__ == "__main__":
    main()
