"""Images of a target in the world, by a renderer that shares no code with cpcal's: what detection is measured with.

    python -m benchmarks.vision_world [--images 10] [--seed 0] [--only WORD,...]

Every pixel is looked through at `FINE` x `FINE` places: the ray's point on the plate is found by the camera's inverse
and a homography, and where it is near a dot's edge the covered share follows from its distance. Around the plate is a
background of any kind, before it a shadow or an occluder; then come the optics (blur, motion), the sensor's noise
and 8 bits. Camera and target are values; how a camera bends rays is written once more (`vision_scenes`).

For each condition are printed: poses found; images whose identification is wrong (a single wrong pair is wrong); the
centres' RMS error, pixels; NEES/6, the mean of e' C^-1 e / 6 over the poses' errors e and stated covariances C: 1 is
honest; the largest error of position; how many poses were marked as doubtful; the most frequent refusals.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from benchmarks import run_by_hand
from benchmarks.vision_scenes import bent, facing_poses, pose_error, true_centers
from cpcal.common.values import Floats
from cpcal.robot import Pose
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.opencv import Grey8, opencv
from cpcal.vision.target import DELTALAB_TARGET, Target

Single = npt.NDArray[np.float32]

cv2: Any = opencv()


def background(size: tuple[int, int], world: World, rng: np.random.Generator) -> Single:
    """Grey levels of fine places (height, width) before light and optics: discs, or a texture of small ones."""
    grey = np.full(size, world.dark, dtype=np.float32)
    low, high = {"dark": (0.0, 0.0), "discs": (5.0, 9.0), "texture": (1.5, 2.3)}[world.background]
    for _ in range(world.amount):
        place = (int(rng.integers(size[1])), int(rng.integers(size[0])))
        cv2.circle(grey, place, int(FINE * rng.uniform(low, high)), world.bright, -1)
    return grey * np.float32(world.level)


FINE = 2  # places in a pixel, each way
_STEPS = 12  # of the fixed point iteration that unbends rays
_MARGIN = 16.0  # mm of plate around the outermost dots
_TICKS = 27.0 * (np.arange(11.0) - 5.0)
FOREIGN = Target("a regular grid", np.stack(np.meshgrid(_TICKS, _TICKS), axis=-1).reshape(-1, 2), 6.0)


@dataclass(frozen=True)
class World:
    """What is seen beside the target, and how. Lengths in pixels, grey levels of 256.

    background  "dark", "discs", "texture"; `level` is how bright it is, as a factor, and `amount` how many discs
    second      a second plate beside the first: "same", "mirrored" or "foreign" (a regular grid), `dim` as bright
    blur        standard deviation of the optics; motion: length of a line
    noise       standard deviation
    gradient    share by which light grows across the image, x and y; shadow: depth of a soft edge, `softness` wide
    occluded    share of the plate's side that something covers
    bent        mm by which the plate's middle stands out of its plane
    """

    background: str = "dark"
    amount: int = 0
    level: float = 1.0
    second: str = ""
    dim: float = 1.0
    bright: float = 200.0
    dark: float = 30.0
    blur: float = 0.8
    motion: float = 0.0
    noise: float = 2.0
    gradient: tuple[float, float] = (0.0, 0.0)
    shadow: float = 0.0
    softness: float = 40.0
    occluded: float = 0.0
    bent: float = 0.0


def photograph(target: Target, camera: Camera, pose: Pose, world: World, rng: np.random.Generator) -> Grey8:
    """The image (height, width) of the target at `pose` in a world."""
    size = camera.height * FINE, camera.width * FINE
    grey, half = background(size, world, rng), float(np.abs(target.dots).max()) + _MARGIN
    if world.second:  # to the right of the first, farther away, so that both are in sight
        mirror = replace(target, dots=target.dots * [-1.0, 1.0])
        plate = {"foreign": FOREIGN, "mirrored": mirror, "same": target}[world.second]
        beside = Pose(pose.position + np.array([2.3 * half, 0.0, 250.0]), pose.quaternion)
        _lay(grey, plate, camera, beside, world, world.dim, bend=0.0)
    _lay(grey, target, camera, pose, world, 1.0, bend=world.bent)
    if world.occluded:  # by a bar of middling grey, as of a cable or an arm
        u, v, _, _ = _on_plate(camera, pose, 0.0, half)
        angle, at = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.6, 0.6) * half
        across = u * np.float32(np.cos(angle)) + v * np.float32(np.sin(angle))
        grey[np.abs(across - np.float32(at)) < world.occluded * half] = 0.4 * world.bright
    grey *= _light(camera, world, rng)
    if world.blur:
        grey = cv2.GaussianBlur(grey, (0, 0), world.blur * FINE)
    if world.motion:
        angle = rng.uniform(0.0, np.pi)
        ways = FINE * np.linspace(-0.5 * world.motion, 0.5 * world.motion, 41)
        shifts = (np.array([[1.0, 0.0, t * np.cos(angle)], [0.0, 1.0, t * np.sin(angle)]]) for t in ways)
        grey = np.mean([cv2.warpAffine(grey, shift, size[::-1]) for shift in shifts], axis=0)
    grey = grey.reshape(camera.height, FINE, camera.width, FINE).mean(axis=(1, 3))
    grey = grey + world.noise * rng.standard_normal(grey.shape)
    return np.asarray(np.clip(np.rint(grey), 0, 255), dtype=np.uint8)


@lru_cache(maxsize=2)
def _rays(camera: Camera) -> tuple[Single, Single]:
    """The directions (height FINE, width FINE) that the fine places see."""
    u = (np.arange(camera.width * FINE) + 0.5) / FINE - 0.5
    v = (np.arange(camera.height * FINE) + 0.5) / FINE - 0.5
    x0 = np.broadcast_to((u - camera.center[0]) / camera.focal[0], (len(v), len(u)))
    y0 = np.broadcast_to(((v - camera.center[1]) / camera.focal[1])[:, None], (len(v), len(u)))
    x, y = x0.copy(), y0.copy()
    for _ in range(_STEPS):
        seen = bent(x, y, camera.distortion)
        x += x0 - seen[..., 0]
        y += y0 - seen[..., 1]
    return x.astype(np.float32), y.astype(np.float32)


def _on_plate(camera: Camera, pose: Pose, bend: float, half: float) -> tuple[Single, Single, Single, Floats]:
    """The plate's coordinates u, v (mm) of every fine place, the depth factor w, and the homography."""
    x, y = _rays(camera)
    turn = pose.rotation
    h = np.linalg.inv(np.stack([turn[:, 0], turn[:, 1], pose.position], axis=1))
    a = h.astype(np.float32)
    w = a[2, 0] * x + a[2, 1] * y + a[2, 2]
    u = (a[0, 0] * x + a[0, 1] * y + a[0, 2]) / w
    v = (a[1, 0] * x + a[1, 1] * y + a[1, 2]) / w
    if bend:  # the ray meets the plate at its height above the plane
        height = np.float32(bend) * (1 - np.clip((u * u + v * v) / np.float32(half * half), 0, 1))
        sight = np.stack([x, y, np.ones_like(x)], axis=-1) @ turn.astype(np.float32)
        u, v = u + height * sight[..., 0] / sight[..., 2], v + height * sight[..., 1] / sight[..., 2]
    return u, v, w, h


def _lay(grey: Single, target: Target, camera: Camera, pose: Pose, world: World, light: float, bend: float) -> None:
    """Put the plate into the image of fine places."""
    half = float(np.abs(target.dots).max()) + _MARGIN
    u, v, w, h = _on_plate(camera, pose, bend, half)
    plate = np.flatnonzero(((np.abs(u) < half) & (np.abs(v) < half) & (w > 0)).ravel())
    share = _covered(target, u.ravel()[plate], v.ravel()[plate], w.ravel()[plate], h, camera, half)
    inside, outside = (world.bright, world.dark) if target.bright else (world.dark, world.bright)
    grey.ravel()[plate] = light * (outside + (inside - outside) * share)


def _covered(target: Target, u: Single, v: Single, w: Single, h: Floats, camera: Camera, half: float) -> Single:
    """Which share of each fine place a dot covers, by its distance from the nearest dot's edge."""
    dot = _nearest(target, half)[np.rint(v + half).astype(np.int64), np.rint(u + half).astype(np.int64)]
    du, dv = u - target.dots[dot, 0].astype(np.float32), v - target.dots[dot, 1].astype(np.float32)
    r = np.hypot(du, dv)
    share: Single = (r < target.radius).astype(np.float32)
    step = 6.0 * float(np.sqrt(abs(np.linalg.det(h))) / abs(h[2, 2]) ** 1.5) / (float(camera.focal.min()) * FINE)
    edge = np.flatnonzero(np.abs(r - target.radius) < step)  # twice as many mm as are in a fine place, roughly
    along = np.stack([du[edge] / r[edge], dv[edge] / r[edge]], axis=-1)
    u, v, w, inside = u[edge], v[edge], w[edge], target.radius - r[edge]
    per_x = np.stack([(h[0, 0] - u * h[2, 0]) / w, (h[1, 0] - v * h[2, 0]) / w], axis=-1) / (camera.focal[0] * FINE)
    per_y = np.stack([(h[0, 1] - u * h[2, 1]) / w, (h[1, 1] - v * h[2, 1]) / w], axis=-1) / (camera.focal[1] * FINE)
    gx, gy = np.abs((along * per_x).sum(axis=-1)), np.abs((along * per_y).sum(axis=-1))
    share[edge] = np.clip(0.5 + inside / (gx + gy), 0.0, 1.0)  # the width of a square seen from the edge
    return share


@lru_cache(maxsize=4)
def _nearest(target: Target, half: float) -> npt.NDArray[np.int64]:
    """The number of the dot next to each whole mm of the plate."""
    ticks = np.arange(-half, half + 1.0)
    cells = np.stack(np.meshgrid(ticks, ticks), axis=-1)
    return np.asarray(cKDTree(target.dots).query(cells)[1], dtype=np.int64)


def _light(camera: Camera, world: World, rng: np.random.Generator) -> Single | float:
    if not (any(world.gradient) or world.shadow):
        return 1.0
    height, width = camera.height * FINE, camera.width * FINE
    x = np.linspace(-0.5, 0.5, width, dtype=np.float32)
    y = np.linspace(-0.5, 0.5, height, dtype=np.float32)[:, None]
    light = 1.0 + np.float32(world.gradient[0]) * x + np.float32(world.gradient[1]) * y
    if world.shadow:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        across = (x * camera.width * np.cos(angle) + y * camera.height * np.sin(angle)).astype(np.float32)
        edge = np.clip((across - rng.uniform(-100.0, 100.0)) / world.softness, -0.5, 0.5) + 0.5
        light = light * (1.0 - np.float32(world.shadow) * edge * edge * (3.0 - 2.0 * edge))
    return np.asarray(light, dtype=np.float32)


DIM = 0.55
CONDITIONS = {
    "plain": World(), "uneven light": World(gradient=(0.4, 0.3)),
    "motion, 3 px": World(motion=3.0), "motion, 6 px": World(motion=6.0), "noise 8": World(noise=8.0),
    "clutter: 150 discs": World("discs", 150, DIM),
    "clutter: texture": World("texture", 4000, 0.9),
    "clutter: texture and discs": World("texture", 3000, DIM, gradient=(0.3, 0.0)),
    "clutter: a dimmer grid beside": World(second="foreign", dim=0.5),
    "shadow, 40 px soft": World(shadow=0.5),
    "shadow, 15 px soft": World(shadow=0.6, softness=15.0),
    "covered, a quarter": World(occluded=0.25), "bent by 0.2 mm": World(bent=0.2),
    "two targets": World(second="same"), "a mirrored copy": World(second="mirrored", dim=0.9),
}  # fmt: skip
_WRONG = 3.0  # pixels between a dot and where the truth sees the one that it is taken for


def poses_for(world: World, rng: np.random.Generator, count: int) -> Pose:
    """Facing the camera; farther away and to the left where a second plate stands beside."""
    poses = facing_poses(rng, count, depth=(800.0, 900.0) if world.second else (550.0, 850.0))
    shift = np.array([-170.0, 0.0, 0.0]) if world.second else np.zeros(3)
    return Pose(poses.position + shift, poses.quaternion)


def measured(world: World, images: int, seed: int) -> dict[str, Any]:
    """Numbers for a table, nan where no pose was found; and the reasons."""
    rng, camera = np.random.default_rng(seed), DELTALAB_CAMERA
    poses, reasons, rows, wrong, doubtful = poses_for(world, rng, images), Counter[str](), list[Floats](), 0, 0
    for k in range(images):
        true = poses.rows(k)
        try:
            found = measure_pose(photograph(DELTALAB_TARGET, camera, true, world, rng), DELTALAB_TARGET, camera)
        except NotMeasured as reason:
            reasons["".join("#" if c.isdigit() else c for c in str(reason))] += 1
            continue
        centers, pairs = true_centers(DELTALAB_TARGET, camera, true), found.identification
        wrong += np.linalg.norm(found.dots.centers[pairs.found] - centers[pairs.numbers], axis=1).max() > _WRONG
        doubtful += bool(found.doubt)
        error, off = pose_error(true, found.estimate), found.centers - centers[found.numbers]
        square = error @ np.linalg.solve(found.estimate.covariance, error) / 6.0
        rows.append(np.array([(off**2).mean(), square, np.abs(error[:3]).max()]))
    columns = np.array(rows).T if rows else np.full((3, 1), np.nan)
    return {
        "images": images, "found": len(rows), "wrong": wrong, "doubtful": doubtful,
        "centres px": float(np.sqrt(columns[0].mean())), "NEES/6": float(columns[1].mean()),
        "largest mm": float(columns[2].max()), "reasons": dict(reasons.most_common(3)),
    }  # fmt: skip


def main(images: int = 10, seed: int = 0, only: str = "") -> None:
    """`images` of each condition whose name holds one of the words `only`."""
    cv2.setNumThreads(1)
    print("| condition | found | wrong | centres [px] | NEES/6 | largest error [mm] | doubtful |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, world in CONDITIONS.items():
        if any(word in name for word in only.split(",")):
            row = measured(world, images, seed)
            numbers = f"{row['centres px']:.4f} | {row['NEES/6']:.2f} | {row['largest mm']:.4f}"
            print(f"| {name} | {row['found']} of {row['images']} | {row['wrong']} | {numbers} | {row['doubtful']} |")
            print(*(f"  {n} x {r}" for r, n in row["reasons"].items()), flush=True)


if __name__ == "__main__":
    run_by_hand(main)
