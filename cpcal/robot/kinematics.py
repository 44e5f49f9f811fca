"""From pose to leg readings (closed form) and back (Newton, continued from a neighbouring pose).

A robot's 7 n parameters are only used as arrays, so every function works for the nominal robot, for a
calibrated one and for a simulated true one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import CpcalError
from cpcal.common.values import ByValue
from cpcal.robot.robot import Robot
from cpcal.robot.rotation import normalised, quaternion_from_rotation_vector, quaternion_product, rotation_matrix

_ITERATIONS = 40  # of Newton, at each step of the continuation
_REFINEMENTS = 2  # how often a failed continuation is tried again, with four times as many steps
_STEPS_MAX = 1_000  # of the continuation, at first
_STRIDE = 0.05  # the continuation's first step length, as a share of the mean leg length
_MAX_TURN = 0.3  # rad: the longest rotation that one Newton step may make
_ACCURACY = 1e-12  # relative to the leg lengths


class KinematicsError(CpcalError):
    """No pose was found for some leg readings. `indices` are the rows of the readings that failed."""

    def __init__(self, message: str, indices: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.indices = indices


@dataclass(frozen=True, eq=False)
class Pose(ByValue):
    """One or many poses of the mobile frame in the base frame: `P + R(q) b` maps mobile to base.

    position (..., 3) mm; quaternion (..., 4), scalar first.
    """

    position: Floats
    quaternion: Floats

    @property
    def rotation(self) -> Floats:
        """(..., 3, 3)."""
        return rotation_matrix(self.quaternion)


def leg_vectors(robot: Robot, pose: Pose) -> Floats:
    """P + R b - a for every pose and leg, (..., n, 3) mm, in the base frame."""
    turned = np.einsum("...ij,nj->...ni", pose.rotation, robot.mobile)
    return np.asarray(pose.position[..., None, :] + turned - robot.base)


def inverse_kinematics(robot: Robot, pose: Pose) -> Floats:
    """The readings L = ||P + R b - a|| - l, (..., n) mm (the paper, eq. 1)."""
    return np.asarray(np.linalg.norm(leg_vectors(robot, pose), axis=-1) - robot.offset)


def pose_jacobian(robot: Robot, pose: Pose) -> Floats:
    """Derivative of the readings by (P, rotation vector in the base frame), (..., n, 6): mm/mm, mm/rad."""
    vectors = leg_vectors(robot, pose)
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    directions = vectors / np.maximum(lengths, np.finfo(np.float64).tiny)
    arms = vectors - pose.position[..., None, :] + robot.base  # R b
    return np.concatenate([directions, np.cross(arms, directions)], axis=-1)


def central_pose(robot: Robot, readings: npt.ArrayLike) -> Pose:
    """The upright pose, above the base and unturned, that the readings (n,) roughly allow, made exact.

    It fixes the assembly branch of whatever is continued from it.
    """
    lengths = robot.offset + np.asarray(readings, dtype=np.float64)
    centre = robot.base.mean(axis=0) - robot.mobile.mean(axis=0)
    reach = robot.mobile + centre - robot.base
    height = np.sqrt(max(float(np.mean(lengths**2 - np.sum(reach**2, axis=1))), float(np.mean(lengths)) ** 2 / 100))
    guess = Pose(centre + np.array([0.0, 0.0, height]), np.array([1.0, 0.0, 0.0, 0.0]))
    return forward_kinematics(robot, readings, guess)


@dataclass(frozen=True, eq=False)
class ForwardPoses:
    """What forward kinematics found, row by row of the readings (...).

    pose       (..., 3) mm and (..., 4); NaN where nothing was found
    converged  (...) bool: whether a pose was found
    residual   (..., n) mm, its readings less those asked for: rounding for six legs, misfit for more
    """

    pose: Pose
    converged: npt.NDArray[np.bool_]
    residual: Floats


def forward_kinematics(robot: Robot, readings: npt.ArrayLike, guess: Pose) -> Pose:
    """The poses whose readings are `readings`, (..., n) mm, on the assembly branch of `guess`.

    As `forward_poses`, but raises KinematicsError, with the rows that failed, when some cannot be reached.
    """
    found = forward_poses(robot, readings, guess)
    failed = np.flatnonzero(~found.converged.ravel())
    if not len(failed):
        return found.pose
    rows = np.asarray(readings, dtype=np.float64).reshape(-1, robot.legs)
    first = ", ".join(f"{value:.6g}" for value in rows[failed[0]])
    message = f"no pose found for {len(failed)} of {len(rows)} rows of readings (row {failed[0]}: {first} mm)"
    remedy = "give a guess nearer to it, or check the robot's parameters"
    raise KinematicsError(f"{message}: {remedy}", tuple(int(row) for row in failed))


def forward_poses(robot: Robot, readings: npt.ArrayLike, guess: Pose) -> ForwardPoses:
    """The poses whose readings are `readings`, (..., n) mm, where they can be reached from `guess`; and where.

    `guess` is one pose or one per row of the readings. The readings are led from those of the guess to those
    asked for in small steps, with a damped Newton iteration on (P, rotation vector) at each; a row that fails
    is tried again with shorter steps. Six legs give the pose exactly; more give the least-squares pose.
    `cpcal.robot.prove_pose` proves one.

    Raises KinematicsError for fewer than six legs, and for readings that are no lengths of such a robot.
    """
    if robot.legs < 6:
        raise KinematicsError(f"{robot.legs} legs do not determine a pose: forward kinematics needs at least 6")
    target = np.asarray(readings, dtype=np.float64)
    if target.ndim == 0 or target.shape[-1] != robot.legs or not np.isfinite(target).all():
        raise KinematicsError(f"readings of shape {target.shape}: expected finite numbers, (..., {robot.legs})")
    rows = target.reshape(-1, robot.legs)
    start = Pose(
        np.broadcast_to(guess.position, (*target.shape[:-1], 3)).reshape(-1, 3).copy(),
        normalised(np.broadcast_to(guess.quaternion, (*target.shape[:-1], 4)).reshape(-1, 4)),
    )
    found, converged = _continued(robot, rows, start)
    pose = Pose(found.position.reshape(*target.shape[:-1], 3), found.quaternion.reshape(*target.shape[:-1], 4))
    return ForwardPoses(pose, converged.reshape(target.shape[:-1]), inverse_kinematics(robot, pose) - target)


def _continued(robot: Robot, target: Floats, start: Pose) -> tuple[Pose, npt.NDArray[np.bool_]]:
    """Continuation of every row (K, n), and which arrived; those that fail are tried with four times as many steps."""
    position, quaternion = start.position.copy(), start.quaternion.copy()
    origin = inverse_kinematics(robot, start)
    span = np.max(np.abs(target - origin), axis=1) / np.mean(np.abs(origin + robot.offset), axis=1)
    steps = 1 + int(min(np.max(span, initial=0.0) / _STRIDE, 1e6))
    if steps > _STEPS_MAX:
        raise KinematicsError("the readings are out of all proportion to the robot: are they in mm?")
    todo = np.arange(len(target))
    for _ in range(1 + _REFINEMENTS):
        pose, reached = _led(robot, origin[todo], target[todo], Pose(position[todo], quaternion[todo]), steps)
        position[todo[reached]], quaternion[todo[reached]] = pose.position, pose.quaternion
        todo = np.delete(todo, reached)
        if not len(todo):
            break
        steps *= 4
    position[todo], quaternion[todo] = np.nan, np.nan
    converged = np.ones(len(target), dtype=bool)
    converged[todo] = False
    return Pose(position, quaternion), converged


def _led(robot: Robot, origin: Floats, target: Floats, pose: Pose, steps: int) -> tuple[Pose, npt.NDArray[np.int64]]:
    """The poses of the rows that could be led from origin to target, and which; others are dropped early."""
    rows = np.arange(len(target))
    for step in range(1, steps + 1):
        share = step / steps
        here = target[rows] if step == steps else (1.0 - share) * origin[rows] + share * target[rows]
        pose, converged = _newton(robot, here, pose)
        pose = Pose(pose.position[converged], pose.quaternion[converged])
        rows = rows[converged]
        if not len(rows):
            break
    return pose, rows


def _newton(robot: Robot, readings: Floats, pose: Pose) -> tuple[Pose, npt.NDArray[np.bool_]]:
    """Damped Newton (Gauss-Newton for more than six legs) on every row; the poses, and which converged."""
    lengths = np.abs(readings + robot.offset)
    accuracy = _ACCURACY * (1.0 + np.max(lengths, axis=-1))
    max_move = 0.3 * np.mean(lengths, axis=-1)
    arm = 1.0 + float(np.max(np.linalg.norm(robot.mobile, axis=1)))  # mm/rad
    converged = np.zeros(len(readings), dtype=bool)
    for _ in range(_ITERATIONS):
        residual = readings - inverse_kinematics(robot, pose)
        jacobian = pose_jacobian(robot, pose) / np.array([1.0, 1.0, 1.0, arm, arm, arm])
        step = np.einsum("kij,kj->ki", np.linalg.pinv(jacobian), residual)
        move, turn = step[:, :3], step[:, 3:] / arm
        size = np.maximum(np.linalg.norm(move, axis=1) / max_move, np.linalg.norm(turn, axis=1) / _MAX_TURN)
        damping = 1.0 / np.maximum(size, 1.0)[:, None]
        pose = Pose(
            pose.position + damping * move,
            normalised(quaternion_product(quaternion_from_rotation_vector(damping * turn), pose.quaternion)),
        )
        reached = (np.max(np.abs(residual), axis=1) <= 1e3 * accuracy) | (robot.legs > 6)
        converged = reached & (np.max(np.abs(step), axis=1) <= 1e3 * accuracy)
        if converged.all():
            break
    return pose, converged
