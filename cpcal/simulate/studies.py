"""Simulated studies: the paper's experiment (sections 2.2 to 2.3.3) on a robot whose legs may be imperfect.

Sensors are commanded to the 64 extremal configurations, several runs each, and to random ones. The true robot is the
nominal one plus manufacturing deviations, and its legs have the given mechanisms; `assembled_with` finds true poses.
What is recorded of a pose P, R of the mobile frame in the base frame is

    L     = commanded reading + noise (Table 2), once a run
    q, P  = R(1, s) camera R target,   2 s = noise,   position + noise (Table 3): target frame in camera frame

Table 3 speaks of single images. A run's row is the mean of its ten images unless images are asked for: the noise of a
mean of ten that are independent. (The paper does not tell how much of Table 3 is the robot's own scatter between runs,
which a mean of images would not lessen; here that scatter comes from backlash alone.)

Everything follows from the seed: one random stream for each kind of thing, so that neither more runs nor another size
of a mechanism change the robot, the frames or the configurations; the true parameters and the joint error's phases are
those of `simulate` with the same seed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Floats
from cpcal.robot import (
    DELTALAB,
    Pose,
    PoseTable,
    Robot,
    Study,
    Truth,
    central_pose,
    compose,
    leg_vectors,
    normalised,
    pose_jacobian,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_matrix,
    small_rotation,
)
from cpcal.robot.campaign import SIMULATION
from cpcal.robot.kinematics import newton, unreached
from cpcal.simulate.campaigns import (
    EULER_SIGMA,
    LENGTH_SIGMA,
    POSITION_SIGMA,
    STROKE,
    assembled,
    check_branch,
    check_options,
    configurations,
    joint_effect,
    standard_noise,
    streams,
)

Stream = np.random.Generator

MEAN_OF = 10  # images of a run, of which a row without images is the mean (the paper, section 2.3.2)


def simulate_study(
    robot: Robot = DELTALAB,
    *,
    seed: int,
    runs: int = 11,
    validation_runs: int = 10,
    random_poses: int = 64,
    images: int = 0,
    noise: float = 1.0,
    pose_noise: float | None = None,
    camera: Pose | None = None,
    truncate: float | None = None,
    deviation: float = 1.0,
    stroke: tuple[float, float] = STROKE,
    joint_error: float = 0.0,
    axis_offset: float = 0.0,
    backlash: float = 0.0,
    friction: float = 0.2,
    sag: float = 0.0,
    gain: float = 0.0,
) -> Study:
    """A study as the paper's experiment would deliver it, with the truth.

    robot             the nominal robot; six legs
    seed              >= 0; the same seed gives the same study, as `simulate` explains
    runs              of each of the 64 extremal configurations ("e00" to "e63"; see `simulate`), for calibration
    random_poses  random configurations ("r000", ...), with `validation_runs` runs each, for validation
    images            rows of single images of each run; 0: one row a run, the mean of ten images
    noise             scale of the paper's standard deviations (Tables 2 and 3)
    pose_noise        of Table 3 alone, where that is another; 0 gives the true poses, to render images of
    camera            the base frame in the camera frame, mm; left out: drawn, about a metre above the base
    truncate          noise beyond this many standard deviations is drawn again
    deviation         mm, standard deviation of each true parameter from its nominal value
    stroke            mm, shortest and longest reading
    joint_error       mm, amplitude of `joint_effect`

    What follows is explained in `Mechanisms`; size 0 is a perfect leg, and changes nothing, bit for bit.

    axis_offset       mm, between the two axes of each lower joint, with a random sign
    backlash          mm, whole clearance of each leg; its side follows the load
    friction          in platform weights, by which the direction of approach, random in each run, shifts the load
    sag               mm, shortening of a leg that lies flat, by its own weight
    gain              relative error of each length sensor, about mid-stroke, with a random sign

    InputError for senseless options, KinematicsError when a configuration cannot be assembled.
    """
    options = dict(locals())
    check_options(options, lambda: (64 * runs + random_poses * validation_runs) * max(images, 1))
    shape, _, pose, noise_c, _, frames, approach_c, noise_v, approach_v = streams(seed, 9)
    true_robot = Robot.from_parameters(robot.name, robot.parameters + deviation * shape.standard_normal((6, 7)))
    mechanisms = mechanisms_of(options)
    drawn_camera, target = _camera(frames), _target(frames)
    truth = Truth(seed, true_robot, drawn_camera if camera is None else camera, target)
    scales = (noise, noise if pose_noise is None else pose_noise)

    def table(extremal: bool, runs: int, approach: Stream, noisy: Stream) -> PoseTable:
        drawn = 0 if extremal else random_poses
        bounds = np.tile(np.array(stroke)[:, None], 6)
        names, readings = configurations(bounds, pose, random_poses=drawn, extremal=extremal)
        poses = true_poses(true_robot, mechanisms, readings, stroke, runs, approach)
        ids = [(name, str(run)) for name in names for run in range(1, runs + 1)]
        return _recorded(truth, ids, poses, np.repeat(readings, runs, axis=0), images, scales, truncate, noisy)

    left_out = {"robot", "camera", *(("pose_noise",) if pose_noise is None else ())}
    told = {name: value for name, value in options.items() if name not in left_out}
    return Study(
        robot,
        table(True, runs, approach_c, noise_c),
        table(False, validation_runs, approach_v, noise_v),
        truth,
        {"generator": f"{SIMULATION} --study", "options": json.dumps(told)},
    )


def true_poses(
    robot: Robot, mechanisms: Mechanisms, readings: Floats, stroke: tuple[float, float], runs: int, approach: Stream
) -> Pose:
    """The mobile frame in the base frame for readings (K, 6), `runs` times each: (K runs).

    Each leg comes to its length extending or retracting, at random in every run.
    """
    ideal = assembled(robot, readings, stroke)
    ideal = Pose(np.repeat(ideal.position, runs, axis=0), np.repeat(ideal.quaternion, runs, axis=0))
    came = np.where(approach.random((len(readings) * runs, robot.legs)) < 0.5, -1.0, 1.0)
    poses = assembled_with(robot, mechanisms, np.repeat(readings, runs, axis=0), ideal, came)
    check_branch(robot, poses, central_pose(robot, np.full(robot.legs, 0.5 * (stroke[0] + stroke[1]))))
    return poses


def _recorded(
    truth: Truth,
    ids: list[tuple[str, str]],
    poses: Pose,
    readings: Floats,
    images: int,
    noise: tuple[float, float],
    truncate: float | None,
    stream: Stream,
) -> PoseTable:
    """What camera and sensors say of the poses (M), one after the other: M rows, or M images rows."""
    rows = max(images, 1)
    share = noise[1] if images else noise[1] / math.sqrt(MEAN_OF)
    length = readings + noise[0] * standard_noise(stream, readings.shape, truncate) * np.array(LENGTH_SIGMA)
    seen = compose(compose(truth.camera, poses), truth.target)
    draw = share * standard_noise(stream, (len(ids) * rows, 6), truncate)
    turn = small_rotation(draw[:, 3:] * np.radians(EULER_SIGMA))
    return PoseTable(
        tuple(pose for pose, _ in ids for _ in range(rows)),
        tuple(run for _, run in ids for _ in range(rows)),
        np.repeat(seen.position, rows, axis=0) + draw[:, :3] * np.array(POSITION_SIGMA),
        normalised(quaternion_product(turn, np.repeat(seen.quaternion, rows, axis=0))),
        np.repeat(length, rows, axis=0),
        tuple(str(image) for _ in ids for image in range(1, rows + 1)) if images else None,
    )


def _camera(stream: Stream) -> Pose:
    """The base frame seen by a camera about a metre above the base that looks down, aimed by eye."""
    place = np.array([*stream.normal(0.0, 50.0, 2), stream.uniform(900.0, 1100.0)])
    down = np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = quaternion_product(_loosely_upright(stream, math.radians(5.0)), down)
    return Pose(-rotation_matrix(quaternion) @ place, normalised(quaternion))


def _target(stream: Stream) -> Pose:
    """The target frame on the mobile platform, put there by eye."""
    position = np.array([*stream.normal(0.0, 20.0, 2), stream.uniform(5.0, 20.0)])
    return Pose(position, normalised(_loosely_upright(stream, math.radians(2.0))))


def _loosely_upright(stream: Stream, tilt: float) -> Floats:
    """A quaternion: any turn about z, then a tilt with a standard deviation of `tilt` rad about x and about y."""
    turn = quaternion_from_rotation_vector([0.0, 0.0, stream.uniform(-np.pi, np.pi)])
    return quaternion_product(quaternion_from_rotation_vector([*stream.normal(0.0, tilt, 2), 0.0]), turn)


# ------------------------------------------------------------------------------------------------------------------
# Imperfect legs: physical mechanisms that the seven parameters of a leg leave out, each with its own size.


@dataclass(frozen=True, eq=False)
class Mechanisms:
    """What is imperfect about each of n legs. Zero offsets, backlash, sag, gain, joint error: nothing.

    base_axis      (n, 3) unit, base frame: first axis of the lower universal joint, fixed in the base, through a
    base_offset    (n,) mm: its second axis passes at this distance, along the common normal of the two, which
                   turns about the first axis with the leg and points to the leg's side of it
    backlash       (n,) mm: whole clearance along the leg, which is half of it longer under tension and half of it
                   shorter under compression
    friction       platform weights: of the axial force, positive under compression, that the approach adds
                   (extending) or takes away (retracting) before its sign decides the side of the clearance
    sag            (n,) mm: by how much the leg's own weight would bring together the ends of the leg if it lay
                   flat with the length of mid-stroke
    gain           (n,): the sensor reads `reference + (1 + gain) (true - reference)`
    reference      mm: the reading at mid-stroke
    joint_error    (n,) mm, joint_phase (n, 2) rad: amplitude and phases of `joint_effect` on the reading
    """

    base_axis: Floats
    base_offset: Floats
    backlash: Floats
    friction: float
    sag: Floats
    gain: Floats
    reference: float
    joint_error: Floats
    joint_phase: Floats

    @property
    def perfect(self) -> bool:
        """Whether nothing is imperfect, whatever the axes, the friction and the phases are."""
        active = (self.base_offset, self.backlash, self.sag, self.gain, self.joint_error)
        return not any(values.any() for values in active)


def mechanisms_of(options: Mapping[str, Any]) -> Mechanisms:
    """Of the options of a simulated study, which its provenance holds as JSON.

    First axes are level, in random directions; offsets and gains have the given size and a random sign. The draw does
    not depend on the sizes, so that each scales on its own.
    """
    children, legs = streams(options["seed"], 9), 6
    azimuth = children[4].uniform(0.0, 2.0 * np.pi, (2, legs))[0]
    sign = np.where(children[4].random((5, legs)) < 0.5, -1.0, 1.0)
    return Mechanisms(
        base_axis=np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(legs)], axis=-1),
        base_offset=options["axis_offset"] * sign[0],
        backlash=np.full(legs, options["backlash"]),
        friction=options["friction"],
        sag=np.full(legs, options["sag"]),
        gain=options["gain"] * sign[4],
        reference=0.5 * sum(options["stroke"]),
        joint_error=np.full(legs, options["joint_error"]),
        joint_phase=children[1].uniform(0.0, 2.0 * np.pi, (legs, 2)),
    )


# ------------------------------------------------------------------------------------------------------------------
# Poses of a robot with imperfect legs: six equations a pose, one a leg.
#
# The leg of base joint a and mobile joint b joins two points that the imperfect joints move about, and its length
# between them is that of the paper's equation (1) plus what the mechanisms do to it:
#
#     ||C - A|| = s - sag (s / s_ref)^7 sin^2(tilt) +- backlash / 2          s = l + true extension
#
# A depends on the leg's direction. `tilt` is the leg's angle from the vertical (z of the
# base frame). The sag term is the shortening of the chord of a uniform, slender beam on two hinges: the deflection
# y = k (x^4 - 2 s x^3 + s^3 x), k = q sin(tilt) / (24 E I), has 1/2 int y'^2 dx = (17/70) k^2 s^7; a shortening d
# means a deflection of sqrt(d s / 2.49) in the middle.
# The sign of the clearance follows the load: see `clearance_sides`.


_ACCURACY = 1e-13  # of a pose's equations, relative to the leg lengths: a few roundings
_ROUNDS = 10  # of clearance sides and poses in turn


def assembled_with(
    robot: Robot, mechanisms: Mechanisms, readings: Floats, ideal: Pose, approach: npt.ArrayLike = 1.0
) -> Pose:
    """The poses (K) of a robot with these mechanisms whose sensors read `readings`, (K, 6) mm.

    `ideal` holds the poses (K) of the perfect robot, from which they are sought; without any imperfection they are
    returned as they are. `approach` (K, 6) is +1 where the leg came to its length extending, -1 retracting.

    The clearances' sides are those that belong to the pose, except where a leg's force changes sign with the side
    itself: that leg floats in its clearance, and ends on one side.

    Raises KinematicsError when there is no such pose near.
    """
    if mechanisms.perfect:
        return ideal
    pose, side = ideal, clearance_sides(robot, mechanisms, ideal, approach)
    accuracy = _ACCURACY * float(np.max(np.abs(readings + robot.offset), initial=1.0))
    for _ in range(_ROUNDS):
        pose, good = newton(robot, partial(leg_gaps, robot, mechanisms, readings, side=side), pose, accuracy)
        if not good.all():
            message = f"no pose found for {np.sum(~good)} rows of readings of a robot with these imperfections"
            raise unreached(message, readings, good, "make them smaller")
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
    leg = leg_vectors(robot, pose)
    # The second axis of the lower joint stands at right angles to the first axis e and to the leg, so that e, common
    # normal and leg lie in one plane: the normal is the part of the leg across e, as a unit vector.
    across = leg - np.sum(leg * mechanisms.base_axis, axis=-1, keepdims=True) * mechanisms.base_axis
    leg = leg - mechanisms.base_offset[:, None] * across / np.linalg.norm(across, axis=-1, keepdims=True)
    length = np.linalg.norm(leg, axis=-1)
    sine_squared = (leg[..., 0] ** 2 + leg[..., 1] ** 2) / length**2
    read = readings - mechanisms.joint_error * joint_effect(robot, pose, mechanisms.joint_phase)
    reference = mechanisms.reference
    stretched = robot.offset + reference + (read - reference) / (1.0 + mechanisms.gain)
    sag = mechanisms.sag * (stretched / (robot.offset + reference)) ** 7 * sine_squared
    return np.asarray(stretched - sag + 0.5 * side * mechanisms.backlash - length)
