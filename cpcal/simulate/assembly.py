"""Poses of a robot with imperfect legs: six equations a pose, one a leg.

The leg of base joint a and mobile joint b joins two points that the imperfect joints move about, and its length
between them is that of the paper's equation (1) plus what the mechanisms do to it:

    ||C - A|| = s - sag (s / s_ref)^7 sin^2(tilt) +- backlash / 2          s = l + true extension

A and C depend on the leg's direction: see `_joint_centres`. `tilt` is the leg's angle from the vertical (z of the
base frame). The sag term is the shortening of the chord of a uniform, slender beam on two hinges: the deflection
y = k (x^4 - 2 s x^3 + s^3 x), k = q sin(tilt) / (24 E I), has 1/2 int y'^2 dx = (17/70) k^2 s^7; a shortening d means a
deflection of sqrt(d s / 2.49) in the middle. The sign of the clearance follows the load: see `clearance_sides`.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Floats
from cpcal.robot import (
    KinematicsError,
    Mechanisms,
    Pose,
    Robot,
    pose_jacobian,
)
from cpcal.robot.kinematics import newton
from cpcal.simulate.campaigns import joint_effect

_ACCURACY = 1e-13  # of a pose's equations, relative to the leg lengths: a few roundings
_CENTRES = 100  # fixed-point steps for the joint centres; each gains a factor of offset / leg length
_ROUNDS = 10  # of clearance sides and poses in turn


def assembled_with(
    robot: Robot, mechanisms: Mechanisms, readings: Floats, ideal: Pose, approach: npt.ArrayLike = 1.0
) -> Pose:
    """The poses (K) of a robot with these mechanisms whose sensors read `readings`, (K, 6) mm.

    `ideal` holds the poses (K) of the perfect robot, from which they are sought; without any imperfection they are
    returned as they are. `approach` (K, 6) is +1 where the leg came to its length extending, -1 retracting.

    The clearances' sides are those that belong to the pose, except where a leg's force changes sign with the side
    itself: that leg floats in its clearance, and ends on one side.

    Raises KinematicsError, with the rows that failed, when there is no such pose near.
    """
    if mechanisms.perfect:
        return ideal
    pose, side = ideal, clearance_sides(robot, mechanisms, ideal, approach)
    accuracy = _ACCURACY * float(np.max(np.abs(readings + robot.offset), initial=1.0))
    for _ in range(_ROUNDS):
        pose, good = newton(robot, partial(leg_gaps, robot, mechanisms, readings, side=side), pose, accuracy)
        if not good.all():
            message = f"no pose found for {np.sum(~good)} rows of readings of a robot with these imperfections"
            raise KinematicsError.of(message, readings, np.flatnonzero(~good), "make them smaller")
        before, side = side, clearance_sides(robot, mechanisms, pose, approach)
        if not mechanisms.backlash.any() or np.array_equal(before, side):
            break
    return pose


def clearance_sides(robot: Robot, mechanisms: Mechanisms, pose: Pose, approach: npt.ArrayLike = 1.0) -> Floats:
    """+1 where a leg is drawn out of its clearance (tension), -1 where it is pushed into it, (K, n).

    Statics of the platform alone, whose weight acts at the mean of its joint centres along -z of the base frame: the
    axial forces f, in platform weights, solve J^T f = (e_z, R g x e_z). Friction in the actuator resists the
    approach, so the force that decides is f + friction * approach.
    """
    up = np.array([0.0, 0.0, 1.0])
    weight_arm = pose.rotation @ robot.mobile.mean(axis=0)
    wrench = np.concatenate([np.broadcast_to(up, weight_arm.shape), np.cross(weight_arm, up)], axis=-1)
    transposed = np.swapaxes(pose_jacobian(robot, pose), -1, -2)
    force = np.linalg.solve(transposed, wrench[..., None])[..., 0]
    return np.where(force + mechanisms.friction * np.asarray(approach) >= 0.0, -1.0, 1.0)


def leg_gaps(robot: Robot, mechanisms: Mechanisms, readings: Floats, pose: Pose, side: Floats) -> Floats:
    """What each leg's equation misses, (..., n) mm: the length that the reading means, less that of the pose."""
    lower, upper = _joint_centres(robot, mechanisms, pose)
    leg = upper - lower
    length = np.linalg.norm(leg, axis=-1)
    sine_squared = (leg[..., 0] ** 2 + leg[..., 1] ** 2) / length**2
    read = readings - mechanisms.joint_error * joint_effect(robot, pose, mechanisms.joint_phase)
    reference = mechanisms.reference
    stretched = robot.offset + reference + (read - reference) / (1.0 + mechanisms.gain)
    sag = mechanisms.sag * (stretched / (robot.offset + reference)) ** 7 * sine_squared
    return np.asarray(stretched - sag + 0.5 * side * mechanisms.backlash - length)


def _joint_centres(robot: Robot, mechanisms: Mechanisms, pose: Pose) -> tuple[Floats, Floats]:
    """The two ends A and C of each leg, (..., n, 3) mm each, in the base frame.

    The lower end depends on the leg's direction, hence on the upper end, and the other way round: alternately.
    """
    rotation = pose.rotation[..., None, :, :]
    origin = pose.position[..., None, :]
    upper = origin + _turned(rotation, robot.mobile)
    scale = float(np.max(np.abs(robot.parameters)))
    for _ in range(_CENTRES):
        lower = robot.base + _lower_end(mechanisms, upper - robot.base)
        seen = _turned(np.swapaxes(rotation, -1, -2), lower - origin) - robot.mobile
        new = origin + _turned(rotation, robot.mobile + _upper_end(mechanisms, seen))
        change = np.max(np.abs(new - upper), initial=0.0)
        upper = new
        if not change > 1e-14 * scale:
            break
    return lower, upper


def _lower_end(mechanisms: Mechanisms, leg: Floats) -> Floats:
    """From a to the end of the leg, given the leg's other end from a, (..., n, 3) mm, base frame.

    The second axis of the joint stands at right angles to the first axis e and to the leg, so that e, the common
    normal of the two axes and the leg lie in one plane: the normal is the part of `leg` across e, as a unit vector.
    """
    axis = mechanisms.base_axis
    across = leg - np.sum(leg * axis, axis=-1, keepdims=True) * axis
    return np.asarray(mechanisms.base_offset[:, None] * across / np.linalg.norm(across, axis=-1, keepdims=True))


def _upper_end(mechanisms: Mechanisms, leg: Floats) -> Floats:
    """From b to the end of the leg, given the leg's other end D from b, (..., n, 3) mm, mobile frame.

    With e the first axis, (r, t) the directions of D across e and at right angles to both, and offsets (h, d, g):
    axis 2 points along e2 = sin(w) r + cos(w) t where |D across e| sin(w) = d; the common normal of axes 1 and 2 is
    n = cos(w) r - sin(w) t; axis 2 has its foot at h n + d e2, and the leg's line passes it at the distance g.
    """
    axis, (h, d, g) = mechanisms.mobile_axis, mechanisms.mobile_offset.T[..., None]
    along = np.sum(leg * axis, axis=-1, keepdims=True)
    across = leg - along * axis
    reach = np.linalg.norm(across, axis=-1, keepdims=True)
    radial = across / reach
    tangent = np.cross(axis, radial)
    with np.errstate(invalid="ignore"):  # offsets that do not fit give NaN, which Newton reports
        sine, cosine = d / reach, np.sqrt(1.0 - (d / reach) ** 2)
        normal, second = cosine * radial - sine * tangent, sine * radial + cosine * tangent
        rest = along * axis + (reach * cosine - h) * normal  # from the foot on axis 2 to D
        distance = np.linalg.norm(rest, axis=-1, keepdims=True)
        unit = rest / distance
        share = g / distance
        to_line = share * unit + np.sqrt(1.0 - share**2) * np.cross(second, unit)
    return np.asarray(h * normal + d * second + g * to_line)


def _turned(rotation: Floats, vectors: Floats) -> Floats:
    return np.asarray((rotation @ vectors[..., None])[..., 0])
