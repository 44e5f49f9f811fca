"""Random poses and dot lists for the vision studies and tests, all from a seed."""

from __future__ import annotations

import numpy as np

from cpcal.common.values import Floats, Ints
from cpcal.robot import Pose, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.camera import Camera
from cpcal.vision.projection import centers_of, predicted_centers
from cpcal.vision.target import Target

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


def one(poses: Pose, k: int) -> Pose:
    return Pose(poses.position[k], poses.quaternion[k])


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
    that identify the target, no nearer to other dots than three radii. `on_rows` takes missing ones from there too.
    """
    numbers, places = spoiled_dots(rng, target, camera, pose, missing, false, on_rows)
    centers = predicted_centers(target, camera, pose)
    added = centers_of(places, target.radius, camera, pose)
    added = added[(added > 0.0).all(axis=1) & (added < [camera.width, camera.height]).all(axis=1)]
    points = np.concatenate([centers[numbers], added])
    labels = np.concatenate([numbers, np.full(len(added), -1)])
    order = rng.permutation(len(points))
    return points[order] + noise * rng.standard_normal((len(points), 2)), labels[order]


def spoiled_dots(
    rng: np.random.Generator,
    target: Target,
    camera: Camera,
    pose: Pose,
    missing: int,
    false: int,
    on_rows: bool,
    apart: float = 1.5,
) -> tuple[Ints, Floats]:
    """The numbers of the dots that are left, clear of the image's border, and places (false, 2) mm of false ones, so
    many radii `apart` from others."""
    centers = predicted_centers(target, camera, pose)
    margin = 12.0
    inside = (centers > margin).all(axis=1) & (centers < [camera.width - margin, camera.height - margin]).all(axis=1)
    numbers = np.flatnonzero(inside)
    rows = np.array(sorted({i for line in target.lines for i in line}))
    preferred = np.intersect1d(numbers, rows) if on_rows else numbers
    numbers = np.setdiff1d(numbers, rng.permutation(preferred)[:missing])
    return numbers, _strewn(rng, target, false, on_rows, apart)


def _strewn(rng: np.random.Generator, target: Target, count: int, on_rows: bool, apart: float) -> Floats:
    """Places (count, 2) mm on the target, clear of its dots; on its rows where that is asked for."""
    places: list[Floats] = []
    while len(places) < count:
        if on_rows:
            line = target.dots[list(target.lines[rng.integers(len(target.lines))])]
            place = line[0] + rng.uniform(-0.02, 1.02) * (line[-1] - line[0])
        else:
            place = rng.uniform(target.dots.min() * 1.2, target.dots.max() * 1.2, 2)
        others = np.concatenate([target.dots, np.array(places).reshape(-1, 2)])
        if np.linalg.norm(others - place, axis=1).min() > apart * target.radius:
            places.append(place)
    return np.array(places).reshape(-1, 2)
