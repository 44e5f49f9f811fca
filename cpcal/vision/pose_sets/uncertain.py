"""What is known of camera and target beforehand, as sets: the camera's numbers, the places of the target's dots.

The camera's nine numbers are `center + spread @ t`, the same t in every image, with |t_j| <= 1 (intervals, or a box in
any directions) or |t| <= 1 (an ellipsoid, such as a calibration's). Each dot is at its place plus an error of its own,
in a box. No distribution is assumed; that the true numbers are in these sets is stated, not proved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats, Value, frozen_array
from cpcal.solver.interval import IntervalArray
from cpcal.vision.camera import BROWN, CAMERA_NUMBERS, Camera
from cpcal.vision.pose_sets.enclosed import ENGINE, exact, stacked
from cpcal.vision.target import Target

LARGEST_SCALE = 0.1  # of a plate's error, as a share
_COUNT = len(CAMERA_NUMBERS)


@dataclass(frozen=True, eq=False)
class CameraSet(Value):
    """Cameras whose numbers fx, fy, cx, cy, k1, k2, p1, p2, k3 are those of `camera` plus `spread @ t`.

    spread  (9, k), in each number's unit; k = 0: this camera alone
    ball    whether t is in the unit ball; else in the unit cube

    Raises InputError for another lens model, or a spread that is none.
    """

    camera: Camera
    spread: Floats = field(default_factory=lambda: np.zeros((_COUNT, 0)))
    ball: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "spread", frozen_array(self.spread))
        problems = []
        if self.camera.model != BROWN:
            what = f"has a lens of the model {self.camera.model}"
            problems.append(Problem("camera", what, f"pose sets are proved for the model {BROWN}: calibrate with it"))
        if self.spread.ndim != 2 or len(self.spread) != _COUNT or not np.isfinite(self.spread).all():
            what = f"has the shape {self.spread.shape}, or a number that is not finite"
            problems.append(Problem("camera spread", what, f"give (9, k), of {', '.join(CAMERA_NUMBERS)}"))
        if problems:
            raise InputError(problems)
        if not (self.camera.focal > self.reach[:2]).all():
            raise InputError([Problem("camera spread", "allows a focal length of zero", "give a narrower set")])

    @classmethod
    def of(cls, camera: Camera | CameraSet) -> CameraSet:
        """An exact camera, or the set that is given."""
        return camera if isinstance(camera, CameraSet) else cls(camera)

    @classmethod
    def intervals(cls, camera: Camera, half_widths: npt.ArrayLike) -> CameraSet:
        """Each number by itself within (9,) half-widths >= 0. Raises InputError."""
        widths = np.asarray(half_widths, dtype=np.float64)
        if widths.shape != (_COUNT,) or not (np.isfinite(widths) & (widths >= 0.0)).all():
            remedy = f"give nine numbers >= 0, of {', '.join(CAMERA_NUMBERS)}"
            raise InputError([Problem("camera half-widths", f"are {widths.tolist()}", remedy)])
        return cls(camera, np.diag(widths)[:, widths > 0.0])

    @classmethod
    def ellipsoid(cls, camera: Camera, covariance: Floats, factor: float) -> CameraSet:
        """All numbers whose Mahalanobis distance from the camera's is at most `factor`: (9, 9) covariance.

        A factor of 5 holds the truth of a calibration with honest covariance in 99.7 % of all cases (chi-square, nine
        degrees of freedom: 5.0 is the root of 25.3). Raises InputError.
        """
        matrix = np.asarray(covariance, dtype=np.float64)
        if matrix.shape != (_COUNT, _COUNT) or not np.isfinite(matrix).all() or not 0.0 < factor < np.inf:
            remedy = "give (9, 9), as `cpcal image detect --calibrate` writes it, and a factor > 0"
            raise InputError([Problem("camera covariance", f"has the shape {matrix.shape}, factor {factor}", remedy)])
        scale = np.sqrt(np.maximum(np.diagonal(matrix), 0.0))
        safe = np.where(scale > 0.0, scale, 1.0)
        values, vectors = np.linalg.eigh(matrix / np.outer(safe, safe))
        held = values > 1e-12 * values[-1]
        return cls(camera, factor * safe[:, None] * vectors[:, held] * np.sqrt(values[held]), ball=True)

    @property
    def size(self) -> int:
        """How many unknowns t there are."""
        return int(self.spread.shape[1])

    def most(self, rows: IntervalArray) -> IntervalArray:
        """The largest value of `rows @ t` over all t, enclosed: rows (..., k)."""
        size = exact(rows.mag)
        return ENGINE.sqrt(ENGINE.sum(ENGINE.sqr(size), -1)) if self.ball else ENGINE.sum(size, -1)

    @property
    def reach(self) -> Floats:
        """(9,) how far each number may be off, at most."""
        return np.asarray(self.most(exact(self.spread)).hi)

    @property
    def numbers(self) -> IntervalArray:
        """(9,) bounds of the numbers."""
        return IntervalArray.around(self.camera.numbers, self.reach)


@dataclass(frozen=True, eq=False)
class TargetSet(Value):
    """Targets whose dot i is within `half_widths[i]` of its place: (n, 3) mm along x, y and z of the target.

    scale  the plate as a whole, dots' radius included, is 1 + tau times such a one, |tau| <= scale: as a print shrinks

    Raises InputError for half-widths or a scale that are none.
    """

    target: Target
    half_widths: Floats
    scale: float = 0.0

    def __post_init__(self) -> None:
        widths, shape = frozen_array(self.half_widths), (len(self.target.dots), 3)
        if widths.shape != shape:
            what = f"have the shape {widths.shape}"
            raise InputError([Problem("target half-widths", what, f"give one number, (3,) or {shape}, mm")])
        if not (np.isfinite(widths) & (widths >= 0.0)).all():
            raise InputError([Problem("target half-widths", "are negative or not finite", "give mm >= 0")])
        if not 0.0 <= self.scale <= LARGEST_SCALE:
            what = f"is {self.scale}"
            raise InputError([Problem("target scale", what, f"give a share from 0 to {LARGEST_SCALE:g}")])
        object.__setattr__(self, "half_widths", widths)

    @classmethod
    def of(cls, target: Target | TargetSet) -> TargetSet:
        """An exact target, or the set that is given."""
        return target if isinstance(target, TargetSet) else cls.within(target, 0.0)

    @classmethod
    def within(cls, target: Target, half_widths: npt.ArrayLike, scale: float = 0.0) -> TargetSet:
        """One half-width, or one for each coordinate (3,), for all dots; or (n, 3). Raises InputError."""
        widths = np.asarray(half_widths, dtype=np.float64)
        alike = widths.ndim == 0 or widths.shape == (3,)
        each = np.tile(widths * np.ones(3), (len(target.dots), 1)) if alike else widths
        return cls(target, each, float(scale))


# ------------------------------------------------------------------------------------------------------------------
# Enclosures of the lens on boxes of directions, for all cameras of a set: d(x, y), its slopes and its curvatures.
#
# The lens of the model "brown" is d = (x, y) g(r^2) + t (see `lens_models`), the gradient of a potential: its
# Jacobian is
# symmetric, its second derivatives are symmetric in all three indices. All are linear in k1, k2, p1, p2, k3, so that
# over
# a set of cameras they are what they are for its centre, and a linear form in t: errors of these numbers that go
# together, as those of a calibration do, are not taken one by one.

_STRAIGHT = np.array([1.0, 1.0, *np.zeros(7)])  # a camera without distortion
_UNITS = _STRAIGHT + np.eye(9)[4:]
_TWO, _THREE, _FOUR, _SIX = (exact(float(k)) for k in (2, 3, 4, 6))


def product(*factors: IntervalArray) -> IntervalArray:
    out = factors[0]
    for factor in factors[1:]:
        out = ENGINE.mul(out, factor)
    return out


def total(parts: Sequence[IntervalArray]) -> IntervalArray:
    out = parts[0]
    for part in parts[1:]:
        out = ENGINE.add(out, part)
    return out


@dataclass(frozen=True)
class LensBounds:
    """On boxes (...,): d (..., 2); slopes (..., 3), of the first component by x, of it by y (the same as of the second
    by x), of the second by y."""

    value: IntervalArray
    slopes: IntervalArray

    @property
    def jacobian(self) -> IntervalArray:
        """(..., 2, 2)"""
        s = self.slopes
        return stacked([stacked([s[..., 0], s[..., 1]]), stacked([s[..., 1], s[..., 2]])], axis=-2)

    @property
    def least_slope(self) -> IntervalArray:
        """(...,) whose lower bound no eigenvalue of a Jacobian is below (Gershgorin)."""
        s, e = self.slopes, ENGINE
        off = exact(s[..., 1].mag)
        a, b = e.sub(s[..., 0], off), e.sub(s[..., 2], off)
        return IntervalArray(np.minimum(a.lo, b.lo), np.minimum(a.hi, b.hi))


def lens_over(x: IntervalArray, cameras: CameraSet) -> LensBounds:
    """Of boxes of directions x (..., 2), for all cameras of a set. `value` is meant for boxes that are points."""
    at = lens_bounds(x, exact(cameras.camera.numbers))
    if not cameras.size:
        return at
    units = [lens_bounds(x, exact(unit)) for unit in _UNITS]
    e, plain = ENGINE, lens_bounds(x, exact(_STRAIGHT))
    value = _over(at.value, [e.sub(one.value, plain.value) for one in units], cameras)
    return LensBounds(value, _over(at.slopes, [e.sub(one.slopes, plain.slopes) for one in units], cameras))


def curvatures_over(x: IntervalArray, cameras: CameraSet) -> IntervalArray:
    """(..., 4), as `curvatures`, for all cameras of a set."""
    at = curvatures(x, exact(cameras.camera.numbers))
    return _over(at, [curvatures(x, exact(unit)) for unit in _UNITS], cameras) if cameras.size else at


def _over(at: IntervalArray, by: Sequence[IntervalArray], cameras: CameraSet) -> IntervalArray:
    """What is linear in the lens's numbers, and `at` those of the centre: `by` each of the five (...,)."""
    rows = ENGINE.dot(stacked(by), exact(cameras.spread[4:]))
    most = cameras.most(rows).hi
    return ENGINE.add(at, IntervalArray(-most, most))


def lens_bounds(x: IntervalArray, numbers: IntervalArray) -> LensBounds:
    """Of boxes of directions x (..., 2); numbers (9,): fx, fy, cx, cy, k1, k2, p1, p2, k3."""
    e = ENGINE
    k1, k2, p1, p2, k3 = (numbers[4 + k] for k in range(5))
    u, v = x[..., 0], x[..., 1]
    uu, vv, uv = e.sqr(u), e.sqr(v), e.mul(u, v)
    s = e.add(uu, vv)

    g = e.add(exact(1.0), e.mul(s, e.add(k1, e.mul(s, e.add(k2, e.mul(s, k3))))))
    g1 = e.add(k1, e.mul(s, e.add(e.mul(_TWO, k2), e.mul(s, e.mul(_THREE, k3)))))
    du = total([e.mul(u, g), product(_TWO, p1, uv), e.mul(p2, e.add(s, e.mul(_TWO, uu)))])
    dv = total([e.mul(v, g), product(_TWO, p2, uv), e.mul(p1, e.add(s, e.mul(_TWO, vv)))])
    along = total([g, product(_TWO, g1, uu), product(_TWO, p1, v), product(_SIX, p2, u)])
    mixed = total([product(_TWO, g1, uv), product(_TWO, p1, u), product(_TWO, p2, v)])
    down = total([g, product(_TWO, g1, vv), product(_SIX, p1, v), product(_TWO, p2, u)])
    return LensBounds(stacked([du, dv]), stacked([along, mixed, down]))


def curvatures(x: IntervalArray, numbers: IntervalArray) -> IntervalArray:
    """(..., 4): second derivatives of d on boxes x (..., 2): xxx, xxy, xyy, yyy."""
    e = ENGINE
    k1, k2, p1, p2, k3 = (numbers[4 + k] for k in range(5))
    u, v = x[..., 0], x[..., 1]
    uu, vv = e.sqr(u), e.sqr(v)
    s = e.add(uu, vv)
    g1 = e.add(k1, e.mul(s, e.add(e.mul(_TWO, k2), e.mul(s, e.mul(_THREE, k3)))))
    g2 = e.add(e.mul(_TWO, k2), product(_SIX, s, k3))
    xxx = total([e.mul(_SIX, p2), product(_SIX, g1, u), product(_FOUR, g2, uu, u)])
    xxy = total([e.mul(_TWO, p1), product(_TWO, g1, v), product(_FOUR, g2, uu, v)])
    xyy = total([e.mul(_TWO, p2), product(_TWO, g1, u), product(_FOUR, g2, vv, u)])
    yyy = total([e.mul(_SIX, p1), product(_SIX, g1, v), product(_FOUR, g2, vv, v)])
    return stacked([xxx, xxy, xyy, yyy])


def number_slopes(x: IntervalArray, numbers: IntervalArray) -> IntervalArray:
    """(..., 2, 9): derivatives of pixels by fx, fy, cx, cy, k1, k2, p1, p2, k3 at directions x (..., 2)."""
    e = ENGINE
    u, v = x[..., 0], x[..., 1]
    uu, vv, uv = e.sqr(u), e.sqr(v), e.mul(u, v)
    s = e.add(uu, vv)
    s2 = e.sqr(s)
    s3, two = e.mul(s2, s), _TWO
    bent = lens_bounds(x, numbers).value
    zero, one = exact(np.zeros(u.shape)), exact(np.ones(u.shape))
    by_x = [e.mul(u, s), e.mul(u, s2), e.mul(two, uv), e.add(s, e.mul(two, uu)), e.mul(u, s3)]
    by_y = [e.mul(v, s), e.mul(v, s2), e.add(s, e.mul(two, vv)), e.mul(two, uv), e.mul(v, s3)]
    first = [bent[..., 0], zero, one, zero, *(e.mul(numbers[0], part) for part in by_x)]
    second = [zero, bent[..., 1], zero, one, *(e.mul(numbers[1], part) for part in by_y)]
    return stacked([stacked(first), stacked(second)], axis=-2)


# ------------------------------------------------------------------------------------------------------------------
# By how much the centre of a dot's image may differ from the image of the dot's centre: bounded, not estimated.
#
# The centre of a dot's image is the centroid of its area, a definite point. (The centre of a conic fitted to its
# outline,
# which is what is measured, differs from it by the fourth order of the dot's size: see `dot_model`.)
#
# Perspective. With tau = radius / Z, x = (X / Z, Y / Z) and n the plate's normal in the camera frame the image is,
# before
# the lens, an ellipse E about x + e with the moments S / 4, q = 1 - tau^2 (1 - n_z^2),
#
#     e_k = tau^2 (n_k n_z + x_k (1 - n_z^2)) / q
#     S   = tau^2 (I - n n') / q + tau^2 ((1 - n_z^2) x x' + n_z (x n' + n x') + tau^2 n_z^2 n n') / q^2
#
# Lens. At c + h, h in E - c, d = d(c) + J h + H(xi)[h, h] / 2 and the density of area w = det d' = w(c) + G(xi) . h.
# Means over the image are means over E with the weight w / mean(w), and |mean of a weight's product with f, less that
# of
# f| is at most (w_max / w_min - 1) mean |f|. So the centroid is
#
#     d(c) + J a + b / 2,     a_i = mean(w h_i) / mean(w) = sum_j mean(G_j(xi) h_j h_i) / mean(w),
#                             b = weighted mean of H(xi)[h, h]
#
# where mean(h_i h_j) = S_ij / 4 and mean |h_i h_j| <= sqrt(S_ii S_jj) / 4; a coefficient that varies counts with its
# middle for the first, and with its radius for the second.

_ONE, _QUARTER, _HALF = (exact(v) for v in (1.0, 0.25, 0.5))
_PAIRS = ((0, 0), (0, 1), (1, 1))
_THIRD = np.array([[0, 1, 2], [1, 2, 3]])  # curvature of component k by the pair


def center_bias(
    x: IntervalArray, tau: IntervalArray, normal: IntervalArray, cameras: CameraSet
) -> IntervalArray | None:
    """Enclosures (m, 2), pixels, of centroid less image of the centre.

    x (m, 2), tau (m,) and normal (m, 3) as above. None where the lens may turn back within
    a dot's image.
    """
    e = ENGINE
    away, spread = _ellipse(x, tau, normal)
    center = e.add(x, away)
    size = stacked([e.sqrt(spread[..., 0]), e.sqrt(spread[..., 2])])
    extent = IntervalArray.around(np.zeros(size.shape), size.hi)
    at, around = lens_over(center, cameras), lens_over(e.add(center, extent), cameras)
    if not (around.least_slope.lo > 0.0).all():
        return None
    way = lens_over(e.add(x, e.mul(away, IntervalArray(np.zeros(1), np.ones(1)))), cameras).jacobian
    moved = e.sum(e.mul(way, away[..., None, :]), -1)
    bent = _bent(at, around, curvatures_over(e.add(center, extent), cameras), spread, size)
    return e.mul(cameras.numbers[:2], e.add(moved, bent))


def _ellipse(x: IntervalArray, tau: IntervalArray, normal: IntervalArray) -> tuple[IntervalArray, IntervalArray]:
    """e (m, 2) and S (m, 3): xx, xy, yy."""
    e = ENGINE
    square = e.sqr(tau)
    nz = normal[..., 2]
    lean = e.sub(_ONE, e.sqr(nz)).intersect(IntervalArray(np.zeros(nz.shape), np.ones(nz.shape)))
    q = e.sub(_ONE, e.mul(square, lean))
    first, second = e.div(square, q), e.div(square, e.sqr(q))
    across = normal[..., :2]
    away = e.mul(first[..., None], e.add(e.mul(across, nz[..., None]), e.mul(x, lean[..., None])))
    parts = []
    for i, j in _PAIRS:
        ni, nj, xi, xj = normal[..., i], normal[..., j], x[..., i], x[..., j]
        nn, xx = (e.sqr(ni), e.sqr(xi)) if i == j else (e.mul(ni, nj), e.mul(xi, xj))
        round_part = e.mul(first, e.sub(exact(float(i == j)), nn))
        mixed = e.mul(nz, e.add(e.mul(xi, nj), e.mul(xj, ni)))
        rest = e.add(e.add(e.mul(lean, xx), mixed), e.mul(e.mul(square, e.sqr(nz)), nn))
        whole = e.add(round_part, e.mul(second, rest))
        parts.append(IntervalArray(np.maximum(whole.lo, 0.0), whole.hi) if i == j else whole)
    return away, stacked(parts)


def _bent(
    at: LensBounds, around: LensBounds, curves: IntervalArray, spread: IntervalArray, size: IntervalArray
) -> IntervalArray:
    """J a + b / 2."""
    e = ENGINE
    xx, xy, yy = (around.slopes[..., k] for k in range(3))
    xxx, xxy, xyy, yyy = (curves[..., k] for k in range(4))
    two = exact(2.0)
    weight = e.sub(e.mul(xx, yy), e.sqr(xy))
    weight = IntervalArray(np.maximum(weight.lo, e.sqr(around.least_slope).lo), weight.hi)
    by_x = e.sub(e.add(e.mul(xxx, yy), e.mul(xx, xyy)), e.mul(two, e.mul(xy, xxy)))
    by_y = e.sub(e.add(e.mul(xxy, yy), e.mul(xx, yyy)), e.mul(two, e.mul(xy, xyy)))
    ratio = e.div(exact(weight.hi), exact(weight.lo))
    most = stacked([e.mul(_QUARTER, e.mul(size[..., i], size[..., j])) for i, j in _PAIRS])  # mean |h_i h_j|
    mean = e.mul(_QUARTER, spread)
    pair = ((0, 1), (1, 2))  # where h_j h_i stands among the pairs
    a = []
    for i in range(2):
        terms = [_mean(slope, mean[..., pair[i][j]], most[..., pair[i][j]]) for j, slope in enumerate((by_x, by_y))]
        a.append(e.div(e.add(*terms), weight))
    shifted = e.sum(e.mul(at.jacobian, stacked(a)[..., None, :]), -1)
    doubled = (_ONE, two, _ONE)
    b = []
    for k in range(2):
        total = exact(np.zeros(weight.shape))
        for p in range(3):
            curve = curves[..., int(_THIRD[k, p])]
            held = _mean(curve, mean[..., p], most[..., p])
            lost = exact(e.mul(e.mul(exact(curve.mag), e.sub(ratio, _ONE)), most[..., p]).hi)
            held = e.add(held, IntervalArray(-lost.lo, lost.hi))
            total = e.add(total, e.mul(doubled[p], held))
        b.append(e.mul(_HALF, total))
    return e.add(shifted, stacked(b))


def _mean(coefficient: IntervalArray, mean: IntervalArray, most: IntervalArray) -> IntervalArray:
    """Of a coefficient that varies times a product with a mean, whose absolute value has a mean of at most `most`."""
    e = ENGINE
    loose = e.mul(exact(coefficient.rad), exact(most.hi)).hi
    return e.add(e.mul(exact(coefficient.mid), mean), IntervalArray(-loose, loose))


# ------------------------------------------------------------------------------------------------------------------
# The directions that count: a disc on which the lens does not turn back, whatever camera of the set it is.

NEAREST = 40.0  # radii of a dot: no dot is nearer to the camera's plane
CELLS = 24  # squares that the disc is looked at by, each way
BIAS_CELLS = 24  # the same for the bias
BIAS_ROUNDS = 3  # in which the bias of a dot is narrowed from that
_MARGIN = 0.03  # of the field beyond the image's corners, as a share of their distance from the axis
_RAYS, _STEPS = 97, 400
_WIDEST = 4.0  # tangent of the largest angle to the axis
_TURNS = 0.01  # determinant of the distortion's derivative, 1 on the axis, at which a lens is said to turn back
_LEAST = 0.02  # of m on the disc
_NARROWER = 0.95  # disc, until m is that large and the bias is bounded
_SMALLEST = 20


@dataclass(frozen=True)
class Field:
    """The directions that count, r <= radius, for all cameras of a set.

    least_slope  m > 0, which no eigenvalue of a lens's Jacobian is below
    bias         pixels, the largest component of the bias of a dot that is seen there
    """

    radius: float
    least_slope: float
    bias: float


@lru_cache(maxsize=16)
def field_of_view(cameras: CameraSet) -> Field:
    """What the image shows and a little more, but no more than where the lens of some camera may turn back.

    Raises InputError for a lens that bends too much to be enclosed.
    """
    camera = cameras.camera
    radius = np.linspace(0.0, _WIDEST, _STEPS)
    angle = np.linspace(-np.pi, np.pi, _RAYS)
    rays = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    onward = np.all(np.linalg.det(camera.distortion_jacobian(rays)) > _TURNS, axis=1)
    pixels = camera.pixels(rays)
    held = (pixels >= -0.5) & (pixels <= [camera.width - 0.5, camera.height - 0.5])
    shown = np.any(np.all(held, axis=2), axis=1)
    good = np.logical_and.accumulate(onward)
    reach = radius[np.flatnonzero(good & shown)[-1]] if (good & shown).any() else 0.0
    edge = min((1.0 + _MARGIN) * float(reach), float(radius[good.sum() - 1]))
    for _ in range(_SMALLEST):
        least = _least_slope(edge, cameras)
        bias = _most_bias(edge, cameras) if least >= _LEAST else None
        if bias is not None:
            return Field(edge, least, bias)
        edge *= _NARROWER
    what = "has a lens that bends too much within the image"
    raise InputError([Problem("camera", what, "pose sets need a lens whose image does not turn back")])


def _least_slope(radius: float, cameras: CameraSet) -> float:
    """m on the disc."""
    return float(lens_over(_squares(radius, CELLS), cameras).least_slope.lo.min())


def _most_bias(radius: float, cameras: CameraSet) -> float | None:
    """The largest component of the bias of a dot anywhere; None where it is not bounded."""
    x = _squares(radius, BIAS_CELLS)
    depths = IntervalArray(np.zeros(len(x.lo)), np.full(len(x.lo), 1.0 / NEAREST))
    normals = IntervalArray(np.full((len(x.lo), 3), -1.0), np.ones((len(x.lo), 3)))
    bias = center_bias(x, depths, normals, cameras)
    return None if bias is None else float(bias.mag.max())


def _squares(radius: float, count: int) -> IntervalArray:
    """Those (c, 2) of count x count squares around the disc that meet it."""
    cuts = np.linspace(-radius, radius, count + 1)
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    lo, hi = np.stack([cuts[i], cuts[j]], axis=1), np.stack([cuts[i + 1], cuts[j + 1]], axis=1)
    nearest = np.where((lo <= 0.0) & (hi >= 0.0), 0.0, np.minimum(np.abs(lo), np.abs(hi)))
    meets = np.hypot(nearest[:, 0], nearest[:, 1]) <= radius * (1.0 + 1e-12)
    return IntervalArray(lo[meets], hi[meets])
