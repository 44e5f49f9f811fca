"""The camera from views of a target: everything adjusted together, with the unbiased model of where a dot is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import CpcalError, InputError, Problem
from cpcal.robot import Pose
from cpcal.vision.calibration.adjustment import Adjusted, State
from cpcal.vision.calibration.camera_fit import DOTS_MIN, CameraFit, covariance, excess, robust_fit
from cpcal.vision.calibration.start import first_camera, first_pose, homography_rms
from cpcal.vision.camera import CAMERA_NUMBERS, Camera
from cpcal.vision.files.camera_file import CameraRecord
from cpcal.vision.homography import fitted
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
