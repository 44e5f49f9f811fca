"""Ten images that `cpcal image detect` refuses, and why: their pictures, and the rows of the table in docs/images.md.

python docs/draw_refusals.py
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from benchmarks.vision_scenes import degenerate_images, one
from benchmarks.vision_world import CONDITIONS, World, photograph, poses_for
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.render import refusal
from cpcal.vision.target import DELTALAB_TARGET

HERE = Path(__file__).resolve().parent
WIDTH, COLOURS, SEED = 360, 16, 1
DEGENERATE = {
    "saturated": "Overexposed: dots and plate run together.",
    "noise": "Nothing but noise.",
    "blurred by 15 pixels": "Far out of focus.",
    "half out, to the right": "Half of the plate is out of the image.",
    "mirrored": "Seen in a mirror, or flipped by a program.",
    "without its rows": "The dots off the grid are covered: the grid that is left looks the same from four sides.",
    "a regular grid of dots": "Another plate.",
}


def cases() -> Iterator[tuple[str, Any, Camera]]:
    """What is wrong, the image, the camera that is said to have made it."""
    images = degenerate_images(SEED)
    yield from ((why, images[name], DELTALAB_CAMERA) for name, why in DEGENERATE.items())
    for name, why in (("two targets", "Two plates in sight."), ("a mirrored copy", "A plate and its mirror image.")):
        yield why, _taken(CONDITIONS[name]), DELTALAB_CAMERA
    wrong = DELTALAB_CAMERA.with_numbers(DELTALAB_CAMERA.numbers + np.array([0.0] * 4 + [0.05] + [0.0] * 4))
    yield "The camera's file is another lens's: k1 is off by 0.05.", _taken(World()), wrong


def _taken(world: World) -> Any:
    rng = np.random.default_rng(SEED)
    return photograph(DELTALAB_TARGET, DELTALAB_CAMERA, one(poses_for(world, rng, 1), 0), world, rng)


def main() -> None:
    for k, (why, image, camera) in enumerate(cases(), start=1):
        try:
            measure_pose(image, DELTALAB_TARGET, camera)
        except NotMeasured as reason:
            drawn = Image.open(io.BytesIO(refusal(image, str(reason), DELTALAB_TARGET.bright, WIDTH)))
            name = f"pictures/refused-{k:02}.png"
            drawn.quantize(COLOURS).save(HERE / name, optimize=True)
            print(f"| ![]({name}) | {why} | {reason} |")
        else:
            raise SystemExit(f"a pose was found: {why}")


if __name__ == "__main__":
    main()
