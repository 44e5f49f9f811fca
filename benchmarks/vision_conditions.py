"""Poses by the condition of the image: found, right, and as good as stated?

    python -m benchmarks.vision_conditions [--images 10] [--seed 0] [--only WORD,...] [--calibrated N] [--json FILE]

Images come from `benchmarks.vision_world`, which shares no code with cpcal's renderer. For each condition: poses found;
images whose identification is wrong (a single wrong pair is wrong); the centres' RMS error, pixels; NEES/6, the mean of
e' C^-1 e / 6 over the poses' errors e and stated covariances C: 1 is honest; the largest error of position; how many
poses were marked as doubtful; the most frequent refusals. With --calibrated, the camera is not the true one: N are
calibrated, each from 18 images of the same renderer, and take turns; their covariances are part of C. Poses of one
camera share its errors, so that NEES/6 of a single camera is one draw and no mean.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.vision_scenes import facing_poses, one
from benchmarks.vision_world import World, photograph, true_centers
from cpcal.robot import Pose, quaternion_conjugate, quaternion_product, rotation_vector
from cpcal.vision.calibrate import calibrate_from_images
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.plate_and_camera import CameraRecord
from cpcal.vision.measure import MeasuredImage, NotMeasured, measure_pose
from cpcal.vision.opencv import opencv
from cpcal.vision.target import DELTALAB_TARGET

DIM = 0.55
CONDITIONS = {
    "plain": World(),
    "uneven light": World(gradient=(0.4, 0.3)),
    "defocus, radius 2 px": World(defocus=2.0),
    "motion, 3 px": World(motion=3.0),
    "motion, 6 px": World(motion=6.0),
    "noise 8": World(noise=8.0),
    "shot noise": World(noise=1.0, shot=0.1),
    "gamma 2.2": World(gamma=2.2),
    "JPEG 75": World(jpeg=75),
    "clutter: 20 discs": World("discs", 20, DIM),
    "clutter: 60 discs": World("discs", 60, DIM),
    "clutter: 150 discs": World("discs", 150, DIM),
    "clutter: checkerboard": World("checkerboard", level=DIM),
    "clutter: text": World("text", level=DIM),
    "clutter: photograph": World("photograph", level=0.8),
    "clutter: texture": World("texture", 4000, 0.9),
    "clutter: texture and discs": World("texture", 3000, DIM, gradient=(0.3, 0.0)),
    "clutter: a dimmer grid beside": World(second="foreign", dim=0.5),
    "shadow, 40 px soft": World(shadow=0.5),
    "shadow, 15 px soft": World(shadow=0.6, softness=15.0),
    "covered, a tenth": World(occluded=0.1),
    "covered, a quarter": World(occluded=0.25),
    "bent by 0.2 mm": World(bent=0.2),
    "two targets": World(second="same"),
    "a mirrored copy": World(second="mirrored", dim=0.9),
}
_VIEWS = 18
_WRONG = 3.0  # pixels between a dot and where the truth sees the one that it is taken for


@dataclass
class Figures:
    """What was seen of one condition."""

    images: int = 0
    wrong: int = 0
    squares: list[float] = field(default_factory=list)
    centers: list[float] = field(default_factory=list)
    position: list[float] = field(default_factory=list)
    doubtful: int = 0
    reasons: Counter[str] = field(default_factory=Counter)

    def row(self) -> dict[str, Any]:
        """Numbers for a table; nan where no pose was found."""
        found = len(self.squares)
        return {
            "images": self.images,
            "found": found,
            "wrong": self.wrong,
            "centres px": float(np.sqrt(np.mean(np.square(self.centers)))) if found else np.nan,
            "NEES/6": float(np.mean(self.squares)) if found else np.nan,
            "largest mm": max(self.position, default=np.nan),
            "doubtful": self.doubtful,
            "reasons": dict(self.reasons.most_common(3)),
        }


def poses_for(world: World, rng: np.random.Generator, count: int) -> Pose:
    """Facing the camera; farther away and to the left where a second plate stands beside."""
    poses = facing_poses(rng, count, depth=(800.0, 900.0) if world.second else (550.0, 850.0))
    shift = np.array([-170.0, 0.0, 0.0]) if world.second else np.zeros(3)
    return Pose(poses.position + shift, poses.quaternion)


def measured(world: World, images: int, seed: int, *records: CameraRecord) -> Figures:
    """Images by the true camera, poses by cameras that take turns."""
    rng = np.random.default_rng(seed)
    out, poses = Figures(), poses_for(world, rng, images)
    for k in range(images):
        true = one(poses, k)
        image = photograph(DELTALAB_TARGET, DELTALAB_CAMERA, true, world, rng)
        record = records[k % len(records)]
        out.images += 1
        try:
            found = measure_pose(image, DELTALAB_TARGET, record.camera, record.covariance)
        except NotMeasured as reason:
            out.reasons["".join("#" if c.isdigit() else c for c in str(reason))] += 1
            continue
        _add(out, found, true)
    return out


def _add(out: Figures, found: MeasuredImage, true: Pose) -> None:
    centers = true_centers(DELTALAB_TARGET, DELTALAB_CAMERA, true)
    pairs = found.dots.centers[found.identification.found] - centers[found.identification.numbers]
    if np.linalg.norm(pairs, axis=1).max() > _WRONG:
        out.wrong += 1
    turn = quaternion_product(true.quaternion, quaternion_conjugate(found.pose.quaternion))
    error = np.concatenate([true.position - found.pose.position, rotation_vector(turn)])
    out.squares.append(float(error @ np.linalg.solve(found.covariance, error)) / 6.0)
    out.doubtful += bool(found.doubt)
    used = found.centers - centers[found.numbers]
    out.centers.append(float(np.sqrt((used**2).mean())))
    out.position.append(float(np.abs(error[:3]).max()))


def calibrated(seed: int) -> CameraRecord:
    """From images of the plain world, tilted in different directions."""
    rng = np.random.default_rng(seed)
    poses = facing_poses(rng, _VIEWS, depth=(600.0, 750.0), tilt=35.0)
    images = [photograph(DELTALAB_TARGET, DELTALAB_CAMERA, one(poses, k), World(), rng) for k in range(_VIEWS)]
    return calibrate_from_images(images, DELTALAB_TARGET).record()


def line(name: str, row: dict[str, Any]) -> str:
    numbers = f"{row['centres px']:.4f} | {row['NEES/6']:.2f} | {row['largest mm']:.4f}"
    return f"| {name} | {row['found']} of {row['images']} | {row['wrong']} | {numbers} | {row['doubtful']} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=10, help="of each condition")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="words that a condition's name must hold one of")
    parser.add_argument("--calibrated", type=int, default=0, help="so many calibrated cameras instead of the true one")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    opencv().setNumThreads(1)
    records = [calibrated(options.seed + 1 + k) for k in range(options.calibrated)] or [CameraRecord(DELTALAB_CAMERA)]
    print("| condition | found | wrong | centres [px] | NEES/6 | largest error [mm] | doubtful |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    figures = {}
    for name, world in CONDITIONS.items():
        if not any(word in name for word in options.only.split(",")):
            continue
        figures[name] = measured(world, options.images, options.seed, *records).row()
        print(line(name, figures[name]), *(f"  {n} x {r}" for r, n in figures[name]["reasons"].items()), flush=True)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
