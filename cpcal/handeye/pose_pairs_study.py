"""Hand-eye studies from what people have: pairs of poses, or photographs of a board.

Pairs of poses say where the robot had its hand and where a camera saw a marker. They hold no pixels; four corners of a
square of stated size stand in for the marker, seen at the stated pose by a stated camera without distortion. Then eps
is in pixels of that camera: a pixel is (distance / focal length) across the line of sight.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.handeye.hand_eye_study import HandEyeStudy, Setup
from cpcal.robot import Pose
from cpcal.vision.camera import Camera

STAND_IN = Camera(2000, 2000, np.array([1000.0, 1000.0]), np.array([999.5, 999.5]), np.zeros(5))


def study_of_pairs(
    hand: Pose, seen: Pose, *, setup: Setup, size: float = 100.0, camera: Camera = STAND_IN, names: tuple[str, ...] = ()
) -> HandEyeStudy:
    """A study whose pixels are those of a square board (3 x 3 points, `size` mm) at the poses where the camera saw it.

    hand   (n, 3) mm and (n, 4): hand in base
    seen   of the same n: target in camera

    Raises InputError for poses that do not go together, or with the board behind the camera.
    """
    count = len(hand.position)
    if len(seen.position) != count:
        what = f"are {count} of the hand and {len(seen.position)} of the target"
        raise InputError([Problem("poses", what, "give the same samples in the same order")])
    side = size * np.array([-0.5, 0.0, 0.5])
    board = np.array([[x, y, 0.0] for y in side for x in side])
    points = np.einsum("nij,kj->nki", seen.rotation, board) + seen.position[:, None, :]
    behind = np.flatnonzero((points[..., 2] <= 0.0).any(axis=1))
    if len(behind):
        what = f"put the target behind the camera in sample {behind[0] + 1}"
        raise InputError([Problem("poses", what, "give the target in the camera frame, z along the line of sight")])
    return HandEyeStudy(
        setup=setup,
        camera=camera,
        images=names or tuple(f"sample{k + 1:03d}" for k in range(count)),
        poses=hand,
        image=np.repeat(np.arange(count), len(board)),
        names=tuple(f"p{k + 1}" for _ in range(count) for k in range(len(board))),
        pixels=camera.project(points).reshape(-1, 2),
        points=np.tile(board, (count, 1)),
    )
