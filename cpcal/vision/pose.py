"""The pose of a target from its identified dots: least squares on pixels with the dots' covariances.

A plane has two poses that look nearly the same, one with its depth turned over along the line of sight. OpenCV has both
(IPPE); the dot model (`cpcal.vision.projection`) is fitted to the pixels from each, and when both fit about as well the
answer is a refusal.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from cpcal.common.errors import CpcalError
from cpcal.common.values import Bools, Floats, Ints, floats
from cpcal.robot import Pose, quaternion_from_matrix, quaternion_from_rotation_vector, turn_between
from cpcal.solver.compiled import compiled
from cpcal.vision.camera import Camera
from cpcal.vision.opencv import opencv
from cpcal.vision.projection import by_camera, centers_by_pose, eigenvalues, median, placed_centers, solved
from cpcal.vision.target import Target

# ------------------------------------------------------------------------------------------------------------------
# The Levenberg-Marquardt fit of a pose to the pixels of dots, compiled.
#
# A step is (6,): of the position (mm), and a rotation vector in the camera frame.

DONE, SINGULAR, ENDLESS, NOWHERE = 0, 1, 2, 3  # how a fit ends
STEPS = 200  # most fits need five, those of a small distant target a hundred
_SMALL = 1e-3  # standard deviations: a step that ends the fit
_ROUGH = 1e-9  # of chi-square: a decrease that ends the fit when the residuals are large
_SLACK = 1e-5  # of chi-square, by which it may grow: derivatives that are a thousandth off do so next to the end
_NO_ANGLE = 1e-6


@compiled
def fit_pose(
    dots: Floats,
    seen: Floats,
    factors: Floats,
    radius: float,
    camera: Floats,
    turn: Floats,
    place: Floats,
    residuals: Floats,
    normal: Floats,
) -> tuple[int, float]:
    """Fits `turn` (1, 3, 3) and `place` (1, 3) in place, fills in residuals (2 n,) and normal matrix (6, 6); returns
    how it ended and chi-square.

    Residuals are of dots (n, 2) mm seen at (n, 2) pixels, in standard deviations by lower triangular factors (n, 2, 2)
    of the covariances.
    """
    size = len(residuals)
    slope, trial, trial_slope = np.empty((size, 6)), np.empty(size), np.empty((size, 6))
    right, step = np.empty(6), np.empty(6)
    _evaluate(dots, seen, factors, radius, camera, turn, place, residuals, slope)
    chi_square, damping = np.dot(residuals, residuals), 0.0
    if not np.isfinite(chi_square):
        return NOWHERE, np.inf
    for _ in range(STEPS):
        normal[:], right[:] = np.dot(slope.T, slope), np.dot(slope.T, residuals)
        if not solved(normal, 6, damping, 0.0, right, step):
            return SINGULAR, chi_square
        moved, turned = place + step[:3], turn.copy()
        turned[0] = _turned(turn[0], step[3:])
        gain = np.dot(step, np.dot(normal, step))
        if gain < max(_SMALL**2, _ROUGH * chi_square) and damping < 1e-3:
            place[:], turn[:], residuals[:] = moved, turned, residuals - np.dot(slope, step)
            return DONE, np.dot(residuals, residuals)
        _evaluate(dots, seen, factors, radius, camera, turned, moved, trial, trial_slope)
        square = np.dot(trial, trial)
        if square <= (1.0 + _SLACK) * chi_square:
            place[:], turn[:], residuals[:], slope[:] = moved, turned, trial, trial_slope
            chi_square, damping = square, 0.1 * damping
        else:
            damping = max(10.0 * damping, 1e-4)
    return ENDLESS, chi_square


@compiled
def _evaluate(
    dots: Floats,
    seen: Floats,
    factors: Floats,
    radius: float,
    camera: Floats,
    turn: Floats,
    place: Floats,
    residuals: Floats,
    slope: Floats,
) -> None:
    """Residuals (2 n,), and minus their derivatives (2 n, 6)."""
    count = len(dots)
    centers, by_pose = np.empty((1, count, 2)), np.empty((1, count, 2, 6))
    placed_centers(dots, radius, camera, turn, place, centers, by_pose)
    for i in range(count):
        a, b, c = factors[i, 0, 0], factors[i, 1, 0], factors[i, 1, 1]
        residuals[2 * i] = (seen[i, 0] - centers[0, i, 0]) / a
        residuals[2 * i + 1] = (seen[i, 1] - centers[0, i, 1] - b * residuals[2 * i]) / c
        slope[2 * i] = by_pose[0, i, 0] / a
        slope[2 * i + 1] = (by_pose[0, i, 1] - b * slope[2 * i]) / c


@compiled
def _turned(turn: Floats, by: Floats) -> Floats:
    """R(by) turn."""
    angle = np.sqrt(np.dot(by, by))
    near = angle < _NO_ANGLE
    a, b = (1.0, 0.5) if near else (np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2)
    cross = np.array([[0.0, -by[2], by[1]], [by[2], 0.0, -by[0]], [-by[1], by[0], 0.0]])
    out: Floats = turn + np.dot(cross, a * turn + b * np.dot(cross, turn))
    return out


# ------------------------------------------------------------------------------------------------------------------
# What a pose is fitted to, and the fit.


class NoPose(CpcalError):
    """The dots determine no pose, or more than one. Its text is the reason."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """The dot model: dots (n, 2) mm that are seen at (n, 2) pixels, with lower triangular factors (n, 2, 2) whose
    squares are the covariances. Its residuals are standard deviations."""

    dots: Floats
    seen: Floats
    factors: Floats
    radius: float
    camera: Camera

    def residuals(self, pose: Pose) -> Floats:
        """(n, 2) at a pose."""
        centers = centers_by_pose(self.dots, self.radius, self.camera.packed, pose)[0]
        return np.asarray(np.linalg.solve(self.factors, (self.seen - centers)[..., None])[..., 0])

    def only(self, used: Bools) -> "Pixels":
        """Of some (n,) of the dots."""
        return Pixels(self.dots[used], self.seen[used], self.factors[used], self.radius, self.camera)


class PoseFit(NamedTuple):
    pose: Pose
    chi_square: float
    normal: Floats  # (6, 6), the inverse of the covariance
    residuals: Floats  # in standard deviations


def fit(model: Pixels, pose: Pose) -> PoseFit:
    """Levenberg-Marquardt from a pose; ends when a step is a small part of the standard deviations."""
    turn, place = pose.rotation[None].copy(), pose.position[None].copy()
    normal, residuals = np.eye(6), np.empty(2 * len(model.dots))
    given = model.dots, model.seen, model.factors, model.radius, model.camera.packed
    ended, square = fit_pose(*given, turn, place, residuals, normal)
    if ended == SINGULAR:
        raise NoPose("the dots do not determine the pose")
    if ended == ENDLESS:
        raise NoPose(f"the fit has not ended after {STEPS} steps")
    return PoseFit(Pose(place[0], quaternion_from_matrix(turn[0])), float(square), normal, residuals)


def plane_poses(dots: Floats, rays: Floats) -> list[Pose]:
    """Both poses of a plane with dots (n, 2) mm seen along (x, y, 1) for the `rays` (n, 2), the likelier first."""
    cv2 = opencv()
    points = np.concatenate([dots, np.zeros((len(dots), 1))], axis=1)
    _, turns, places, _ = cv2.solvePnPGeneric(points, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    both = zip(turns, places, strict=True)
    return [Pose(place.ravel(), quaternion_from_rotation_vector(turn.ravel())) for turn, place in both]


# ------------------------------------------------------------------------------------------------------------------
# What errors that all images share do to a pose: those of the camera, of the plate's scale, of the places of its dots.
#
# By A, the derivatives of the whitened centres by the pose, and B, those by the errors, each of deviation 1, errors e
# move the pose by -(A' A)^-1 A' B e and leave the residuals M e, M = B - A (A' A)^-1 A' B. For e of unit covariance the
# chi-square of residuals r is r' (I + M M')^-1 r.


def shared_part(model: Pixels, found: PoseFit, target: Target, covariance: Floats | None) -> tuple[Floats, float]:
    """The part (6, 6) of the pose's covariance that shared errors make, and the chi-square of its residuals under them;
    `covariance` (9, 9) of the camera's numbers, or None where the camera is exact."""
    if covariance is None and not target.scale_sigma and not target.dot_sigma:
        return np.zeros((6, 6)), found.chi_square
    dots, camera, count, pose = model.dots, model.camera, len(model.dots), found.pose
    centers, by_pose = centers_by_pose(dots, target.radius, camera.packed, pose)
    sources = []  # derivatives (m, 2, k) of the centres by k errors of deviation 1
    if covariance is not None:
        values, vectors = np.linalg.eigh(covariance)
        half = vectors * np.sqrt(np.maximum(values, 0.0))
        sources.append(by_camera(dots, target.radius, camera, pose, centers) @ half)
    if target.scale_sigma:
        outward = dots @ pose.rotation[:, :2].T  # mm, where a larger plate has its dots
        sources.append(target.scale_sigma * by_pose[..., :3] @ outward[..., None])
    if target.dot_sigma:
        each = np.zeros((count, 2, count, 2))
        each[np.arange(count), :, np.arange(count)] = target.dot_sigma * by_pose[..., :3] @ pose.rotation[:, :2]
        sources.append(each.reshape(count, 2, 2 * count))
    slopes, *others = (np.linalg.solve(model.factors, d).reshape(2 * count, -1) for d in (by_pose, *sources))
    by_errors = np.concatenate(others, axis=1)
    moved = np.linalg.solve(slopes.T @ slopes, slopes.T @ by_errors)
    left = by_errors - slopes @ moved
    against = found.residuals @ left
    explained = against @ np.linalg.solve(np.eye(len(against)) + left.T @ left, against)
    return moved @ moved.T, float(found.chi_square - explained)


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


def estimate_pose(
    seen: Floats, spread: Floats, which: Ints, target: Target, camera: Camera, camera_covariance: Floats | None = None
) -> PoseEstimate:
    """The pose that fits the target's dots `which` (m,), each once, seen at (m, 2) px with covariances (m, 2, 2) px^2.

    `camera_covariance` (9, 9) of fx, fy, cx, cy, k1, k2, p1, p2, k3; left out: the camera is exact.

    Raises NoPose with the reason.
    """
    if len(which) < FEWEST:
        raise NoPose(f"{len(which)} dots are too few for a pose: at least {FEWEST} are needed")
    rays = camera.normalised(seen)
    if not np.isfinite(rays).all():
        raise NoPose("the camera cannot see some of the dots where they are: its distortion has no inverse there")
    dots = target.dots[which]
    away = dots - dots.mean(axis=0)
    least, most = eigenvalues(away.T @ away)
    if least < _SLIM**2 * most:
        raise NoPose("the dots lie on a line or nearly so")
    pixels = Pixels(dots, seen, floats(np.linalg.cholesky(spread)), target.radius, camera)
    first, *others = plane_poses(dots, rays)
    used, final, residuals = _screened(pixels, first)
    second = _other(pixels.only(used), final, others)
    if second is not None and second.chi_square < final.chi_square:
        first = final.pose
        used, final, residuals = _screened(pixels, second.pose)
        second = _other(pixels.only(used), final, [first])
    degrees = 2 * int(used.sum()) - 6
    kept = pixels.only(used)
    part, chi_square = shared_part(kept, final, target, camera_covariance)
    p_value = float(chdtrc(degrees, chi_square))
    scale = chi_square / degrees if p_value < POOR else 1.0
    if second is not None and (rival := (second.chi_square - final.chi_square) / scale) < AMBIGUOUS:
        raise NoPose(f"ambiguous: two poses fit about equally well, chi-square {rival:.1f} apart")
    rms = float(np.sqrt((residuals[used] ** 2).mean()))
    common = _common(kept.dots, final.residuals.reshape(-1, 2), degrees) if scale > DOUBTFUL else 1.0
    covariance = scale * common * np.linalg.inv(final.normal) + part
    return PoseEstimate(final.pose, covariance, part, residuals, ~used, rms, chi_square, degrees, p_value, scale)


def _common(dots: Floats, residuals: Floats, degrees: int) -> float:
    """How much larger a misfit is in each direction of the pose than in one of the residuals (n, 2) of dots (n, 2).

    1 if dots are off each by itself. A bent plate or a wrong lens moves neighbours alike; the share that is alike is in
    the six directions of the pose as much as in all of the residuals together, at a guess: it does not average out.
    """
    apart = ((dots[:, None] - dots) ** 2).sum(axis=2)
    near = np.argsort(apart, axis=1)[:, 1 : 1 + _NEIGHBOURS]
    alike = float((residuals[:, None] * residuals[near]).sum(axis=2).mean() / (residuals**2).sum(axis=1).mean())
    return 1.0 + alike * (degrees / 6.0 - 1.0) if alike > _ALIKE else 1.0


def _other(pixels: Pixels, final: PoseFit, starts: list[Pose]) -> PoseFit | None:
    """The fit of the plane's other pose; None where it is the same, to within a standard deviation."""
    for start in starts:
        found = fit(pixels, start)
        turn = turn_between(found.pose.quaternion, final.pose.quaternion)
        step = np.concatenate([found.pose.position - final.pose.position, turn])
        if not step @ final.normal @ step < 1.0:
            return found
    return None


def _screened(model: Pixels, pose: Pose) -> tuple[Bools, PoseFit, Floats]:
    """The fit without dots that are too far off, and the residuals of all (m, 2), pixels.

    Too far is beyond the level that one good dot exceeds in a hundred images; where the residuals are larger than the
    covariances say, their own median is the measure.
    """
    used = np.ones(len(model.dots), bool)
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
