"""Poses of a robot that is measured all over a box of poses, whatever the number of its legs."""

from __future__ import annotations

from itertools import product

import numpy as np

from cpcal.common.values import Floats
from cpcal.robot import Pose, PoseRange, quaternion_from_rotation_vector


def workspace_poses(
    workspace: PoseRange, stream: np.random.Generator, *, random_poses: int, extremal: bool
) -> tuple[list[str], Pose]:
    """Pose ids (K) and poses: the corners of the box, and poses drawn evenly from it.

    In pose "e05" the coordinate i (x, y, z and the rotation vector's, those that vary) is at its upper end if bit i
    of 5 is set.
    """
    corners = _corners(workspace) if extremal else np.empty((0, 6))
    low, high = workspace.bounds
    drawn = stream.uniform(low, high, (random_poses, 6))
    rows = np.concatenate([corners, drawn])
    names = [f"e{k:02d}" for k in range(len(corners))] + [f"r{k:03d}" for k in range(random_poses)]
    return names, Pose(rows[:, :3], quaternion_from_rotation_vector(rows[:, 3:]))


def corner_count(workspace: PoseRange) -> int:
    """How many corners the box has: 64 if all coordinates vary."""
    return 1 << int(workspace.free.sum())


def _corners(workspace: PoseRange) -> Floats:
    """(2^k, 6)."""
    low, high = workspace.bounds
    ends = [(lo, hi) if free else (lo,) for lo, hi, free in zip(low, high, workspace.free, strict=True)]
    return np.array([row[::-1] for row in product(*ends[::-1])])
