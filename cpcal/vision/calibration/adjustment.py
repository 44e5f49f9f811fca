"""Bundle adjustment: one camera, one target and the poses of all views, so that predicted centres fit found ones.

Levenberg-Marquardt on the normal equations. With s the shared parameters (camera and dots) and p those of the poses,

    [ A  B' ] [ds]   [a]         S = A - sum_v B_v' C_v^-1 B_v
    [ B  C  ] [dp] = [c]         S ds = a - sum_v B_v' C_v^-1 c_v,   dp_v = C_v^-1 (c_v - B_v ds)

where C is block-diagonal (6 x 6 a view), so that time grows with the number of views and no faster. Dots are refined
up to the similarity that no image can tell: corrections are orthogonal to shifts, turn and scale of the stated dots.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError
from cpcal.common.values import Floats
from cpcal.robot import Pose, normalised, quaternion_from_matrix, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.camera import Camera
from cpcal.vision.projection import centers_of, mapped, predict

# ------------------------------------------------------------------------------------------------------------------
# Where a camera calibration starts: homographies, and Zhang's closed form for the focal lengths and the poses.
#
# A homography H = K [r1 r2 p] takes the target's plane to undistorted pixels. With the principal point in the middle of
# the image, r1.r2 = 0 and |r1| = |r2| are two linear equations a view in (1 / fx^2, 1 / fy^2).

_FOCAL_RANGE = (0.2, 20.0)  # of the image's longer side: else the equations say nothing


def homography_rms(matrix: Floats, dots: Floats, centers: Floats) -> float:
    """How far, in pixels per axis, a homography (3, 3) is from taking dots (m, 2) to centers (m, 2)."""
    off = mapped(matrix, dots) - centers
    return float(np.sqrt(np.mean(off**2))) if np.isfinite(off).all() else np.inf


def first_camera(homographies: Floats, size: tuple[int, int]) -> Camera:
    """A pinhole camera without distortion for images of `size` (width, height), from homographies (v, 3, 3)."""
    width, height = size
    center = np.array([0.5 * (width - 1), 0.5 * (height - 1)])
    unit = float(max(size))
    shift = np.array([[1.0, 0.0, -center[0]], [0.0, 1.0, -center[1]], [0.0, 0.0, unit]]) / unit
    h = shift @ homographies
    h = h / np.linalg.norm(h, axis=(1, 2), keepdims=True)
    one, two = h[..., 0], h[..., 1]
    left = np.concatenate([one * two, one * one - two * two])
    focal = _focal(left[:, :2], -left[:, 2]) or _focal(left[:, :2].sum(axis=1, keepdims=True), -left[:, 2]) or (1.0,)
    return Camera(width, height, unit * np.resize(focal, 2), center, np.zeros(5))


def first_pose(matrix: Floats, camera: Camera) -> Pose:
    """The pose of the target in the frame of a camera without distortion, from its homography."""
    k = np.array([[camera.focal[0], 0, camera.center[0]], [0, camera.focal[1], camera.center[1]], [0, 0, 1.0]])
    columns = np.linalg.solve(k, matrix)
    scale = 2.0 / (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1]))
    columns = columns * (scale if columns[2, 2] > 0.0 else -scale)
    u, _, v = np.linalg.svd(columns[:, :2], full_matrices=False)
    x, y = (u @ v).T
    return Pose(columns[:, 2], quaternion_from_matrix(np.stack([x, y, np.cross(x, y)], axis=1)))


def _focal(left: Floats, right: Floats) -> tuple[float, ...] | None:
    inverse_squares = np.linalg.lstsq(left, right, rcond=None)[0]
    if not (inverse_squares > 0.0).all():
        return None
    focal = inverse_squares**-0.5
    inside = (focal > _FOCAL_RANGE[0]) & (focal < _FOCAL_RANGE[1])
    return tuple(focal.tolist()) if inside.all() else None


# ------------------------------------------------------------------------------------------------------------------
# From a start to a fit that views and dots which do not belong have no say in.

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


_DAMPING = 1e-4  # at first, of the diagonal
_DAMPING_MAX = 1e12
_SETTLED = 1e-10  # the share of the cost that a step must gain, else it was the last
_NEARLY_SETTLED = 1e-3  # with a loss, whose scale is to change anyway


@dataclass(frozen=True, eq=False)
class Adjusted:
    """What was found: centers (v, n, 2) px of each target dot in each view; weight (v, n, 2, 2) px^-2, 0: not used."""

    centers: Floats
    weight: Floats

    @property
    def used(self) -> npt.NDArray[np.bool_]:
        """(v, n)."""
        return np.asarray(self.weight.any(axis=(2, 3)))

    @property
    def seen(self) -> npt.NDArray[np.bool_]:
        """(n,) the dots that are used in some view."""
        return np.asarray(self.weight.any(axis=(0, 2, 3)))


@dataclass(frozen=True, eq=False)
class State:
    """What is adjusted: a camera, the poses (v,) of the target in its frame, the dots (n, 2) mm."""

    camera: Camera
    poses: Pose
    dots: Floats


@dataclass(frozen=True, eq=False)
class Free:
    """Which of the shared parameters move: `basis` (9 + 2n, k), whose columns are steps of camera and dots."""

    basis: Floats

    @classmethod
    def of(cls, camera: npt.NDArray[np.bool_], dots: Floats, moving: npt.NDArray[np.bool_]) -> Free:
        """`camera` (9,) which of its numbers move; `moving` (n,) which dots do."""
        intrinsic = np.eye(9)[:, camera]
        basis = np.zeros((9 + 2 * len(dots), 0))
        if moving.any():
            own = np.repeat(moving, 2)
            generators = _similarities(dots[moving])
            complement = np.linalg.qr(generators, mode="complete")[0][:, generators.shape[1] :]
            basis = np.zeros((len(own) + 9, complement.shape[1]))
            basis[9:][own] = complement
        left = np.concatenate([intrinsic, np.zeros((2 * len(dots), intrinsic.shape[1]))])
        return cls(np.concatenate([left, basis], axis=1))


@dataclass(frozen=True, eq=False)
class Normal:
    """The normal equations at a state."""

    cost: float
    shared: Floats  # A (s, s)
    shared_side: Floats  # a (s,)
    mixed: Floats  # B (v, 6, s)
    poses: Floats  # C (v, 6, 6)
    poses_side: Floats  # c (v, 6)

    def reduced(self, free: Free, damping: float = 0.0) -> tuple[Floats, Floats]:
        """S (k, k) and its right side (k,), on the parameters that move."""
        damped = self.poses + damping * self.poses * np.eye(6)
        solved = np.linalg.solve(damped, np.concatenate([self.mixed, self.poses_side[..., None]], axis=2))
        size = len(self.shared)
        eliminated = self.mixed.reshape(-1, size).T @ solved.reshape(-1, size + 1)
        matrix = self.shared + damping * np.diag(np.diag(self.shared)) - eliminated[:, :-1]
        side = self.shared_side - eliminated[:, -1]
        return free.basis.T @ matrix @ free.basis, free.basis.T @ side


def adjusted(
    state: State, found: Adjusted, radius: float, free: Free, *, loss: float | None = None, steps: int = 50
) -> tuple[State, bool]:
    """The state at a minimum of the cost nearby, and whether it has settled there within `steps`.

    The cost is the sum of e^2 = r' weight r over the dots; with `loss` that of loss^2 log(1 + e^2 / loss^2), to which a
    dot far off adds little.
    """
    damping = _DAMPING
    normal = normal_equations(state, found, radius, loss)
    for _ in range(steps):
        while True:
            trial = _moved(state, normal, free, damping)
            cost = np.inf if trial is None else _cost(trial, found, radius, loss)
            if cost <= normal.cost or damping > _DAMPING_MAX:
                break
            damping *= 10.0
        if trial is None or not cost <= normal.cost:
            return state, True  # no direction leads down
        gained = normal.cost - cost
        state, damping = trial, max(damping * 0.1, 1e-12)
        if gained <= (_SETTLED if loss is None else _NEARLY_SETTLED) * normal.cost + 1e-15:
            return state, True
        normal = normal_equations(state, found, radius, loss)
    return state, False


def residuals(state: State, found: Adjusted, radius: float) -> Floats:
    """Found minus predicted, (v, n, 2) px; nan where a dot is not used."""
    off = found.centers - centers_of(state.dots, radius, state.camera, state.poses)
    return np.where(found.used[..., None], off, np.nan)


def squares(off: Floats, weight: Floats) -> Floats:
    """r' weight r (v, n) of residuals (v, n, 2); nan stays nan."""
    return np.asarray(np.einsum("vni,vnij,vnj->vn", off, weight, off))


def normal_equations(state: State, found: Adjusted, radius: float, loss: float | None = None) -> Normal:
    """The normal equations of the cost (of its Gauss-Newton model, with `loss` reweighted) at a state."""
    used = found.used
    prediction = predict(state.dots, radius, state.camera, state.poses, by_camera=True, by_dots=True)
    assert prediction.by_camera is not None
    assert prediction.by_dots is not None
    off = np.where(used[..., None], found.centers - prediction.centers, 0.0)
    square = squares(off, found.weight)
    weight = found.weight
    if loss is not None:
        weight = weight / (1.0 + square / loss**2)[..., None, None]
    mask = used[..., None, None]
    pose, camera, dots = (
        np.where(mask, j, 0.0) for j in (prediction.by_pose, prediction.by_camera, prediction.by_dots)
    )
    weighted = [np.swapaxes(j, -1, -2) @ weight for j in (pose, camera, dots)]  # (v, n, parameters, 2)
    sides = [(w @ off[..., None])[..., 0] for w in weighted]
    size = 9 + 2 * len(state.dots)
    shared, mixed = np.zeros((size, size)), np.zeros((len(used), 6, size))
    shared[:9, :9] = (weighted[1] @ camera).sum(axis=(0, 1))
    shared[:9, 9:] = np.moveaxis((weighted[1] @ dots).sum(axis=0), 0, 1).reshape(9, -1)
    shared[9:, :9] = shared[:9, 9:].T
    each = np.arange(len(state.dots))
    blocks = np.zeros((len(each), 2, len(each), 2))
    blocks[each, :, each, :] = (weighted[2] @ dots).sum(axis=0)
    shared[9:, 9:] = blocks.reshape(size - 9, size - 9)
    mixed[:, :, :9] = (weighted[0] @ camera).sum(axis=1)
    mixed[:, :, 9:] = np.swapaxes(weighted[0] @ dots, 1, 2).reshape(len(used), 6, -1)
    return Normal(
        _total(square, loss),
        shared,
        np.concatenate([sides[1].sum(axis=(0, 1)), sides[2].sum(axis=0).ravel()]),
        mixed,
        (weighted[0] @ pose).sum(axis=1),
        sides[0].sum(axis=1),
    )


def _cost(state: State, found: Adjusted, radius: float, loss: float | None) -> float:
    off = residuals(state, found, radius)
    if np.isnan(off[found.used]).any():
        return np.inf  # a dot that was seen would be behind the camera
    return _total(squares(np.where(found.used[..., None], off, 0.0), found.weight), loss)


def _total(square: Floats, loss: float | None) -> float:
    return float(square.sum() if loss is None else loss**2 * np.log1p(square / loss**2).sum())


def _moved(state: State, normal: Normal, free: Free, damping: float) -> State | None:
    """The state after a damped step; None where there is no such step, or it makes no camera."""
    matrix, side = normal.reduced(free, damping)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(np.float64).tiny))
    try:
        step = free.basis @ (scale * np.linalg.solve(matrix * scale[:, None] * scale, side * scale))
        damped = normal.poses + damping * normal.poses * np.eye(6)
        turn = np.linalg.solve(damped, (normal.poses_side - normal.mixed @ step)[..., None])[..., 0]
        camera = state.camera.with_numbers(state.camera.numbers + step[:9])
    except (np.linalg.LinAlgError, InputError):
        return None
    quaternion = quaternion_product(quaternion_from_rotation_vector(turn[:, 3:]), state.poses.quaternion)
    poses = Pose(state.poses.position + turn[:, :3], normalised(quaternion))
    return State(camera, poses, state.dots + step[9:].reshape(-1, 2))


def _similarities(dots: Floats) -> Floats:
    """Steps (2n, 4) of dots (n, 2) that shift, turn or scale them all."""
    x, y = dots[:, 0] - dots[:, 0].mean(), dots[:, 1] - dots[:, 1].mean()
    one, zero = np.ones_like(x), np.zeros_like(x)
    steps = [(one, zero), (zero, one), (-y, x), (x, y)]
    return np.stack([np.stack(step, axis=1).ravel() for step in steps], axis=1)
