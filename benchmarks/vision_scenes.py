"""Simulated scenes of the DeltaLab target, all from a seed: poses, lists of dots, views, images that show none.

    python -m benchmarks.vision_scenes [--lists 2000] [--images 20]

Measures with them, and prints:

1. Identification: lists of predicted centres with noise, in random order, up to 10 dots missing and false ones added,
   anywhere or on the very rows that identify the target; or the target partly out of view. One wrong pair is wrong.
2. Dots in rendered images, 550 to 850 mm away, tilted to 30 degrees, under light that differs by up to 40 %: errors to
   the centre of the dot's exact image, Cramer's and Rao's bound for a known blurred edge, errors over stated ones.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from benchmarks import run_by_hand
from cpcal.common.values import Floats, Ints
from cpcal.robot import Pose, quaternion_conjugate, quaternion_from_rotation_vector, quaternion_product, rotation_vector
from cpcal.vision.calibrate import Calibration, TargetView
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.dots import observe_dots
from cpcal.vision.identify import Unidentified, identify
from cpcal.vision.opencv import opencv
from cpcal.vision.pose import PoseEstimate
from cpcal.vision.projection import centers_by_pose, predicted_centers
from cpcal.vision.render import BRIGHT, DARK, Scene, render
from cpcal.vision.target import DELTALAB_TARGET, Target

ROWS = (slice(0, 7), slice(7, 13))  # the diagonals of the default target, off its grid
MOST = 10  # false and missing dots
KINDS = ("none", "anywhere", "missing on the rows", "false on the rows", "both on the rows")
ASIDE = "partly out of view"
_APART = 1.5  # radii between false dots and others

FACING = np.array([0.0, 1.0, 0.0, 0.0])  # x right, y up on the target: half a turn about the camera's x


def facing_poses(
    rng: np.random.Generator, count: int, *, depth: tuple[float, float] = (550.0, 850.0), tilt: float = 30.0
) -> Pose:
    """`count` poses of a target that faces the camera: so many mm away, turned at will, tilted up to `tilt` degrees."""
    spin = quaternion_from_rotation_vector(rng.uniform(-np.pi, np.pi, (count, 1)) * [0.0, 0.0, 1.0])
    axis = rng.uniform(0.0, 2.0 * np.pi, count)
    lean = np.radians(rng.uniform(0.0, tilt, (count, 1))) * np.stack([np.cos(axis), np.sin(axis), 0.0 * axis], axis=1)
    turn = quaternion_product(quaternion_from_rotation_vector(lean), quaternion_product(spin, FACING))
    return Pose(rng.uniform([-60.0, -50.0, depth[0]], [60.0, 50.0, depth[1]], (count, 3)), turn)


def found_dots(
    rng: np.random.Generator,
    target: Target,
    camera: Camera,
    pose: Pose,
    *,
    noise: float = 0.01,
    missing: int = 0,
    false: int = 0,
    on_rows: bool = False,
) -> tuple[Floats, Ints]:
    """Centres (m, 2) in random order, and which dot of the target each is (-1: none).

    Dots out of the image are left out, then `missing` more; `false` dots are strewn over the image, or on the rows
    that identify the target, no nearer to other dots than 1.5 radii. `on_rows` takes missing ones from there too.
    """
    centers, size, margin = predicted_centers(target, camera, pose), np.array([camera.width, camera.height]), 12.0
    numbers = np.flatnonzero(((centers > margin) & (centers < size - margin)).all(axis=1))
    preferred = np.intersect1d(numbers, np.arange(13)) if on_rows else numbers
    numbers = np.setdiff1d(numbers, rng.permutation(preferred)[:missing])
    places: list[Floats] = []
    while len(places) < false:
        line = target.dots[ROWS[rng.integers(2)]]
        on_line = line[0] + rng.uniform(-0.02, 1.02) * (line[-1] - line[0])
        place = on_line if on_rows else rng.uniform(target.dots.min() * 1.2, target.dots.max() * 1.2, 2)
        others = np.concatenate([target.dots, *places])
        if np.linalg.norm(others - place, axis=1).min() > _APART * target.radius:
            places.append(place[None])
    added = centers_by_pose(np.reshape(places, (-1, 2)), target.radius, camera.packed, pose)[0]
    added = added[((added > 0.0) & (added < size)).all(axis=1)]
    points = np.concatenate([centers[numbers], added])
    labels = np.concatenate([numbers, np.full(len(added), -1)])
    order = rng.permutation(len(points))
    return points[order] + noise * rng.standard_normal((len(points), 2)), labels[order]


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


def identified(lists: int, seed: int) -> dict[str, Counter[str]]:
    """How many lists of each kind are right, refused and wrong; so many in all."""
    rng, out = np.random.default_rng(seed), {}
    for kind in (*KINDS, ASIDE):
        poses, told = facing_poses(rng, lists // (len(KINDS) + 1)), Counter(right=0, refused=0, wrong=0)
        if kind == ASIDE:
            poses.position[:, :2] += rng.uniform(-200.0, 200.0, (len(poses.position), 2))
        for k in range(len(poses.position)):
            how = spoiled(rng, kind)
            centers, labels = found_dots(rng, DELTALAB_TARGET, DELTALAB_CAMERA, poses.rows(k), noise=0.02, **how)
            try:
                found = identify(centers, DELTALAB_TARGET, DELTALAB_CAMERA)
                told["right" if np.array_equal(labels[found.found], found.numbers) else "wrong"] += 1
            except Unidentified:
                told["refused"] += 1
        out[kind] = told
    return out


def pose_error(true: Pose, estimate: PoseEstimate) -> Floats:
    """(6,): true minus estimated position (mm), and the rotation vector (rad) from the estimate to the truth."""
    turn = quaternion_product(true.quaternion, quaternion_conjugate(estimate.pose.quaternion))
    return np.concatenate([true.position - estimate.pose.position, rotation_vector(turn)])


def degenerate_images(seed: int) -> dict[str, npt.NDArray[np.generic]]:
    """Images without a target that could be measured, 1024 x 768 unless their name says otherwise."""
    rng = np.random.default_rng(seed)
    camera, target = DELTALAB_CAMERA, DELTALAB_TARGET
    poses = facing_poses(rng, 1, depth=(700.0, 700.0))
    pose = poses.rows(0)
    plain = render(target, camera, pose)
    shape = plain.shape
    beside, below = (Pose(pose.position + shift, pose.quaternion) for shift in ([420.0, 0.0, 0.0], [0.0, 400.0, 0.0]))
    on_rows = tuple(range(13))
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


def bent(x: Floats, y: Floats, distortion: Floats) -> Floats:
    """Where the lens shows the directions x, y: (..., 2)."""
    k1, k2, p1, p2, k3 = distortion
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    dx = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    dy = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.stack([dx, dy], axis=-1)


def true_centers(target: Target, camera: Camera, pose: Pose) -> Floats:
    """The centroids (n, 2) of the dots' images, pixels: of polygons of 360 points on each circle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    rim = target.dots[:, None, :] + target.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    p = rim @ pose.rotation[:, :2].T + pose.position
    at = camera.center + camera.focal * bent(p[..., 0] / p[..., 2], p[..., 1] / p[..., 2], camera.distortion)
    start = at.mean(axis=1, keepdims=True)
    (x, y), (x1, y1) = np.moveaxis(at - start, -1, 0), np.moveaxis(np.roll(at, -1, axis=1) - start, -1, 0)
    cross = x * y1 - x1 * y
    moments = np.stack([((x + x1) * cross).sum(axis=1), ((y + y1) * cross).sum(axis=1)], axis=-1)
    return np.asarray(start[:, 0] + moments / (3.0 * cross.sum(axis=1, keepdims=True)))


@dataclass(frozen=True)
class DotErrors:
    """pixels (m, 2) errors of the dots found; normalised (m, 2) in standard deviations; bound (m,) pixels; missing:
    dots in sight that were not found; false: found where there is none."""

    pixels: Floats
    normalised: Floats
    bound: Floats
    missing: int
    false: int


def errors(target: Target, camera: Camera, pose: Pose, scene: Scene, seed: int = 0, **options: Any) -> DotErrors:
    """What `observe_dots(image, **options)` gets wrong in one rendered image."""
    image = render(target, camera, pose, scene, seed=seed)
    found = observe_dots(image, **options)
    true = true_centers(target, camera, pose)
    distance, number = (np.asarray(a) for a in cKDTree(true).query(found.centers))
    right = distance < 1.0
    off = found.centers[right] - true[number[right]]
    half = np.linalg.cholesky(found.covariance[right])
    inside = ((true > 0.0) & (true < [camera.width - 1, camera.height - 1])).all(axis=1)
    missing = int(inside.sum()) - len(np.unique(number[right]))
    spread = np.sqrt(scene.blur**2 + 1.0 / 12.0)
    light = 1.0 + (np.array(scene.gradient) * (found.centers[right] / [camera.width, camera.height] - 0.5)).sum(axis=1)
    slope = (BRIGHT - DARK) * light / np.hypot(scene.noise, np.sqrt(1.0 / 12.0))
    bound = np.sqrt(2.0 * np.sqrt(np.pi) * spread / (np.pi * found.axes[right].mean(axis=1))) / slope
    return DotErrors(off, np.linalg.solve(half, off[..., None])[..., 0], bound, missing, int((~right).sum()))


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
    poses = [every.rows(k) for k in range(setting.views)]
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


def main(lists: int = 2000, images: int = 20, seed: int = 0) -> None:
    """`images` of each kind."""
    opencv().setNumThreads(1)
    for kind, told in identified(lists, seed).items() if lists else ():
        print(f"{kind:24}", ", ".join(f"{told[word]} {word}" for word in ("right", "refused", "wrong")))
    for blur, noise in ((blur, noise) for blur in (0.5, 0.8, 1.2) for noise in (1.0, 2.0, 4.0)):
        found = []
        for number in range(seed, seed + images):
            rng = np.random.default_rng(number)
            x, y = rng.uniform(-0.4, 0.4, 2)
            scene, pose = Scene(blur, noise, gradient=(float(x), float(y))), facing_poses(rng, 1).rows(0)
            found.append(errors(DELTALAB_TARGET, DELTALAB_CAMERA, pose, scene, number, bright=True))
        if found:
            names = ("pixels", "bound", "normalised")
            each = (np.concatenate([getattr(e, name).ravel() for e in found]) for name in names)
            rms = ", ".join(f"{np.sqrt((values**2).mean()):.4f}" for values in each)
            lost = f"missing {sum(e.missing for e in found)}, false {sum(e.false for e in found)}"
            print(f"blur {blur}, noise {noise}: dots' errors, bound [px], over stated ones: {rms}; {lost}")


if __name__ == "__main__":
    run_by_hand(main)
