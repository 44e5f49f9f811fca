"""The pose of a target from its identified dots: least squares on pixels with the dots' covariances.

The start comes from the homography of the dots' directions, so no library is needed; a Levenberg-Marquardt fit of the
plain pinhole model to the directions improves it, and one of the dot model (`cpcal.vision.dot_model`) to the pixels
ends it. A plane has a second pose that looks nearly the same, its depth turned over along the line of sight; it is
fitted as well, and when it fits about as well the answer is a refusal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc

from cpcal.errors import CpcalError, InputError, Problem
from cpcal.robot.kinematics import Pose
from cpcal.robot.rotation import (
    normalised,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_vector,
)
from cpcal.robot.rotation import quaternion_conjugate as conjugate
from cpcal.vision.camera import Camera
from cpcal.vision.dot_model import centers_of, predict
from cpcal.vision.homography import fitted
from cpcal.vision.target import Target

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Model = Callable[[Pose], tuple[Array, Array]]  # residuals (m, 2) and the predictions' Jacobian (m, 2, 6)

FEWEST = 6  # dots
AMBIGUOUS = 30.0  # a second pose whose chi-square is no more than this above the first's is as credible (exp(15) to 1)
OUTLIER = 0.01  # expected number of good dots screened, per image
OUTLIERS = 0.1  # share of the dots that may be screened
POOR = 1e-3  # p-value below which the covariance is scaled by the residuals
_MEDIAN = 2.0 * np.log(2.0)  # of a chi-square variable with two degrees of freedom
_STEPS = 30
_SMALL = 1e-3  # standard deviations: a step that ends the fit


class NoPose(CpcalError):
    """The dots determine no pose, or more than one. Its text is the reason."""


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """A pose of the target in the camera frame.

    pose        position (3,) mm, unit quaternion (4,)
    covariance  (6, 6) of position (mm) and rotation vector (rad) in the camera frame: R = R(vector) R_estimated;
                it follows from the dots' covariances, times `scale`
    residuals   (m, 2) found minus predicted centres, pixels, of all given dots
    outliers    (m,) dots that were screened and have no part in the pose
    rms         root mean square of the others' residuals, pixels, per axis
    chi_square, degrees, p_value   of the others
    scale       1, or chi_square / degrees when the p-value is below 0.001: then the residuals are larger than the dots'
                covariances say (the camera or the target is not quite as stated)
    rival       by how much at least the chi-square of the plane's second pose is larger, over `scale`; inf: none is
    """

    pose: Pose
    covariance: Array
    residuals: Array
    outliers: Bools
    rms: float
    chi_square: float
    degrees: int
    p_value: float
    scale: float
    rival: float


def estimate_pose(
    centers: npt.ArrayLike, covariance: npt.ArrayLike, numbers: npt.ArrayLike, target: Target, camera: Camera
) -> PoseEstimate:
    """The pose that fits centres (m, 2) px with covariances (m, 2, 2) px^2 of the target's dots `numbers` (m,).

    Raises NoPose with the reason, InputError when the arrays do not belong together.
    """
    seen, spread, which = _checked(centers, covariance, numbers, target)
    if len(which) < FEWEST:
        raise NoPose(f"{len(which)} dots are too few for a pose: at least {FEWEST} are needed")
    rays = camera.normalised(seen)
    if not np.isfinite(rays).all():
        raise NoPose("the camera cannot see some of the dots where they are: its distortion has no inverse there")
    dots = target.dots[which]
    information: Array = np.asarray(np.linalg.inv(spread), dtype=np.float64)

    def on_pixels(used: Bools) -> Model:
        def model(pose: Pose) -> tuple[Array, Array]:
            predicted = predict(dots[used], target.radius, camera, pose)
            return seen[used] - predicted.centers, predicted.by_pose

        return model

    everyone = np.ones(len(which), dtype=bool)
    sharpness = 0.5 * float(np.median(np.trace(information, axis1=1, axis2=2)) * camera.focal.mean() ** 2)
    round_ones = np.broadcast_to(sharpness * np.eye(2), information.shape)
    plain = _pinhole(dots, rays)
    first = _fit(plain, _start(dots, rays), round_ones)
    used, final = _screened(on_pixels, first.pose, information, everyone)
    degrees = 2 * int(used.sum()) - 6
    p_value = float(chdtrc(degrees, final.chi_square))
    scale = final.chi_square / degrees if p_value < POOR else 1.0
    second = _fit(plain, _turned_over(final.pose, dots), round_ones)
    rival = np.inf
    if not _same(second.pose, first):
        # the dot model differs from the plain one by no more than the first pose's residuals in both tell
        least = np.sqrt(second.chi_square) - np.sqrt(first.chi_square) - np.sqrt(final.chi_square)
        rival = (max(least, 0.0) ** 2 - final.chi_square) / scale
        if rival < AMBIGUOUS:
            second = _fit(on_pixels(used), second.pose, information[used])
            rival = np.inf if _same(second.pose, final) else (second.chi_square - final.chi_square) / scale
    if rival < AMBIGUOUS:
        raise NoPose(f"ambiguous: two poses fit about equally well, chi-square {rival:.1f} apart")
    residuals = seen - centers_of(dots, target.radius, camera, final.pose)
    rms = float(np.sqrt((residuals[used] ** 2).mean()))
    return PoseEstimate(
        final.pose,
        np.asarray(scale * np.linalg.inv(final.normal), dtype=np.float64),
        residuals,
        ~used,
        rms,
        final.chi_square,
        degrees,
        p_value,
        scale,
        float(rival),
    )


def _checked(
    centers: npt.ArrayLike, covariance: npt.ArrayLike, numbers: npt.ArrayLike, target: Target
) -> tuple[Array, Array, Ints]:
    seen, spread = np.asarray(centers, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    which = np.asarray(numbers, dtype=np.int64)
    if which.ndim != 1 or seen.shape != (len(which), 2) or spread.shape != (len(which), 2, 2):
        raise InputError([Problem("dots", "centres, covariances and numbers differ in length", "give m of each")])
    problems = []
    if not np.isfinite(seen).all():
        problems.append(Problem("dots", "some centres are not finite", "leave those dots out"))
    if len(np.unique(which)) < len(which) or not ((which >= 0) & (which < len(target.dots))).all():
        problems.append(Problem("dots", "the numbers are not different dots of the target", "number dots from 0"))
    determinant = spread[:, 0, 0] * spread[:, 1, 1] - spread[:, 0, 1] * spread[:, 1, 0]
    if not (np.isfinite(spread).all() and (determinant > 0.0).all() and (spread[:, 0, 0] > 0.0).all()):
        problems.append(Problem("dots", "some covariances are not positive definite", "give pixels squared"))
    if problems:
        raise InputError(problems)
    return seen, spread, which


@dataclass(frozen=True, eq=False)
class _Fit:
    pose: Pose
    chi_square: float
    normal: Array  # (6, 6), the inverse of the covariance
    residuals: Array


def _start(dots: Array, rays: Array) -> Pose:
    """The pose whose plane has the homography of the dots' directions, its columns made orthonormal."""
    homography = fitted(dots, rays)
    homography = homography * (2.0 / np.linalg.norm(homography[:, :2], axis=0).sum())
    matrix = np.column_stack([homography[:, :2], np.cross(homography[:, 0], homography[:, 1])])
    left, values, right = np.linalg.svd(matrix)
    if not (np.isfinite(values).all() and values[1] > 1e-6):
        raise NoPose("the dots lie on a line or nearly so")
    return Pose(
        homography[:, 2], quaternion_from_matrix(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)
    )


def _turned_over(pose: Pose, dots: Array) -> Pose:
    """The plane's other pose: depths along the line of sight to the dots' middle change their sign."""
    middle = np.append(dots.mean(axis=0), 0.0)
    center = pose.position + pose.rotation @ middle
    sight = center / np.linalg.norm(center)
    turn = (np.eye(3) - 2.0 * np.outer(sight, sight)) @ pose.rotation @ np.diag([1.0, 1.0, -1.0])
    return Pose(center - turn @ middle, quaternion_from_matrix(turn))


def _pinhole(dots: Array, rays: Array) -> Model:
    """Directions of points without a size."""

    def model(pose: Pose) -> tuple[Array, Array]:
        arm = dots @ pose.rotation[:, :2].T
        x, y, z = (pose.position + arm).T
        z = np.where(z > 0.0, z, np.nan)
        u, v = x / z, y / z
        slope = np.zeros((len(dots), 2, 6))
        slope[:, 0, 0] = slope[:, 1, 1] = 1.0 / z
        slope[:, 0, 2], slope[:, 1, 2] = -u / z, -v / z
        x, y, z = arm.T
        for slope_of in slope.transpose(1, 2, 0):  # the vector product of the arm and the derivatives by position
            a, b, c = slope_of[:3]
            slope_of[3:] = y * c - z * b, z * a - x * c, x * b - y * a
        return rays - np.stack([u, v], axis=1), slope

    return model


def _fit(model: Model, pose: Pose, information: Array) -> _Fit:
    """Levenberg-Marquardt; ends when a step is a small part of the standard deviations."""
    damping = 0.0
    current = _evaluated(model, pose, information)
    if not np.isfinite(current[0]):
        return _Fit(pose, np.inf, np.eye(6), current[3])
    for _ in range(_STEPS):
        chi_square, normal, gradient, residuals, slope = current
        scaled = normal + damping * np.diag(np.diag(normal))
        try:
            step: Array = np.asarray(np.linalg.solve(scaled, gradient), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise NoPose("the dots do not determine the pose") from None
        moved = _moved(pose, step)
        if step @ normal @ step < _SMALL**2 and damping < 1e-3:
            return _Fit(moved, chi_square - float(step @ gradient), normal, residuals - slope @ step)
        trial = _evaluated(model, moved, information)
        if trial[0] <= chi_square:
            pose, current, damping = moved, trial, 0.1 * damping
        else:
            damping = max(10.0 * damping, 1e-4)
    return _Fit(pose, current[0], current[1], current[3])


def _evaluated(model: Model, pose: Pose, information: Array) -> tuple[float, Array, Array, Array, Array]:
    """Chi-square (inf for nonsense), normal matrix (6, 6), minus half the gradient (6,), residuals, slopes."""
    residuals, slope = model(pose)
    weighted = np.swapaxes(slope, 1, 2) @ information  # (m, 6, 2)
    chi_square = float(_squares(residuals, information).sum())
    if not np.isfinite(chi_square):
        return np.inf, np.eye(6), np.zeros(6), residuals, slope
    flat = np.swapaxes(weighted, 1, 2).reshape(-1, 6)
    return chi_square, flat.T @ slope.reshape(-1, 6), flat.T @ residuals.ravel(), residuals, slope


def _squares(residuals: Array, information: Array) -> Array:
    """The squares (m,) of residuals (m, 2) in standard deviations."""
    return np.asarray(((information @ residuals[..., None])[..., 0] * residuals).sum(axis=1))


def _moved(pose: Pose, step: Array) -> Pose:
    turn = quaternion_from_rotation_vector(step[3:])
    return Pose(pose.position + step[:3], normalised(quaternion_product(turn, pose.quaternion)))


def _screened(on_pixels: Callable[[Bools], Model], pose: Pose, information: Array, used: Bools) -> tuple[Bools, _Fit]:
    """The fit without dots that are too far off: beyond the level that a good dot exceeds in one image of a hundred,
    where the residuals' own median is the measure when it is larger than the covariances say."""
    cut = 2.0 * np.log(len(used) / OUTLIER)
    while True:
        fit = _fit(on_pixels(used), pose, information[used])
        if used.all():
            residuals = fit.residuals
        else:
            residuals, _ = on_pixels(np.ones(len(used), dtype=bool))(fit.pose)
        square = _squares(residuals, information)
        level = max(1.0, float(np.median(square)) / _MEDIAN)
        good = square <= cut * level
        if (~good).sum() > OUTLIERS * len(good):
            raise NoPose(f"{(~good).sum()} of {len(good)} dots do not fit one pose")
        if (good == used).all() or (used & ~good).sum() == 0:
            return used, fit
        used, pose = used & good, fit.pose


def _same(pose: Pose, fit: _Fit) -> bool:
    """Whether a pose is the fit's to within a standard deviation."""
    turn = quaternion_product(pose.quaternion, conjugate(fit.pose.quaternion))
    step = np.concatenate([pose.position - fit.pose.position, rotation_vector(turn)])
    return bool(step @ fit.normal @ step < 1.0)
