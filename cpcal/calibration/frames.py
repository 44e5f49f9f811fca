"""Where the camera stands and how the target is fixed, from pairs of poses (the paper, section 3.1).

The robot tells A_i, the mobile frame in the base frame (from its drawing and the leg readings); the camera tells
B_i, the target frame in the camera frame. Unknown are X, the camera frame in the base frame, and Z, the target
frame in the mobile frame. Both ways from the target to the base are the same:

    X B_i = A_i Z                                                   (robot-world and hand-eye calibration)

All of this is ordinary estimation: nothing here is proved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats
from cpcal.robot import (
    Pose,
    Robot,
    compose,
    inverse,
    normalised,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_vector,
    transformed,
)
from cpcal.robot.kinematics import nearest_rotation, with_translations, world_hand_eye
from cpcal.solver.optimize.least_squares import least_squares

# ------------------------------------------------------------------------------------------------------------------
# Pairs of poses for hand-eye problems: checked, in a unit of their own, and with enough rotation.
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


@dataclass(frozen=True, eq=False)
class Pairs:
    """N poses A_i and B_i, positions divided by `unit` mm."""

    a: Pose
    b: Pose
    unit: float

    def __len__(self) -> int:
        return len(self.a.position)


def pose_pairs(a: Pose, b: Pose) -> Pairs:
    """N >= 3 pairs of poses, (N, 3) mm and (N, 4), scaled by the rms length of all positions.

    Raises InputError for wrong shapes, NaN or infinite numbers, zero quaternions, too few pairs.
    """
    problems = [p for pose, name in zip((a, b), _NAMES, strict=True) for p in _pose_problems(pose, name)]
    count, both = len(a.position), " and ".join(_NAMES)
    if not problems and count != len(b.position):
        what = f"hold {count} and {len(b.position)} poses"
        problems.append(Problem(both, what, "give the same measurements in the same order"))
    elif not problems and count < 3:
        what = f"hold {count} pairs, which do not determine the unknown frames"
        problems.append(Problem(both, what, "give at least 3, with rotations about two axes"))
    if problems:
        raise InputError(problems)
    lengths = np.concatenate([a.position, b.position])
    largest = float(np.max(np.abs(lengths))) or 1.0  # squares of lengths may overflow, those of shares do not
    unit = largest * (float(np.sqrt(np.mean(np.sum((lengths / largest) ** 2, axis=1)))) or 1.0)
    scaled = [Pose(pose.position / unit, normalised(pose.quaternion)) for pose in (a, b)]
    return Pairs(scaled[0], scaled[1], unit)


@dataclass(frozen=True, eq=False)
class Spread:
    """How far the rotations `name` move the direction `axis` (3,), rad, the one that they move least; and the one that
    they move most."""

    name: str
    axis: Floats
    least: float
    most: float

    @classmethod
    def of(cls, name: str, rotations: Floats) -> Spread:
        """Of poses (N, 3, 3), in their reference frame. InputError that says what is missing where it is zero."""
        left, size, _ = np.linalg.svd(rotations.mean(axis=0))
        values = np.sqrt(2.0 * np.maximum(0.0, 1.0 - size))
        axis = left[:, 0] * np.sign(left[np.argmax(np.abs(left[:, 0])), 0]) + 0.0
        found = cls(name, axis, float(values[0]), float(values[2]))
        if found.least > LEAST_SPREAD:
            return found
        what = f"hardly turn: by {found.most:.2g} rad (rms), which is not above {LEAST_SPREAD:.2g} rad"
        if found.most > LEAST_SPREAD:
            what = (
                f"turn about one axis only, ({found.direction}): it moves by {found.least:.2g} rad (rms), which is not "
                f"above {LEAST_SPREAD:.2g} rad, so that translations along it are not determined"
            )
        remedy = "add poses tilted about at least two different axes, as far as the robot and the view allow"
        raise InputError([Problem(name, what, remedy)])

    @property
    def direction(self) -> str:
        return ", ".join(f"{value:.3f}" for value in self.axis)

    def remarks(self, turn: Floats) -> tuple[str, ...]:
        """What the rotation residuals (N, 3) say; InputError when they are as large as the rotations themselves."""
        rms = float(np.sqrt(np.mean(np.sum(turn**2, axis=1))))
        found = f"move the direction ({self.direction}) by {self.least:.2g} rad (rms) only"
        if self.least <= _LOST * rms:
            what = f"{found}, and the two sides differ by {rms:.2g} rad: translations along it are not determined"
            remedy = (
                "add poses tilted about at least two axes; check that the pairs belong together and map as documented"
            )
            raise InputError([Problem(self.name, what, remedy)])
        remarks = []
        if self.least <= _WEAK * rms:
            ratio = f"{self.least / rms:.1f} times the {rms:.2g} rad by which the two sides differ"
            remarks.append(f"{self.name} {found}, {ratio}: translations along it are weakly determined")
        if rms > _LARGE:
            remarks.append(f"the two sides differ by {rms:.2g} rad (rms): check that the pairs belong together")
        return tuple(remarks)


def _pose_problems(pose: Pose, name: str) -> list[Problem]:
    shape = (np.shape(pose.position), np.shape(pose.quaternion))
    count = shape[0][0] if shape[0] else 0
    if shape != ((count, 3), (count, 4)):
        what = f"have positions of shape {shape[0]} and quaternions of shape {shape[1]}"
        return [Problem(name, what, "give (N, 3) in mm and (N, 4), scalar first")]
    found = []
    good = np.isfinite(np.concatenate([pose.position, pose.quaternion], axis=1)).all(axis=1)
    for k in np.flatnonzero(~(good & pose.quaternion.any(axis=1)))[:_LISTED]:
        what = "has the zero quaternion" if good[k] else "holds a NaN or an infinity"
        found.append(Problem(f"{name}, pose {k} (from 0)", what, "correct it, or leave the pair out"))
    return found


# ------------------------------------------------------------------------------------------------------------------
# Least squares on rigid motions for `X B_i = A_i Z`.
#
# The residuals of a pair compare B with what A tells of it, C = X^-1 A Z, in B's reference frame,
#
#     position   t_B - t_C          rotation   log(R_B R_C^T), a rotation vector in rad
#
# because that is where a camera's errors have their axes (it sees depth worse than the rest). A motion is varied as
# (P + p, exp(w) R) with w a rotation vector in the motion's reference frame. Lengths have the unit of the pairs. The
# order of the unknowns is (p_X, w_X, p_Z, w_Z).

_TELL_AXES = 10  # pairs from which on the axes have standard deviations of their own
_FLOOR = 1e-13  # of standard deviations, for data without noise
_ROUNDS = 30  # of weights from residuals and residuals from weights
_STEPS = 100  # of Levenberg and Marquardt, in each round
_END = 1e-13  # its relative tolerance
_SETTLED = 1e-4  # the relative change of the weights that ends them

Motions = tuple[Pose, Pose]  # X and Z


@dataclass(frozen=True, eq=False)
class Refined:
    """The motions, the standard deviations (6,) that weighted them, and the covariance (12, 12)."""

    motions: Motions
    sigma: Floats
    unit_weight: float
    covariance: Floats


def residuals(pairs: Pairs, motions: Motions) -> Floats:
    """(N, 6): position and rotation (rad) of the text above."""
    x, z = motions
    told = compose(inverse(x), compose(pairs.a, z))
    turn = rotation_vector(compose(pairs.b, inverse(told)).quaternion)
    return np.concatenate([pairs.b.position - told.position, turn], axis=1)


def refined(pairs: Pairs, motions: Motions, given: Floats, *, move: bool = True) -> Refined:
    """The motions with the smallest weighted sum of squares near those (or, without `move`, these themselves).

    `given` (6,): standard deviations of the components of the residuals; nan: estimated together with the motions, axis
    by axis where there are pairs enough to tell them apart. The covariance is that of linearised least squares, scaled
    by the residuals' own size (`unit_weight` squared, near 1 for right ones).
    """
    rms = np.sqrt(np.mean(residuals(pairs, motions) ** 2, axis=0))
    sigma = np.where(np.isnan(given), np.maximum(_FLOOR, np.repeat(rms.reshape(2, 3).max(axis=1), 3)), given)
    for _ in range(_ROUNDS):
        if move:
            motions = _minimum(pairs, motions, sigma)
        values, jacobian = (residuals(pairs, motions) / sigma).ravel(), _jacobian(pairs, motions, sigma)
        cofactor: Floats = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
        sizes = _sizes(values, jacobian, cofactor, pooled=len(pairs) < _TELL_AXES)
        used, sigma = sigma, np.where(np.isnan(given), np.maximum(sigma * sizes, _FLOOR), given)
        if np.allclose(sigma, used, rtol=_SETTLED, atol=0.0):
            break
    weight = float(np.linalg.norm(values)) / np.sqrt(len(values) - 12)
    return Refined(motions, used, float(weight), weight**2 * cofactor)


def _minimum(pairs: Pairs, motions: Motions, sigma: Floats) -> Motions:
    def values(at: Motions) -> Floats:
        return residuals(pairs, at) / sigma

    def jacobian(at: Motions) -> Floats:
        return _jacobian(pairs, at, sigma)

    def moved(at: Motions, step: Floats) -> Motions:
        turns = quaternion_from_rotation_vector(step.reshape(2, 6)[:, 3:])
        x, z = (
            Pose(pose.position + move, quaternion_product(turn, pose.quaternion))
            for pose, move, turn in zip(at, step.reshape(2, 6)[:, :3], turns, strict=True)
        )
        return x, z

    return least_squares(values, jacobian, motions, tolerance=_END, moved=moved, steps=_STEPS).at


def _sizes(values: Floats, jacobian: Floats, cofactor: Floats, *, pooled: bool) -> Floats:
    """Size (6,) of the weighted residuals of each component, per degree of freedom; `pooled` over three axes.

    Residuals are smaller than errors because they were minimised: element i by its leverage, its share of the fit.
    This is the restricted maximum likelihood estimate of variance components, by its fixed point.
    """
    leverage = np.einsum("ij,jk,ik->i", jacobian, cofactor, jacobian).reshape(-1, 6)
    freedom, square = np.sum(1.0 - leverage, axis=0), np.sum(values.reshape(-1, 6) ** 2, axis=0)
    if pooled:
        freedom, square = (np.repeat(sums.reshape(2, 3).sum(axis=1), 3) for sums in (freedom, square))
    return np.asarray(np.sqrt(square / np.maximum(freedom, 1e-3)), dtype=np.float64)


def _jacobian(pairs: Pairs, motions: Motions, sigma: Floats) -> Floats:
    """Derivative (6 N, 12) of `residuals`, over their standard deviations (6,), by the unknowns."""
    x, z = motions
    error = residuals(pairs, motions)[:, 3:]
    back, turned = x.rotation.T, x.rotation.T @ pairs.a.rotation
    target = compose(pairs.a, z).position  # in A's reference frame
    log = np.linalg.inv(left_jacobian(-error))  # of log(E exp(v)) by v: the right Jacobian is the left one at -e
    jacobian = np.zeros((len(pairs), 6, 12))
    jacobian[:, :3, :3] = back
    jacobian[:, :3, 3:6] = -back @ cross_matrix(target - x.position)
    jacobian[:, :3, 6:9] = -turned
    jacobian[:, 3:, 3:6] = log @ back
    jacobian[:, 3:, 9:] = -log @ turned
    return np.asarray((jacobian / sigma[:, None]).reshape(-1, 12))


def cross_matrix(vector: npt.ArrayLike) -> Floats:
    """The matrix of v -> vector x v, (..., 3) -> (..., 3, 3)."""
    v = np.asarray(vector, dtype=np.float64)
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


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


# ------------------------------------------------------------------------------------------------------------------
# The linear method for `A_i Z = X B_i`; Shah's closed form is `cpcal.robot.kinematics.world_hand_eye`.
#
# Poses are those of the pairs above, lengths without unit. vec(M) stacks the rows of M, so that
# vec(A X B) = (A kron B^T) vec(X).

_MOTIONS_MAX = 5_000  # pairs of poses that Andreff's method uses


def andreff(pairs: Pairs) -> Motions:
    """X and Z of `X B_i = A_i Z` by the linear method for hand-eye (Andreff, Horaud and Espiau 1999).

    R_Z from the relative motions, A_ij = A_i^-1 A_j and likewise B_ij, A_ij Z = Z B_ij, by least squares on

        [ I - R_A kron R_B      0     ] [ vec R_Z ]   [  0  ]
        [   I kron t_B^T     I - R_A  ] [   t_Z   ] = [ t_A ]

    then R_X, the mean of R_A R_Z R_B^T, and both translations by least squares.
    """
    first, second = np.triu_indices(len(pairs), 1)
    if len(first) > _MOTIONS_MAX:  # evenly thinned out
        kept = np.linspace(0, len(first) - 1, _MOTIONS_MAX).astype(np.intp)
        first, second = first[kept], second[kept]
    a, b = (
        compose(
            inverse(Pose(pose.position[first], pose.quaternion[first])),
            Pose(pose.position[second], pose.quaternion[second]),
        )
        for pose in (pairs.a, pairs.b)
    )
    count, turn, eye = len(first), a.rotation, np.eye(3)
    matrix = np.zeros((count, 12, 12))
    matrix[:, :9, :9] = np.eye(9) - np.einsum("kij,kpq->kipjq", turn, b.rotation).reshape(count, 9, 9)
    matrix[:, 9:, :9] = np.einsum("ij,kq->kijq", eye, b.position).reshape(count, 3, 9)
    matrix[:, 9:, 9:] = eye - turn
    right = np.concatenate([np.zeros((count, 9)), a.position], axis=1)
    z = nearest_rotation(_solved(matrix.reshape(-1, 12), right.ravel())[:9].reshape(3, 3))
    x = nearest_rotation(np.einsum("kij,jl,kml->im", pairs.a.rotation, z, pairs.b.rotation))
    return with_translations(pairs.a, pairs.b, x, z)


def _solved(matrix: Floats, right: Floats) -> Floats:
    """The least-squares solution."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)


METHODS: dict[str, Callable[[Pairs], Motions]] = {
    "shah": lambda pairs: world_hand_eye(pairs.a, pairs.b),
    "andreff": andreff,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameCalibration:
    """The camera in the base frame, the target in the mobile frame, and how well they are known.

    camera_in_base     X; target_in_mobile Z; positions in mm
    position_residual  (N, 3) mm, the target's origin as B_i has it less that of X^-1 A_i Z, in the camera frame
    rotation_residual  (N, 3) rad, the rotation vector from X^-1 A_i Z to B_i, in the camera frame
    sigma_position     (3,) mm, sigma_rotation (3,) rad: standard deviations that weighted the two, by axis
    unit_weight        size of the weighted residuals; near 1 when the two standard deviations are right
    covariance         (12, 12) by linearised least squares for independent errors, of X's position (mm) and rotation
                       vector (rad, base frame), then of Z's position and rotation vector (mobile frame)
    spread             rad, how far the direction moves that the rotations move least (see above)
    remarks            sentences on what makes the result doubtful; empty when nothing does
    """

    camera_in_base: Pose
    target_in_mobile: Pose
    method: str
    position_residual: Floats
    rotation_residual: Floats
    sigma_position: Floats
    sigma_rotation: Floats
    unit_weight: float
    covariance: Floats
    spread: float
    remarks: tuple[str, ...]


def calibrate_frames(
    robot_poses: Pose,
    camera_poses: Pose,
    *,
    method: str = "shah",
    refine: bool = True,
    sigma_position: npt.ArrayLike | None = None,
    sigma_rotation: npt.ArrayLike | None = None,
) -> FrameCalibration:
    """X and Z of `X B_i = A_i Z` from N >= 3 poses A_i of the robot and B_i of the camera.

    robot_poses     A_i, mobile frame in base frame: (N, 3) mm and (N, 4); e.g. forward_kinematics of the drawing
    camera_poses    B_i, target frame in camera frame, of the same configurations in the same order
    method          "shah" (closed form, 2013) or "andreff" (linear, Andreff, Horaud and Espiau 1999): the start
    refine          whether non-linear least squares on positions and rotations follows
    sigma_position  mm, sigma_rotation rad: standard deviations of B_i against X^-1 A_i Z, one or three (for the
                    camera's axes). None: estimated from the residuals, for each axis from 10 pairs on.

    Lengths are scaled before anything is solved: the result does not depend on their unit. InputError for unusable
    arrays, for fewer than three pairs, and where the orientations do not determine the frames: all (nearly) the
    same, or turned about one axis only (planar motion), or by no more than their own errors.
    """
    if method not in METHODS:
        raise InputError([Problem("method", f"there is none called {method!r}", f"choose one of {sorted(METHODS)}")])
    pairs = pose_pairs(robot_poses, camera_poses)
    spreads = [Spread.of(name, pose.rotation) for name, pose in zip(_NAMES, (pairs.a, pairs.b), strict=True)]
    spread = min(spreads, key=lambda one: one.least)  # without noise they are the same
    start = METHODS[method](pairs)
    spread.remarks(residuals(pairs, start)[:, 3:])  # refuses what no refinement can mend
    stated = {"sigma_position": sigma_position, "sigma_rotation": sigma_rotation}
    given = [np.full(3, np.nan) if sigma is None else np.asarray(sigma, dtype=np.float64) for sigma in stated.values()]
    wrong = [
        Problem(name, f"is {value!r}", "give a positive number, or three, or None")
        for (name, value), array in zip(stated.items(), given, strict=True)
        if value is not None and not (array.shape in ((), (3,)) and ((array > 0.0) & np.isfinite(array)).all())
    ]
    if wrong:
        raise InputError(wrong)
    lengths = np.repeat([pairs.unit, 1.0], 3)
    best = refined(pairs, start, np.concatenate([np.broadcast_to(g, 3) for g in given]) / lengths, move=refine)
    off, sigma = residuals(pairs, best.motions) * lengths, best.sigma * lengths
    x, z = (Pose(pose.position * pairs.unit, pose.quaternion) for pose in best.motions)
    both = np.tile(lengths, 2)
    return FrameCalibration(
        camera_in_base=x,
        target_in_mobile=z,
        method=method,
        position_residual=off[:, :3],
        rotation_residual=off[:, 3:],
        sigma_position=sigma[:3],
        sigma_rotation=sigma[3:],
        unit_weight=best.unit_weight,
        covariance=best.covariance * np.outer(both, both),
        spread=spread.least,
        remarks=spread.remarks(off[:, 3:]),
    )


def redefined(robot: Robot, camera_in_base: Pose, target_in_mobile: Pose) -> Robot:
    """The robot with its base joint centres in the camera frame and its mobile ones in the target frame.

    Then `P + R b` with the camera's own P and R maps them into one frame, and the measured poses calibrate the legs
    without further frames (the paper, end of section 3.1). Offsets stay.
    """
    base = transformed(inverse(camera_in_base), robot.base)
    return Robot(robot.name, base, transformed(inverse(target_in_mobile), robot.mobile), robot.offset)
