"""Guaranteed pose sets when camera and target are uncertain: is the true pose inside, and how wide is the set?

    python -m benchmarks.uncertain_poses [--trials 60] [--half-width 0.05] [--certified 6] [--seed 0]

Each trial draws a pose (as `benchmarks.pose_sets`), a camera and a plate from their sets, shows the dots, moves the
centres of their images at random within the boxes of pixels, and asks for the pose with those sets. The camera is
exact, known to intervals, or in the ellipsoid of a calibration from 18 views of the same camera (factor 5); plates are
exact or have dots off by up to 0.01 mm in x, y and z. The first `--certified` trials of each row are certified too, and
checked.

Widths are half-widths of the sets, medians, um and urad; "times z" is how much wider in z than with exact camera and
plate, the first row.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.camera_covariance import Setting, simulated_views
from benchmarks.pose_sets import COLUMNS, drawn_pose
from cpcal.checker.pose_claim import check_pose_set
from cpcal.common.values import Floats, Indices
from cpcal.robot import Pose, transformed
from cpcal.vision.calibrate import calibrate_camera
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.pose_sets import CameraSet, PixelBoxes, TargetSet, enclose_pose
from cpcal.vision.projection import predicted_centers
from cpcal.vision.target import DELTALAB_TARGET

INTERVALS = np.array([0.2, 0.2, 0.1, 0.1, 2e-4, 2e-4, 2e-5, 2e-5, 1e-4])
PLATE = 0.01  # mm
_BORDER = 10.0  # pixels


def calibrated() -> CameraSet:
    """The ellipsoid of a calibration from 18 views with centres good to 0.005 px, about the true camera."""
    views, _ = simulated_views(np.random.default_rng(0), DELTALAB_TARGET, DELTALAB_CAMERA, Setting(18, noise=0.005))
    found = calibrate_camera(views, DELTALAB_TARGET, (DELTALAB_CAMERA.width, DELTALAB_CAMERA.height))
    return CameraSet.ellipsoid(DELTALAB_CAMERA, found.covariance, 5.0)


def shown(rng: np.random.Generator, pose: Pose, cameras: CameraSet, targets: TargetSet) -> tuple[Indices, Floats]:
    """Numbers of dots, and centres (m, 2) of their images, of a camera and a plate drawn from their sets."""
    t = rng.uniform(-1.0, 1.0, cameras.size)
    t = t / max(1.0, float(np.linalg.norm(t))) if cameras.ball else t
    camera = cameras.camera.with_numbers(cameras.camera.numbers + cameras.spread @ t)
    off = targets.half_widths * rng.uniform(-1.0, 1.0, targets.half_widths.shape)
    flat = replace(targets.target, dots=targets.target.dots + off[:, :2], lines=())
    high = transformed(pose, flat.points + [0.0, 0.0, 1.0] * off)
    centers = predicted_centers(flat, camera, pose) + camera.project(high)
    centers = centers - camera.project(transformed(pose, flat.points))
    size = np.array([camera.width, camera.height])
    numbers = np.flatnonzero(((centers > _BORDER) & (centers < size - _BORDER)).all(axis=1))
    return numbers, centers[numbers]


def trial(rng: np.random.Generator, cameras: CameraSet, targets: TargetSet, half: float, folder: Path | None) -> Any:
    pose = drawn_pose(rng)
    numbers, centers = shown(rng, pose, cameras, targets)
    moved = centers + 0.999 * half * rng.uniform(-1.0, 1.0, centers.shape)
    boxes = PixelBoxes.around(numbers, moved, half, of_images=True)
    begin = time.process_time()
    found = enclose_pose(boxes, targets, cameras)
    out: dict[str, Any] = {
        "seconds": time.process_time() - begin,
        "inside": pose in found,
        "accepted": None,
        "checking": np.nan,
    }
    parts = (np.full(3, np.nan) if part is None else part for part in (found.position_radius, found.rotation_radius))
    out["widths"] = np.concatenate(list(parts))
    if folder is not None:
        written = enclose_pose(boxes, targets, cameras, certificate=folder / "one")
        begin = time.process_time()
        checked = check_pose_set(folder / "one.pose.json")
        out["checking"] = time.process_time() - begin
        out["accepted"] = checked.refused is None and checked.radii is not None and pose in written
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=60)
    parser.add_argument("--half-width", type=float, default=0.05, help="pixels")
    parser.add_argument("--certified", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    plates = {"": TargetSet.of(DELTALAB_TARGET), ", plate": TargetSet.within(DELTALAB_TARGET, PLATE)}
    cameras = {
        "exact": CameraSet(DELTALAB_CAMERA),
        "intervals": CameraSet.intervals(DELTALAB_CAMERA, INTERVALS),
        "ellipsoid": calibrated(),
    }
    print(f"boxes of +-{options.half_width} px; half-widths in um and urad, medians of {options.trials} trials")
    print(f"{'camera':<18} {'inside':>7} {'checked':>7} {'s':>5} {'check':>5}", end=" ")
    print(" ".join(f"{name:>7}" for name in COLUMNS), "  times z")
    first = None
    for name, camera in cameras.items():
        for plate, target in plates.items():
            rng = np.random.default_rng(options.seed)
            with tempfile.TemporaryDirectory() as folder:
                every = [Path(folder) if k < options.certified else None for k in range(options.trials)]
                rows = [trial(rng, camera, target, options.half_width, one) for one in every]
            widths = np.nanmedian([row["widths"] for row in rows], axis=0)
            first = widths[2] if first is None else first
            _print(name + plate, rows, widths, widths[2] / first)


def _print(name: str, rows: list[dict[str, Any]], widths: Floats, times: float) -> None:
    accepted = [row["accepted"] for row in rows if row["accepted"] is not None]
    inside = sum(row["inside"] for row in rows)
    seconds, checking = (np.nanmedian([row[key] for row in rows]) for key in ("seconds", "checking"))
    print(f"{name:<18} {inside:>3}/{len(rows):<3} {sum(accepted):>3}/{len(accepted):<3} {seconds:5.2f}", end=" ")
    print(f"{checking:5.2f}", " ".join(f"{v:7.1f}" for v in 1e3 * widths * [1, 1, 1, 1e3, 1e3, 1e3]), f"{times:7.2f}")


if __name__ == "__main__":
    main()
