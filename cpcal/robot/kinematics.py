"""From pose to leg readings (closed form) and back (Newton, continued from a neighbouring pose).

A robot's 7 n parameters are only used as arrays, so every function works for the nominal robot, for a
calibrated one and for a simulated true one.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.errors import CpcalError, unusable
from cpcal.common.values import TINY, ArrayLike, ArrayPair, Bools, ByValue, Floats, all_finite, floats, norms
from cpcal.robot.robot import Robot

# ------------------------------------------------------------------------------------------------------------------
# Rotations as quaternions, scalar first: (w, x, y, z). Every function is vectorised over leading axes.
#
# `rotation_matrix(q)` divides by |q|^2, so it is the same rational function of q everywhere in cpcal, in floats
# and in exact arithmetic, whether q has unit norm or not (DESIGN section 1).


def rotation_numerators(quaternion: Iterable[Any]) -> tuple[list[list[Any]], Any]:
    """The nine entries of |q|^2 R(q), row by row, and |q|^2, over any ring: arrays, fractions, expressions, intervals.

    Every product is formed once. What R(q) is stands here alone; the checker has its own.
    """
    w, x, y, z = quaternion
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    xy, xz, yz, wx, wy, wz = x * y, x * z, y * z, w * x, w * y, w * z
    halves = xy - wz, xz + wy, xy + wz, yz - wx, xz - wy, yz + wx
    r12, r13, r21, r23, r31, r32 = (half + half for half in halves)
    rows = [[ww + xx - yy - zz, r12, r13], [r21, ww - xx + yy - zz, r23], [r31, r32, ww - xx - yy + zz]]
    return rows, ww + xx + yy + zz


def rotation_matrix(quaternion: ArrayLike) -> Floats:
    """R(q), (..., 4) -> (..., 3, 3): the rotation of any non-zero quaternion, without a square root."""
    q = floats(quaternion)
    entries, norm_squared = rotation_numerators(np.moveaxis(q, -1, 0))
    matrix = np.ascontiguousarray(np.moveaxis(np.array(entries), (0, 1), (-2, -1)))
    return np.asarray(matrix / norm_squared[..., None, None])


def quaternion_product(left: ArrayLike, right: ArrayLike) -> Floats:
    """The Hamilton product, (..., 4) x (..., 4) -> (..., 4): R(left * right) = R(left) R(right)."""
    p, q = floats(left), floats(right)
    scalar = p[..., 0] * q[..., 0] - np.sum(p[..., 1:] * q[..., 1:], axis=-1)
    across = p[..., (2, 3, 1)] * q[..., (3, 1, 2)] - p[..., (3, 1, 2)] * q[..., (2, 3, 1)]  # np.cross takes ten times
    vector = p[..., :1] * q[..., 1:] + q[..., :1] * p[..., 1:] + across
    return np.concatenate([scalar[..., None], vector], axis=-1)


def quaternion_conjugate(quaternion: ArrayLike) -> Floats:
    """(w, -x, -y, -z), (..., 4) -> (..., 4): the inverse rotation."""
    q = floats(quaternion)
    return np.concatenate([q[..., :1], -q[..., 1:]], axis=-1)


def turn_between(one: ArrayLike, other: ArrayLike) -> Floats:
    """The rotation vector of the turn that takes rotations `other` to `one`, rad, (..., 4) x (..., 4) -> (..., 3)."""
    return rotation_vector(quaternion_product(one, quaternion_conjugate(other)))


def normalised(quaternion: ArrayLike) -> Floats:
    """The unit quaternion of the same rotation with a scalar part >= 0, (..., 4) -> (..., 4)."""
    q = floats(quaternion)
    sign = np.where(q[..., :1] < 0, -1.0, 1.0)
    return q * sign / norms(q)[..., None]


def small_rotation(vector: ArrayLike) -> Floats:
    """The quaternion (1, s) with 2 s = vector, not normalised, (..., 3) -> (..., 4).

    This is how the reading sets write a rotation error (DESIGN section 1): its inverse is exactly (1, -s),
    and 2 s is the rotation vector up to a relative error of angle^2 / 12.
    """
    s = 0.5 * floats(vector)
    return np.concatenate([np.ones((*s.shape[:-1], 1)), s], axis=-1)


def quaternion_from_rotation_vector(vector: ArrayLike) -> Floats:
    """The unit quaternion that turns by |vector| rad about it, (..., 3) -> (..., 4)."""
    v = floats(vector)
    half = 0.5 * norms(v)[..., None]
    return np.concatenate([np.cos(half), 0.5 * v * np.sinc(half / np.pi)], axis=-1)


def rotation_vector(quaternion: ArrayLike) -> Floats:
    """The rotation vector, rad, of norm at most pi, (..., 4) -> (..., 3)."""
    q = normalised(quaternion)
    half = np.arctan2(norms(q[..., 1:])[..., None], q[..., :1])
    return 2.0 * q[..., 1:] / np.sinc(half / np.pi)


def quaternion_from_matrix(matrix: ArrayLike) -> Floats:
    """The unit quaternion (scalar part >= 0) of a rotation matrix, (..., 3, 3) -> (..., 4)."""
    from scipy.spatial.transform import Rotation  # here: it takes a while to load

    given = floats(matrix)
    found = Rotation.from_matrix(given.reshape(-1, 3, 3), assume_valid=True).as_quat(scalar_first=True)
    return normalised(found.reshape(*given.shape[:-2], 4))


_ITERATIONS = 40  # of Newton, at each step of the continuation
_STEPS_MAX = 1_000  # of the continuation
_STRIDE = 0.05  # the continuation's step length, as a share of the mean leg length
_MAX_TURN = 0.3  # rad: the longest rotation that one Newton step may make
_ACCURACY = 1e-9  # of a step before the last one, relative to the leg lengths: it gains as many digits again


class KinematicsError(CpcalError):
    """No pose was found for some leg readings."""


def unreached(message: str, readings: Floats, good: Bools, remedy: str) -> KinematicsError:
    """Of those rows of the readings (K, n) that are not good."""
    row = int(np.argmin(good))
    first = ", ".join(f"{value:.6g}" for value in readings[row])
    return KinematicsError(f"{message} (row {row}: {first} mm): {remedy}")


@dataclass(frozen=True, eq=False)
class Pose(ByValue):
    """One or many poses of the mobile frame in the base frame: `P + R(q) b` maps mobile to base.

    position (..., 3) mm; quaternion (..., 4), scalar first.
    """

    position: Floats
    quaternion: Floats

    @cached_property
    def rotation(self) -> Floats:
        """(..., 3, 3)."""
        return rotation_matrix(self.quaternion)

    def rows(self, chosen: Any) -> "Pose":
        """Some of many poses."""
        return Pose(self.position[chosen], self.quaternion[chosen])

    def moved(self, step: Floats) -> "Pose":
        """Moved by step[..., :3] mm, and turned by the rotation vector step[..., 3:] rad in the base frame."""
        turn = quaternion_from_rotation_vector(step[..., 3:])
        return Pose(self.position + step[..., :3], normalised(quaternion_product(turn, self.quaternion)))


def leg_vectors(robot: Robot, pose: Pose) -> Floats:
    """P + R b - a for every pose and leg, (..., n, 3) mm, in the base frame."""
    turned = np.einsum("...ij,nj->...ni", pose.rotation, robot.mobile)
    return np.asarray(pose.position[..., None, :] + turned - robot.base)


def inverse_kinematics(robot: Robot, pose: Pose) -> Floats:
    """The readings L = ||P + R b - a|| - l, (..., n) mm (the paper, eq. 1)."""
    return norms(leg_vectors(robot, pose)) - robot.offset


def pose_jacobian(robot: Robot, pose: Pose) -> Floats:
    """Derivative of the readings by (P, rotation vector in the base frame), (..., n, 6): mm/mm, mm/rad."""
    vectors = leg_vectors(robot, pose)
    lengths = norms(vectors)[..., None]
    directions = vectors / np.maximum(lengths, TINY)
    arms = vectors - pose.position[..., None, :] + robot.base  # R b
    return np.concatenate([directions, np.cross(arms, directions)], axis=-1)


def central_pose(robot: Robot, readings: ArrayLike, side: float = 1.0) -> Pose:
    """The upright pose, above the base (side -1: below) and unturned, that the readings (n,) roughly allow, made exact.

    It fixes the assembly branch of whatever is continued from it.
    """
    lengths = robot.offset + floats(readings)
    centre = robot.base.mean(axis=0) - robot.mobile.mean(axis=0)
    reach = robot.mobile + centre - robot.base
    height = np.sqrt(max(float(np.mean(lengths**2 - np.sum(reach**2, axis=1))), float(np.mean(lengths)) ** 2 / 100))
    guess = Pose(centre + np.array([0.0, 0.0, side * height]), np.array([1.0, 0.0, 0.0, 0.0]))
    return forward_kinematics(robot, readings, guess)


def forward_kinematics(robot: Robot, readings: ArrayLike, guess: Pose) -> Pose:
    """The poses whose readings are `readings`, (..., n) mm, on the assembly branch of `guess`.

    As `forward_poses`, but raises KinematicsError when some cannot be reached.
    """
    pose, converged = forward_poses(robot, readings, guess)
    if converged.all():
        return pose
    rows = floats(readings).reshape(-1, robot.legs)
    message = f"no pose found for {np.sum(~converged)} of {len(rows)} rows of readings"
    raise unreached(message, rows, converged.ravel(), "give a guess nearer to it, or check the robot's parameters")


def forward_poses(robot: Robot, readings: ArrayLike, guess: Pose) -> tuple[Pose, Bools]:
    """The poses whose readings are `readings`, (..., n) mm, where they can be reached from `guess`, NaN elsewhere; and
    where that is, (...).

    `guess` is one pose or one per row of the readings. The readings are led from those of the guess to those asked for
    in small steps (continuation), with Newton's method at each. Six legs give the pose exactly; more give the
    least-squares pose.

    Raises KinematicsError for fewer than six legs, and for readings that are no lengths of such a robot.
    """
    if robot.legs < 6:
        raise KinematicsError(f"{robot.legs} legs do not determine a pose: forward kinematics needs at least 6")
    asked = floats(readings)
    if asked.ndim == 0 or asked.shape[-1] != robot.legs or not all_finite(asked):
        raise KinematicsError(f"readings of shape {asked.shape}: expected finite numbers, (..., {robot.legs})")
    shape, target = asked.shape[:-1], asked.reshape(-1, robot.legs)
    start = Pose(
        np.broadcast_to(guess.position, (*shape, 3)).reshape(-1, 3),
        normalised(np.broadcast_to(guess.quaternion, (*shape, 4)).reshape(-1, 4)),
    )
    origin = inverse_kinematics(robot, start)
    span = np.max(np.abs(target - origin), axis=1) / np.mean(np.abs(origin + robot.offset), axis=1)
    steps = 1 + int(min(np.max(span, initial=0.0) / _STRIDE, 1e6))
    if steps > _STEPS_MAX:
        raise KinematicsError("the readings are out of all proportion to the robot: are they in mm?")
    position, quaternion = np.full((len(target), 3), np.nan), np.full((len(target), 4), np.nan)
    pose, rows = start, np.arange(len(target))
    for share in np.arange(1, steps + 1) / steps:  # rows that fail are dropped early
        here = (1.0 - share) * origin[rows] + share * target[rows]
        accuracy = _ACCURACY * (1.0 + np.max(np.abs(here + robot.offset), axis=-1))

        def gaps(at: Pose, here: Floats = here) -> Floats:
            return here - inverse_kinematics(robot, at)

        pose, good = newton(robot, gaps, pose, accuracy)
        pose, rows = pose.rows(good), rows[good]
        if not len(rows):
            break
    position[rows], quaternion[rows] = pose.position, pose.quaternion
    found = Pose(position.reshape(*shape, 3), quaternion.reshape(*shape, 4))
    return found, np.asarray(np.isfinite(found.position).all(axis=-1))


def newton(robot: Robot, gaps: Callable[[Pose], Floats], pose: Pose, accuracy: ArrayLike) -> tuple[Pose, Bools]:
    """Poses (K) at which all legs have the length that they should have, and which converged, (K,).

    gaps      what the legs lack of it at poses, (K, n) mm. Legs may be imperfect: the derivative is the robot's own
    accuracy  mm, of gaps and steps

    Newton's method, damped; Gauss-Newton for more than six legs.
    """
    longest = 0.3 * np.mean(norms(leg_vectors(robot, pose)), axis=-1)  # mm, of a step
    arm = 1.0 + float(np.max(norms(robot.mobile)))  # mm/rad
    scale = np.repeat([1.0, arm], 3)
    converged = np.zeros(len(longest), np.bool_)
    for _ in range(_ITERATIONS):
        gap = gaps(pose)
        step = np.einsum("kij,kj->ki", np.linalg.pinv(pose_jacobian(robot, pose) / scale), gap)
        step = np.where(np.isfinite(step), step, 0.0)  # where gaps are not finite nothing converges
        converged = np.max(np.abs(step), axis=1) <= accuracy
        if robot.legs == 6:
            converged &= np.max(np.abs(gap), axis=1) <= accuracy
        move, turn = (norms(part) for part in (step[:, :3], step[:, 3:] / arm))
        size = np.maximum(np.maximum(move / longest, turn / _MAX_TURN), 1.0)
        pose = pose.moved(step / scale / size[:, None])
        if converged.all():
            break
    return pose, converged


# ------------------------------------------------------------------------------------------------------------------
# Rigid motions x -> P + R(q) x, written as a `Pose`: product, inverse, and what they do to points.
#
# Every function broadcasts over leading axes: one motion times N motions gives N.


def compose(left: Pose, right: Pose) -> Pose:
    """First `right`, then `left`: position P + R p (mm) and quaternion of R r, normalised."""
    turned = np.einsum("...ij,...j->...i", left.rotation, right.position)
    return Pose(left.position + turned, normalised(quaternion_product(left.quaternion, right.quaternion)))


def inverse(pose: Pose) -> Pose:
    """The motion back: -R^T P and R^T. A pose of frame B in frame A becomes that of A in B."""
    turned = np.einsum("...ji,...j->...i", pose.rotation, pose.position)
    return Pose(-turned, normalised(quaternion_conjugate(pose.quaternion)))


def transformed(pose: Pose, points: ArrayLike) -> Floats:
    """P + R x for points (..., n, 3) mm: coordinates in the pose's own frame become those in its reference."""
    turned = np.einsum("...ij,...nj->...ni", pose.rotation, floats(points))
    return np.asarray(pose.position[..., None, :] + turned)


def distances(one: Pose, other: Pose) -> ArrayPair:
    """Between K poses: mm, and the angle in rad."""
    turn = turn_between(one.quaternion, other.quaternion)
    return norms(one.position - other.position), norms(turn)


# ------------------------------------------------------------------------------------------------------------------
# Two frames from pairs of poses (the paper, section 3.1).
#
# The robot tells A_i, the mobile frame in the base frame (from its drawing and the leg readings); the camera tells
# B_i, the target frame in the camera frame. Unknown are X, the camera frame in the base frame, and Z, the target
# frame in the mobile frame. Both ways from the target to the base are the same:
#
#     X B_i = A_i Z                                                   (robot-world and hand-eye calibration)
#
# How much rotation there is has one figure, the `spread` in rad of the direction that moves least: for poses the
# smallest over unit vectors v of sqrt(2 (1 - |mean_i R_i v|)), about the rms angle between the R_i v and their mean
# direction. It is zero exactly when all poses turn about one common axis v: then translations along it cannot be found,
# whatever the method.

LEAST_SPREAD = 1e-6  # rad: below it the data are degenerate to rounding
_LOST = 1.0  # spread of the rotations over the rms rotation residual: below it, the rotation is noise


def cross_matrix(vector: ArrayLike) -> Floats:
    """The matrix of v -> vector x v, (..., 3) -> (..., 3, 3)."""
    v = floats(vector)
    return np.cross(v[..., None, :], np.eye(3)).swapaxes(-1, -2)


class FrameCalibration(NamedTuple):
    """camera_in_base: X, target_in_mobile: Z (positions in mm)."""

    camera_in_base: Pose
    target_in_mobile: Pose


def calibrate_frames(robot_poses: Pose, camera_poses: Pose) -> FrameCalibration:
    """X and Z of `X B_i = A_i Z` from N >= 3 poses A_i of the robot and B_i of the camera, in closed form.

    robot_poses     A_i, mobile frame in base frame: (N, 3) mm and (N, 4); e.g. forward_kinematics of the drawing
    camera_poses    B_i, target frame in camera frame, of the same configurations in the same order

    InputError for unusable arrays, for fewer than three pairs, and where the orientations do not determine the frames:
    all (nearly) the same, or turned about one axis only (planar motion), or by no more than their own errors.
    """
    pairs = {"robot_poses": robot_poses, "camera_poses": camera_poses}
    for name, pose in pairs.items():
        table = np.concatenate([pose.position, pose.quaternion], axis=-1)
        good = table.ndim == 2 and table.shape[1] == 7 and all_finite(table)
        if not (good and pose.quaternion.any(axis=1).all()):
            what = "are no poses, or hold a NaN, an infinity or a zero quaternion"
            raise unusable(name, what, "give (N, 3) in mm and (N, 4), scalar first")
    counts = len(robot_poses.position), len(camera_poses.position)
    if counts[0] != counts[1] or counts[0] < 3:
        what, remedy = f"hold {counts[0]} and {counts[1]} poses", "give at least 3, the same measurements in order"
        raise unusable(" and ".join(pairs), what, remedy)
    lengths = np.concatenate([robot_poses.position, camera_poses.position])
    unit = float(np.max(np.abs(lengths))) or 1.0  # no result depends on the unit of lengths
    a, b = (Pose(pose.position / unit, normalised(pose.quaternion)) for pose in pairs.values())
    least, name, direction = min(_spread(name, pose.rotation) for name, pose in zip(pairs, (a, b), strict=True))
    x, z = world_hand_eye(a, b)
    turn = rotation_vector(compose(b, inverse(compose(inverse(x), compose(a, z)))).quaternion)
    rms = float(np.sqrt(np.mean(np.sum(turn**2, axis=1))))
    if least <= _LOST * rms:
        what = (
            f"move the direction ({direction}) by {least:.2g} rad (rms) only, and the two sides differ by {rms:.2g} "
            "rad: translations along it are not determined"
        )
        remedy = "add poses tilted about at least two axes; check that the pairs belong together and map as documented"
        raise unusable(name, what, remedy)
    return FrameCalibration(*(Pose(pose.position * unit, pose.quaternion) for pose in (x, z)))


def axis_text(axis: Floats, decimals: int) -> str:
    """A unit vector (3,) or its opposite, whichever has a positive largest entry."""
    upward = np.round(axis * np.sign(axis[np.argmax(np.abs(axis))]), decimals) + 0.0
    return ", ".join(f"{value:.{decimals}f}" for value in upward)


def _spread(name: str, rotations: Floats) -> tuple[float, str, str]:
    """How far the rotations (N, 3, 3) of poses move the direction that they move least, rad; the poses' name, and that
    direction. InputError that says what is missing where it is zero."""
    left, size, _ = np.linalg.svd(rotations.mean(axis=0))
    least, _, most = np.sqrt(2.0 * np.maximum(0.0, 1.0 - size)).tolist()
    direction = axis_text(left[:, 0], 3)
    if least > LEAST_SPREAD:
        return least, name, direction
    what = f"hardly turn: by {most:.2g} rad (rms), which is not above {LEAST_SPREAD:.2g} rad"
    if most > LEAST_SPREAD:
        what = (
            f"turn about one axis only, ({direction}): it moves by {least:.2g} rad (rms), which is not above "
            f"{LEAST_SPREAD:.2g} rad, so that translations along it are not determined"
        )
    remedy = "add poses tilted about at least two different axes, as far as the robot and the view allow"
    raise unusable(name, what, remedy)


def world_hand_eye(a: Pose, b: Pose, turn: float = 0.0) -> tuple[Pose, Pose]:
    """X and Z of `X B_i = A_i Z` for N poses each, in closed form.

    R_X maps the axes of all motions B_i B_j^-1 to those of A_i A_j^-1, each as long as the sine of its angle, by least
    squares; R_Z and then the translations follow by least squares. Where all motions turn about one axis, their
    rotations leave the angle of R_X about it open, and only translations tell it: `turn` (rad) is added to that angle.
    """
    cross = np.cross(np.eye(3)[:, None], np.eye(3))  # (p, q, a): the axis of a rotation R is half of sum cross R_qp
    both = np.einsum("npk,nsl->pksl", a.rotation, b.rotation)
    axes = np.einsum("pqa,stb,pksl,qktl->ab", cross, cross, both, both)
    most = np.linalg.svd(axes)[0][:, 0]  # of the A_i A_j^-1
    x = rotation_matrix(quaternion_from_rotation_vector(turn * most)) @ nearest_rotation(axes)
    z = nearest_rotation(np.einsum("nji,njk->ik", a.rotation, x @ b.rotation))
    # t_X - R_A t_Z = t_A - R_X t_B, and none along an axis that all motions turn about, but for the rotations' errors
    off = np.linalg.norm(a.rotation @ z - x @ b.rotation, axis=(1, 2))  # sqrt(2) times the angles between both ways
    matrix = np.concatenate([np.tile(np.eye(3), (len(a.position), 1)), -a.rotation.reshape(-1, 3)], axis=1)
    side, least = (a.position - b.position @ x.T).ravel(), float(np.sqrt(np.mean(off**2) / 8.0))
    found = np.linalg.lstsq(matrix, side, rcond=least)[0]
    return Pose(found[:3], quaternion_from_matrix(x)), Pose(found[3:], quaternion_from_matrix(z))


def nearest_rotation(matrix: Floats) -> Floats:
    """The rotation (3, 3) nearest to a matrix in the Frobenius norm."""
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)
