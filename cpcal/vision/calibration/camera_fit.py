"""From a start to a fit that views and dots which do not belong have no say in."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.robot import Pose
from cpcal.vision.calibration.adjustment import Adjusted, Free, State, adjusted, normal_equations, residuals, squares

DOTS_MIN = 8  # in a view
SIGHTINGS_MIN = 3  # of a dot that is refined

_ROUNDS = 12  # of the robust adjustment, and of leaving out
_LOSS = 3.0  # robust standard deviations
_MEDIAN = 1.1774  # of the length of a pair of standard normal numbers
_SCALE_MIN = 0.01  # of the stated standard deviations: nothing is judged by less
_VIEW_LIMIT = 5.0  # a view is bad whose median residual is so many times that of all
_DOT_LIMIT = 6.0  # a dot is bad so many robust standard deviations off
_CONDITION_MIN = 1e-14  # of the reduced normal matrix, its columns scaled


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A state fitted to what was found in the views `rows` (v,) of those given.

    free_camera  (9,) which of the camera's numbers move
    refine       whether the dots move
    """

    rows: npt.NDArray[np.intp]
    found: Adjusted
    state: State
    dots: Floats  # (n, 2) mm, as stated
    radius: float
    free_camera: npt.NDArray[np.bool_]
    refine: bool
    settled: bool = False
    plain: bool = False  # whether by least squares, and of all dots that are used

    def residuals(self) -> Floats:
        """(v, n, 2) pixels, nan where a dot is not used."""
        return residuals(self.state, self.found, self.radius)

    def normalised(self) -> Floats:
        """The residuals' lengths (v, n) in stated standard deviations."""
        return np.sqrt(squares(self.residuals(), self.found.weight))

    def free(self) -> Free:
        moving = self.found.seen if self.refine else np.zeros(len(self.dots), dtype=bool)
        return Free.of(self.free_camera, self.dots, moving)

    def only(self, keep: npt.NDArray[np.bool_]) -> CameraFit:
        """Without the views (v,) that are not kept."""
        poses = Pose(self.state.poses.position[keep], self.state.poses.quaternion[keep])
        found = Adjusted(self.found.centers[keep], self.found.weight[keep])
        return replace(self, rows=self.rows[keep], found=found, state=replace(self.state, poses=poses))

    def without(self, bad: npt.NDArray[np.bool_]) -> CameraFit:
        """Without the dots (v, n) that are bad and, when dots are refined, those that too few views then show."""
        weight = np.where(bad[..., None, None], 0.0, self.found.weight)
        if self.refine:
            rare = weight.any(axis=(2, 3)).sum(axis=0) < SIGHTINGS_MIN
            weight[:, rare] = 0.0
        return replace(self, found=replace(self.found, weight=weight), plain=False)

    def adjusted(self, loss: float | None = None, steps: int = 50) -> CameraFit:
        state, settled = adjusted(self.state, self.found, self.radius, self.free(), loss=loss, steps=steps)
        return replace(self, state=state, settled=settled, plain=loss is None)


def robust_fit(fit: CameraFit) -> tuple[CameraFit, list[int]]:
    """The fit without what does not belong, and which rows were left out."""
    everything = fit.rows
    fit = _robustly(fit.without(np.zeros(fit.found.used.shape, dtype=bool)))
    for _ in range(_ROUNDS):
        good = _good_views(fit)
        if good.all() or good.sum() < 2:
            break
        fit = _robustly(fit.only(good))
    for _ in range(_ROUNDS):  # the first time by the robust fit, which bad dots have hardly moved
        length = fit.normalised()
        bad = length > _DOT_LIMIT * _scale(length)
        seen = (fit.found.used & ~bad).sum(axis=1) >= DOTS_MIN
        if fit.plain and not bad.any() and seen.all():
            break
        fit = fit.without(bad).only(seen).adjusted()
    return fit, sorted(set(everything.tolist()) - set(fit.rows.tolist()))


def covariance(fit: CameraFit) -> Floats | None:
    """Of camera and dots (9 + 2n, 9 + 2n), by the stated covariances; None where the views leave it open."""
    free = fit.free()
    normal = normal_equations(fit.state, fit.found, fit.radius)
    try:
        matrix, _ = normal.reduced(free)
    except np.linalg.LinAlgError:
        return None
    scale = np.sqrt(np.diag(matrix))
    if not (scale > 0.0).all():
        return None
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    if not values[0] > _CONDITION_MIN * values[-1]:
        return None
    half = free.basis @ (vectors / scale[:, None] / np.sqrt(values))
    full = half @ half.T
    return np.asarray(0.5 * (full + full.T))


def excess(fit: CameraFit) -> float:
    """The residuals' root mean square in stated standard deviations, degrees of freedom counted."""
    freedom = 2 * int(fit.found.used.sum()) - 6 * len(fit.rows) - fit.free().basis.shape[1]
    return float(np.sqrt(np.nansum(fit.normalised() ** 2) / max(freedom, 1)))


def _robustly(fit: CameraFit) -> CameraFit:
    """Adjusted with a loss whose scale follows the residuals."""
    last = np.inf
    for _ in range(_ROUNDS):
        scale = _scale(fit.normalised())
        if fit.settled and scale > 0.99 * last:
            break
        last = scale
        fit = fit.adjusted(_LOSS * scale, steps=10)
    return fit


def _scale(length: Floats) -> float:
    """The robust standard deviation of residuals, as a multiple of those stated."""
    return max(float(np.nanmedian(length)) / _MEDIAN, _SCALE_MIN)


def _good_views(fit: CameraFit) -> npt.NDArray[np.bool_]:
    length = fit.normalised()
    medians = np.nanmedian(length, axis=1) / _MEDIAN
    return np.asarray(medians <= _VIEW_LIMIT * max(float(np.median(medians)), _SCALE_MIN))
