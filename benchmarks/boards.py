"""Our dots beside OpenCV's ChArUco and AprilTag boards: the same poses, plate, camera, light, blur and noise.

    python -m benchmarks.boards [--images 100] [--seed 1] [--settings nominal,sharp,poor] [-o FILE]

Each image's plate is 550 to 850 mm away, tilted by up to 30 degrees, turned at will and anywhere in view; every board
spans 292 mm of it. Pixel errors are per axis and against the exact projection, of all dots or corners that the method
identified. Pose errors are those of the middle of the plate (lateral: per axis across the camera's axis) and of the
rotation vector, per axis, all in the camera's frame. No image is left out: those without a pose are counted with their
reasons, and a pose off by more than 5 mm or a degree is counted as wrong and stays in the errors. Times are of the CPU,
from the image to the pose, in one thread: medians, the methods taking turns.

The peers' pose minimises the reprojection error of the corners they found, with the exact camera (OpenCV's SQPNP and
solvePnPRefineLM, outliers screened); ours is the program's own chain, `cpcal.vision.measure.measure_pose`. Some methods
of some versions of OpenCV count pixels from a corner of the first pixel instead of its centre: what an image without
noise shows of that, to the nearest half pixel, is taken off their corners and told below the table.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.board_methods import AprilTags, BoardMethod, Charuco, DotBoard, Failed
from benchmarks.isolation import ONE_THREAD
from benchmarks.machine import machine
from benchmarks.vision_scenes import FACING, facing_poses, one
from cpcal.common.arrays import Floats
from cpcal.robot import (
    Pose,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_vector,
    transformed,
)
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Image, Scene
from cpcal.vision.target import DELTALAB_TARGET

PLATE = 300.0  # mm
WRONG = (5.0, 1.0)  # mm, degrees
SETTINGS = {
    "nominal": Scene(blur=0.8, noise=2.0, gradient=(0.15, -0.1)),
    "sharp": Scene(blur=0.5, noise=1.0, gradient=(0.15, -0.1)),
    "poor": Scene(blur=1.2, noise=4.0, gradient=(0.15, -0.1)),
}
_MARGIN = 10.0  # pixels between the plate and the image's border


def methods() -> list[BoardMethod]:
    peers = [Charuco(10, 10), Charuco(8, 12), AprilTags(refinement="SUBPIX"), AprilTags(refinement="APRILTAG")]
    return [DotBoard(DELTALAB_TARGET), *peers]


@dataclass(frozen=True)
class BoardRow:
    """What one method made of the images of one setting. Errors are root mean squares; nan without any pose."""

    setting: str
    method: str
    board: str
    images: int
    failures: int
    wrong: int
    points: float  # used, per image with a pose
    of: int
    pixels: float
    worst: float  # pixels: the largest of all errors, of either axis
    lateral: float  # mm
    depth: float  # mm
    degrees: float
    milliseconds: float
    shift: tuple[float, float]  # pixels that were taken off
    reasons: dict[str, int] = field(default_factory=dict)


def poses(camera: Camera, count: int, seed: int) -> list[Pose]:
    """Poses of the plate in the camera frame, all of it in view."""
    rng = np.random.default_rng(seed)
    corners = 0.5 * PLATE * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    size = np.array([camera.width, camera.height])
    found: list[Pose] = []
    while len(found) < count:
        drawn = facing_poses(rng, 64)
        rays = camera.normalised(rng.uniform([0.0, 0.0], size, (64, 2)))
        depths = drawn.position[:, 2:]
        drawn = Pose(np.concatenate([rays * depths, depths], axis=1), drawn.quaternion)
        seen = camera.project(transformed(drawn, corners))
        inside = ((seen > _MARGIN) & (seen < size - 1 - _MARGIN)).all(axis=(1, 2))
        found += [one(drawn, int(k)) for k in np.flatnonzero(inside)]
    return found[:count]


def studied(name: str, images: int, seed: int, chosen: Sequence[BoardMethod] | None = None) -> list[BoardRow]:
    """The rows of the setting of that name. The poses depend on the seed alone."""
    opencv().setNumThreads(1)
    camera, scene = DELTALAB_CAMERA, SETTINGS[name]
    chosen = methods() if chosen is None else chosen
    tallies = [_Tally(method, camera) for method in chosen]
    for number, pose in enumerate(poses(camera, images, seed)):
        drawn: dict[str, Image] = {}
        for tally in tallies:
            board = tally.method.drawing
            if board not in drawn:
                drawn[board] = tally.method.draw(camera, pose, scene, seed + number)
            tally.add(drawn[board], pose)
    return [tally.row(name) for tally in tallies]


class _Tally:
    """One method's errors so far."""

    def __init__(self, method: BoardMethod, camera: Camera) -> None:
        self.method, self.camera = method, camera
        self.pixels: list[Floats] = []
        self.moved: list[Floats] = []  # position, mm
        self.turned: list[Floats] = []  # rotation vector, degrees
        self.seconds: list[float] = []
        self.reasons: Counter[str] = Counter()
        self.shift = origin(method, camera)

    def add(self, image: Image, pose: Pose) -> None:
        began = time.process_time()
        try:
            found = self.method.measure(image, self.camera, self.shift)
        except Failed as failure:
            self.reasons[str(failure)] += 1
            return
        finally:
            self.seconds.append(time.process_time() - began)
        self.pixels.append(found.pixels - self.method.exact(self.camera, pose)[found.numbers])
        self.moved.append(found.pose.position - pose.position)
        turn = quaternion_product(found.pose.quaternion, quaternion_conjugate(pose.quaternion))
        self.turned.append(np.degrees(rotation_vector(turn)))

    def row(self, setting: str) -> BoardRow:
        pixels = np.concatenate([np.zeros((0, 2)), *self.pixels])
        moved, turned = np.reshape(self.moved, (-1, 3)), np.reshape(self.turned, (-1, 3))
        off = (np.linalg.norm(moved, axis=1) > WRONG[0]) | (np.linalg.norm(turned, axis=1) > WRONG[1])
        return BoardRow(
            setting,
            self.method.name,
            self.method.drawing,
            images=len(self.seconds),
            failures=self.reasons.total(),
            wrong=int(off.sum()),
            points=len(pixels) / max(len(self.pixels), 1),
            of=self.method.count,
            pixels=_rms(pixels),
            worst=float(np.abs(pixels).max(initial=0.0)),
            lateral=_rms(moved[:, :2]),
            depth=_rms(moved[:, 2]),
            degrees=_rms(turned),
            milliseconds=1e3 * float(np.median(self.seconds)),
            shift=(float(self.shift[0]), float(self.shift[1])),
            reasons=dict(self.reasons),
        )


def origin(method: BoardMethod, camera: Camera) -> Floats:
    """By how many pixels (2,), to the nearest half, the method's origin is off. (This warms it up, too.)"""
    turn = quaternion_product(quaternion_from_rotation_vector([0.1, 0.1, 0.2]), FACING)
    pose = Pose(np.array([0.0, 0.0, 600.0]), turn)
    found = method.measure(method.draw(camera, pose, Scene(noise=0.0), 0), camera, np.zeros(2))
    mean = (found.pixels - method.exact(camera, pose)[found.numbers]).mean(axis=0)
    return np.asarray(0.5 * np.rint(2.0 * mean) + 0.0)  # no negative zero


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")


def printed(rows: Sequence[BoardRow]) -> Iterator[str]:
    """The table of one setting's rows; in brackets, how many times the first row's figure it is."""
    scene = SETTINGS[rows[0].setting]
    yield f"{rows[0].setting}: blur {scene.blur:g} px, noise {scene.noise:g} grey levels, {rows[0].images} images"
    heads = "".join(f" {head:>15}" for head in ("pixels", "lateral mm", "depth mm", "degrees", "ms"))
    yield f"{'':24} {'':23} {'failed':>6} {'wrong':>5} {'points':>11} {'worst px':>8}{heads}"
    ours = _figures(rows[0])
    for row in rows:
        points = f"{row.points:.1f}/{row.of}"
        line = f"{row.method:24} {row.board:23} {row.failures:6} {row.wrong:5} {points:>11} {row.worst:8.3f}"
        for value, mine, form in zip(_figures(row), ours, ("7.4f", "7.4f", "7.4f", "7.5f", "7.1f"), strict=True):
            ratio = "" if row is rows[0] else f"({value / mine:.1f})"
            line += f" {value:{form}}{ratio:>8}"
        yield line.rstrip()
    yield from (f"  {row.method}: {count} x {why}" for row in rows for why, count in sorted(row.reasons.items()))
    yield from (f"  {row.method}: {row.shift} pixels taken off" for row in rows if any(row.shift))


def _figures(row: BoardRow) -> tuple[float, ...]:
    return row.pixels, row.lateral, row.depth, row.degrees, row.milliseconds


def _told(row: BoardRow) -> dict[str, object]:
    """The row for JSON, which knows no nan."""
    return {key: None if value != value else value for key, value in asdict(row).items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=100, help="for each setting")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--settings", default=",".join(SETTINGS), help="of these, comma-separated")
    parser.add_argument("-o", "--output", type=Path, help="write the figures here too, as JSON")
    options = parser.parse_args()
    names = options.settings.split(",")
    if unknown := [name for name in names if name not in SETTINGS]:
        parser.error(f"no setting is called {unknown[0]}; there are {', '.join(SETTINGS)}")
    os.environ.update(ONE_THREAD)  # read by a process when it starts: so the study has one of its own
    rows: list[BoardRow] = []
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        for name in names:
            found = pool.submit(studied, name, options.images, options.seed).result()
            print(*printed(found), sep="\n", end="\n\n", flush=True)
            rows += found
    if options.output:
        facts = {"machine": machine(), "opencv": opencv().__version__, "images": options.images, "seed": options.seed}
        scenes = {name: asdict(SETTINGS[name]) for name in names}
        told = {**facts, "settings": scenes, "rows": [_told(row) for row in rows]}
        options.output.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
