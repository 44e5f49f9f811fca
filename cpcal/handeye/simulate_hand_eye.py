"""Simulated hand-eye studies, with their truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.handeye.hand_eye_study import HandEyeFrames, HandEyeStudy, Setup
from cpcal.robot import Pose, compose, inverse, quaternion_from_rotation_vector, quaternion_product, rotation_matrix
from cpcal.robot.rotation import normalised
from cpcal.vision.camera import Camera

CAMERA = Camera(1280, 960, np.array([1000.0, 1000.0]), np.array([639.5, 479.5]), np.zeros(5))
_TILT = np.radians(40.0)


@dataclass(frozen=True, eq=False)
class SimulatedHandEye:
    """A study and the frames that made it."""

    study: HandEyeStudy
    truth: HandEyeFrames


def simulate_hand_eye(
    *,
    setup: Setup = "eye-in-hand",
    images: int = 30,
    corners: tuple[int, int] = (8, 6),
    pitch: float = 30.0,
    pixel_error: float = 0.2,
    position_error: float = 0.0,
    rotation_error: float = 0.0,
    camera: Camera = CAMERA,
    seed: int = 0,
) -> SimulatedHandEye:
    """A board of `corners` at `pitch` mm, seen from 500 to 800 mm under tilts up to 40 degrees.

    pixel_error     px, rotation_error rad, position_error mm: errors are uniform in plus and minus that, on each axis

    The hand-eye rotation is any rotation, its translation within 150 mm; the other frame is anywhere within a metre.
    """
    random = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(corners[0]), np.arange(corners[1])), axis=-1).reshape(-1, 2)
    flat = pitch * (grid - (np.array(corners) - 1) / 2.0)
    board = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)
    seen = _views(images, random)
    on_hand = Pose(random.uniform(-150.0, 150.0, 3), normalised(random.normal(size=4)))
    far = Pose(random.uniform(-1000.0, 1000.0, 3), normalised(random.normal(size=4)))
    if setup == "eye-in-hand":  # camera on the hand, target in the base
        e, f = inverse(on_hand), far
        poses = inverse(compose(compose(on_hand, seen), inverse(far)))
    else:  # target on the hand, base in the camera
        e, f = far, on_hand
        poses = compose(compose(inverse(far), seen), inverse(on_hand))
    if setup == "eye-in-hand":
        poses = Pose(poses.position, poses.quaternion)
    turned = quaternion_from_rotation_vector(random.uniform(-rotation_error, rotation_error, (images, 3)))
    stated = Pose(
        poses.position + random.uniform(-position_error, position_error, (images, 3)),
        normalised(quaternion_product(turned, poses.quaternion)),
    )
    x = np.einsum("nij,kj->nki", rotation_matrix(seen.quaternion), board) + seen.position[:, None, :]
    pixels = camera.project(x) + random.uniform(-pixel_error, pixel_error, (images, len(board), 2))
    count = len(board)
    study = HandEyeStudy(
        setup=setup,
        camera=camera,
        images=tuple(f"image{k + 1:03d}" for k in range(images)),
        poses=stated,
        image=np.repeat(np.arange(images), count),
        names=tuple(f"p{k + 1}" for _ in range(images) for k in range(count)),
        pixels=pixels.reshape(-1, 2),
        points=np.tile(board, (images, 1)),
    )
    return SimulatedHandEye(study, HandEyeFrames(_matrix(e), e.position, _matrix(f), f.position))


def _matrix(pose: Pose) -> Floats:
    return rotation_matrix(pose.quaternion)


def _views(images: int, random: np.random.Generator) -> Pose:
    """Poses of the target in the camera frame."""
    axis = random.uniform(0.0, 2.0 * np.pi, images)
    tilt = _TILT * np.sqrt(random.uniform(0.1, 1.0, images))
    leaning = quaternion_from_rotation_vector(
        np.stack([tilt * np.cos(axis), tilt * np.sin(axis), np.zeros(images)], axis=1)
    )
    roll = random.uniform(-np.pi, np.pi, images)
    rolled = quaternion_from_rotation_vector(np.stack([np.zeros(images), np.zeros(images), roll], axis=1))
    place = np.stack(
        [random.uniform(-100.0, 100.0, images), random.uniform(-70.0, 70.0, images), random.uniform(500, 800, images)],
        axis=1,
    )
    return Pose(place, normalised(quaternion_product(leaning, rolled)))
