"""Whether a calibrated camera's stated covariance tells the truth, on simulated views of a target.

    python -m benchmarks.camera_covariance [--seeds 200] [--views 15] [--noise 0.01] [--tilt 30] [--dots 0.05]

Views 550 to 850 mm away, tilted to 30 degrees, centres with noise of 0.01 px. For each of the camera's nine numbers the
variance of (estimate - truth) / standard error, which is 1 when the covariance is right (with 200 seeds to within 0.1),
and over all nine that of the errors freed from their correlations (to within 0.034). "Scale" is
that of the residuals in stated standard deviations; "x, y mm" the RMS error of the poses' positions across the line of
sight. The same

- without the model of the dots' size: the centres of the ellipses are taken for the images of the dots' centres. Far
  away that shifts all dots of a view alike, so that the poses get it, not the camera; near by both do;
- with dots of 0.05 mm off their places, not refined and refined (the errors of their places in mm too).
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.vision_scenes import facing_poses, one
from cpcal.common.values import Floats
from cpcal.robot import Pose
from cpcal.vision.calibrate import Calibration, TargetView, calibrate_camera
from cpcal.vision.camera import CAMERA_NUMBERS, DELTALAB_CAMERA, Camera
from cpcal.vision.projection import predicted_centers
from cpcal.vision.target import DELTALAB_TARGET, Target

_POINT = 1e-3  # mm: the radius of a dot without a size


@dataclass(frozen=True)
class Setting:
    """Where the target is: distance in mm, tilt in degrees at most; how many views; the centres' noise in px."""

    views: int = 15
    noise: float = 0.01
    tilt: float = 30.0
    distance: tuple[float, float] = (550.0, 850.0)


def simulated_views(
    rng: np.random.Generator, target: Target, camera: Camera, setting: Setting
) -> tuple[list[TargetView], list[Pose]]:
    """Views of the dots that are at least 10 px clear of the image's border, and the true poses."""
    views = []
    every = facing_poses(rng, setting.views, depth=setting.distance, tilt=setting.tilt)
    poses = [one(every, k) for k in range(setting.views)]
    for pose in poses:
        centers = predicted_centers(target, camera, pose)
        clear = (centers > 10.0) & (centers < np.array([camera.width - 11.0, camera.height - 11.0]))
        numbers = np.flatnonzero(clear.all(axis=1))
        found = centers[numbers] + setting.noise * rng.standard_normal((len(numbers), 2))
        views.append(TargetView(found, np.tile(setting.noise**2 * np.eye(2), (len(numbers), 1, 1)), numbers))
    return views, poses


def normalised_errors(found: Calibration, camera: Camera) -> tuple[Floats, Floats]:
    """(9,) errors by their standard errors, and freed from their correlations."""
    error = found.camera.numbers - camera.numbers
    factor = np.linalg.cholesky(found.covariance)
    return error / found.standard_errors, np.linalg.solve(factor, error)


def aligned(dots: Floats, stated: Floats) -> Floats:
    """Dots (n, 2) shifted, turned and scaled onto the stated ones, by least squares."""
    z, w = dots @ [1.0, 1.0j], stated @ [1.0, 1.0j]
    z = z - z.mean()
    moved = z * (np.vdot(z, w) / np.vdot(z, z)) + w.mean()
    return np.stack([moved.real, moved.imag], axis=1)


@dataclass(frozen=True)
class CalibrationKind:
    """One kind of calibration: the setting, the target that is assumed, how far dots are off it (mm), `refine_dots`."""

    setting: Setting
    true: Target
    assumed: Target
    off: float = 0.0
    refine: bool = False


def kinds(setting: Setting, off: float) -> dict[str, CalibrationKind]:
    stated = replace(DELTALAB_TARGET, lines=())
    near, large = replace(setting, distance=(250.0, 400.0), tilt=1.5 * setting.tilt), replace(stated, radius=9.0)
    return {
        "dots with their size": CalibrationKind(setting, stated, stated),
        "without their size": CalibrationKind(setting, stated, replace(stated, radius=_POINT)),
        "near, dots of 18 mm, with size": CalibrationKind(near, large, large),
        "near, dots of 18 mm, without": CalibrationKind(near, large, replace(large, radius=_POINT)),
        "dots off their places": CalibrationKind(setting, stated, stated, off),
        "dots off, refined": CalibrationKind(setting, stated, stated, off, refine=True),
    }


def calibrated(kind: CalibrationKind, seed: int) -> dict[str, Any]:
    """The figures of one calibration."""
    camera, rng = DELTALAB_CAMERA, np.random.default_rng(seed)
    places = kind.true.dots + (kind.off * rng.standard_normal(kind.true.dots.shape) if kind.off else 0.0)
    views, poses = simulated_views(rng, replace(kind.true, dots=places), camera, kind.setting)
    began = time.perf_counter()
    found = calibrate_camera(views, kind.assumed, (camera.width, camera.height), refine_dots=kind.refine)
    spent = time.perf_counter() - began
    single, free = normalised_errors(found, camera)
    pairs = zip(found.views, poses, strict=True)
    away = [view.pose.position - pose.position for view, pose in pairs if view.pose is not None]
    figures = {"single": single**2, "all": np.mean(free**2), "scale": found.scale, "seconds": spent}
    figures["across"] = np.mean(np.array(away)[:, :2] ** 2)
    if kind.refine:
        error = found.target.dots - aligned(places, kind.true.dots)
        figures["dots"] = np.nanmean(error**2)
        figures["dots normalised"] = np.nanmean((error / found.dot_errors) ** 2)
    return figures


def studied(kind: CalibrationKind, seeds: int) -> dict[str, Any]:
    """The means of a kind's figures over seeds, (9,) or a number."""
    rows = [calibrated(kind, seed) for seed in range(seeds)]
    return {key: np.mean([row[key] for row in rows], axis=0).tolist() for key in rows[0]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--views", type=int, default=15)
    parser.add_argument("--noise", type=float, default=0.01, help="px")
    parser.add_argument("--tilt", type=float, default=30.0, help="degrees, at most")
    parser.add_argument("--dots", type=float, default=0.05, help="mm, standard deviation of dots off their places")
    parser.add_argument("--only", default="", help="kinds of calibration whose names hold this")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    found: dict[str, dict[str, Any]] = {}
    print(f"variances of normalised errors, {options.seeds} seeds of {options.views} views, noise {options.noise:g} px")
    print(f"{'':32}" + "".join(f"{name:>8}" for name in CAMERA_NUMBERS) + "     all  scale  x, y mm    s")
    for name, kind in kinds(Setting(options.views, options.noise, options.tilt), options.dots).items():
        if options.only not in name:
            continue
        found[name] = figures = studied(kind, options.seeds)
        cells = "".join(f"{value:8.2f}" for value in figures["single"])
        rest = f"{figures['all']:8.2f}{figures['scale']:7.2f}{figures['across'] ** 0.5:9.4f}{figures['seconds']:5.1f}"
        print(f"{name:32}{cells}{rest}", flush=True)
        if kind.refine:
            print(f"{'':32}refined dots: errors {figures['dots'] ** 0.5:.4f} mm RMS,", end=" ")
            print(f"variance of normalised errors {figures['dots normalised']:.2f}")
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
