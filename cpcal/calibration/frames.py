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
from typing import Any

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
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_vector,
    transformed,
)

# ------------------------------------------------------------------------------------------------------------------
# Pairs of poses for hand-eye problems: checked, in a unit of their own, and with enough rotation.
#
# Lengths are divided by a length of the data before anything is solved, so that no result depends on the unit.
#
# How much rotation there is has one figure, the `spread` in rad of the direction that moves least: for poses the
# smallest over unit vectors v of sqrt(2 (1 - |mean_i R_i v|)), about the rms angle between the R_i v and their mean
# direction; for motions that of the rms of |R_i v - v|. It is zero exactly when all motions turn about one common
# axis v: then translations along it cannot be found, whatever the method.

LEAST_SPREAD = 1e-6  # rad: below it the data are degenerate to rounding
_LISTED = 20  # unusable poses that a message lists


@dataclass(frozen=True, eq=False)
class Pairs:
    """N poses A_i and B_i, positions divided by `unit` mm."""

    a: Pose
    b: Pose
    unit: float

    def __len__(self) -> int:
        return len(self.a.position)


def pose_pairs(a: Pose, b: Pose, least: int, names: tuple[str, str]) -> Pairs:
    """N >= `least` pairs of poses, (N, 3) mm and (N, 4), scaled by the rms length of all positions.

    Raises InputError for wrong shapes, NaN or infinite numbers, zero quaternions, too few pairs.
    """
    problems = [p for pose, name in zip((a, b), names, strict=True) for p in _pose_problems(pose, name)]
    if not problems and len(a.position) != len(b.position):
        what = f"hold {len(a.position)} and {len(b.position)} poses"
        problems.append(Problem(" and ".join(names), what, "give the same measurements in the same order"))
    if not problems and len(a.position) < least:
        what = f"hold {len(a.position)} pairs, which do not determine the unknown frames"
        problems.append(Problem(" and ".join(names), what, f"give at least {least}, with rotations about two axes"))
    if problems:
        raise InputError(problems)
    lengths = np.concatenate([a.position, b.position])
    largest = float(np.max(np.abs(lengths))) or 1.0  # squares of lengths may overflow, those of shares do not
    unit = largest * (float(np.sqrt(np.mean(np.sum((lengths / largest) ** 2, axis=1)))) or 1.0)
    scaled = [Pose(pose.position / unit, normalised(pose.quaternion)) for pose in (a, b)]
    return Pairs(scaled[0], scaled[1], unit)


@dataclass(frozen=True, eq=False)
class Spreads:
    """How far rotations move three orthogonal directions, rad, ascending; `axis` (3,) is the one moved least."""

    values: Floats
    axis: Floats

    def demand(self, name: str, least: float = LEAST_SPREAD) -> float:
        """The smallest spread; InputError that says what is missing when it is at most `least` rad."""
        low, high = float(self.values[0]), float(self.values[2])
        if low > least:
            return low
        if high <= least:
            what = f"hardly turn: by {high:.2g} rad (rms), which is not above {least:.2g} rad"
        else:
            text = ", ".join(f"{value:.3f}" for value in self.axis)
            what = (
                f"turn about one axis only, ({text}): it moves by {low:.2g} rad (rms), which is not above {least:.2g} "
                "rad, so that translations along it are not determined"
            )
        remedy = "add poses tilted about at least two different axes, as far as the robot and the view allow"
        raise InputError([Problem(name, what, remedy)])


def pose_spreads(rotations: Floats) -> Spreads:
    """Of the directions R_i v about their mean, for poses (N, 3, 3); the axis is in the poses' reference frame."""
    left, size, _ = np.linalg.svd(rotations.mean(axis=0))
    return Spreads(np.sqrt(2.0 * np.maximum(0.0, 1.0 - size)), _signed(left[:, 0]))


def motion_spreads(rotations: Floats) -> Spreads:
    """Of the directions R_i v from v itself, for motions (N, 3, 3)."""
    moved = np.eye(3) - rotations
    square, axes = np.linalg.eigh(np.einsum("kij,kil->jl", moved, moved) / len(rotations))
    return Spreads(np.sqrt(np.maximum(0.0, square)), _signed(axes[:, 0]))


def _signed(axis: Floats) -> Floats:
    """The one of an axis' two unit vectors whose largest component is positive."""
    return np.asarray(axis * np.sign(axis[np.argmax(np.abs(axis))])) + 0.0


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
# Least squares on rigid motions for `X B_i = A_i Z`, and for `X B_i = A_i X` (Z tied to X).
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
_STEPS = 100  # of Levenberg-Marquardt, in each round
_END = 1e-13  # its relative tolerances
_SETTLED = 1e-4  # the relative change of the weights that ends them


@dataclass(frozen=True, eq=False)
class Refined:
    """The motions, the weights that were used, and the covariance (12, 12) or, tied, (6, 6)."""

    x: Pose
    z: Pose
    sigma_position: Floats
    sigma_rotation: Floats
    unit_weight: float
    covariance: Floats


def residuals(pairs: Pairs, x: Pose, z: Pose) -> tuple[Floats, Floats]:
    """Position (N, 3) and rotation (N, 3) rad of the text above."""
    told = compose(inverse(x), compose(pairs.a, z))
    return pairs.b.position - told.position, rotation_vector(compose(pairs.b, inverse(told)).quaternion)


def refined(
    pairs: Pairs,
    x: Pose,
    z: Pose,
    *,
    sigma_position: npt.ArrayLike | None = None,
    sigma_rotation: npt.ArrayLike | None = None,
    tied: bool = False,
    move: bool = True,
) -> Refined:
    """The motions with the smallest weighted sum of squares near x and z (or, without `move`, x and z themselves).

    Standard deviations, one or three each, are of the components of the residuals. None: they are estimated together
    with the motions, axis by axis where there are pairs enough to tell them apart. The covariance is that of
    linearised least squares, scaled by the residuals' own size (`unit_weight` squared, near 1 for right ones).
    """
    given = np.concatenate([_three(sigma_position), _three(sigma_rotation)])
    pooled = len(pairs) < _TELL_AXES
    rms = np.sqrt(np.mean(np.concatenate(residuals(pairs, x, z), axis=1) ** 2, axis=0))
    sigma = np.where(np.isnan(given), np.maximum(_FLOOR, np.repeat(rms.reshape(2, 3).max(axis=1), 3)), given)
    for _ in range(_ROUNDS):
        if move:
            x, z = _moved_to_minimum(pairs, x, z, sigma, tied)
        values, jacobian = _values(pairs, x, z, sigma), _columns(pairs, x, z, sigma, tied)
        cofactor: Floats = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
        used, found = sigma, np.maximum(sigma * _sizes(values, jacobian, cofactor, pooled), _FLOOR)
        sigma = np.where(np.isnan(given), found, given)
        if np.allclose(sigma, used, rtol=_SETTLED, atol=0.0):
            break
    freedom = len(values) - jacobian.shape[1]
    weight = float(np.linalg.norm(values)) / np.sqrt(freedom)
    return Refined(x, z, used[:3], used[3:], float(weight), weight**2 * cofactor)


def _three(sigma: npt.ArrayLike | None) -> Floats:
    return np.broadcast_to(np.asarray(np.nan if sigma is None else sigma, dtype=np.float64), 3)


def _sizes(values: Floats, jacobian: Floats, cofactor: Floats, pooled: bool) -> Floats:
    """Size (6,) of the weighted residuals of each component, per degree of freedom; `pooled` over three axes.

    Residuals are smaller than errors because they were minimised: element i by its leverage, its share of the fit.
    This is the restricted maximum likelihood estimate of variance components, by its fixed point.
    """
    leverage = np.einsum("ij,jk,ik->i", jacobian, cofactor, jacobian).reshape(-1, 6)
    freedom, square = np.sum(1.0 - leverage, axis=0), np.sum(values.reshape(-1, 6) ** 2, axis=0)
    if pooled:
        freedom, square = (np.repeat(sums.reshape(2, 3).sum(axis=1), 3) for sums in (freedom, square))
    return np.asarray(np.sqrt(square / np.maximum(freedom, 1e-3)), dtype=np.float64)


def _moved_to_minimum(pairs: Pairs, x: Pose, z: Pose, sigma: Floats, tied: bool) -> tuple[Pose, Pose]:
    """Levenberg-Marquardt on the vector of steps away from x and z."""
    size = 6 if tied else 12

    def at(step: Floats) -> tuple[Pose, Pose]:
        return (_moved(x, step[:6]),) * 2 if tied else (_moved(x, step[:6]), _moved(z, step[6:]))

    def slopes(step: Floats) -> Floats:
        columns = _columns(pairs, *at(step), sigma, tied)
        for k in range(3, size, 6):  # exp(w + dw) = exp(J dw) exp(w)
            columns[:, k : k + 3] = columns[:, k : k + 3] @ left_jacobian(step[k : k + 3])
        return columns

    def values(step: Floats) -> Floats:
        return _values(pairs, *at(step), sigma)

    start = np.zeros(size)
    from scipy.optimize import least_squares  # here: it takes half a second to load

    found = least_squares(values, start, jac=slopes, method="lm", xtol=_END, ftol=_END, gtol=_END, max_nfev=_STEPS)
    return at(found.x)


def _values(pairs: Pairs, x: Pose, z: Pose, sigma: Floats) -> Floats:
    """Weighted residuals (6 N,)."""
    return np.asarray((np.concatenate(residuals(pairs, x, z), axis=1) / sigma).ravel())


def _columns(pairs: Pairs, x: Pose, z: Pose, sigma: Floats, tied: bool) -> Floats:
    """Their derivative (6 N, 12), or (6 N, 6) where Z is X."""
    jacobian = _jacobian(pairs, x, z) / sigma[:, None]
    columns = jacobian[:, :, :6] + jacobian[:, :, 6:] if tied else jacobian
    return np.asarray(columns.reshape(6 * len(pairs), -1))


def _moved(pose: Pose, step: Floats) -> Pose:
    turn = quaternion_from_rotation_vector(step[3:])
    return Pose(pose.position + step[:3], quaternion_product(turn, pose.quaternion))


def _jacobian(pairs: Pairs, x: Pose, z: Pose) -> Floats:
    """Derivative (N, 6, 12) of (position, rotation) by the unknowns, at x and z."""
    error = residuals(pairs, x, z)[1]
    back, turned = x.rotation.T, x.rotation.T @ pairs.a.rotation
    target = compose(pairs.a, z).position  # in A's reference frame
    log = np.linalg.inv(left_jacobian(-error))  # of log(E exp(v)) by v: the right Jacobian is the left one at -e
    jacobian = np.zeros((len(pairs), 6, 12))
    jacobian[:, :3, :3] = back
    jacobian[:, :3, 3:6] = -back @ cross_matrix(target - x.position)
    jacobian[:, :3, 6:9] = -turned
    jacobian[:, 3:, 3:6] = log @ back
    jacobian[:, 3:, 9:] = -log @ turned
    return jacobian


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
# Closed forms for `A X = X B` (hand-eye) and `A_i Z = X B_i` (robot-world and hand-eye at once).
#
# Poses are those of the pairs above, lengths without unit. vec(M) stacks the rows of M, so that
# vec(A X B) = (A kron B^T) vec(X).

_MOTIONS_MAX = 5_000  # pairs of poses that Andreff's method uses


def shah(pairs: Pairs) -> tuple[Pose, Pose]:
    """X and Z of `X B_i = A_i Z` by Shah's closed form (J. Mechanisms and Robotics 5(3), 2013).

    R_X = R_A R_Z R_B^T, so with K = sum_i R_A kron R_B the vectors vec(R_X) and vec(R_Z) are its left and right
    singular vectors of the largest singular value (N, without noise), up to factors that make them rotations.
    """
    a, b = pairs.a.rotation, pairs.b.rotation
    kron = np.einsum("kij,kpq->ipjq", a, b).reshape(9, 9)
    left, _, right = np.linalg.svd(kron)
    x, z = left[:, 0].reshape(3, 3), right[0].reshape(3, 3)
    sign = np.sign(np.linalg.det(x))  # that of z is the same: K maps rotations to near-multiples of rotations
    return _translations(pairs, nearest_rotation(sign * x), nearest_rotation(sign * z))


def andreff(pairs: Pairs) -> tuple[Pose, Pose]:
    """X and Z of `X B_i = A_i Z` by the linear method for hand-eye (Andreff, Horaud and Espiau 1999).

    Z from the relative motions, (A_i^-1 A_j) Z = Z (B_i^-1 B_j); then R_X, the mean of R_A R_Z R_B^T, and both
    translations by least squares.
    """
    first, second = relative_pairs(len(pairs))
    z = andreff_hand_eye(_relative(pairs.a, first, second), _relative(pairs.b, first, second)).rotation
    x = nearest_rotation(np.einsum("kij,jl,kml->im", pairs.a.rotation, z, pairs.b.rotation))
    return _translations(pairs, x, z)


def andreff_hand_eye(a: Pose, b: Pose) -> Pose:
    """X of `A_i X = X B_i` for motions (N, 3), (N, 4): the linear system of Andreff, Horaud and Espiau 1999,

        [ I - R_A kron R_B      0     ] [ vec R_X ]   [  0  ]
        [   I kron t_B^T     I - R_A  ] [   t_X   ] = [ t_A ]

    by least squares; R_X is then replaced by the nearest rotation, and t_X solved for again.
    """
    count, turn, eye = len(a.position), a.rotation, np.eye(3)
    top = np.eye(9) - np.einsum("kij,kpq->kipjq", turn, b.rotation).reshape(count, 9, 9)
    arm = np.einsum("ij,kq->kijq", eye, b.position).reshape(count, 3, 9)
    rows = np.concatenate([top.reshape(-1, 9), arm.reshape(-1, 9)])
    still = eye - turn
    matrix = np.concatenate([rows, np.concatenate([np.zeros((9 * count, 3)), still.reshape(-1, 3)])], axis=1)
    right = np.concatenate([np.zeros(9 * count), a.position.ravel()])
    rotation = nearest_rotation(_solved(matrix, right)[:9].reshape(3, 3))
    # the rows of translations again, with that rotation: (I - R_A) t_X = t_A - R_X t_B
    rest = (a.position - b.position @ rotation.T).ravel()
    return Pose(_solved(still.reshape(-1, 3), rest), quaternion_from_matrix(rotation))


def _solved(matrix: Floats, right: Floats) -> Floats:
    """The least-squares solution."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)


def relative_pairs(count: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Indices i < j of all pairs of `count` poses, evenly thinned out where there are very many."""
    first, second = np.triu_indices(count, 1)
    if len(first) > _MOTIONS_MAX:
        kept = np.linspace(0, len(first) - 1, _MOTIONS_MAX).astype(np.intp)
        first, second = first[kept], second[kept]
    return first, second


def nearest_rotation(matrix: Floats) -> Floats:
    """The rotation (3, 3) nearest to a matrix in the Frobenius norm."""
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)


def _relative(pose: Pose, first: npt.NDArray[np.intp], second: npt.NDArray[np.intp]) -> Pose:
    """The motions T_i^-1 T_j."""
    back = inverse(Pose(pose.position[first], pose.quaternion[first]))
    return compose(back, Pose(pose.position[second], pose.quaternion[second]))


def _translations(pairs: Pairs, x: Floats, z: Floats) -> tuple[Pose, Pose]:
    """Both motions, given their rotations: t_X - R_A t_Z = t_A - R_X t_B by least squares."""
    count = len(pairs)
    matrix = np.concatenate([np.tile(np.eye(3), (count, 1)), -pairs.a.rotation.reshape(-1, 3)], axis=1)
    right = pairs.a.position - pairs.b.position @ x.T
    found = _solved(matrix, right.ravel())
    return Pose(found[:3], quaternion_from_matrix(x)), Pose(found[3:], quaternion_from_matrix(z))


METHODS: dict[str, Callable[[Pairs], tuple[Pose, Pose]]] = {"shah": shah, "andreff": andreff}

_LOST = 1.0  # spread of the rotations over the rms rotation residual: below it, the rotation is noise
_WEAK = 5.0  # and below it, a remark
_LARGE = 0.1  # rad: rms rotation residuals that calibrated sensors hardly have


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fitted:
    """What is told of every fit.

    position_residual  (N, 3) mm, the target's origin as B_i has it less that of X^-1 A_i Z, in the camera frame
    rotation_residual  (N, 3) rad, the rotation vector from X^-1 A_i Z to B_i, in the camera frame
    sigma_position     (3,) mm, sigma_rotation (3,) rad: standard deviations that weighted the two, by axis
    unit_weight        size of the weighted residuals; near 1 when the two standard deviations are right
    covariance         by linearised least squares for independent errors, mm and rad
    spread             rad, how far the direction moves that the rotations move least (see above)
    remarks            sentences on what makes the result doubtful; empty when nothing does
    """

    position_residual: Floats
    rotation_residual: Floats
    sigma_position: Floats
    sigma_rotation: Floats
    unit_weight: float
    covariance: Floats
    spread: float
    remarks: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameCalibration(_Fitted):
    """The camera in the base frame, the target in the mobile frame, and how well they are known.

    camera_in_base     X; target_in_mobile Z; positions in mm
    covariance         (12, 12), of X's position (mm) and rotation vector (rad, base frame), then of Z's position and
                       rotation vector (mobile frame)

    The rest is in `_Fitted`.
    """

    camera_in_base: Pose
    target_in_mobile: Pose
    method: str

    @property
    def standard_deviations(self) -> Floats:
        """(12,) mm and rad, in the order of `covariance`."""
        return np.sqrt(np.diagonal(self.covariance))


@dataclass(frozen=True, eq=False, kw_only=True)
class HandEye(_Fitted):
    """`transform`: X of `A_i X = X B_i`; everything else as in `_Fitted`, with X for Z and a covariance (6, 6)."""

    transform: Pose


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
    pairs = pose_pairs(robot_poses, camera_poses, 3, ("robot_poses", "camera_poses"))
    name, spread = _smaller_spread(pairs, pose_spreads, ("robot_poses", "camera_poses"))
    x, z = METHODS[method](pairs)
    _remarks(name, spread, residuals(pairs, x, z)[1])  # refuses what no refinement can mend
    best = _estimated(pairs, x, z, refine, sigma_position, sigma_rotation, tied=False)
    return FrameCalibration(
        camera_in_base=_in_mm(best.x, pairs.unit),
        target_in_mobile=_in_mm(best.z, pairs.unit),
        method=method,
        **_told(pairs, best, name, spread),
    )


def hand_eye(
    a: Pose,
    b: Pose,
    *,
    refine: bool = True,
    sigma_position: npt.ArrayLike | None = None,
    sigma_rotation: npt.ArrayLike | None = None,
) -> HandEye:
    """X of `A_i X = X B_i` from N >= 2 relative motions, by Andreff's linear method and least squares.

    a, b  motions (N, 3) mm and (N, 4) of the same rigid body, seen in the two frames that X relates: X maps
          coordinates of B's frame to A's. The rest is as for `calibrate_frames`, InputErrors included.
    """
    pairs = pose_pairs(a, b, 2, ("a", "b"))
    name, spread = _smaller_spread(pairs, motion_spreads, ("a", "b"))
    start = andreff_hand_eye(pairs.a, pairs.b)
    _remarks(name, spread, residuals(pairs, start, start)[1])
    best = _estimated(pairs, start, start, refine, sigma_position, sigma_rotation, tied=True)
    return HandEye(transform=_in_mm(best.x, pairs.unit), **_told(pairs, best, name, spread))


def _told(pairs: Pairs, best: Refined, name: str, spread: Spreads) -> dict[str, Any]:
    """The fields of `_Fitted`, lengths in mm."""
    position, turn = residuals(pairs, best.x, best.z)
    return {
        "position_residual": position * pairs.unit,
        "rotation_residual": turn,
        "sigma_position": best.sigma_position * pairs.unit,
        "sigma_rotation": best.sigma_rotation,
        "unit_weight": best.unit_weight,
        "covariance": _covariance_in_mm(best.covariance, pairs.unit),
        "spread": float(spread.values[0]),
        "remarks": _remarks(name, spread, turn),
    }


def redefined(robot: Robot, camera_in_base: Pose, target_in_mobile: Pose) -> Robot:
    """The robot with its base joint centres in the camera frame and its mobile ones in the target frame.

    Then `P + R b` with the camera's own P and R maps them into one frame, and the measured poses calibrate the legs
    without further frames (the paper, end of section 3.1). Offsets stay.
    """
    base = transformed(inverse(camera_in_base), robot.base)
    return Robot(robot.name, base, transformed(inverse(target_in_mobile), robot.mobile), robot.offset)


def _smaller_spread(pairs: Pairs, spreads: Callable[[Floats], Spreads], names: tuple[str, str]) -> tuple[str, Spreads]:
    """That of A or of B (without noise they are the same) and its name; InputError where one is degenerate."""
    found = [(name, spreads(pose.rotation)) for name, pose in zip(names, (pairs.a, pairs.b), strict=True)]
    for name, spread in found:
        spread.demand(name)
    return min(found, key=lambda item: float(item[1].values[0]))


def _estimated(
    pairs: Pairs,
    x: Pose,
    z: Pose,
    refine: bool,
    sigma_position: npt.ArrayLike | None,
    sigma_rotation: npt.ArrayLike | None,
    *,
    tied: bool,
) -> Refined:
    given = {"sigma_position": sigma_position, "sigma_rotation": sigma_rotation}
    wrong = [name for name, value in given.items() if value is not None and not _standard_deviations(value)]
    if wrong:
        remedy = "give a positive number, or three, or None"
        raise InputError([Problem(name, f"is {given[name]!r}", remedy) for name in wrong])
    scaled = None if sigma_position is None else np.asarray(sigma_position, dtype=np.float64) / pairs.unit
    return refined(pairs, x, z, sigma_position=scaled, sigma_rotation=sigma_rotation, tied=tied, move=refine)


def _standard_deviations(value: npt.ArrayLike) -> bool:
    array = np.asarray(value, dtype=np.float64)
    return array.shape in ((), (3,)) and bool(((array > 0.0) & np.isfinite(array)).all())


def _remarks(name: str, spread: Spreads, turn: Floats) -> tuple[str, ...]:
    """What the rotation residuals (N, 3) say; InputError when they are as large as the rotations themselves."""
    rms = float(np.sqrt(np.mean(np.sum(turn**2, axis=1))))
    least = float(spread.values[0])
    axis = ", ".join(f"{value:.3f}" for value in spread.axis)
    found = f"move the direction ({axis}) by {least:.2g} rad (rms) only"
    if least <= _LOST * rms:
        what = f"{found}, and the two sides differ by {rms:.2g} rad: translations along it are not determined"
        remedy = "add poses tilted about at least two axes; check that the pairs belong together and map as documented"
        raise InputError([Problem(name, what, remedy)])
    remarks = []
    if least <= _WEAK * rms:
        ratio = f"{least / rms:.1f} times the {rms:.2g} rad by which the two sides differ"
        remarks.append(f"{name} {found}, {ratio}: translations along it are weakly determined")
    if rms > _LARGE:
        remarks.append(f"the two sides differ by {rms:.2g} rad (rms): check that the pairs belong together")
    return tuple(remarks)


def _in_mm(pose: Pose, unit: float) -> Pose:
    return Pose(pose.position * unit, pose.quaternion)


def _covariance_in_mm(covariance: Floats, unit: float) -> Floats:
    scale = np.tile(np.repeat([unit, 1.0], 3), len(covariance) // 6)
    return np.asarray(covariance * np.outer(scale, scale))
