"""The camera from views of a target: homographies and a closed form first, then everything adjusted together.

Bundle adjustment of one camera, one target and the poses of all views, so that predicted centres fit found ones: least
squares in blocks, each view's pose eliminated.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cpcal.common.errors import CpcalError, InputError, printable
from cpcal.common.files import StrPath
from cpcal.common.least_squares import Blocks, least_squares
from cpcal.common.values import AnyArray, Bools, Floats, Ints, norms
from cpcal.robot import Pose
from cpcal.vision.camera import CAMERA_NUMBERS, Camera
from cpcal.vision.files.image_file import read_image
from cpcal.vision.measure import REFUSED, points_in, reason_of
from cpcal.vision.opencv import opencv
from cpcal.vision.pose import plane_poses
from cpcal.vision.projection import by_camera, centers_by_pose, fitted, mapped, predicted_centers
from cpcal.vision.target import Target

# ------------------------------------------------------------------------------------------------------------------
# From a start to a fit that views and dots which do not belong have no say in.

DOTS_MIN, _VIEWS_MIN = 8, 3  # in a view; and views

_MEDIAN = 1.1774  # of the length of a pair of standard normal numbers
_SCALE_MIN = 0.01  # of the stated standard deviations: less is no measure
_VIEW_LIMIT = 5.0  # a view is bad whose median residual is so many times that of all
_DOT_LIMIT = 6.0  # a dot is bad so many robust standard deviations off
_WORST = 0.3  # of the largest residual: bad dots that are left out together, since each moves others
_CONDITION_MIN = 1e-14  # of the reduced normal matrix, its columns scaled
_SETTLED = 1e-10  # the share of the cost that a step must gain, else it was the last
_STEPS = 50


@dataclass(frozen=True, eq=False)
class State:
    """What is adjusted: a camera, and the poses (v,) of the target in its frame."""

    camera: Camera
    poses: Pose

    def moved(self, step: Floats) -> "State | None":
        """By a step (9 + 6 v,); None where that makes no camera."""
        try:
            camera = self.camera.with_numbers(self.camera.numbers + step[:9])
        except InputError:
            return None
        return State(camera, self.poses.moved(step[9:].reshape(-1, 6)))


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A state fitted to what was found in the views `rows` (v,) of those given.

    centers  (v, n, 2) px of each target dot in each view
    factor   (v, n, 2, 2) px^-1: makes standard deviations of pixels; 0: not used
    """

    rows: Ints
    centers: Floats
    factor: Floats
    state: State
    target: Target
    settled: bool = False

    @property
    def used(self) -> Bools:
        """(v, n)."""
        return np.asarray(self.factor.any(axis=(2, 3)))

    def residuals(self, state: State | None = None) -> Floats:
        """Found minus predicted, (v, n, 2) px; nan where a dot is not used."""
        at = state or self.state
        off = self.centers - predicted_centers(self.target, at.camera, at.poses)
        return np.where(self.used[..., None], off, np.nan)

    def deviations(self, state: State | None = None) -> Floats:
        """The residuals (v, n, 2) in stated standard deviations; 0 where a dot is not used, nan behind the camera."""
        off = np.where(self.used[..., None], self.residuals(state), 0.0)
        return (self.factor @ off[..., None])[..., 0]

    def without(self, views: Bools, dots: Bools) -> "CameraFit":
        """Without these views (v,) and dots (v, n), and then without views of too few dots."""
        factor = np.where(dots[..., None, None], 0.0, self.factor)
        keep = ~views & (factor.any(axis=(2, 3)).sum(axis=1) >= DOTS_MIN)
        state = replace(self.state, poses=self.state.poses.rows(keep))
        return replace(self, state=state, rows=self.rows[keep], centers=self.centers[keep], factor=factor[keep])

    def blocks(self, state: State) -> Blocks:
        """The normal equations: nine numbers of the camera that all views share, and each view's pose."""
        dots, radius, camera, poses = self.target.dots, self.target.radius, state.camera, state.poses
        centers, by_pose = centers_by_pose(dots, radius, camera.packed, poses)
        used, of_camera = self.used[..., None], by_camera(dots, radius, camera, poses, centers)
        slopes = np.where(used[..., None], np.concatenate([of_camera, by_pose], axis=-1), 0.0)
        views = len(self.rows)
        slopes, off = (self.factor @ slopes).reshape(views, -1, 15), self.deviations(state).reshape(views, -1, 1)
        turned = np.swapaxes(slopes, 1, 2)
        normal, side = turned @ slopes, (turned @ off)[..., 0]
        own = normal[:, 9:, :9], normal[:, 9:, 9:], side[:, 9:]
        return Blocks(normal[:, :9, :9].sum(axis=0), side[:, :9].sum(axis=0), *own)

    def covariance(self) -> Floats | None:
        """Of the camera (9, 9), by the stated covariances; None where the views leave it open."""
        try:
            matrix, _ = self.blocks(self.state).reduced()
        except np.linalg.LinAlgError:
            return None
        scale = np.sqrt(np.diag(matrix))
        if not (scale > 0.0).all():
            return None
        values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
        half = vectors / scale[:, None] / np.sqrt(np.abs(values))
        return half @ half.T if values[0] > _CONDITION_MIN * values[-1] else None


def robust_fit(fit: CameraFit) -> CameraFit:
    """The fit without the views and dots that do not belong, which go one after the other, the worst first."""
    while len(fit.rows) >= _VIEWS_MIN:
        found = least_squares(
            fit.deviations, fit.blocks, fit.state, tolerance=_SETTLED, moved=State.moved, steps=_STEPS
        )
        fit = replace(fit, state=found.at, settled=found.settled)
        off = np.where(fit.used, norms(fit.deviations()), np.nan)
        medians = np.nanmedian(off, axis=1) / _MEDIAN
        views = medians >= max(_VIEW_LIMIT * max(float(np.median(medians)), _SCALE_MIN), medians.max())
        scale = max(float(np.nanmedian(off)) / _MEDIAN, _SCALE_MIN)
        dots = np.nan_to_num(off) > max(_DOT_LIMIT * scale, _WORST * float(np.nanmax(off)))
        if not views.any() and not dots.any():
            break
        fit = fit.without(views, dots & ~views.any())
    return fit


# ------------------------------------------------------------------------------------------------------------------
# The camera from views: a start, the fit, and what it is worth.

_HOMOGRAPHY_LIMIT = 0.02  # of the image's longer side: no lens bends a plane's dots so much, they are mistaken
_BAD_SHARE = 0.5  # of the views
_FOCAL_RANGE = (0.2, 20.0)  # of the image's longer side: else the homographies say nothing
_ERROR_MAX = 0.02  # the largest standard error of focal length and centre, as a share of the focal length
_REMEDY = "take 10 to 20 views with the target tilted by 20 to 30 degrees in different directions"


class TargetView(NamedTuple):
    """The dots of one image.

    centers     (m, 2) pixels, of the conics through their contours
    covariance  (m, 2, 2) pixels^2
    numbers     (m,) which dot of the target each is
    name        for messages
    """

    centers: Floats
    covariance: Floats
    numbers: Ints
    name: str = ""


class NotCalibratedError(CpcalError):
    """The views do not determine the camera; the message says why and what would help."""


@dataclass(frozen=True, eq=False)
class CalibratedView:
    """What became of a view.

    reason     why it was left out; empty: it was used
    pose       of the target in the camera frame, mm; None where left out
    residuals  (m, 2) found minus predicted, pixels, in the view's order; nan where a dot was not used
    """

    name: str
    reason: str
    pose: Pose | None
    residuals: Floats

    @property
    def used(self) -> Bools:
        """(m,) whether the dot was used; one far off its place is not."""
        return np.asarray(np.isfinite(self.residuals).all(axis=1))

    @property
    def rms(self) -> float:
        """Of the used residuals, pixels per axis; nan without any."""
        return float(np.sqrt(np.nanmean(self.residuals**2))) if self.used.any() else float("nan")


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera from views of a target.

    covariance   (9, 9) of fx, fy, cx, cy, k1, k2, p1, p2, k3; from the stated covariances of the
                 centres, times scale^2 where that is above 1
    rms          of all used residuals, pixels per axis
    scale        of the residuals in stated standard deviations: their root mean square, degrees of freedom counted
    views        in the order given
    """

    camera: Camera
    covariance: Floats
    rms: float
    scale: float
    views: tuple[CalibratedView, ...]

    @property
    def standard_errors(self) -> Floats:
        """(9,) of fx, fy, cx, cy (pixels), k1, k2, p1, p2, k3."""
        return np.sqrt(np.diag(self.covariance))

    def __str__(self) -> str:
        used = sum(not view.reason for view in self.views)
        lines = [f"camera from {used} of {len(self.views)} views, RMS {self.rms:.4f} px per axis"]
        rows = zip(CAMERA_NUMBERS, self.camera.numbers, self.standard_errors, strict=True)
        lines += [f"  {name} = {value:.6g} +- {error:.2g}" for name, value, error in rows]
        lines += [f"  left out: {view.name}: {view.reason}" for view in self.views if view.reason]
        return "\n".join(lines)


def calibrate_camera(views: Sequence[TargetView], target: Target, size: tuple[int, int]) -> Calibration:
    """The camera that took `views` of a target, in images of `size` (width, height) pixels.

    Least squares in pixels, weighted with the stated covariances, over the camera's nine numbers and all poses. Views
    and dots that do not fit the others are left out, and said.

    Raises NotCalibratedError where the views do not determine the camera.
    """
    named = [view if view.name else view._replace(name=f"view {row}") for row, view in enumerate(views, start=1)]
    reasons: dict[int, str] = {}
    start = _start(named, target, size, reasons)
    fit = robust_fit(start)
    bad = set(start.rows.tolist()) - set(fit.rows.tolist())
    reasons.update(dict.fromkeys(bad, "its dots do not fit the other views: moved, blurred, or wrong numbers?"))
    _enough(len(fit.rows), reasons, named)
    freedom = 2 * int(fit.used.sum()) - 6 * len(fit.rows) - 9
    scale, spread = float(np.sqrt((fit.deviations() ** 2).sum() / max(freedom, 1))), fit.covariance()
    if spread is None or not fit.settled:
        raise NotCalibratedError(f"the views leave the camera open: {_REMEDY}")
    spread *= max(scale, 1.0) ** 2
    of_camera = np.sqrt(np.diag(spread)[:4])
    if not of_camera.max() <= _ERROR_MAX * fit.state.camera.focal.mean():
        names = ", ".join(f"{n} +- {e:.3g} px" for n, e in zip(CAMERA_NUMBERS, of_camera, strict=False))
        raise NotCalibratedError(f"the views hardly determine the focal length and the centre ({names}): {_REMEDY}")
    residuals, poses = fit.residuals(), fit.state.poses
    every = [
        CalibratedView(v.name, reasons.get(k, ""), None, np.full(v.centers.shape, np.nan)) for k, v in enumerate(named)
    ]
    for k, row in enumerate(fit.rows.tolist()):
        every[row] = replace(every[row], pose=poses.rows(k), residuals=residuals[k][named[row].numbers])
    rms = float(np.sqrt(np.nanmean(residuals**2)))
    return Calibration(fit.state.camera, spread, rms, scale, tuple(every))


def _start(views: list[TargetView], target: Target, size: tuple[int, int], reasons: dict[int, str]) -> CameraFit:
    """A camera without distortion and the likelier pose of each view; adds to `reasons` for views of no use."""
    rows = []
    for row, view in enumerate(views):
        dots = target.dots[view.numbers]
        if len(dots) < DOTS_MIN or np.linalg.matrix_rank(dots - dots.mean(axis=0), tol=target.radius) < 2:
            reasons[row] = f"fewer than {DOTS_MIN} dots, or all of them on a line"
            continue
        off = mapped(fitted(dots, view.centers), dots) - view.centers
        if np.isfinite(off).all() and np.sqrt(np.mean(off**2)) <= _HOMOGRAPHY_LIMIT * max(size):
            rows.append(row)
        else:
            reasons[row] = "its dots are not where those of a plane can be: wrong numbers?"
    _enough(len(rows), reasons, views)
    some, count = [views[row] for row in rows], len(target.dots)
    points = [target.points[view.numbers].astype(np.float32) for view in some]
    seen = [view.centers.astype(np.float32) for view in some]
    side = float(max(size))
    focal = np.array([side, side])  # where the homographies say nothing
    for aspect in (1.0, 0.0):  # of one focal length for both, else of fx and fy
        found = np.diag(opencv().initCameraMatrix2D(points, seen, size, aspect))[:2]
        if ((found > _FOCAL_RANGE[0] * side) & (found < _FOCAL_RANGE[1] * side)).all():
            focal = found
    camera = Camera(*size, focal, 0.5 * (np.array(size) - 1.0), np.zeros(5))
    poses = [plane_poses(target.dots[view.numbers], camera.normalised(view.centers))[0] for view in some]
    centers, factor = np.zeros((len(rows), count, 2)), np.zeros((len(rows), count, 2, 2))
    for k, view in enumerate(some):
        centers[k, view.numbers] = view.centers
        factor[k, view.numbers] = np.linalg.inv(np.linalg.cholesky(view.covariance))
    stacked = Pose(np.stack([pose.position for pose in poses]), np.stack([pose.quaternion for pose in poses]))
    return CameraFit(np.array(rows), centers, factor, State(camera, stacked), target)


def _enough(count: int, reasons: dict[int, str], views: list[TargetView]) -> None:
    if count >= _VIEWS_MIN and count >= (1.0 - _BAD_SHARE) * len(views):
        return
    said = _listed(reasons, [view.name for view in views])
    what = f"only {count} of {len(views)} views can be used" if views else "there are no views"
    raise NotCalibratedError(f"{what}; at least {_VIEWS_MIN} and half of those given are needed{said}")


# ------------------------------------------------------------------------------------------------------------------
# The camera from images of a target: points, identified without a camera first, calibration.

Image = StrPath | AnyArray


def calibrate_from_images(images: Sequence[Image], target: Target) -> Calibration:
    """The camera that took `images` of the target: files, as `read_image` takes them, or arrays as `observe_dots` does.

    See `calibrate_camera`. The result has a view for each image; one that cannot be used is left out, and its view says
    why.

    Raises NotCalibratedError where the usable images do not determine the camera.
    """
    names = [f"image {k}" if isinstance(one, np.ndarray) else printable(one) for k, one in enumerate(images, start=1)]
    sizes = {}
    camera, nothing = None, np.zeros((0, 2))
    for _ in range(3):  # without a camera, with the rough one that this gives, and with a good one
        reasons, views = {}, {}
        for k, image in enumerate(images):
            try:
                pixels = image if isinstance(image, np.ndarray) else read_image(Path(image))
                if pixels.ndim >= 2:
                    sizes[k] = pixels.shape[1], pixels.shape[0]
                dots, pairs = points_in(pixels, target, camera)
                seen = dots.centers[pairs.found], dots.covariance[pairs.found]
                views[k] = TargetView(*seen, pairs.numbers.astype(np.intp), names[k])
            except REFUSED as error:
                reasons[k] = reason_of(error)
        if not sizes:
            raise NotCalibratedError(f"there is no image that can be used{_listed(reasons, names)}")
        ((size, _),) = Counter(sizes.values()).most_common(1)
        for k in [k for k in sizes if sizes[k] != size]:  # a camera's numbers belong to a size
            reasons[k] = "has {} x {} pixels, most have {} x {}".format(*sizes[k], *size)
            views.pop(k, None)
        try:
            found = calibrate_camera(list(views.values()), target, size)
        except NotCalibratedError as error:
            raise NotCalibratedError(f"{error}{_listed(reasons, names)}") from None
        camera = found.camera
    used = dict(zip(views, found.views, strict=True))
    every = (used.get(k) or CalibratedView(name, reasons[k], None, nothing) for k, name in enumerate(names))
    return replace(found, views=tuple(every))


def _listed(reasons: dict[int, str], names: list[str]) -> str:
    return "".join(f"\n  {names[k]}: {reason}" for k, reason in sorted(reasons.items()))
