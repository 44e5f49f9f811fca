"""The camera from views of a target: homographies and a closed form first, then everything adjusted together.

Bundle adjustment of one camera, one target and the poses of all views, so that predicted centres fit found ones: least
squares in blocks, each view's pose eliminated. Dots are refined up to the similarity that no image can tell:
corrections are orthogonal to shifts, turn and scale of the stated dots.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import CpcalError, InputError, Problem, printable
from cpcal.common.values import Bools, Floats, Ints
from cpcal.robot import Pose, normalised, quaternion_from_rotation_vector, quaternion_product
from cpcal.solver.optimize.least_squares import Blocks, least_squares
from cpcal.vision.boards import board_points
from cpcal.vision.camera import CAMERA_NUMBERS, Camera
from cpcal.vision.dots import Dots, observe_dots, refitted
from cpcal.vision.files.image_file import UnreadableImageError, read_image
from cpcal.vision.files.plate_and_camera import CameraRecord
from cpcal.vision.identify import Identification, Unidentified, identify
from cpcal.vision.opencv import opencv
from cpcal.vision.pose import plane_poses
from cpcal.vision.projection import centers_of, fitted, mapped, predict
from cpcal.vision.target import Target

# ------------------------------------------------------------------------------------------------------------------
# From a start to a fit that views and dots which do not belong have no say in.

DOTS_MIN = 8  # in a view
SIGHTINGS_MIN = 3  # of a dot that is refined

_ROUNDS = 12  # of the robust adjustment, and of leaving out
_LOSS = 3.0  # robust standard deviations
_MEDIAN = 1.1774  # of the length of a pair of standard normal numbers
_SCALE_MIN = 0.01  # of the stated standard deviations: less is no measure
_VIEW_LIMIT = 5.0  # a view is bad whose median residual is so many times that of all
_DOT_LIMIT = 6.0  # a dot is bad so many robust standard deviations off
_CONDITION_MIN = 1e-14  # of the reduced normal matrix, its columns scaled
_SETTLED = 1e-10  # the share of the cost that a step must gain, else it was the last
_NEARLY_SETTLED = 1e-3  # with a loss, whose scale is to change anyway


@dataclass(frozen=True, eq=False)
class State:
    """What is adjusted: a camera, the poses (v,) of the target in its frame, the dots (n, 2) mm."""

    camera: Camera
    poses: Pose
    dots: Floats


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A state fitted to what was found in the views `rows` (v,) of those given.

    centers      (v, n, 2) px of each target dot in each view; weight (v, n, 2, 2) px^-2, 0: not used
    refine       whether the dots move
    plain        whether it is by least squares, of all dots that are used
    """

    rows: Ints
    centers: Floats
    weight: Floats
    state: State
    dots: Floats  # (n, 2) mm, as stated
    radius: float
    refine: bool
    settled: bool = False
    plain: bool = False

    @property
    def used(self) -> Bools:
        """(v, n)."""
        return np.asarray(self.weight.any(axis=(2, 3)))

    @property
    def moving(self) -> Bools:
        """(n,) the dots that are refined."""
        return np.asarray(self.used.any(axis=0) & self.refine)

    def residuals(self) -> Floats:
        """Found minus predicted, (v, n, 2) px; nan where a dot is not used."""
        off = self.centers - centers_of(self.state.dots, self.radius, self.state.camera, self.state.poses)
        return np.where(self.used[..., None], off, np.nan)

    def normalised(self) -> Floats:
        """The residuals' lengths (v, n) in stated standard deviations."""
        return np.sqrt(_squares(self.residuals(), self.weight))

    @property
    def scale(self) -> float:
        """The robust standard deviation of residuals, as a multiple of those stated."""
        return max(float(np.nanmedian(self.normalised())) / _MEDIAN, _SCALE_MIN)

    def basis(self) -> Floats:
        """(9 + 2n, k): steps of camera and dots that move the shared parameters."""
        intrinsic = np.eye(9 + 2 * len(self.dots))[:, :9]
        if not self.moving.any():
            return intrinsic
        x, y = (self.dots[self.moving] - self.dots[self.moving].mean(axis=0)).T
        one, zero = np.ones_like(x), np.zeros_like(x)
        alike = [np.stack(step, axis=1).ravel() for step in ((one, zero), (zero, one), (-y, x), (x, y))]
        free = np.zeros((len(intrinsic), len(alike[0]) - 4))
        free[9:][np.repeat(self.moving, 2)] = np.linalg.qr(np.stack(alike, axis=1), mode="complete")[0][:, 4:]
        return np.concatenate([intrinsic, free], axis=1)

    def only(self, keep: Bools) -> CameraFit:
        """Without the views (v,) that are not kept."""
        poses = Pose(self.state.poses.position[keep], self.state.poses.quaternion[keep])
        state, centers, weight = replace(self.state, poses=poses), self.centers[keep], self.weight[keep]
        return replace(self, state=state, rows=self.rows[keep], centers=centers, weight=weight)

    def without(self, bad: Bools) -> CameraFit:
        """Without the dots (v, n) that are bad and, when dots are refined, those that too few views then show."""
        weight = np.where(bad[..., None, None], 0.0, self.weight)
        if self.refine:
            rare = weight.any(axis=(2, 3)).sum(axis=0) < SIGHTINGS_MIN
            weight[:, rare] = 0.0
        return replace(self, weight=weight, plain=False)

    def adjusted(self, loss: float | None = None, steps: int = 50) -> CameraFit:
        """At a minimum of the cost nearby, if it settles there within `steps`.

        The cost is the sum of e^2 = r' weight r over the dots; with `loss` that of loss^2 log(1 + e^2 / loss^2), to
        which a dot far off adds little.
        """
        basis = self.basis()

        def at(state: State) -> CameraFit:
            return replace(self, state=state)

        def cost(state: State) -> float:
            off = at(state).residuals()
            if np.isnan(off[self.used]).any():
                return np.inf  # a dot that was seen would be behind the camera
            square = _squares(np.where(self.used[..., None], off, 0.0), self.weight)
            return float(square.sum() if loss is None else loss**2 * np.log1p(square / loss**2).sum())

        def moved(state: State, step: Floats) -> State | None:
            shared, own = basis @ step[: basis.shape[1]], step[basis.shape[1] :].reshape(-1, 6)
            try:
                camera = state.camera.with_numbers(state.camera.numbers + shared[:9])
            except InputError:
                return None
            turned = quaternion_product(quaternion_from_rotation_vector(own[:, 3:]), state.poses.quaternion)
            poses = Pose(state.poses.position + own[:, :3], normalised(turned))
            return State(camera, poses, state.dots + shared[9:].reshape(-1, 2))

        found = least_squares(
            lambda state: at(state).residuals(),
            lambda state: at(state).blocks(basis, loss),
            self.state,
            tolerance=_SETTLED if loss is None else _NEARLY_SETTLED,
            moved=moved,
            cost=cost,
            steps=steps,
        )
        return replace(self, state=found.at, settled=found.settled, plain=loss is None)

    def blocks(self, basis: Floats, loss: float | None = None) -> Blocks:
        """The normal equations of the cost (of its Gauss-Newton model, with `loss` reweighted)."""
        state, used, weight = self.state, self.used, self.weight
        prediction = predict(state.dots, self.radius, state.camera, state.poses, by_camera=True, by_dots=True)
        assert prediction.by_camera is not None
        assert prediction.by_dots is not None
        off = np.where(used[..., None], self.centers - prediction.centers, 0.0)
        if loss is not None:
            weight = weight / (1.0 + _squares(off, weight) / loss**2)[..., None, None]
        mask = used[..., None, None]
        pose, camera, dots = (
            np.where(mask, j, 0.0) for j in (prediction.by_pose, prediction.by_camera, prediction.by_dots)
        )
        by_pose, by_camera, by_dots = (np.swapaxes(j, -1, -2) @ weight for j in (pose, camera, dots))
        sides = [(w @ off[..., None])[..., 0] for w in (by_camera, by_dots, by_pose)]
        size, each = 9 + 2 * len(state.dots), np.arange(len(state.dots))
        shared, mixed = np.zeros((size, size)), np.zeros((len(used), 6, size))
        shared[:9, :9] = (by_camera @ camera).sum(axis=(0, 1))
        shared[:9, 9:] = np.moveaxis((by_camera @ dots).sum(axis=0), 0, 1).reshape(9, -1)
        shared[9:, :9] = shared[:9, 9:].T
        alone = np.zeros((len(each), 2, len(each), 2))
        alone[each, :, each, :] = (by_dots @ dots).sum(axis=0)
        shared[9:, 9:] = alone.reshape(size - 9, size - 9)
        mixed[:, :, :9] = (by_pose @ camera).sum(axis=1)
        mixed[:, :, 9:] = np.swapaxes(by_pose @ dots, 1, 2).reshape(len(used), 6, -1)
        side = np.concatenate([sides[0].sum(axis=(0, 1)), sides[1].sum(axis=0).ravel()])
        own = (by_pose @ pose).sum(axis=1)
        return Blocks(basis.T @ shared @ basis, basis.T @ side, mixed @ basis, own, sides[2].sum(axis=1))

    def covariance(self) -> Floats | None:
        """Of camera and dots (9 + 2n, 9 + 2n), by the stated covariances; None where the views leave it open."""
        basis = self.basis()
        try:
            matrix, _ = self.blocks(basis).reduced()
        except np.linalg.LinAlgError:
            return None
        scale = np.sqrt(np.diag(matrix))
        if not (scale > 0.0).all():
            return None
        values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
        if not values[0] > _CONDITION_MIN * values[-1]:
            return None
        half = basis @ (vectors / scale[:, None] / np.sqrt(values))
        full = half @ half.T
        return np.asarray(0.5 * (full + full.T))

    def excess(self) -> float:
        """The residuals' root mean square in stated standard deviations, degrees of freedom counted."""
        freedom = 2 * int(self.used.sum()) - 6 * len(self.rows) - self.basis().shape[1]
        return float(np.sqrt(np.nansum(self.normalised() ** 2) / max(freedom, 1)))


def _squares(off: Floats, weight: Floats) -> Floats:
    """r' weight r (v, n) of residuals (v, n, 2); nan stays nan."""
    return np.asarray(np.einsum("vni,vnij,vnj->vn", off, weight, off))


def robust_fit(fit: CameraFit) -> CameraFit:
    """The fit without the views and dots that do not belong."""
    fit = _robustly(fit.without(np.zeros(fit.used.shape, dtype=bool)))
    for _ in range(_ROUNDS):
        medians = np.nanmedian(fit.normalised(), axis=1) / _MEDIAN
        good = np.asarray(medians <= _VIEW_LIMIT * max(float(np.median(medians)), _SCALE_MIN))
        if good.all() or good.sum() < 2:
            break
        fit = _robustly(fit.only(good))
    for _ in range(_ROUNDS):  # the first time by the robust fit, which bad dots have hardly moved
        bad = fit.normalised() > _DOT_LIMIT * fit.scale
        seen = (fit.used & ~bad).sum(axis=1) >= DOTS_MIN
        if fit.plain and not bad.any() and seen.all():
            break
        fit = fit.without(bad).only(seen).adjusted()
    return fit


def _robustly(fit: CameraFit) -> CameraFit:
    """Adjusted with a loss whose scale follows the residuals."""
    last = np.inf
    for _ in range(_ROUNDS):
        scale = fit.scale
        if fit.settled and scale > 0.99 * last:
            break
        last = scale
        fit = fit.adjusted(_LOSS * scale, steps=10)
    return fit


# ------------------------------------------------------------------------------------------------------------------
# The camera from views: a start, the fit, and what it is worth.

_VIEWS_MIN = 3
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
    def used(self) -> npt.NDArray[np.bool_]:
        """(m,) whether the dot was used; one far off its place is not."""
        return np.asarray(np.isfinite(self.residuals).all(axis=1))

    @property
    def rms(self) -> float:
        """Of the used residuals, pixels per axis; nan without any."""
        return _rms(self.residuals)


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera from views of a target.

    covariance   (9, 9) of fx, fy, cx, cy, k1, k2, p1, p2, k3; from the stated covariances of the
                 centres, times scale^2 where that is above 1
    rms          of all used residuals, pixels per axis
    scale        of the residuals in stated standard deviations: their root mean square, degrees of freedom counted
    views        in the order given
    target       with refined dots, where that was asked for
    dot_errors   (n, 2) mm, standard errors of the refined dots; nan where a dot was not refined
    """

    camera: Camera
    covariance: Floats
    rms: float
    scale: float
    views: tuple[CalibratedView, ...]
    target: Target
    dot_errors: Floats

    @property
    def standard_errors(self) -> Floats:
        """(9,) of fx, fy, cx, cy (pixels), k1, k2, p1, p2, k3."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def record(self, provenance: dict[str, str] | None = None) -> CameraRecord:
        """What goes into camera.toml."""
        return CameraRecord(self.camera, self.covariance, self.rms, provenance or {})

    def __str__(self) -> str:
        used = sum(not view.reason for view in self.views)
        lines = [f"camera from {used} of {len(self.views)} views, RMS {self.rms:.4f} px per axis"]
        rows = zip(CAMERA_NUMBERS, self.camera.numbers, self.standard_errors, strict=True)
        lines += [f"  {name} = {value:.6g} +- {error:.2g}" for name, value, error in rows]
        lines += [f"  left out: {view.name}: {view.reason}" for view in self.views if view.reason]
        return "\n".join(lines)


def calibrate_camera(
    views: Sequence[TargetView],
    target: Target,
    size: tuple[int, int],
    *,
    refine_dots: bool = False,
) -> Calibration:
    """The camera that took `views` of a target, in images of `size` (width, height) pixels.

    Least squares in pixels, weighted with the stated covariances, over the camera's nine numbers and all poses; with
    `refine_dots` over the dots' places too, up to shift, turn and scale, which stay those of the target (a dot seen in
    fewer than three views stays where it is, and is not used). Views and dots that do not fit the others are left out,
    and said.

    Raises InputError for values that are no views, NotCalibratedError where the views do not determine the camera.
    """
    named = [view if view.name else view._replace(name=f"view {row}") for row, view in enumerate(views, start=1)]
    problems = [problem for view in named for problem in _view_problems(view, len(target.dots))]
    if min(size) < 1:
        problems.append(Problem("size", f"is {size}", "give the images' width and height in pixels"))
    if problems:
        raise InputError(problems)
    reasons: dict[int, str] = {}
    start = _start(named, target, size, refine_dots, reasons)
    fit = robust_fit(start)
    bad = set(start.rows.tolist()) - set(fit.rows.tolist())
    reasons.update(dict.fromkeys(bad, "its dots do not fit the other views: moved, blurred, or wrong numbers?"))
    _enough(len(fit.rows), reasons, named)
    scale, spread = fit.excess(), fit.covariance()
    if spread is None or not fit.settled:
        raise NotCalibratedError(f"the views leave the camera open: {_REMEDY}")
    spread *= max(scale, 1.0) ** 2
    of_camera = np.sqrt(np.diag(spread)[:4])
    if not of_camera.max() <= _ERROR_MAX * fit.state.camera.focal.mean():
        names = ", ".join(f"{n} +- {e:.3g} px" for n, e in zip(CAMERA_NUMBERS, of_camera, strict=False))
        raise NotCalibratedError(f"the views hardly determine the focal length and the centre ({names}): {_REMEDY}")
    return Calibration(
        camera=fit.state.camera,
        covariance=spread[:9, :9],
        rms=_rms(fit.residuals()),
        scale=scale,
        views=_results(named, fit, reasons),
        target=replace(target, dots=fit.state.dots) if refine_dots else target,
        dot_errors=np.where(fit.moving[:, None], np.sqrt(np.diag(spread)[9:]).reshape(-1, 2), np.nan),
    )


def _view_problems(view: TargetView, dots: int) -> list[Problem]:
    centers, covariance, numbers, name = view
    count = len(centers)
    if centers.shape != (count, 2) or covariance.shape != (count, 2, 2) or numbers.shape != (count,):
        return [Problem(name, "has other shapes than (m, 2), (m, 2, 2) and (m,)", "give a row for each found dot")]
    if not np.isfinite(centers).all() or not np.isfinite(covariance).all():
        return [Problem(name, "holds numbers that are not finite", "leave such dots out")]
    if count and not (np.linalg.eigvalsh(covariance)[:, 0] > 0.0).all():
        return [Problem(name, "has covariances that are not positive", "give variances in pixels^2")]
    whole = np.issubdtype(numbers.dtype, np.integer) or not count
    if not whole or (count and not (numbers.min() >= 0 and numbers.max() < dots)):
        return [Problem(name, "numbers dots that the target does not have", f"give whole numbers from 0 to {dots - 1}")]
    if len(np.unique(numbers)) < count:
        return [Problem(name, "gives a dot more than once", "give each dot of the target at most once")]
    return []


def _start(
    views: list[TargetView], target: Target, size: tuple[int, int], refine: bool, reasons: dict[int, str]
) -> CameraFit:
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
    camera = _first_camera([views[row] for row in rows], target, size)
    poses = [
        plane_poses(target.dots[view.numbers], camera.normalised(view.centers))[0]
        for view in map(views.__getitem__, rows)
    ]
    count = len(target.dots)
    centers, weight = np.zeros((len(rows), count, 2)), np.zeros((len(rows), count, 2, 2))
    for k, row in enumerate(rows):
        centers[k, views[row].numbers] = views[row].centers
        weight[k, views[row].numbers] = np.linalg.inv(views[row].covariance)
    stacked = Pose(np.stack([pose.position for pose in poses]), np.stack([pose.quaternion for pose in poses]))
    state = State(camera, stacked, target.dots)
    return CameraFit(np.array(rows), centers, weight, state, target.dots, target.radius, refine)


def _first_camera(views: list[TargetView], target: Target, size: tuple[int, int]) -> Camera:
    """From the views' homographies, with the principal point in the middle of the image; where these say nothing of fx
    and fy, or of one focal length for both, as long as the image."""
    points = [target.points[view.numbers].astype(np.float32) for view in views]
    centers = [view.centers.astype(np.float32) for view in views]
    center, side = 0.5 * (np.array(size) - 1.0), float(max(size))
    for aspect in (0.0, 1.0):
        focal = np.diag(opencv().initCameraMatrix2D(points, centers, size, aspect))[:2]
        if ((focal > _FOCAL_RANGE[0] * side) & (focal < _FOCAL_RANGE[1] * side)).all():
            break
    else:
        focal = np.array([side, side])
    return Camera(*size, focal, center, np.zeros(5))


def _enough(count: int, reasons: dict[int, str], views: list[TargetView]) -> None:
    if count >= _VIEWS_MIN and count >= (1.0 - _BAD_SHARE) * len(views):
        return
    said = "".join(f"\n  {views[row].name}: {reason}" for row, reason in sorted(reasons.items()))
    what = f"only {count} of {len(views)} views can be used" if views else "there are no views"
    raise NotCalibratedError(f"{what}; at least {_VIEWS_MIN} and half of those given are needed{said}")


def _results(views: list[TargetView], fit: CameraFit, reasons: dict[int, str]) -> tuple[CalibratedView, ...]:
    residuals = dict(zip(fit.rows.tolist(), fit.residuals(), strict=True))
    poses = fit.state.poses
    place = {row: i for i, row in enumerate(fit.rows.tolist())}
    out = []
    for row, view in enumerate(views):
        if row in place:
            pose = Pose(poses.position[place[row]], poses.quaternion[place[row]])
            out.append(CalibratedView(view.name, "", pose, residuals[row][view.numbers]))
        else:
            out.append(CalibratedView(view.name, reasons[row], None, np.full(view.centers.shape, np.nan)))
    return tuple(out)


def _rms(residuals: Floats) -> float:
    return float(np.sqrt(np.nanmean(residuals**2))) if np.isfinite(residuals).any() else float("nan")


# ------------------------------------------------------------------------------------------------------------------
# The camera from images of a target: dots, identification without a camera, calibration.

_FIRST = 4  # images that a rough camera is calibrated from

Image = str | os.PathLike[str] | npt.NDArray[Any]


@dataclass
class _Seen:
    """An image's dots, or the reason why there are none; and the view that was made of them last, or why not."""

    image: Image
    name: str
    reason: str = ""
    size: tuple[int, int] | None = None
    dots: Dots | None = None
    view: TargetView | None = None

    def observe(self, target: Target) -> None:
        try:
            if isinstance(self.image, str | os.PathLike):
                self.name = printable(self.image)
            pixels = _pixels(self.image)
            self.size = (pixels.shape[1], pixels.shape[0])
            if target.printed:
                self._show(*board_points(pixels, target))
            else:
                self.dots = observe_dots(pixels, bright=target.bright)
        except (UnreadableImageError, Unidentified) as error:
            self.reason = str(error)
        except InputError as error:
            self.reason = "; ".join(problem.what for problem in error.problems)

    def identify(self, target: Target, size: tuple[int, int], camera: Camera | None = None) -> None:
        if self.dots is None:
            return
        try:
            self._show(self.dots, identify(self.dots.centers, target, camera, size=size))
        except Unidentified as error:
            self.view, self.reason = None, str(error)

    def _show(self, dots: Dots, pairs: Identification) -> None:
        of_dot = dots.centers[pairs.found], dots.covariance[pairs.found]
        self.view, self.reason = TargetView(*of_dot, pairs.numbers.astype(np.intp), self.name), ""


def calibrate_from_images(images: Sequence[Image], target: Target, *, refine_dots: bool = False) -> Calibration:
    """The camera that took `images` of the target: files (PNG, JPEG, TIFF), or arrays as `observe_dots` takes them.

    See `calibrate_camera`. A few images are identified without a camera, all of them with the rough one that they give,
    and once more with the one that all give. The result has a view for each image; one that cannot be used is left out,
    and its view says why.

    Raises NotCalibratedError where the usable images do not determine the camera.
    """
    seen = [_Seen(image, f"image {i}") for i, image in enumerate(images, start=1)]
    for one in seen:
        one.observe(target)
    sizes = Counter(one.size for one in seen if one.size is not None)
    if not sizes:
        raise NotCalibratedError(f"there is no image that can be used{_reasons(seen)}")
    ((size, _),) = sizes.most_common(1)
    for one in seen:
        if one.size is not None and one.size != size:  # a camera's numbers belong to a size
            one.reason = "has {} x {} pixels, most have {} x {}".format(*one.size, *size)
            one.dots = one.view = None

    def calibrated(some: list[_Seen], refine: bool = False) -> Calibration:
        try:
            views = [one.view for one in some if one.view is not None]
            result = calibrate_camera(views, target, size, refine_dots=refine)
        except NotCalibratedError as error:
            raise NotCalibratedError(f"{error}{_reasons([one for one in some if one.view is None])}") from None
        used, nothing = iter(result.views), np.zeros((0, 2))
        every = (next(used) if o.view is not None else CalibratedView(o.name, o.reason, None, nothing) for o in some)
        return replace(result, views=tuple(every))

    camera, enough = None, _FIRST
    for count, one in enumerate(seen, start=1):  # the first images that give one: without a camera it takes its time
        one.identify(target, size)
        if count == len(seen):
            camera = calibrated(seen).camera
        elif one.view is not None and sum(some.view is not None for some in seen) == enough:
            try:
                camera = calibrated(seen[:count]).camera
                break
            except NotCalibratedError:
                enough *= 2
    for one in seen:
        if one.dots is not None:  # the target's dots under their own light (see `refitted`), where they are identified
            with suppress(Unidentified, UnreadableImageError):
                pairs = identify(one.dots.centers, target, camera)
                one.dots = refitted(_pixels(one.image), one.dots, pairs.found)
        one.identify(target, size, camera)
    first = calibrated(seen, refine_dots).camera
    for one in seen:
        one.identify(target, size, first)
    return calibrated(seen, refine_dots)


def _pixels(image: Image) -> npt.NDArray[Any]:
    return read_image(Path(image)) if isinstance(image, str | os.PathLike) else image


def _reasons(some: list[_Seen]) -> str:
    return "".join(f"\n  {one.name}: {one.reason}" for one in some)
