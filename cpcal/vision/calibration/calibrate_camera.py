"""The camera from views of a target: everything adjusted together, with the unbiased model of where a dot is seen."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import CpcalError, InputError, Problem, printable
from cpcal.common.values import Floats
from cpcal.robot import Pose
from cpcal.vision.calibration.adjustment import (
    DOTS_MIN,
    Adjusted,
    CameraFit,
    State,
    covariance,
    excess,
    first_camera,
    first_pose,
    homography_rms,
    robust_fit,
)
from cpcal.vision.camera import CAMERA_NUMBERS, Camera
from cpcal.vision.dots import Dots, observe_dots, refitted
from cpcal.vision.files.image_file import UnreadableImageError, read_image
from cpcal.vision.files.plate_and_camera import CameraRecord
from cpcal.vision.identify import Unidentified, identify
from cpcal.vision.projection import fitted
from cpcal.vision.target import Target

_VIEWS_MIN = 3
_HOMOGRAPHY_LIMIT = 0.02  # of the image's longer side: no lens bends a plane's dots so much, they are mistaken
_BAD_SHARE = 0.5  # of the views
_ERROR_MAX = 0.02  # the largest standard error of focal length and centre, as a share of the focal length
_REMEDY = "take 10 to 20 views with the target tilted by 20 to 30 degrees in different directions"
_DISTORTION = CAMERA_NUMBERS[4:]


class TargetView(NamedTuple):
    """The dots of one image.

    centers     (m, 2) pixels, of the conics through their contours
    covariance  (m, 2, 2) pixels^2
    numbers     (m,) which dot of the target each is
    name        for messages
    """

    centers: Floats
    covariance: Floats
    numbers: npt.NDArray[np.intp]
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

    covariance   (9, 9) of fx, fy, cx, cy, k1, k2, p1, p2, k3; zero where a number was held. From the stated covariances
                 of the centres, times scale^2 where that is above 1
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
    views: Sequence[TargetView | tuple[Floats, Floats, npt.NDArray[np.intp]]],
    target: Target,
    size: tuple[int, int],
    *,
    refine_dots: bool = False,
    fixed: Sequence[str] = (),
) -> Calibration:
    """The camera that took `views` of a target, in images of `size` (width, height) pixels.

    Least squares in pixels, weighted with the stated covariances, over the camera's nine numbers and all poses; with
    `refine_dots` over the dots' places too, up to shift, turn and scale, which stay those of the target (a dot seen in
    fewer than three views stays where it is, and is not used). `fixed` names coefficients of the distortion that are
    zero. Views and dots that do not fit the others are left out, and said.

    Raises InputError for values that are no views, NotCalibratedError where the views do not determine the camera.
    """
    named = [_named(row, view) for row, view in enumerate(views, start=1)]
    _check(named, target, size, fixed)
    reasons: dict[int, str] = {}
    free = np.array([name not in fixed for name in CAMERA_NUMBERS])
    start = _start(named, target, size, free, refine_dots, reasons)
    fit, bad = robust_fit(start)
    reasons.update(dict.fromkeys(bad, "its dots do not fit the other views: moved, blurred, or wrong numbers?"))
    _enough(len(fit.rows), reasons, named)
    scale = excess(fit)
    spread = covariance(fit)
    if spread is None or not fit.settled:
        raise NotCalibratedError(f"the views leave the camera open: {_REMEDY}")
    spread *= max(scale, 1.0) ** 2
    _determined(fit.state.camera, spread)
    errors = np.sqrt(np.diag(spread)[9:]).reshape(-1, 2)
    moved = fit.found.seen[:, None] & refine_dots
    return Calibration(
        camera=fit.state.camera,
        covariance=spread[:9, :9],
        rms=_rms(fit.residuals()),
        scale=scale,
        views=_results(named, fit, reasons),
        target=replace(target, dots=fit.state.dots) if refine_dots else target,
        dot_errors=np.where(moved, errors, np.nan),
    )


def _named(row: int, view: TargetView | tuple[Floats, Floats, npt.NDArray[np.intp]]) -> TargetView:
    centers, covariance, numbers, *name = view
    floats = [np.asarray(values, dtype=np.float64) for values in (centers, covariance)]
    return TargetView(floats[0], floats[1], np.asarray(numbers), str(name[0]) if name and name[0] else f"view {row}")


def _check(views: list[TargetView], target: Target, size: tuple[int, int], fixed: Sequence[str]) -> None:
    problems = [problem for view in views for problem in _view_problems(view, len(target.dots))]
    if min(size) < 1:
        problems.append(Problem("size", f"is {size}", "give the images' width and height in pixels"))
    for name in fixed:
        if name not in _DISTORTION:
            problems.append(Problem("fixed", f"{name!r} cannot be held", f"choose of {', '.join(_DISTORTION)}"))
    if problems:
        raise InputError(problems)


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
    views: list[TargetView],
    target: Target,
    size: tuple[int, int],
    free: npt.NDArray[np.bool_],
    refine: bool,
    reasons: dict[int, str],
) -> CameraFit:
    """Homographies and the closed form; adds to `reasons` for views that are of no use."""
    homographies = {}
    for row, view in enumerate(views):
        dots = target.dots[view.numbers]
        if len(dots) < DOTS_MIN or np.linalg.matrix_rank(dots - dots.mean(axis=0), tol=target.radius) < 2:
            reasons[row] = f"fewer than {DOTS_MIN} dots, or all of them on a line"
            continue
        homographies[row] = fitted(dots, view.centers)
        if homography_rms(homographies[row], dots, view.centers) > _HOMOGRAPHY_LIMIT * max(size):
            del homographies[row]
            reasons[row] = "its dots are not where those of a plane can be: wrong numbers?"
    _enough(len(homographies), reasons, views)
    camera = first_camera(np.stack(list(homographies.values())), size)
    poses = [first_pose(matrix, camera) for matrix in homographies.values()]
    stacked = Pose(np.stack([p.position for p in poses]), np.stack([p.quaternion for p in poses]))
    rows = np.array(list(homographies), dtype=np.intp)
    found = _arranged([views[row] for row in rows], len(target.dots))
    return CameraFit(
        rows=rows,
        found=found,
        state=State(camera, stacked, target.dots),
        dots=target.dots,
        radius=target.radius,
        free_camera=free,
        refine=refine,
    )


def _arranged(views: list[TargetView], dots: int) -> Adjusted:
    """Views (v) as arrays by the target's dots."""
    centers, weight = np.zeros((len(views), dots, 2)), np.zeros((len(views), dots, 2, 2))
    for row, view in enumerate(views):
        centers[row, view.numbers] = view.centers
        weight[row, view.numbers] = np.linalg.inv(view.covariance)
    return Adjusted(centers, weight)


def _enough(count: int, reasons: dict[int, str], views: list[TargetView]) -> None:
    if count >= _VIEWS_MIN and count >= (1.0 - _BAD_SHARE) * len(views):
        return
    said = "".join(f"\n  {views[row].name}: {reason}" for row, reason in sorted(reasons.items()))
    what = f"only {count} of {len(views)} views can be used" if views else "there are no views"
    raise NotCalibratedError(f"{what}; at least {_VIEWS_MIN} and half of those given are needed{said}")


def _determined(camera: Camera, spread: Floats) -> None:
    errors = np.sqrt(np.diag(spread)[:4])
    largest = float((errors / np.repeat(camera.focal.mean(), 4)).max())
    if not largest <= _ERROR_MAX:
        names = ", ".join(f"{n} +- {e:.3g} px" for n, e in zip(CAMERA_NUMBERS, errors, strict=False))
        raise NotCalibratedError(f"the views hardly determine the focal length and the centre ({names}): {_REMEDY}")


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

Size = tuple[int, int]

_FIRST = 4  # images that a rough camera is calibrated from


@dataclass(frozen=True)
class _Seen:
    """An image's dots, or the reason why there are none."""

    name: str
    reason: str = ""
    size: Size | None = None
    dots: Dots | None = None


def calibrate_from_images(
    images: Sequence[str | os.PathLike[str] | npt.NDArray[Any]],
    target: Target,
    *,
    refine_dots: bool = False,
    fixed: Sequence[str] = (),
) -> Calibration:
    """The camera that took `images` of the target: files (PNG, JPEG, TIFF), or arrays as `observe_dots` takes them.

    See `calibrate_camera`. A few images are identified without a camera, all of them with the rough one that they give,
    and once more with the one that all give. The result has a view for each image; one that cannot be used is left out,
    and its view says why.

    Raises InputError for a `fixed` that cannot be, NotCalibratedError where the usable images do not determine the
    camera.
    """
    seen = _of_one_size([_seen(image, target, f"image {i}") for i, image in enumerate(images, start=1)])
    rough = _Job(seen, target, fixed).rough()
    seen = [_refitted(image, one, target, rough.camera) for image, one in zip(images, seen, strict=True)]
    job = _Job(seen, target, fixed)
    first = job.calibrated(job.identified(range(len(seen)), rough.camera), refine_dots)
    return job.calibrated(job.identified(range(len(seen)), first.camera), refine_dots)


def _seen(image: str | os.PathLike[str] | npt.NDArray[Any], target: Target, name: str) -> _Seen:
    try:
        if isinstance(image, (str, os.PathLike)):
            name = printable(image)
        pixels = _pixels(image)
        dots = observe_dots(pixels, bright=target.bright)
    except UnreadableImageError as error:
        return _Seen(name, str(error))
    except InputError as error:
        return _Seen(name, "; ".join(problem.what for problem in error.problems))
    return _Seen(name, size=(pixels.shape[1], pixels.shape[0]), dots=dots)


def _pixels(image: str | os.PathLike[str] | npt.NDArray[Any]) -> npt.NDArray[Any]:
    return read_image(Path(image)) if isinstance(image, (str, os.PathLike)) else image


def _refitted(image: str | os.PathLike[str] | npt.NDArray[Any], seen: _Seen, target: Target, camera: Camera) -> _Seen:
    """With the target's dots under their own light (see `refitted`), where they are identified."""
    if seen.reason or seen.dots is None:
        return seen
    try:
        pairs = identify(seen.dots.centers, target, camera)
        return replace(seen, dots=refitted(_pixels(image), seen.dots, pairs.found))
    except (Unidentified, UnreadableImageError):
        return seen


def _of_one_size(seen: list[_Seen]) -> list[_Seen]:
    """Those of another size than most are left out: a camera's numbers belong to a size."""
    sizes = Counter(image.size for image in seen if image.size is not None)
    if not sizes:
        said = "".join(f"\n  {image.name}: {image.reason}" for image in seen)
        raise NotCalibratedError(f"there is no image that can be used{said}")
    (usual, _), *_ = sizes.most_common(1)
    return [
        replace(image, reason="has {} x {} pixels, most have {} x {}".format(*image.size, *usual), size=usual)
        if image.size is not None and image.size != usual
        else image
        for image in seen
    ]


@dataclass(frozen=True)
class _Identified:
    """Views by the rows of their images, and why other images have none."""

    views: dict[int, TargetView]
    reasons: dict[int, str]


class _Job:
    """Identification and calibration of images of one size."""

    def __init__(self, seen: list[_Seen], target: Target, fixed: Sequence[str]) -> None:
        self.seen, self.target, self.fixed = seen, target, fixed
        self.size: Size = next(image.size for image in seen if image.size is not None)

    def rough(self) -> Calibration:
        """From the first images that give one: without a camera identification takes its time."""
        got = _Identified({}, {})
        enough = _FIRST
        for row in range(len(self.seen)):
            more = self.identified([row], None)
            got.views.update(more.views)
            got.reasons.update(more.reasons)
            if more.views and len(got.views) == enough and row + 1 < len(self.seen):
                try:
                    return self.calibrated(got, False)
                except NotCalibratedError:
                    enough *= 2
        return self.calibrated(got, False)

    def identified(self, rows: Iterable[int], camera: Camera | None) -> _Identified:
        got = _Identified({}, {})
        for row in rows:
            image = self.seen[row]
            if image.reason or image.dots is None:
                got.reasons[row] = image.reason
                continue
            try:
                pairs = identify(image.dots.centers, self.target, camera, size=self.size)
            except Unidentified as error:
                got.reasons[row] = str(error)
                continue
            of_dot = image.dots.centers[pairs.found], image.dots.covariance[pairs.found]
            got.views[row] = TargetView(*of_dot, pairs.numbers.astype(np.intp), image.name)
        return got

    def calibrated(self, got: _Identified, refine_dots: bool) -> Calibration:
        views = list(got.views.values())
        try:
            result = calibrate_camera(views, self.target, self.size, refine_dots=refine_dots, fixed=self.fixed)
        except NotCalibratedError as error:
            said = "".join(f"\n  {self.seen[row].name}: {reason}" for row, reason in sorted(got.reasons.items()))
            raise NotCalibratedError(f"{error}{said}") from None
        used = dict(zip(got.views, result.views, strict=True))
        nothing = np.zeros((0, 2))
        every = (
            used[row] if row in used else CalibratedView(image.name, got.reasons.get(row, ""), None, nothing)
            for row, image in enumerate(self.seen)
        )
        return replace(result, views=tuple(every))
