"""Poses of other frames than the mobile one in that of the base: see `mistakes`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.robot.given import Given
from cpcal.robot.kinematics import KinematicsError, Pose, central_pose, forward_poses
from cpcal.robot.motion import compose, inverse
from cpcal.robot.rotation import normalised, quaternion_from_matrix, rotation_matrix, rotation_vector

_TRIED = 40  # rows are enough to tell frames
_LEAST = 5  # rows, of which twelve numbers can be told

Variants = Iterator[tuple[str, Given]]


def inverse_poses(given: Given) -> Variants:
    """The same as exchanging the platforms: ||P + R b - a|| = ||-R'P + R'a - b||."""
    turned = inverse(given.pose)
    name = "poses are those of the base in the mobile frame (inverse), or the drawing's base and mobile are swapped"
    yield name, given.posed(turned.position, turned.quaternion)


def other_axes(given: Given) -> Variants:
    """Axes that are exchanged or point the other way: for positions alone, and for both frames."""
    place, rotation = given.pose.position, given.pose.rotation
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.array_equal(turn, np.eye(3)):
                continue
            moved = place @ turn.T
            axes = ", ".join(f"{'-' * (sign < 0)}{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True))
            yield f"the columns x, y, z of positions are to be ({axes})", given.posed(moved, given.pose.quaternion)
            kind = "left-handed" if np.linalg.det(turn) < 0 else "of other axes"
            name = f"the poses' frames are {kind}: the drawing's (x, y, z) are their ({axes})"
            yield name, given.posed(moved, quaternion_from_matrix(turn @ rotation @ turn.T))


def other_frames(given: Given) -> Variants:
    """The poses of a target in a tracker's frame: both frames are fitted to the poses that the readings give."""
    few = given.sampled(_TRIED)
    if given.robot.legs < 6 or len(few.length) < _LEAST:
        return
    try:
        middle = central_pose(few.robot, np.median(few.length, axis=0))
        found = forward_poses(few.robot, few.length, middle)
    except (KinematicsError, np.linalg.LinAlgError):
        return
    rows = np.flatnonzero(found.converged)
    if len(rows) < max(_LEAST, len(few.length) // 2):
        return
    part, seen = few.rows(rows), Pose(found.pose.position[rows], found.pose.quaternion[rows])
    base, target = _frames(part.pose, seen)
    moved = compose(compose(inverse(base), part.pose), inverse(target))
    name = "poses are not of the mobile frame in the base frame, but of a target in a tracker's frame"
    yield f"{name}: `cpcal calibrate` finds both", part.posed(moved.position, moved.quaternion)


def _frames(measured: Pose, seen: Pose) -> tuple[Pose, Pose]:
    """X and Z with measured = X seen Z, by least squares: the axes of relative turns, then the positions."""
    last, first = np.tril_indices(len(measured.position), -1)
    a = rotation_vector(quaternion_from_matrix(_relative(measured, last, first)))
    b = rotation_vector(quaternion_from_matrix(_relative(seen, last, first)))
    u, _, v = np.linalg.svd(a.T @ b)
    x = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    u, _, v = np.linalg.svd(np.einsum("kji,jl,klm->im", seen.rotation, x.T, measured.rotation))
    z = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    left = np.concatenate(
        [np.broadcast_to(np.eye(3), seen.rotation.shape), np.einsum("ij,kjl->kil", x, seen.rotation)], axis=2
    )
    right = measured.position - seen.position @ x.T
    solution, *_ = np.linalg.lstsq(left.reshape(-1, 6), right.ravel(), rcond=None)
    return Pose(solution[:3], quaternion_from_matrix(x)), Pose(solution[3:], normalised(quaternion_from_matrix(z)))


def _relative(pose: Pose, last: Indices, first: Indices) -> Floats:
    """R_i R_j' of pairs of rows."""
    rotation = rotation_matrix(pose.quaternion)
    return np.asarray(np.einsum("kij,klj->kil", rotation[last], rotation[first]))
