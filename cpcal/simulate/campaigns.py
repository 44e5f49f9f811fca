"""Simulated campaigns and studies: a true robot, its extremal and random poses, and readings with the paper's noise.

The true robot is the nominal one plus manufacturing deviations. A true pose P, R is the forward kinematics of
the true robot. The sensors then read, run by run,

    L      = ||P + R b - a|| - l + joint error + noise          (legs; true a, b, l)
    P_k    = P + noise,      R(q_k) = R(1, s) R,  2 s = noise     (camera; in the base frame)

so that noise within the half-widths leaves the truth inside the reading sets of DESIGN section 1, up to the
rounding of a float. Everything follows from the seed: one random stream for each of the true robot, the joint
error, the random poses and the noise, so that more poses or runs do not change the robot.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.random import PCG64, SeedSequence
from numpy.random import Generator as Stream

from cpcal.common.errors import InputError, refuse
from cpcal.common.values import LARGEST, ArrayLike, Floats, Json, Pair, norms
from cpcal.robot import (
    DELTALAB,
    Campaign,
    KinematicsError,
    Pose,
    PoseRange,
    PoseTable,
    Robot,
    Study,
    Truth,
    Uncertainty,
    central_pose,
    compose,
    forward_kinematics,
    inverse_kinematics,
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

# ------------------------------------------------------------------------------------------------------------------
# What is asked of the options of simulated measurements: name, whether it is so, remedy.

MEASUREMENTS_MAX = 10_000_000
_MOST = 1_000_000  # of whole numbers, but the seed
_WHOLE = {"seed": (0, math.inf), "runs": (1, _MOST), "random_poses": (0, _MOST), "validation_runs": (1, _MOST)}
_WHOLE |= {"images": (0, _MOST)}
_SIZES = ("noise", "pose_noise", "deviation", "joint_error", "factor", "axis_offset", "backlash", "friction", "sag")
_BOUNDS = {**_WHOLE, **dict.fromkeys(_SIZES, (0, LARGEST)), "gain": (0, 0.99), "truncate": (0.1, LARGEST)}


def check_options(options: Json, rows: Callable[[], int]) -> None:
    """InputError that names every option of a simulation without a meaning, and one of too many `rows`."""
    stroke, robot, wrong = options["stroke"], options["robot"], {}
    for name, value in options.items():
        low, high = _BOUNDS.get(name, (0, 0))
        if name in _BOUNDS and value is not None:
            kind = type(value) is int if name in _WHOLE else isinstance(value, int | float)
            if not (kind and low <= value <= high):
                wrong[name] = f"give a {'whole ' * (name in _WHOLE)}number from {low:g} to {high:,g}"
    if not isinstance(robot, Robot) or (robot.legs != 6 and options.get("workspace") is None):
        wrong["robot"] = "give a Robot with six legs, or a workspace"
    if not (isinstance(stroke, tuple) and len(stroke) == 2 and -LARGEST < stroke[0] < stroke[1] < LARGEST):
        wrong["stroke"] = "give (shortest, longest) in mm"
    if not options.get("extremal") and options["random_poses"] == 0:  # a study takes them to validate
        wrong["random_poses"] = "give at least one, or the extremal poses"
    if not wrong and rows() > MEASUREMENTS_MAX:
        wrong["runs"] = f"keep the measurements within {MEASUREMENTS_MAX:,}"
    refuse(*((True, f"option {name}", f"has no meaning: {options[name]!r}", give) for name, give in wrong.items()))


# ------------------------------------------------------------------------------------------------------------------
# Campaigns.

STROKE = (0.0, 140.0)  # mm, readings of a DeltaLab leg: 345 to 485 mm long (the paper, section 2.2)
LENGTH_SIGMA = (0.0077, 0.0127, 0.0117, 0.0102, 0.0118, 0.0190)  # mm (the paper, Table 2)
EULER_SIGMA = (9.23e-3, 1.19e-2, 8.94e-3)  # degrees (Table 3); taken as the rotation vector's components
POSITION_SIGMA = (6.33e-2, 2.30e-2, 6.08e-2)  # mm (Table 3)

_WAVES = 3.0  # of the joint error, per radian of joint angle
_INSIDE = 1.0 - 1e-6  # truncated noise stays this much inside, clear of rounding
_MAX_TILT = 60.0  # degrees from upright; the DeltaLab's extremal poses reach 35


def simulate(
    robot: Robot = DELTALAB,
    *,
    seed: int,
    runs: int = 1,
    random_poses: int = 0,
    extremal: bool = True,
    joint_error: float = 0.0,
    factor: float = 3.0,
    noise: float = 1.0,
    truncate: float | None = None,
    deviation: float = 1.0,
    stroke: Pair = STROKE,
    workspace: PoseRange | None = None,
) -> Campaign:
    """A campaign of the 64 extremal leg configurations and of random ones, as a sensor would deliver it.

    robot         the nominal robot, which the campaign states; six legs, or any number with a `workspace`
    seed          >= 0; the same seed gives the same campaign, bit for bit, with the same versions of cpcal, numpy and
                  its linear algebra library on the same kind of processor. Other versions may draw other numbers
                  (numpy promises the bits of PCG64, not what becomes of them) or round the poses differently
    runs          measurements of each configuration; run ids "1", "2", ...
    random_poses  configurations with readings uniform over the stroke; pose ids "r000", ...
    extremal      whether to take the 64 extremal ones; in pose "e37" leg i + 1 is long if bit i of 37 is set
    joint_error   mm, amplitude of `joint_effect`, which 7 parameters a leg cannot describe
    factor        half-width of the reading sets in standard deviations; 0: readings are declared exact
    noise         scale of the paper's standard deviations (Tables 2 and 3), both as drawn and as declared
    truncate      noise beyond this many standard deviations is drawn again; with `truncate <= factor` the
                  truth lies inside the reading sets (when joint_error is 0)
    deviation     mm, standard deviation of each true parameter from its nominal value
    stroke        mm, shortest and longest reading
    workspace     the box of poses to measure, instead of a stroke: its corners are the extremal configurations, and
                  random ones are drawn from it. Coordinates that it fixes are read without noise. Legs repeat the
                  paper's six standard deviations in turn

    The true robot is in the provenance: see `true_robot`. InputError for senseless options, KinematicsError
    when a configuration cannot be assembled.
    """
    given = dict(locals())
    corners = extremal * (64 if workspace is None else 1 << int(workspace.free.sum()))
    check_options(given, lambda: (corners + random_poses) * runs)
    shape_stream, joint_stream, pose_stream, noise_stream = streams(seed)
    deviations = deviation * shape_stream.standard_normal((robot.legs, 7))
    truth = Robot.from_parameters(robot.name, robot.parameters + deviations)
    bounds = np.tile(np.array(stroke)[:, None], 6) if workspace is None else workspace.bounds
    names, rows = configurations(bounds, pose_stream, random_poses=random_poses, extremal=extremal)
    if workspace is None:
        poses = assembled(truth, rows, stroke)
    else:
        poses = Pose(rows[:, :3], quaternion_from_rotation_vector(rows[:, 3:]))
    phases = joint_stream.uniform(0.0, 2.0 * np.pi, (truth.legs, 2))
    lengths = inverse_kinematics(truth, poses) + joint_error * joint_effect(truth, poses, phases)
    free = np.ones(6) if workspace is None else workspace.free.astype(np.float64)  # what a workspace fixes has no noise
    pose_sigma = noise * free * np.concatenate([POSITION_SIGMA, np.radians(EULER_SIGMA)])
    length_sigma = noise * np.resize(LENGTH_SIGMA, robot.legs)
    # a pose's runs together
    draw = standard_noise(noise_stream, (len(lengths) * runs, 6 + robot.legs), truncate)
    turn = small_rotation(draw[:, 3:6] * pose_sigma[3:])
    stated = Uncertainty(pose_sigma[:3], pose_sigma[3:], length_sigma, factor) if factor > 0 else None
    apart = ("robot", "stroke", "workspace")
    options = {name: value for name, value in given.items() if name not in apart}
    if workspace is None:
        options["stroke"] = list(stroke)
    else:
        options["workspace"] = {name: getattr(workspace, name).tolist() for name in ("low", "high", "turn")}
    return Campaign.of(
        robot,
        np.repeat(poses.position, runs, axis=0) + draw[:, :3] * pose_sigma[:3],
        normalised(quaternion_product(turn, np.repeat(poses.quaternion, runs, axis=0))),
        np.repeat(lengths, runs, axis=0) + draw[:, 6:] * length_sigma,
        pose=[name for name in names for _ in range(runs)],
        run=[str(run) for _ in names for run in range(1, runs + 1)],
        uncertainty=stated,
        exact=stated is None,
        provenance={
            "generator": SIMULATION,
            "options": json.dumps(options),
            "true_parameters": json.dumps(truth.parameters.tolist()),
        },
    )


def true_robot(campaign: Campaign) -> Robot | None:
    """The true robot behind a simulated campaign; None when its provenance does not tell."""
    try:
        parameters = json.loads(campaign.provenance["true_parameters"])
        return Robot.from_parameters(campaign.robot.name, parameters)
    except (KeyError, ValueError, TypeError, RecursionError, InputError):
        return None


def configurations(bounds: Floats, stream: Stream, *, random_poses: int, extremal: bool) -> tuple[list[str], Floats]:
    """Pose ids (K) and (K, 6) numbers that command them, leg readings or poses: the corners of the box `bounds` (2, 6),
    and such as are drawn evenly from it.

    In "e05" number i of those that vary is at its upper end if bit i of 5 is set.
    """
    low, high = bounds
    free = np.flatnonzero(low < high)
    corners = np.tile(low, (1 << len(free) if extremal else 0, 1))
    corners[:, free] += (np.arange(len(corners))[:, None] >> np.arange(len(free)) & 1) * (high - low)[free]
    names = [f"e{k:02d}" for k in range(len(corners))] + [f"r{k:03d}" for k in range(random_poses)]
    return names, np.concatenate([corners, stream.uniform(low, high, (random_poses, 6))])


def assembled(robot: Robot, readings: Floats, stroke: Pair) -> Pose:
    """The poses (K) with these readings (K, 6), all on the assembly branch of the upright mid-stroke pose.

    Each is continued from that pose along a straight line in the readings. See `check_branch`.
    """
    centre = central_pose(robot, np.full(robot.legs, 0.5 * (stroke[0] + stroke[1])))
    poses = forward_kinematics(robot, readings, centre)
    check_branch(robot, poses, centre)
    return poses


def check_branch(robot: Robot, poses: Pose, centre: Pose) -> None:
    """KinematicsError unless the poses (K) lie on the assembly branch of the pose `centre`.

    The Jacobian's determinant must have the same sign there, and the platform be above the base and moderately
    tilted.
    """
    sign = np.sign(np.linalg.det(pose_jacobian(robot, centre)))
    same = np.sign(np.linalg.det(pose_jacobian(robot, poses))) == sign
    upright = poses.rotation[:, 2, 2] > math.cos(math.radians(_MAX_TILT))
    lost = int(np.sum(~(same & upright & (poses.position[:, 2] > robot.base[:, 2].max()))))
    if lost:
        message = f"{lost} of {len(same)} configurations leave the assembly branch of the upright pose"
        raise KinematicsError(f"{message}: lessen the deviation or the stroke")


def joint_effect(robot: Robot, poses: Pose, phases: Floats) -> Floats:
    """A smooth effect in [-1, 1] of the joints' angles on each leg's reading, (..., n).

    With t_x, t_y the angles of the leg about the base joint and t'_x, t'_y those about the mobile joint (rad,
    each in its platform's frame), and the two phases p, p' of each leg, (n, 2) rad, it is
    (sin(3 (t_x + t_y) + p) + sin(3 (t'_x - t'_y) + p')) / 2. Over the extremal poses its largest value is 0.8
    or more, and 0.3 to 1.2 (typically 0.75) is left after the best fit of 7 parameters (300 seeds).
    """
    at_base = leg_vectors(robot, poses)
    at_mobile = np.einsum("...ji,...nj->...ni", poses.rotation, at_base)
    base_angle = np.arctan2(at_base[..., 0], at_base[..., 2]) + np.arctan2(at_base[..., 1], at_base[..., 2])
    mobile_angle = np.arctan2(at_mobile[..., 0], at_mobile[..., 2]) - np.arctan2(at_mobile[..., 1], at_mobile[..., 2])
    waves = np.sin(_WAVES * base_angle + phases[:, 0]) + np.sin(_WAVES * mobile_angle + phases[:, 1])
    return np.asarray(0.5 * waves)


def standard_noise(stream: Stream, shape: tuple[int, int], truncate: float | None) -> Floats:
    """Independent standard normal numbers, those beyond +-truncate drawn again."""
    draw = stream.standard_normal(shape)
    while truncate is not None:
        beyond = np.abs(draw) > truncate * _INSIDE
        if not beyond.any():
            break
        draw[beyond] = stream.standard_normal(int(beyond.sum()))
    return draw


def streams(seed: int, count: int = 4) -> list[Stream]:
    """Independent PCG64 generators; asking for more of them does not change the first ones."""
    return [Stream(PCG64(child)) for child in SeedSequence(seed).spawn(count)]


# ------------------------------------------------------------------------------------------------------------------
# Simulated studies: the paper's experiment (sections 2.2 to 2.3.3) on a robot whose legs may be imperfect.
#
# Sensors are commanded to the 64 extremal configurations, several runs each, and to random ones. The true robot is the
# nominal one plus manufacturing deviations, and its legs have the given mechanisms; `assembled_with` finds true poses.
# What is recorded of a pose P, R of the mobile frame in the base frame is
#
#     L     = commanded reading + noise (Table 2), once a run
#     q, P  = R(1, s) camera R target,   2 s = noise,   position + noise (Table 3): target frame in camera frame
#
# Table 3 speaks of single images. A run's row is the mean of its ten images unless images are asked for: the noise of a
# mean of ten that are independent. (The paper does not tell how much of Table 3 is the robot's own scatter between
# runs, which a mean of images would not lessen; here that scatter comes from backlash alone.)
#
# Everything follows from the seed: one random stream for each kind of thing, so that neither more runs nor another size
# of a mechanism change the robot, the frames or the configurations; the true parameters and the joint error's phases
# are those of `simulate` with the same seed.

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
    stroke: Pair = STROKE,
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
    # aimed by eye: a camera about a metre above the base that looks down, and the target on the mobile platform
    place = np.array([*frames.normal(0.0, 50.0, 2), frames.uniform(900.0, 1100.0)])
    looking = quaternion_product(_loosely_upright(frames, math.radians(5.0)), [0.0, 1.0, 0.0, 0.0])
    above = Pose(-rotation_matrix(looking) @ place, normalised(looking))
    fixed = np.array([*frames.normal(0.0, 20.0, 2), frames.uniform(5.0, 20.0)])
    target = Pose(fixed, normalised(_loosely_upright(frames, math.radians(2.0))))
    truth = Truth(seed, true_robot, above if camera is None else camera, target)
    rows = max(images, 1)
    share = noise if pose_noise is None else pose_noise
    share = share if images else share / math.sqrt(MEAN_OF)

    def table(extremal: bool, runs: int, approach: Stream, noisy: Stream) -> PoseTable:
        """What camera and sensors say of the poses, one after the other."""
        drawn = 0 if extremal else random_poses
        bounds = np.tile(np.array(stroke)[:, None], 6)
        names, readings = configurations(bounds, pose, random_poses=drawn, extremal=extremal)
        poses = true_poses(true_robot, mechanisms, readings, stroke, runs, approach)
        ids = [(name, str(run)) for name in names for run in range(1, runs + 1)]
        readings = np.repeat(readings, runs, axis=0)
        length = readings + noise * standard_noise(noisy, readings.shape, truncate) * np.array(LENGTH_SIGMA)
        seen = compose(compose(truth.camera, poses), target)
        draw = share * standard_noise(noisy, (len(ids) * rows, 6), truncate)
        turn = small_rotation(draw[:, 3:] * np.radians(EULER_SIGMA))
        return PoseTable(
            tuple(pose for pose, _ in ids for _ in range(rows)),
            tuple(run for _, run in ids for _ in range(rows)),
            np.repeat(seen.position, rows, axis=0) + draw[:, :3] * np.array(POSITION_SIGMA),
            normalised(quaternion_product(turn, np.repeat(seen.quaternion, rows, axis=0))),
            np.repeat(length, rows, axis=0),
            tuple(str(image) for _ in ids for image in range(1, rows + 1)) if images else None,
        )

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
    robot: Robot, mechanisms: Mechanisms, readings: Floats, stroke: Pair, runs: int, approach: Stream
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


def mechanisms_of(options: Json) -> Mechanisms:
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
    robot: Robot, mechanisms: Mechanisms, readings: Floats, ideal: Pose, approach: ArrayLike = 1.0
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


def clearance_sides(robot: Robot, mechanisms: Mechanisms, pose: Pose, approach: ArrayLike = 1.0) -> Floats:
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
    leg = leg - mechanisms.base_offset[:, None] * across / norms(across)[..., None]
    length = norms(leg)
    sine_squared = (leg[..., 0] ** 2 + leg[..., 1] ** 2) / length**2
    read = readings - mechanisms.joint_error * joint_effect(robot, pose, mechanisms.joint_phase)
    reference = mechanisms.reference
    stretched = robot.offset + reference + (read - reference) / (1.0 + mechanisms.gain)
    sag = mechanisms.sag * (stretched / (robot.offset + reference)) ** 7 * sine_squared
    return np.asarray(stretched - sag + 0.5 * side * mechanisms.backlash - length)
