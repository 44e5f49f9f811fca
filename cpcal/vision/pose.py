"""The pose of a target from its identified dots: least squares on pixels with the dots' covariances.

The start comes from the homography of the dots' directions, so no library is needed; a Levenberg-Marquardt fit of the
plain pinhole model to the directions improves it, and one of the dot model (`cpcal.vision.dot_model`) to the pixels
ends it. A plane has a second pose that looks nearly the same, its depth turned over along the line of sight; it is
fitted as well, and when it fits about as well the answer is a refusal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc

from cpcal.common.arrays import Bools, Floats, Ints
from cpcal.common.errors import InputError, Problem
from cpcal.robot import Pose, normalised
from cpcal.vision.camera import Camera
from cpcal.vision.median import median
from cpcal.vision.pose_fit import NoPose, Pixels, PoseFit, fit, plain_model, same_pose, turned_over
from cpcal.vision.shared_errors import shared_part
from cpcal.vision.target import Target
from cpcal.vision.two_by_two import determinants, eigenvalues

FEWEST = 6  # dots
AMBIGUOUS = 30.0  # a second pose whose chi-square is no more than this above the first's is as credible (exp(15) to 1)
OUTLIER = 0.01  # expected number of good dots screened, per image
OUTLIERS = 0.1  # share of the dots that may be screened
POOR = 1e-3  # p-value below which the covariance is scaled by the residuals
DOUBTFUL = 2.0  # scale: what a camera and a target as stated never come near
_NEIGHBOURS = 4
_ALIKE = 0.25  # correlation of neighbours' residuals from which on they are no noise: that of noise is below
_MEDIAN = 2.0 * np.log(2.0)  # of a chi-square variable with two degrees of freedom
_SLIM = 0.01  # breadth by length of all dots, below which they are as good as on a line


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """A pose of the target in the camera frame.

    pose        position (3,) mm, unit quaternion (4,)
    covariance  (6, 6) of position (mm) and rotation vector (rad) in the camera frame: R = R(vector) R_estimated;
                it follows from the dots' covariances, times `scale`, and from the errors that images share; where
                `scale` is above 2 and neighbouring dots are off alike, no mean over dots makes it smaller
    shared_part (6, 6) of it: what the camera's covariance and the target's deviations make; these errors are the same
                in every image of that camera and plate, so no mean makes them smaller
    residuals   (m, 2) found minus predicted centres, pixels, of all given dots
    outliers    (m,) dots that were screened and have no part in the pose
    rms         root mean square of the others' residuals, pixels, per axis
    chi_square, degrees, p_value   of the others
    scale       1, or chi_square / degrees when the p-value is below 0.001: then the residuals are
                larger than the covariances say. The camera or the target is not as stated; that moves all dots
                together, and the error may be far larger than the scaled covariance says
    rival       by how much at least the chi-square of the plane's second pose is larger, over `scale`; inf: none is
    """

    pose: Pose
    covariance: Floats
    shared_part: Floats
    residuals: Floats
    outliers: Bools
    rms: float
    chi_square: float
    degrees: int
    p_value: float
    scale: float
    rival: float


def estimate_pose(
    centers: npt.ArrayLike,
    covariance: npt.ArrayLike,
    numbers: npt.ArrayLike,
    target: Target,
    camera: Camera,
    camera_covariance: Floats | None = None,
) -> PoseEstimate:
    """The pose that fits centres (m, 2) px with covariances (m, 2, 2) px^2 of the target's dots `numbers` (m,).

    `camera_covariance` (9, 9) of fx, fy, cx, cy, k1, k2, p1, p2, k3; left out: the camera is exact.

    Raises NoPose with the reason, InputError when the arrays do not belong together.
    """
    seen, spread, which = _checked(centers, covariance, numbers, target)
    if len(which) < FEWEST:
        raise NoPose(f"{len(which)} dots are too few for a pose: at least {FEWEST} are needed")
    rays = camera.normalised(seen)
    if not np.isfinite(rays).all():
        raise NoPose("the camera cannot see some of the dots where they are: its distortion has no inverse there")
    dots = target.dots[which]
    _check_spread(dots)
    factors: Floats = np.asarray(np.linalg.cholesky(spread), dtype=np.float64)
    plain, start = plain_model(
        dots, rays, float(camera.focal.mean() / np.sqrt(median(spread[:, [0, 1], [0, 1]].ravel())))
    )
    first = fit(plain, start)
    second = fit(plain, turned_over(first.pose, dots))
    if second.chi_square < first.chi_square:
        first, second = second, first
    pixels = Pixels(dots, seen, factors, target.radius, camera)
    used, final, residuals = _screened(pixels, first.pose)
    degrees = 2 * int(used.sum()) - 6
    kept = pixels.only(used)
    part, chi_square = shared_part(final, kept.dots, target, camera, camera_covariance, kept.whitened)
    p_value = float(chdtrc(degrees, chi_square))
    scale = chi_square / degrees if p_value < POOR else 1.0
    rival = _rival(first, second, final, pixels, used, scale)
    if rival < AMBIGUOUS:
        raise NoPose(f"ambiguous: two poses fit about equally well, chi-square {rival:.1f} apart")
    rms = float(np.sqrt((residuals[used] ** 2).mean()))
    common = _common(kept.dots, final.residuals.reshape(-1, 2), degrees) if scale > DOUBTFUL else 1.0
    return PoseEstimate(
        pose=Pose(final.pose.position, normalised(final.pose.quaternion)),
        covariance=np.asarray(scale * common * np.linalg.inv(final.normal) + part, dtype=np.float64),
        shared_part=part,
        residuals=residuals,
        outliers=~used,
        rms=rms,
        chi_square=chi_square,
        degrees=degrees,
        p_value=p_value,
        scale=scale,
        rival=rival,
    )


def _common(dots: Floats, residuals: Floats, degrees: int) -> float:
    """How much larger a misfit is in each direction of the pose than in one of the residuals (n, 2) of dots (n, 2).

    1 if dots are off each by itself. A bent plate or a wrong lens moves neighbours alike; the share that is alike is in
    the six directions of the pose as much as in all of the residuals together, at a guess: it does not average out.
    """
    apart = ((dots[:, None] - dots) ** 2).sum(axis=2)
    near = np.argsort(apart, axis=1)[:, 1 : 1 + _NEIGHBOURS]
    alike = float((residuals[:, None] * residuals[near]).sum(axis=2).mean() / (residuals**2).sum(axis=1).mean())
    return 1.0 + alike * (degrees / 6.0 - 1.0) if alike > _ALIKE else 1.0


def _rival(first: PoseFit, second: PoseFit, final: PoseFit, pixels: Pixels, used: Bools, scale: float) -> float:
    """By how much at least the plane's second pose fits worse than the final one, over `scale`; inf: it is the same."""
    if same_pose(second.pose, first):
        return np.inf
    # The plain model's residuals differ from the dot model's by no more than the first pose's in both tell, and by
    # the dots' relative depths, surely less than a factor of 2.
    least = 0.5 * np.sqrt(second.chi_square) - np.sqrt(first.chi_square) - np.sqrt(final.chi_square)
    rival = (max(least, 0.0) ** 2 - final.chi_square) / scale
    if rival < AMBIGUOUS:
        second = fit(pixels.only(used), second.pose)
        rival = np.inf if same_pose(second.pose, final) else (second.chi_square - final.chi_square) / scale
    return float(rival)


def _checked(
    centers: npt.ArrayLike, covariance: npt.ArrayLike, numbers: npt.ArrayLike, target: Target
) -> tuple[Floats, Floats, Ints]:
    seen, spread = np.asarray(centers, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    which = np.asarray(numbers, dtype=np.int64)
    if which.ndim != 1 or seen.shape != (len(which), 2) or spread.shape != (len(which), 2, 2):
        raise InputError([Problem("dots", "centres, covariances and numbers differ in length", "give m of each")])
    problems = []
    if not np.isfinite(seen).all():
        problems.append(Problem("dots", "some centres are not finite", "leave those dots out"))
    if len(np.unique(which)) < len(which) or not ((which >= 0) & (which < len(target.dots))).all():
        problems.append(Problem("dots", "the numbers are not different dots of the target", "number dots from 0"))
    if not (np.isfinite(spread).all() and (determinants(spread) > 0.0).all() and (spread[:, 0, 0] > 0.0).all()):
        problems.append(Problem("dots", "some covariances are not positive definite", "give pixels squared"))
    if problems:
        raise InputError(problems)
    return seen, spread, which


def _check_spread(dots: Floats) -> None:
    away = dots - dots.mean(axis=0)
    least, most = eigenvalues(away.T @ away)
    if least < _SLIM**2 * most:
        raise NoPose("the dots lie on a line or nearly so")


def _screened(model: Pixels, pose: Pose) -> tuple[Bools, PoseFit, Floats]:
    """The fit without dots that are too far off, and the residuals of all (m, 2), pixels.

    Too far is beyond the level that one good dot exceeds in a hundred images; where the residuals are larger than the
    covariances say, their own median is the measure.
    """
    used = np.ones(len(model.dots), dtype=bool)
    cut = 2.0 * np.log(len(used) / OUTLIER)
    while True:
        found = fit(model.only(used), pose)
        residuals = found.residuals.reshape(-1, 2) if used.all() else model.residuals(found.pose)
        square = (residuals * residuals).sum(axis=1)
        level = max(1.0, median(square) / _MEDIAN)
        good = square <= cut * level
        if not (np.isfinite(square).all() and (~good).sum() <= OUTLIERS * len(good)):
            raise NoPose(f"{(~good).sum()} of {len(good)} dots do not fit one pose")
        if not (used & ~good).any():
            return used, found, (model.factors @ residuals[..., None])[..., 0]
        used, pose = used & good, found.pose
