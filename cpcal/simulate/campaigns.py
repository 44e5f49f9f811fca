"""Simulated campaigns: a true robot, its extremal and random poses, and readings with the paper's noise.

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
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cpcal.common.errors import InputError, refuse
from cpcal.common.values import LARGEST, Floats
from cpcal.robot import (
    DELTALAB,
    Campaign,
    KinematicsError,
    Pose,
    PoseRange,
    Robot,
    Uncertainty,
    central_pose,
    forward_kinematics,
    inverse_kinematics,
    leg_vectors,
    normalised,
    pose_jacobian,
    quaternion_from_rotation_vector,
    quaternion_product,
    small_rotation,
)
from cpcal.robot.campaign import SIMULATION

# ------------------------------------------------------------------------------------------------------------------
# What is asked of the options of simulated measurements: name, whether it is so, remedy.

MEASUREMENTS_MAX = 10_000_000
_MOST = 1_000_000  # of whole numbers, but the seed
_WHOLE = {"seed": (0, math.inf), "runs": (1, _MOST), "random_poses": (0, _MOST), "validation_runs": (1, _MOST)}
_WHOLE |= {"images": (0, _MOST)}
_SIZES = ("noise", "pose_noise", "deviation", "joint_error", "factor", "axis_offset", "backlash", "friction", "sag")
_BOUNDS = {**_WHOLE, **dict.fromkeys(_SIZES, (0, LARGEST)), "gain": (0, 0.99), "truncate": (0.1, LARGEST)}


def check_options(options: Mapping[str, Any], rows: Callable[[], int]) -> None:
    """InputError that names every option of a simulation without a meaning, and one of too many `rows`."""
    stroke, robot, wrong = options["stroke"], options["robot"], dict[str, str]()
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
    stroke: tuple[float, float] = STROKE,
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
    known = ("seed", "runs", "random_poses", "extremal", "joint_error", "factor", "noise", "truncate", "deviation")
    options: dict[str, object] = {name: given[name] for name in known}
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


def configurations(
    bounds: Floats, stream: np.random.Generator, *, random_poses: int, extremal: bool
) -> tuple[list[str], Floats]:
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


def assembled(robot: Robot, readings: Floats, stroke: tuple[float, float]) -> Pose:
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


def standard_noise(stream: np.random.Generator, shape: tuple[int, int], truncate: float | None) -> Floats:
    """Independent standard normal numbers, those beyond +-truncate drawn again."""
    draw = stream.standard_normal(shape)
    while truncate is not None:
        beyond = np.abs(draw) > truncate * _INSIDE
        if not beyond.any():
            break
        draw[beyond] = stream.standard_normal(int(beyond.sum()))
    return draw


def streams(seed: int, count: int = 4) -> list[np.random.Generator]:
    """Independent PCG64 generators; asking for more of them does not change the first ones."""
    return [np.random.Generator(np.random.PCG64(child)) for child in np.random.SeedSequence(seed).spawn(count)]
