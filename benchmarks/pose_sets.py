"""Guaranteed pose sets on simulated dots: do they hold the true pose, how wide are they, how long does it take.

    python -m benchmarks.pose_sets [--trials 60] [--half-width 0.05] [--outliers 0] [--certified 6]

Each trial is another pose: 550 to 850 mm away, tilted by up to 30 degrees, all dots that the image shows. The camera is
exact or in the ellipsoid of a calibration from 18 views of the same camera (factor 5); plates are exact or have dots
off by up to 0.01 mm in x, y and z. Each trial draws camera and plate from their sets, and moves the centres of the
dots' images at random within the boxes; with outliers, as many dots by 10 to 40 pixels besides. The first `--certified`
trials of each row are certified too, and checked.

Widths are half-widths of the sets, medians over the trials, um and urad; seconds are those of one processor.
"""

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import run_by_hand
from benchmarks.vision_scenes import Setting, facing_poses, simulated_views
from cpcal.checker.sight import check_pose_set
from cpcal.common.values import Floats, Indices
from cpcal.models.sight import CameraSet, PixelBoxes, TargetSet, enclose_pose
from cpcal.robot import Pose, transformed
from cpcal.vision.calibrate import calibrate_camera
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.projection import predicted_centers
from cpcal.vision.target import DELTALAB_TARGET

COLUMNS = ("x", "y", "z", "rx", "ry", "rz")
PLATE = 0.01  # mm
_BORDER = 10.0  # pixels


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
    off = np.asarray(targets.half_widths) * rng.uniform(-1.0, 1.0, (len(targets.target.dots), 3))
    flat = replace(targets.target, dots=targets.target.dots + off[:, :2])
    high = transformed(pose, flat.points + [0.0, 0.0, 1.0] * off)
    centers = predicted_centers(flat, camera, pose) + camera.project(high)
    centers = centers - camera.project(transformed(pose, flat.points))
    size = np.array([camera.width, camera.height])
    numbers = np.flatnonzero(((centers > _BORDER) & (centers < size - _BORDER)).all(axis=1))
    return numbers, centers[numbers]


def trial(
    rng: np.random.Generator, cameras: CameraSet, targets: TargetSet, half: float, outliers: int, certified: bool
) -> dict[str, Any]:
    """One image: whether its set holds the truth, half-widths, seconds; certified and checked where that is asked."""
    pose = facing_poses(rng, 1).rows(0)
    numbers, centers = shown(rng, pose, cameras, targets)
    moved = centers + 0.999 * half * rng.uniform(-1.0, 1.0, centers.shape)
    wrong = rng.choice(len(numbers), outliers, replace=False)
    moved[wrong] += rng.choice([-1.0, 1.0], (outliers, 2)) * rng.uniform(10.0, 40.0, (outliers, 2))
    boxes = PixelBoxes.around(numbers, moved, half, of_images=True)
    begin = time.process_time()
    found = enclose_pose(boxes, targets, cameras, outliers=outliers)
    seconds, nothing = time.process_time() - begin, np.full(3, np.nan)
    widths = [nothing if r is None else r for r in (found.position_radius, found.rotation_radius)]
    figures = {"seconds": seconds, "inside": pose in found, "widths": np.concatenate(widths)}
    if certified:
        with tempfile.TemporaryDirectory() as folder:
            enclose_pose(boxes, targets, cameras, outliers=outliers, certificate=Path(folder) / "one")
            checked = check_pose_set(Path(folder) / "one.pose.json")
        figures["accepted"] = checked.refused is None and checked.radii is not None
    return figures


def main(trials: int = 60, half_width: float = 0.05, outliers: int = 0, certified: int = 6, seed: int = 0) -> None:
    print(f"boxes of +-{half_width} px, {outliers} outliers; half-widths in um and urad")
    print(f"{'':<18} {'inside':>7} {'s':>6}", " ".join(f"{name:>7}" for name in COLUMNS))
    plates = {"": TargetSet(DELTALAB_TARGET), ", plate": TargetSet(DELTALAB_TARGET, PLATE)}
    cameras = {"exact": CameraSet(DELTALAB_CAMERA), "ellipsoid": calibrated()}
    for (name, camera), (with_, plate) in ((c, p) for c in cameras.items() for p in plates.items()):
        rng, given = np.random.default_rng(seed), (camera, plate, half_width, outliers)
        rows = [trial(rng, *given, k < certified) for k in range(trials)]
        inside, seconds = sum(row["inside"] for row in rows), np.median([row["seconds"] for row in rows])
        widths = 1e3 * np.nanmedian([row["widths"] for row in rows], axis=0) * [1, 1, 1, 1e3, 1e3, 1e3]
        refused = sum(not row.get("accepted", True) for row in rows)
        numbers = " ".join(f"{value:7.1f}" for value in widths) + (f"  {refused} REFUSED" if refused else "")
        print(f"{name + with_:<18} {inside:3}/{len(rows):<3} {seconds:6.2f}", numbers, flush=True)


if __name__ == "__main__":
    run_by_hand(main)
