"""How accurately dots are found in rendered images and a photograph, how honest their stated errors are, and how fast.

    python -m benchmarks.dot_errors [--images 20] [--photograph FILE] [--json FILE]

Rendered: the DeltaLab target, 550 to 850 mm away and tilted to 30 degrees, under light that differs by up to 40 % from
one border to the other. Errors are those to the centre of the dot's exact image, the bound is Cramer's and Rao's for a
known blurred edge, `normalised` the errors' root mean square in units of their stated standard deviation.

Photographs: a plate with a regular grid of dark dots; the residuals to a polynomial map from the grid to the pixels.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from cpcal.common.values import Floats, Ints
from cpcal.robot import Pose, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.dots import Dots, observe_dots
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Image, Scene, contours, render
from cpcal.vision.target import DELTALAB_TARGET, Target

CONDITIONS = [(blur, noise) for blur in (0.5, 0.8, 1.2) for noise in (1.0, 2.0, 4.0)]


def random_pose(rng: np.random.Generator) -> Pose:
    """The target 550 to 850 mm away, tilted to 30 degrees, turned anyhow, all of it in sight."""
    distance = rng.uniform(550.0, 850.0)
    tilt, direction, turn = np.radians(rng.uniform(0.0, 30.0)), *rng.uniform(0.0, 2.0 * np.pi, 2)
    facing = quaternion_product(
        quaternion_from_rotation_vector([np.pi, 0.0, 0.0]), quaternion_from_rotation_vector([0.0, 0.0, turn])
    )
    tilted = quaternion_from_rotation_vector([tilt * np.cos(direction), tilt * np.sin(direction), 0.0])
    aside = rng.uniform([-0.12, -0.06], [0.12, 0.06]) * distance
    return Pose(np.array([*aside, distance]), quaternion_product(tilted, facing))


def true_centers(target: Target, camera: Camera, pose: Pose) -> Floats:
    """The centres (n, 2) of the conics through the dots' exact contours, pixels."""
    points = contours(target, camera, pose)
    middle = points.mean(axis=1, keepdims=True)
    x, y = np.moveaxis((points - middle) / 10.0, -1, 0)
    terms = np.stack([x * x, x * y, y * y, x, y], axis=-1)
    conic = np.linalg.solve(terms.transpose(0, 2, 1) @ terms, terms.sum(axis=1)[..., None])[..., 0]
    xx, xy, yy = conic[:, 0], conic[:, 1], conic[:, 2]
    matrix = np.stack([np.stack([2.0 * xx, xy], axis=-1), np.stack([xy, 2.0 * yy], axis=-1)], axis=-2)
    return np.asarray(middle[:, 0] - 10.0 * np.linalg.solve(matrix, conic[:, 3:, None])[..., 0])


@dataclass(frozen=True)
class DotErrors:
    """pixels (m, 2) errors of the dots found; normalised (m, 2) in standard deviations; bound (m,) pixels; missing:
    dots in sight that were not found; false: found where there is none; seconds."""

    pixels: Floats
    normalised: Floats
    bound: Floats
    missing: int
    false: int
    seconds: float


def errors(target: Target, camera: Camera, pose: Pose, scene: Scene, seed: int = 0, **options: Any) -> DotErrors:
    """What `observe_dots(image, **options)` gets wrong in one rendered image."""
    image = render(target, camera, pose, scene, seed=seed)
    begin = time.thread_time()
    found = observe_dots(image, **options)
    seconds = time.thread_time() - begin
    true = true_centers(target, camera, pose)
    distance, number = (np.asarray(a) for a in cKDTree(true).query(found.centers))
    right = distance < 1.0
    off = found.centers[right] - true[number[right]]
    half = np.linalg.cholesky(found.covariance[right])
    inside = ((true > 0.0) & (true < [camera.width - 1, camera.height - 1])).all(axis=1)
    missing = int(inside.sum()) - len(np.unique(number[right]))
    spread = np.sqrt(scene.blur**2 + 1.0 / 12.0)
    light = 1.0 + (np.array(scene.gradient) * (found.centers[right] / [camera.width, camera.height] - 0.5)).sum(axis=1)
    slope = (scene.bright - scene.dark) * light / np.hypot(scene.noise, np.sqrt(1.0 / 12.0))
    bound = np.sqrt(2.0 * np.sqrt(np.pi) * spread / (np.pi * found.axes[right].mean(axis=1))) / slope
    return DotErrors(off, np.linalg.solve(half, off[..., None])[..., 0], bound, missing, int((~right).sum()), seconds)


def studied(images: int, blur: float, noise: float) -> dict[str, float]:
    """The errors' figures over random images of the DeltaLab target."""
    found = []
    for seed in range(images):
        rng = np.random.default_rng(seed)
        pose, gradient = random_pose(rng), rng.uniform(-0.4, 0.4, 2)
        scene = Scene(blur, noise, gradient=(float(gradient[0]), float(gradient[1])))
        found.append(errors(DELTALAB_TARGET, DELTALAB_CAMERA, pose, scene, seed, bright=True))
    pixels, normalised = (np.concatenate([getattr(e, name) for e in found]) for name in ("pixels", "normalised"))
    return {
        "blur": blur,
        "noise": noise,
        "rms x": float(np.sqrt((pixels[:, 0] ** 2).mean())),
        "rms y": float(np.sqrt((pixels[:, 1] ** 2).mean())),
        "bound": float(np.sqrt((np.concatenate([e.bound for e in found]) ** 2).mean())),
        "largest": float(np.abs(pixels).max()),
        "normalised": float(np.sqrt((normalised**2).mean())),
        "missing": sum(e.missing for e in found),
        "false": sum(e.false for e in found),
        "ms": 1e3 * float(np.median([e.seconds for e in found])),
    }


def grid_indices(centers: Floats) -> Ints:
    """Column and row (n, 2) of dots on a nearly regular upright grid, walking from neighbour to neighbour; -1 where the
    walk does not come."""
    tree = cKDTree(centers)
    near = np.asarray(tree.query(centers, 5)[1])[:, 1:]
    steps = (centers[near] - centers[:, None]).reshape(-1, 2)
    wide = np.abs(steps[:, 0]) > np.abs(steps[:, 1])
    right = np.median(steps[wide & (steps[:, 0] > 0.0)], axis=0)
    down = np.median(steps[~wide & (steps[:, 1] > 0.0)], axis=0)
    index = np.full((len(centers), 2), np.iinfo(np.int64).min)
    start = int(((centers - centers.mean(axis=0)) ** 2).sum(axis=1).argmin())
    index[start], todo = 0, [start]
    while todo:
        one = todo.pop()
        for sign, (axis, step) in ((s, move) for s in (-1, 1) for move in enumerate((right, down))):
            distance, other = tree.query(centers[one] + sign * step)
            if distance < 0.25 * np.linalg.norm(step) and index[other, 0] == np.iinfo(np.int64).min:
                index[other] = index[one] + sign * np.eye(2, dtype=np.int64)[axis]
                todo.append(int(other))
    reached = index[:, 0] > np.iinfo(np.int64).min
    index[reached] -= index[reached].min(axis=0)
    index[~reached] = -1
    return index


def grid_residuals(centers: Floats, index: Ints, degree: int) -> Floats:
    """The residuals (n, 2) of centres to the polynomials of a degree of their column and row, by least squares."""
    half = 0.5 * index.max(axis=0)
    x, y = (index / half - 1.0).T
    terms = np.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)
    return np.asarray(centers - terms @ np.linalg.lstsq(terms, centers, rcond=None)[0])


def photograph_figures(image: Image) -> tuple[Dots, dict[str, Any]]:
    """The dots of a photograph of a grid, and the figures of their residuals."""
    begin = time.thread_time()
    found = observe_dots(image)
    seconds = time.thread_time() - begin
    index = grid_indices(found.centers)
    figures: dict[str, Any] = {
        "dots": len(found),
        "off the grid": int((index < 0).any(axis=1).sum()) + len(index) - len(np.unique(index, axis=0)),
        "stated": float(np.sqrt(np.median(found.covariance[:, 0, 0]))),
        "ms": 1e3 * seconds,
    }
    for degree in (5, 6, 7):
        residual = grid_residuals(found.centers, index, degree)
        figures[f"degree {degree}"] = [float(rms) for rms in np.sqrt((residual**2).mean(axis=0))]
    stated = np.linalg.solve(np.linalg.cholesky(found.covariance), residual[..., None])[..., 0]
    figures["beyond 4"] = int(np.count_nonzero(np.linalg.norm(stated, axis=1) > 4.0))
    third = np.minimum((3.0 * found.centers / np.array(image.shape[1::-1])).astype(np.int64), 2)
    for name, values in (("pixels", residual), ("stated", stated)):
        figures[f"thirds, {name}"] = [
            [float(np.sqrt((values[(third == [x, y]).all(axis=1)] ** 2).mean())) for x in range(3)] for y in range(3)
        ]
    return found, figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=20, help="of each kind")
    parser.add_argument("--photograph", type=Path, help="of a plate with a grid of dots")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    opencv().setNumThreads(1)
    rows = [studied(options.images, blur, noise) for blur, noise in CONDITIONS]
    print(f"{options.images} images of each kind; pixels, errors as root mean squares\n")
    print("blur noise    rms x   rms y   bound  largest  normalised  missing  false    ms")
    for r in rows:
        print(f"{r['blur']:4.1f} {r['noise']:5.1f}  {r['rms x']:7.4f} {r['rms y']:7.4f} {r['bound']:7.4f}", end=" ")
        print(f"{r['largest']:8.4f}  {r['normalised']:10.3f} {r['missing']:8.0f} {r['false']:6.0f} {r['ms']:5.1f}")
    overall = [float(np.sqrt(np.mean([r[f"rms {axis}"] ** 2 for r in rows]))) for axis in "xy"]
    print(f"all        {overall[0]:7.4f} {overall[1]:7.4f}")
    result: dict[str, Any] = {"rendered": rows, "rms": overall}
    if options.photograph:
        _, figures = photograph_figures(opencv().imread(str(options.photograph), opencv().IMREAD_UNCHANGED))
        print(f"\n{options.photograph.name}: {figures['dots']} dots, {figures['off the grid']} off the grid,", end=" ")
        print(f"stated error {figures['stated']:.4f}, {figures['ms']:.0f} ms; root mean squares of the residuals:")
        for degree in (5, 6, 7):
            print(f"  to polynomials of degree {degree}: {figures[f'degree {degree}'][0]:.4f}", end=" ")
            print(f"{figures[f'degree {degree}'][1]:.4f}")
        share = 100.0 * figures["beyond 4"] / figures["dots"]
        print(
            f"  beyond four stated deviations: {figures['beyond 4']} ({share:.2f} %); RMS by thirds, pixels and stated:"
        )
        for row, stated in zip(figures["thirds, pixels"], figures["thirds, stated"], strict=True):
            print("   ", *(f"{rms:.4f}" for rms in row), "  ", *(f"{rms:.2f}" for rms in stated))
        result["photograph"] = figures
    if options.json:
        options.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
