"""Where the camera stands and how the target is fixed, from pairs of poses (the paper, section 3.1).

The robot tells A_i, the mobile frame in the base frame (from its drawing and the leg readings); the camera tells
B_i, the target frame in the camera frame. Unknown are X, the camera frame in the base frame, and Z, the target
frame in the mobile frame. Both ways from the target to the base are the same:

    X B_i = A_i Z                                                   (robot-world and hand-eye calibration)

Shah's closed form begins, least squares end. All of this is ordinary estimation: nothing here is proved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem, unusable
from cpcal.common.numbers import about
from cpcal.common.values import Floats
from cpcal.robot import (
    Pose,
    Robot,
    compose,
    inverse,
    normalised,
    quaternion_from_matrix,
    rotation_vector,
    transformed,
)
from cpcal.robot.kinematics import nearest_rotation, world_hand_eye
from cpcal.solver.optimize.least_squares import least_squares

# ------------------------------------------------------------------------------------------------------------------
# Pairs of poses: checked, and with enough rotation.
#
# Lengths are divided by a length of the data before anything is solved, so that no result depends on the unit.
#
# How much rotation there is has one figure, the `spread` in rad of the direction that moves least: for poses the
# smallest over unit vectors v of sqrt(2 (1 - |mean_i R_i v|)), about the rms angle between the R_i v and their mean
# direction. It is zero exactly when all poses turn about one common axis v: then translations along it cannot be found,
# whatever the method.

_NAMES = ("robot_poses", "camera_poses")
LEAST_SPREAD = 1e-6  # rad: below it the data are degenerate to rounding
_LOST = 1.0  # spread of the rotations over the rms rotation residual: below it, the rotation is noise
_WEAK = 5.0  # and below it, a remark
_LARGE = 0.1  # rad: rms rotation residuals that calibrated sensors hardly have
_LISTED = 20  # unusable poses that a message lists


def _check_pairs(*pairs: Pose) -> None:
    """Raises InputError for wrong shapes, NaN or infinite numbers, zero quaternions, too few pairs."""
    problems = []
    for pose, name in zip(pairs, _NAMES, strict=True):
        count = len(pose.position)
        if (np.shape(pose.position), np.shape(pose.quaternion)) != ((count, 3), (count, 4)):
            what = f"have positions of shape {np.shape(pose.position)} and quaternions of {np.shape(pose.quaternion)}"
            problems.append(Problem(name, what, "give (N, 3) in mm and (N, 4), scalar first"))
            continue
        good = np.isfinite(np.concatenate([pose.position, pose.quaternion], axis=1)).all(axis=1)
        for k in np.flatnonzero(~(good & pose.quaternion.any(axis=1)))[:_LISTED]:
            what = "has the zero quaternion" if good[k] else "holds a NaN or an infinity"
            problems.append(Problem(f"{name}, pose {k} (from 0)", what, "correct it, or leave the pair out"))
    one, other = (len(pose.position) for pose in pairs)
    if not problems and (one != other or one < 3):
        what, remedy = f"hold {one} and {other} poses", "give the same measurements in the same order"
        if one == other:
            what = f"hold {one} pairs, which do not determine the unknown frames"
            remedy = "give at least 3, with rotations about two axes"
        problems.append(Problem(" and ".join(_NAMES), what, remedy))
    if problems:
        raise InputError(problems)


def _spread(name: str, rotations: Floats) -> tuple[float, str, str]:
    """How far the rotations (N, 3, 3) of poses move the direction that they move least, rad; the poses' name, and that
    direction. InputError that says what is missing where it is zero."""
    left, size, _ = np.linalg.svd(rotations.mean(axis=0))
    least, _, most = np.sqrt(2.0 * np.maximum(0.0, 1.0 - size)).tolist()
    axis = left[:, 0] * np.sign(left[np.argmax(np.abs(left[:, 0])), 0]) + 0.0
    direction = ", ".join(f"{value:.3f}" for value in axis)
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


def _remarks(spread: tuple[float, str, str], turn: Floats) -> tuple[str, ...]:
    """What the rotation residuals (N, 3) say; InputError when they are as large as the rotations themselves."""
    (least, name, direction), rms = spread, float(np.sqrt(np.mean(np.sum(turn**2, axis=1))))
    found = f"move the direction ({direction}) by {least:.2g} rad (rms) only"
    if least <= _LOST * rms:
        what = f"{found}, and the two sides differ by {rms:.2g} rad: translations along it are not determined"
        remedy = "add poses tilted about at least two axes; check that the pairs belong together and map as documented"
        raise unusable(name, what, remedy)
    remarks = []
    if least <= _WEAK * rms:
        ratio = f"{least / rms:.1f} times the {rms:.2g} rad by which the two sides differ"
        remarks.append(f"{name} {found}, {ratio}: translations along it are weakly determined")
    if rms > _LARGE:
        remarks.append(f"the two sides differ by {rms:.2g} rad (rms): check that the pairs belong together")
    return tuple(remarks)


# ------------------------------------------------------------------------------------------------------------------
# Least squares on rigid motions for `X B_i = A_i Z`.
#
# The residuals of a pair compare B with what A tells of it, C = X^-1 A Z, in B's reference frame,
#
#     position   t_B - t_C          rotation   log(R_B R_C^T), a rotation vector in rad
#
# because that is where a camera's errors have their axes (it sees depth worse than the rest). A motion is varied as
# (P + p, exp(w) R) with w a rotation vector in the motion's reference frame. The order of the unknowns is
# (p_X, w_X, p_Z, w_Z).

_TELL_AXES = 10  # pairs from which on the axes have standard deviations of their own
_FLOOR = 1e-13  # of standard deviations, for data without noise
_ROUNDS = 30  # of weights from residuals and residuals from weights
_STEPS = 100  # of Levenberg and Marquardt, in each round
_END = 1e-13  # its relative tolerance
_SETTLED = 1e-4  # the relative change of the weights that ends them

Motions = tuple[Pose, Pose]  # X and Z; and A and B


def _residuals(pairs: Motions, motions: Motions) -> Floats:
    """(N, 6): position and rotation (rad) of the text above."""
    (a, b), (x, z) = pairs, motions
    told = compose(inverse(x), compose(a, z))
    turn = rotation_vector(compose(b, inverse(told)).quaternion)
    return np.concatenate([b.position - told.position, turn], axis=1)


def _refined(pairs: Motions, motions: Motions) -> tuple[Motions, Floats, Floats]:
    """The motions near those with the smallest weighted sum of squares; the standard deviations (6,) that weighted it;
    and the covariance (12, 12) of linearised least squares, scaled by the mean square of the residuals in these.

    Standard deviations are estimated together with the motions, axis by axis where pairs are enough to tell them apart.
    """
    count = len(pairs[0].position)
    rms = np.sqrt(np.mean(_residuals(pairs, motions) ** 2, axis=0))
    sigma = np.maximum(_FLOOR, np.repeat(rms.reshape(2, 3).max(axis=1), 3))

    def fitted(start: Motions, sigma: Floats) -> Motions:
        def values(at: Motions) -> Floats:
            return _residuals(pairs, at) / sigma

        def jacobian(at: Motions) -> Floats:
            return _jacobian(pairs, at, sigma)

        return least_squares(values, jacobian, start, tolerance=_END, moved=_moved, steps=_STEPS).at

    for _ in range(_ROUNDS):
        used, motions = sigma, fitted(motions, sigma)
        values, jacobian = (_residuals(pairs, motions) / used).ravel(), _jacobian(pairs, motions, used)
        cofactor = np.linalg.inv(jacobian.T @ jacobian)
        # residuals are smaller than errors because they were minimised: element i by its leverage, its share of the
        # fit; this is the restricted maximum likelihood estimate of variance components, by its fixed point
        leverage = np.einsum("ij,jk,ik->i", jacobian, cofactor, jacobian).reshape(-1, 6)
        freedom, square = np.sum(1.0 - leverage, axis=0), np.sum(values.reshape(-1, 6) ** 2, axis=0)
        if count < _TELL_AXES:
            freedom, square = (np.repeat(sums.reshape(2, 3).sum(axis=1), 3) for sums in (freedom, square))
        sigma = np.maximum(used * np.sqrt(square / np.maximum(freedom, 1e-3)), _FLOOR)
        if np.allclose(sigma, used, rtol=_SETTLED, atol=0.0):
            break
    return motions, used, np.asarray(values @ values / (len(values) - 12) * cofactor)


def _moved(at: Motions, step: Floats) -> Motions:
    return at[0].moved(step[:6]), at[1].moved(step[6:])


def _jacobian(pairs: Motions, motions: Motions, sigma: Floats) -> Floats:
    """Derivative (6 N, 12) of `_residuals`, over their standard deviations (6,), by the unknowns."""
    a, (x, z) = pairs[0], motions
    error = _residuals(pairs, motions)[:, 3:]
    back, turned = x.rotation.T, x.rotation.T @ a.rotation
    target = compose(a, z).position  # in A's reference frame
    log = np.linalg.inv(left_jacobian(-error))  # of log(E exp(v)) by v: the right Jacobian is the left one at -e
    jacobian = np.zeros((len(error), 6, 12))
    jacobian[:, :3, :3] = back
    jacobian[:, :3, 3:6] = -back @ cross_matrix(target - x.position)
    jacobian[:, :3, 6:9] = -turned
    jacobian[:, 3:, 3:6] = log @ back
    jacobian[:, 3:, 9:] = -log @ turned
    return np.asarray((jacobian / sigma[:, None]).reshape(-1, 12))


def cross_matrix(vector: npt.ArrayLike) -> Floats:
    """The matrix of v -> vector x v, (..., 3) -> (..., 3, 3)."""
    v = np.asarray(vector, dtype=np.float64)
    return np.asarray(np.cross(v[..., None, :], np.eye(3)).swapaxes(-1, -2))


def left_jacobian(vector: npt.ArrayLike) -> Floats:
    """J with exp(v + dv) = exp(J dv) exp(v) to first order, (..., 3) rad -> (..., 3, 3): the closed form

    J = I + (1 - cos t) / t^2 [v] + (t - sin t) / t^3 [v]^2 for t = |v|.
    """
    v = np.asarray(vector, dtype=np.float64)
    square = np.sum(v**2, axis=-1)[..., None, None]
    t = np.sqrt(square)
    once = 0.5 * np.sinc(0.5 * t / np.pi) ** 2
    small = t < 1e-2  # there t - sin t cancels; two terms of its series are exact to rounding
    safe = np.where(small, 1.0, t)
    twice = np.where(small, (1.0 - square / 20.0) / 6.0, (safe - np.sin(safe)) / safe**3)
    matrix = cross_matrix(v)
    return np.asarray(np.eye(3) + once * matrix + twice * (matrix @ matrix))


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameCalibration:
    """The camera in the base frame, the target in the mobile frame, and how well they are known.

    camera_in_base     X; target_in_mobile Z; positions in mm
    position_residual  (N, 3) mm, the target's origin as B_i has it less that of X^-1 A_i Z, in the camera frame
    rotation_residual  (N, 3) rad, the rotation vector from X^-1 A_i Z to B_i, in the camera frame
    sigma              (6,) mm and rad: standard deviations that weighted the two, by axis
    covariance         (12, 12) by linearised least squares for independent errors, of X's position (mm) and rotation
                       vector (rad, base frame), then of Z's position and rotation vector (mobile frame)
    spread             rad, how far the direction moves that the rotations move least (see above)
    remarks            sentences on what makes the result doubtful; empty when nothing does
    """

    camera_in_base: Pose
    target_in_mobile: Pose
    position_residual: Floats
    rotation_residual: Floats
    sigma: Floats
    covariance: Floats
    spread: float
    remarks: tuple[str, ...]


def calibrate_frames(robot_poses: Pose, camera_poses: Pose) -> FrameCalibration:
    """X and Z of `X B_i = A_i Z` from N >= 3 poses A_i of the robot and B_i of the camera.

    robot_poses     A_i, mobile frame in base frame: (N, 3) mm and (N, 4); e.g. forward_kinematics of the drawing
    camera_poses    B_i, target frame in camera frame, of the same configurations in the same order

    Non-linear least squares on positions and rotations, from Shah's closed form (2013). The standard deviations of B_i
    against X^-1 A_i Z are estimated from the residuals, for each axis of the camera from 10 pairs on. Lengths are
    scaled before anything is solved: the result does not depend on their unit. InputError for unusable arrays, for
    fewer than three pairs, and where the orientations do not determine the frames: all (nearly) the same, or turned
    about one axis only (planar motion), or by no more than their own errors.
    """
    _check_pairs(robot_poses, camera_poses)
    lengths = np.concatenate([robot_poses.position, camera_poses.position])
    largest = float(np.max(np.abs(lengths))) or 1.0  # squares of lengths may overflow, those of shares do not
    unit = largest * (float(np.sqrt(np.mean(np.sum((lengths / largest) ** 2, axis=1)))) or 1.0)
    a, b = (Pose(pose.position / unit, normalised(pose.quaternion)) for pose in (robot_poses, camera_poses))
    spread = min(_spread(name, pose.rotation) for name, pose in zip(_NAMES, (a, b), strict=True))
    start = world_hand_eye(a, b)
    _remarks(spread, _residuals((a, b), start)[:, 3:])  # refuses what no refinement can mend
    motions, sigma, covariance = _refined((a, b), start)
    units = np.repeat([unit, 1.0], 3)
    off = _residuals((a, b), motions) * units
    x, z = (Pose(pose.position * unit, pose.quaternion) for pose in motions)
    return FrameCalibration(
        camera_in_base=x,
        target_in_mobile=z,
        position_residual=off[:, :3],
        rotation_residual=off[:, 3:],
        sigma=sigma * units,
        covariance=covariance * np.outer(np.tile(units, 2), np.tile(units, 2)),
        spread=spread[0],
        remarks=_remarks(spread, off[:, 3:]),
    )


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
# the rigid motion that brings the calibrated centres nearest to the drawing's (least squares), and two uncertainties
# belong to it. The centres are known to within the calibration's errors: that is how well the frame is known that the
# robot's own joints define. And the joints are not where the drawing has them: how far off is told by what the motion
# leaves over, with few degrees of freedom; that is how well the drawing's frame can be known, whatever is measured.


@dataclass(frozen=True)
class FittedFrame:
    """The frame in which the centres were measured, seen in the drawing's: x_drawing = P + R(q) x_measured, P in mm.

    sigma            (6,) standard deviations of position (mm) and rotation vector (rad, drawing's frame), of the frame
                     that the joints define
    drawing_sigma    (6,) of the drawing's frame: with the drawing's own errors, estimated from the residuals
    drawing_error    mm: how far a coordinate of a joint centre is off its drawing (standard deviation)
    coverage_factor  k for 95 % with so few degrees of freedom, 3 n - 6 (Student)
    """

    position: tuple[float, ...]
    quaternion: tuple[float, ...]
    sigma: tuple[float, ...]
    drawing_sigma: tuple[float, ...]
    drawing_error: float
    coverage_factor: float

    def sentence(self, name: str) -> str:
        own, drawn = max(self.sigma[:3]), max(self.drawing_sigma[:3])
        return (
            f"{name}: the calibrated joint centres are {self.drawing_error:.2g} mm a coordinate off the "
            f"drawing's; the frame that they define is known to U = {2.0 * own:.2g} mm (k = 2), the drawing's to "
            f"{self.coverage_factor * drawn:.2g} mm (k = {self.coverage_factor:.2g}, 95 %)."
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


def fitted_frame(measured: Floats, drawing: Floats, covariance: Floats, shared: Floats) -> FittedFrame:
    """Of centres (n, 3) mm with their covariance (3 n, 3 n) mm^2, centre by centre, and the drawing's.

    shared  (6,) standard deviations of an error of the frame that comes on top. Raises InputError as `nearest_motion`.
    """
    from scipy import special  # here: it takes a third of a second to load

    motion, count = nearest_motion(measured, drawing), len(measured)
    turned = measured @ motion.rotation.T
    residual = drawing - turned - motion.position
    columns = np.concatenate([np.tile(np.eye(3), (count, 1)), -cross_matrix(turned).reshape(-1, 3)], axis=1)
    back = np.linalg.pinv(columns) @ np.kron(np.eye(count), motion.rotation)
    own = back @ covariance @ back.T + np.diag(shared**2)
    freedom = 3 * count - 6
    error = float(np.sqrt(np.sum(residual**2) / freedom))
    of_drawing = error**2 * np.linalg.inv(columns.T @ columns) + own
    arrays = motion.position, motion.quaternion, np.sqrt(np.diagonal(own)), np.sqrt(np.diagonal(of_drawing))
    position, quaternion, sigma, drawing_sigma = (tuple(array.tolist()) for array in arrays)
    k = float(special.stdtrit(freedom, 0.975))
    return FittedFrame(position, quaternion, sigma, drawing_sigma, error, k)


# Parameters laid on the drawing, so that those of two fits can be compared: base and mobile centres each by the rigid
# motion that brings them nearest to the drawing's.

_STEP = 1e-3  # mm, of the difference quotients; the map is smooth over millimetres


def on_drawing(parameters: Floats, drawing: Robot) -> Floats:
    """Parameters (n, 7), mm, in the drawing's frames. Raises InputError as `nearest_motion` does."""
    parts = [
        transformed(nearest_motion(parameters[:, columns], centres), parameters[:, columns])
        for columns, centres in ((slice(0, 3), drawing.base), (slice(3, 6), drawing.mobile))
    ]
    return np.concatenate([*parts, parameters[:, 6:]], axis=1)


def on_drawing_errors(parameters: Floats, covariance: Floats, drawing: Robot) -> Floats:
    """(n, 7) mm: standard deviations of `on_drawing`, to first order, from the covariance (7 n, 7 n), leg by leg."""
    size = parameters.size
    steps = _STEP * np.eye(size).reshape(size, *parameters.shape)
    ahead, back = (
        np.stack([on_drawing(parameters + sign * step, drawing).ravel() for step in steps]) for sign in (1.0, -1.0)
    )
    slopes = ((ahead - back) / (2.0 * _STEP)).T
    variance = np.diagonal(slopes @ covariance @ slopes.T).reshape(parameters.shape)
    return np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.inf))


# ------------------------------------------------------------------------------------------------------------------
# Errors of poses that all images share: what the camera's covariance and the target's deviations make of them.
#
# Repeats do not show them and no mean is free of them. If every pose is off by the same (dp, dr), a fit puts that
# into the frames: camera in base is off by dr and by dp + dr x d, d the way from the target to the camera; or target
# in mobile by dr and dp. The shared errors of different poses are not the same, so that each frame is off by less
# than this: what is added to the frames' deviations is an upper estimate, the same in all directions.


@dataclass(frozen=True)
class SharedError:
    """Standard deviations, mm and rad.

    pose      (6,) of a pose's position and rotation vector in the camera frame, root mean squares over a study's runs
    distance  mm, root mean square, from the camera to the target
    """

    pose: tuple[float, ...]
    distance: float

    def __post_init__(self) -> None:
        """Raises ValueError for what is not six deviations and a distance."""
        if len(self.pose) != 6 or not min(*self.pose, self.distance) >= 0.0:
            raise ValueError("a shared error is not six deviations and a distance")

    @classmethod
    def of(cls, shared: Floats, position: Floats) -> SharedError:
        """Of runs (N, 6), of targets at (N, 3) mm in the camera frame."""
        sigma = np.sqrt(np.mean(shared**2, axis=0))
        return cls(tuple(sigma.tolist()), float(np.sqrt(np.mean(np.sum(position**2, axis=1)))))

    def of_frames(self) -> tuple[Floats, Floats]:
        """(6,) that the frames of the camera and of the target may take of it."""
        moved, turned = max(self.pose[:3]), max(self.pose[3:])
        camera, target = (np.repeat([np.hypot(moved, arm * turned), turned], 3) for arm in (self.distance, 0.0))
        return camera, target

    @property
    def sentence(self) -> str:
        """What they are, and where they are counted."""
        moved, turned = about(max(self.pose[:3]), 2), about(float(np.degrees(max(self.pose[3:]))), 2)
        return (
            f"Errors of camera and target that all images share: up to {moved} mm and {turned} degrees (standard "
            "deviations) of a pose. No repeat shows them and no mean makes them smaller: reading sets and the frames' "
            "U hold them in full; the table of repeats, standard errors of the fits and what validation expects do not."
        )
