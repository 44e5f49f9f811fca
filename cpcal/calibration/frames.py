"""Where the camera stands and how the target is fixed, from poses and leg readings (the paper, section 3.1).

A closed form begins (`calibrate_frames`); least squares on the legs' lengths end, for a study and for a log alike.
All of this is ordinary estimation: nothing here is proved.
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpcal.calibration.fit import Fit, Noise, fit, robust_scale
from cpcal.common.errors import InputError, unusable
from cpcal.common.files import listed
from cpcal.common.numbers import about, nearest
from cpcal.common.values import Bools, Floats, Numbers
from cpcal.robot import (
    Campaign,
    KinematicsError,
    LegEquations,
    Pose,
    Robot,
    Uncertainty,
    calibrate_frames,
    central_pose,
    compose,
    inverse,
    inverse_kinematics,
    quaternion_from_matrix,
    rotation_vector,
    transformed,
)
from cpcal.robot.kinematics import FrameCalibration, cross_matrix, forward_poses, nearest_rotation
from cpcal.robot.mistakes import spread_of


def redefined(robot: Robot, camera_in_base: Pose, target_in_mobile: Pose) -> Robot:
    """The robot with its base joint centres in the camera frame and its mobile ones in the target frame.

    Then `P + R b` with the camera's own P and R maps them into one frame, and the measured poses calibrate the legs
    without further frames (the paper, end of section 3.1). Offsets stay.
    """
    base = transformed(inverse(camera_in_base), robot.base)
    return Robot(robot.name, base, transformed(inverse(target_in_mobile), robot.mobile), robot.offset)


# ------------------------------------------------------------------------------------------------------------------
# Calibrated joint centres laid on those of the drawing: where the drawing's frame is, and how well that is known.
#
# A robot has no other base frame than its joints, and the drawing says where these are in it. So the frame is that of
# the rigid motion that brings the calibrated centres nearest to the drawing's (least squares), known to within the
# calibration's errors. How far the joints are from where the drawing has them is told by what the motion leaves over.


@dataclass(frozen=True)
class FittedFrame:
    """The frame in which the centres were measured, seen in the drawing's: x_drawing = P + R(q) x_measured, P in mm.

    sigma            (6,) standard deviations of position (mm) and rotation vector (rad, drawing's frame), of the frame
                     that the joints define
    drawing_error    mm: how far a coordinate of a joint centre is off its drawing (standard deviation)
    """

    position: Numbers
    quaternion: Numbers
    sigma: Numbers
    drawing_error: float

    def sentence(self, name: str) -> str:
        return (
            f"{name}: the calibrated joint centres are {self.drawing_error:.2g} mm a coordinate off the drawing's; the "
            f"frame that they define is known to U = {2.0 * max(self.sigma[:3]):.2g} mm (k = 2)."
        )


def nearest_motion(measured: Floats, drawing: Floats) -> Pose:
    """The rigid motion that brings centres (n, 3) mm nearest to the drawing's.

    Raises InputError for fewer than three centres, and for centres on a line.
    """
    count, middle, drawn = len(measured), measured.mean(axis=0), drawing.mean(axis=0)
    sizes = np.linalg.svd(drawing - drawn, compute_uv=False) if count > 2 else np.zeros(3)
    if sizes[1] < 1e-9 * sizes[0] or sizes[0] == 0.0:
        what = f"are {count} on a line, or fewer than three: no frame follows from them"
        raise unusable("joint centres", what, "give three that are not on a line")
    rotation = nearest_rotation((drawing - drawn).T @ (measured - middle))
    return Pose(drawn - rotation @ middle, quaternion_from_matrix(rotation))


def fitted_frames(fit: Fit, drawing: Robot, shared: Floats | None = None) -> tuple[FittedFrame, FittedFrame]:
    """Of base and mobile centres of a fit of all legs, laid on the drawing's.

    shared  (2, 6) standard deviations of an error of each frame that comes on top. Raises InputError as
            `nearest_motion`.
    """
    x, count = fit.parameters, len(fit.parameters)
    blocks = np.where(np.isfinite(fit.covariance), fit.covariance, 0.0).reshape(count, 7, count, 7)
    found = []
    for k, drawn in enumerate((drawing.base, drawing.mobile)):
        part = slice(3 * k, 3 * k + 3)
        motion = nearest_motion(x[:, part], drawn)
        turned = x[:, part] @ motion.rotation.T
        residual = drawn - turned - motion.position
        columns = np.hstack([np.tile(np.eye(3), (count, 1)), -cross_matrix(turned).reshape(-1, 3)])
        back = np.linalg.pinv(columns) @ np.kron(np.eye(count), motion.rotation)
        own = back @ blocks[:, part, :, part].reshape(3 * count, 3 * count) @ back.T
        own += np.diag(np.zeros(6) if shared is None else shared[k] ** 2)
        error = float(np.sqrt(np.sum(residual**2) / (3 * count - 6)))
        parts = motion.position, motion.quaternion, np.sqrt(np.diagonal(own))
        position, quaternion, sigma = (tuple(values.tolist()) for values in parts)
        found.append(FittedFrame(position, quaternion, sigma, error))
    return found[0], found[1]


# Parameters laid on the drawing, so that those of two fits can be compared: base and mobile centres each by the rigid
# motion that brings them nearest to the drawing's.

_STEP = 1e-3  # mm, of the difference quotients; the map is smooth over millimetres


def on_drawing(parameters: Floats, drawing: Robot) -> Floats:
    """Parameters (n, 7), mm, in the drawing's frames. Raises InputError as `nearest_motion` does."""
    parts = [
        transformed(nearest_motion(parameters[:, columns], centres), parameters[:, columns])
        for columns, centres in ((slice(0, 3), drawing.base), (slice(3, 6), drawing.mobile))
    ]
    return np.hstack([*parts, parameters[:, 6:]])


def on_drawing_errors(found: Fit, drawing: Robot) -> Floats:
    """(n, 7) mm: standard deviations of `on_drawing`, to first order, from the covariance of a fit."""
    parameters, size = found.parameters, found.parameters.size
    steps = _STEP * np.eye(size).reshape(size, *parameters.shape)
    ahead, back = (
        np.stack([on_drawing(parameters + sign * step, drawing).ravel() for step in steps]) for sign in (1.0, -1.0)
    )
    slopes = ((ahead - back) / (2.0 * _STEP)).T
    variance = np.diagonal(slopes @ found.covariance @ slopes.T).reshape(parameters.shape)
    return np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.inf))


# ------------------------------------------------------------------------------------------------------------------
# Poses of a target in a tracker's frame, from a log in which each was read once.
#
# The drawing and the readings of the legs give poses of the mobile frame, from above the base or from below, and these
# the frames by the closed form, wherever the tracker stands. The legs are then fitted in the frames of tracker and
# target, by least squares with the stated deviations. In which base frame, no reading tells: a turn or shift of it is
# one of all base centres. So the frames stand where the centres are nearest to the drawing's.

_FAR = 5.0  # times the median of the rows' residuals, or robust standard deviations of a leg's: left out of the frames
_TRIMS = 4
_ROWS = 2_000  # of a log, spread evenly, are enough for frames
_ROUNDING = 1e-6  # mm: residuals below it are none
_TOLD = 6  # rows that a sentence names


Drawn = tuple[Pose, Bools]  # by forward kinematics: poses (N), and which were found


def drawn_poses(robot: Robot, length: Floats) -> list[Drawn]:
    """The poses that the drawing gives for readings (N, n) mm, from above its base and from below.

    Raises KinematicsError for fewer than six legs and where the drawing cannot reach the readings.
    """
    found = []
    failed = []
    for side in (1.0, -1.0):
        try:
            found.append(forward_poses(robot, length, central_pose(robot, np.median(length, axis=0), side)))
        except KinematicsError as error:
            failed.append(error)
    if not found:
        raise failed[0]
    return found


def first_frames(robot: Robot, length: Floats, seen: Pose, drawn: list[Drawn] | None = None) -> FrameCalibration:
    """Frames by `drawn_poses` of readings (N, n) mm, against those that camera or tracker saw (N).

    Rows that are far off the others are left out, so that a wrong reading moves no frame. Raises InputError as
    `calibrate_frames` does, and KinematicsError as `drawn_poses`.
    """
    found = []
    failed = []
    for reached, good in drawn or drawn_poses(robot, length):
        try:
            rows = keep = np.flatnonzero(good)
            for _ in range(_TRIMS):
                frames = calibrate_frames(reached.rows(keep), seen.rows(keep))
                told = inverse_kinematics(redefined(robot, *frames), seen)
                off = np.max(np.abs(told - length), axis=1)
                keep = rows[off[rows] <= _FAR * np.median(off)]
            found.append((float(np.median(off)), frames))
        except InputError as error:
            failed.append(error)
    if not found:
        raise failed[0]
    return min(found, key=lambda one: one[0])[1]


def _notes(base: FittedFrame, mobile: FittedFrame, fit: Fit, left_out: Sequence[str]) -> Iterator[tuple[str, str]]:
    """What was estimated, and how well it is known: sentences of a provenance, and the poses in full."""
    yield (
        "frames",
        "The poses are of a target in a tracker's frame. Both frames and all legs are fitted together to "
        f"{len(fit.residuals):,} measurements, by least squares with the stated deviations. No reading tells the base "
        "frame: it is taken where the joint centres are nearest to the drawing's.",
    )
    for key, frame, name in (
        ("tracker_in_base", base, "Tracker in base"),
        ("target_in_mobile", mobile, "Target in mobile"),
    ):
        sigmas = max(frame.sigma[:3]), math.degrees(max(frame.sigma[3:]))
        digits = (9 if s <= 0.0 else min(9, max(0, -math.floor(math.log10(s)))) for s in sigmas)  # that they leave
        turn = np.degrees(rotation_vector(np.array(frame.quaternion)))
        parts = zip((frame.position, turn.tolist()), digits, ("mm", "degrees"), strict=True)
        at = "; rotation vector ".join(f"({', '.join(nearest(v, d) for v in part)}) {w}" for part, d, w in parts)
        yield key, f"{name}: {at}. {frame.sentence('There')}"
        yield f"{key}_pose", json.dumps({"position": frame.position, "quaternion": frame.quaternion})
    spread = ", ".join(about(robust_scale(leg), 2) for leg in fit.residuals.T)
    yield "residuals", f"The legs of the fit are {spread} mm off (robust standard deviation). {fit.sentence}"
    if left_out:
        names = listed(left_out, _TOLD)
        yield "left_out", f"Left out of the frames, as far off the others, and kept in the campaign: {names}."


def in_base_frame(campaign: Campaign) -> Campaign:
    """The campaign in the base frame, of one whose poses are of a target in a tracker's frame: every measurement, wrong
    ones too, as a pose of the mobile frame; its provenance says what was estimated.

    Standard deviations of a pose are carried to the mobile frame (its origin is off the target's by a lever, which a
    turn moves), declared half-widths as sums of absolute values. Raises InputError where the poses do not determine the
    frames, KinematicsError where the drawing cannot reach the readings.
    """
    if campaign.legs < 6:
        what = f"has {campaign.legs} legs, and fewer than six give no pose to find a tracker's frame by"
        raise unusable(campaign.robot.name, what, "measure in the base frame, and say --frames base")
    drawing, sample = campaign.robot, campaign.sampled(_ROWS)
    first = first_frames(drawing, sample.length, sample.poses)
    tracked = replace(sample, robot=redefined(drawing, *first))
    start = spread_of(tracked).fitted  # which a few gross errors do not move
    off = np.abs(LegEquations.of(tracked).values(start))
    far = (off > np.maximum(_FAR * np.array([robust_scale(leg) for leg in off.T]), _ROUNDING)).any(axis=1)
    good = tracked.rows(~far)
    factor = None if campaign.uncertainty is None else campaign.uncertainty.factor
    noise = None if good.exact else Noise.of(good, factor or 1.0)
    best = fit(good, weighted=noise is not None, noise=noise, start=start)
    base, mobile = fitted_frames(best, drawing)
    tracker, target = (Pose(np.array(one.position), np.array(one.quaternion)) for one in (base, mobile))
    seen = compose(tracker, campaign.poses)
    pose, lever = compose(seen, inverse(target)), seen.rotation @ inverse(target).position
    power = 1.0 if factor is None else 2.0  # bounds add up, independent standard deviations in quadrature
    sizes = np.zeros((len(lever), 6, 6))
    sizes[:, :3, :3] = sizes[:, 3:, 3:] = tracker.rotation
    sizes[:, :3, 3:] = cross_matrix(-lever) @ tracker.rotation
    radius = np.hstack([campaign.position_radius, campaign.rotation_radius])
    radii = np.einsum("kij,kj->ki", np.abs(sizes) ** power, radius**power) ** (1.0 / power)
    declared = campaign.uncertainty
    if declared is not None:
        widest = radii.max(axis=0) / (factor or 1.0)
        declared = Uncertainty(widest[:3], widest[3:], declared.length, factor)
    told = {key: text for key, text in campaign.provenance.items() if key not in ("true_parameters", "options")}
    left_out = np.array(sample.measurement_ids)[far].tolist()
    return replace(
        campaign,
        position=pose.position,
        quaternion=pose.quaternion,
        position_radius=radii[:, :3],
        rotation_radius=radii[:, 3:],
        uncertainty=declared,
        provenance=told | dict(_notes(base, mobile, best, left_out)),
    )
