"""The camera: a pinhole and a lens."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem, shown
from cpcal.common.values import Floats, Value, frozen_array
from cpcal.solver.compiled import compiled

# ------------------------------------------------------------------------------------------------------------------
# The lens as polynomials: the distortion d(x, y) with its first three derivatives, also by its coefficients.
#
# d is a sum of fixed vector polynomials of degree up to 7, one for the straight ray and one for each of k1, k2, p1, p2,
# k3. So every derivative is a table of numbers times the monomials of (x, y), exact and one matrix product.

_DEGREE = 7
_POWERS = [(a, b) for a in range(_DEGREE + 1) for b in range(_DEGREE + 1 - a)]  # of x and y in each monomial
_ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]  # of the derivatives by x, y
# where the derivatives of each order stand in _ORDERS, as full tensors
_FIRST = np.array([1, 2])
_SECOND = np.array([[3, 4], [4, 5]])
_THIRD = np.array([[[6, 7], [7, 8]], [[7, 8], [8, 9]]])

Polynomial = dict[tuple[int, int], float]  # powers of x and y -> coefficient


def _fields() -> list[tuple[Polynomial, Polynomial]]:
    """The vector polynomials that 1, k1, k2, p1, p2, k3 stand before: x and y components."""
    r2: Polynomial = {(2, 0): 1.0, (0, 2): 1.0}
    r4: Polynomial = {(4, 0): 1.0, (2, 2): 2.0, (0, 4): 1.0}
    r6: Polynomial = {(6, 0): 1.0, (4, 2): 3.0, (2, 4): 3.0, (0, 6): 1.0}

    def ray_times(radial: Polynomial) -> tuple[Polynomial, Polynomial]:
        return {(a + 1, b): c for (a, b), c in radial.items()}, {(a, b + 1): c for (a, b), c in radial.items()}

    p1: tuple[Polynomial, Polynomial] = {(1, 1): 2.0}, {(2, 0): 1.0, (0, 2): 3.0}
    p2: tuple[Polynomial, Polynomial] = {(2, 0): 3.0, (0, 2): 1.0}, {(1, 1): 2.0}
    return [ray_times({(0, 0): 1.0}), ray_times(r2), ray_times(r4), p1, p2, ray_times(r6)]


def _derivative(polynomial: Polynomial, orders: tuple[int, int]) -> Polynomial:
    for axis, times in enumerate(orders):
        for _ in range(times):
            polynomial = {
                (p[0] - (axis == 0), p[1] - (axis == 1)): c * p[axis] for p, c in polynomial.items() if p[axis] > 0
            }
    return polynomial


def _table() -> Floats:
    """(monomials, derivatives, 2 components, 6 fields)."""
    table = np.zeros((len(_POWERS), len(_ORDERS), 2, 6))
    for k, field in enumerate(_fields()):
        for i, component in enumerate(field):
            for j, orders in enumerate(_ORDERS):
                for powers, coefficient in _derivative(component, orders).items():
                    table[_POWERS.index(powers), j, i, k] = coefficient
    return table


_TABLE = _table()
_OF_X, _OF_Y = np.array(_POWERS).T


@dataclass(frozen=True, eq=False)
class Jet:
    """d at points (..., 2) with its derivatives; the trailing axes of the derivatives count x and y.

    value (..., 2), first (..., 2, 2), second (..., 2, 2, 2), third (..., 2, 2, 2, 2)
    """

    value: Floats
    first: Floats
    second: Floats
    third: Floats


def jet(normalised: Floats, distortion: Floats) -> Jet:
    """The lens of `distortion` (k1, k2, p1, p2, k3) at points (..., 2)."""
    table = _TABLE @ np.concatenate([[1.0], distortion])
    return _jet(_monomials(normalised), table)


def jets_by_coefficient(normalised: Floats) -> Jet:
    """The derivatives of `jet` by k1, k2, p1, p2, k3: the same fields with an axis of 5 after those of the points."""
    table = np.moveaxis(_TABLE[..., 1:], -1, 1)
    return _jet(_monomials(normalised), table)


def _monomials(normalised: Floats) -> Floats:
    powers = np.ones((_DEGREE + 1, *normalised.shape))
    np.multiply.accumulate(np.broadcast_to(normalised, (_DEGREE, *normalised.shape)), axis=0, out=powers[1:])
    return np.moveaxis(powers[_OF_X, ..., 0] * powers[_OF_Y, ..., 1], 0, -1)


def _jet(monomials: Floats, table: Floats) -> Jet:
    """table (monomials, ..., derivatives, 2)."""
    product = monomials @ table.reshape(len(_POWERS), -1)
    all_of_it = product.reshape(*monomials.shape[:-1], *table.shape[1:])
    components_first = np.swapaxes(all_of_it, -1, -2)
    return Jet(
        all_of_it[..., 0, :],
        components_first[..., _FIRST],
        components_first[..., _SECOND],
        components_first[..., _THIRD],
    )


# ------------------------------------------------------------------------------------------------------------------
# How a lens bends a direction, compiled: the radial factor with its derivatives, the lens, and its inverse.
#
# A lens is packed as (9,) numbers: 1 for a fisheye and 0 otherwise; p1, p2; k1 to k6 (k4 to k6 are zero for "brown", k5
# and k6 for "fisheye"). `cpcal.vision.camera` says what they stand for.

PACKED = 9
_NEAR = 1e-2  # below this r^2 the series of atan(r) / r has all digits
_TERMS = 12
_NEWTON_STEPS = 50
_LAST = 1e-8  # of a normalised coordinate: after so short a step of Newton the error is its square
_EXACT = 1e-9  # how near the inverse must come

Four = tuple[float, float, float, float]


@compiled
def radial(lens: Floats, s: float) -> Four:
    """The factor g(s), s = r^2, and its first three derivatives by s."""
    if lens[0] != 0.0:
        return _fisheye(lens, s)
    n, n1, n2, n3 = _cubic(s, lens[3], lens[4], lens[5])
    if lens[6] == 0.0 and lens[7] == 0.0 and lens[8] == 0.0:
        return n, n1, n2, n3
    d, d1, d2, d3 = _cubic(s, lens[6], lens[7], lens[8])
    g = n / d
    g1 = (n1 - g * d1) / d
    g2 = (n2 - 2.0 * g1 * d1 - g * d2) / d
    return g, g1, g2, (n3 - 3.0 * g2 * d1 - 3.0 * g1 * d2 - g * d3) / d


@compiled
def _cubic(s: float, a: float, b: float, c: float) -> Four:
    """1 + a s + b s^2 + c s^3."""
    return 1.0 + s * (a + s * (b + s * c)), a + s * (2.0 * b + s * 3.0 * c), 2.0 * b + s * 6.0 * c, 6.0 * c


@compiled
def _fisheye(lens: Floats, s: float) -> Four:
    h = _angle_by_radius(s)
    square = _product((s, 1.0, 0.0, 0.0), _product(h, h))  # a^2
    total = (0.0, 0.0, 0.0, 0.0)
    for k in (lens[6], lens[5], lens[4], lens[3], 1.0):  # Horner's rule
        value, first, second, third = _product(total, square)
        total = (value + k, first, second, third)
    return _product(h, total)


@compiled
def _product(f: Four, g: Four) -> Four:
    """Leibniz's rule."""
    return (
        f[0] * g[0],
        f[1] * g[0] + f[0] * g[1],
        f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2],
        f[3] * g[0] + 3.0 * f[2] * g[1] + 3.0 * f[1] * g[2] + f[0] * g[3],
    )


@compiled
def _angle_by_radius(s: float) -> Four:
    """h = atan(r) / r; away from 0 from 2 s h' + h = 1 / (1 + s) and that, derived: near it by the series."""
    if s < _NEAR:
        h, h1, h2, h3, power = 0.0, 0.0, 0.0, 0.0, 1.0
        for k in range(_TERMS):  # of (-1)^k s^k / (2 k + 1), and derived
            sign = 1.0 - 2.0 * (k % 2)
            h += sign * power / (2 * k + 1)
            h1 -= sign * power * (k + 1) / (2 * k + 3)
            h2 += sign * power * (k + 1) * (k + 2) / (2 * k + 5)
            h3 -= sign * power * (k + 1) * (k + 2) * (k + 3) / (2 * k + 7)
            power *= s
        return h, h1, h2, h3
    r = np.sqrt(s)
    h = np.arctan(r) / r
    h1 = (1.0 / (1.0 + s) - h) / (2.0 * s)
    h2 = (-1.0 / (1.0 + s) ** 2 - 3.0 * h1) / (2.0 * s)
    return h, h1, h2, (2.0 / (1.0 + s) ** 3 - 5.0 * h2) / (2.0 * s)


@compiled
def radials(lens: Floats, s: Floats, out: Floats) -> None:
    """`radial` of s (n,), into (4, n)."""
    for i in range(len(s)):
        out[0, i], out[1, i], out[2, i], out[3, i] = radial(lens, s[i])


@compiled
def bent(lens: Floats, x: float, y: float) -> tuple[float, float, float, float, float]:
    """d(x, y), and the derivatives of the first component by x, of it by y (and of the other by x), of the other by
    y."""
    p1, p2 = lens[1], lens[2]
    r2 = x * x + y * y
    g, slope, _, _ = radial(lens, r2)
    return (
        x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        g + 2.0 * slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
        2.0 * slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y,
        g + 2.0 * slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
    )


@compiled
def all_bent(lens: Floats, points: Floats, out: Floats) -> None:
    """`bent` of points (n, 2), into (n, 5)."""
    for i in range(len(points)):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = bent(lens, points[i, 0], points[i, 1])


@compiled
def unbent(lens: Floats, wanted: Floats, out: Floats) -> None:
    """The directions (n, 2) that are bent to those wanted (n, 2), by Newton's method; nan where there is none
    nearby."""
    for i in range(len(wanted)):
        u, v = wanted[i, 0], wanted[i, 1]
        x, y = u, v
        for _ in range(_NEWTON_STEPS):
            dx, dy, xx, xy, yy = bent(lens, x, y)
            off_x, off_y, determinant = u - dx, v - dy, xx * yy - xy * xy
            step_x, step_y = (yy * off_x - xy * off_y) / determinant, (xx * off_y - xy * off_x) / determinant
            x, y = x + step_x, y + step_y
            if not (abs(step_x) > _LAST or abs(step_y) > _LAST):
                break
        dx, dy, _, _, _ = bent(lens, x, y)
        near = abs(dx - u) < _EXACT and abs(dy - v) < _EXACT
        out[i, 0], out[i, 1] = (x, y) if near else (np.nan, np.nan)


# ------------------------------------------------------------------------------------------------------------------
# The lenses that cameras have: how a direction (x, y) = (X / Z, Y / Z) is bent, with derivatives up to the third.
#
# With r^2 = x^2 + y^2 and the numbers in OpenCV's order
#
#     brown     k1, k2, p1, p2, k3              d = (x, y) c(k1, k2, k3) + t
#     rational  k1, k2, p1, p2, k3, k4, k5, k6  d = (x, y) c(k1, k2, k3) / c(k4, k5, k6) + t
#     fisheye   k1, k2, k3, k4                  d = (x, y) (a / r) (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8),  a = atan r
#
# where c(k, l, m) = 1 + k r^2 + l r^4 + m r^6 and
# t = (2 p1 x y + p2 (r^2 + 2 x^2), p1 (r^2 + 2 y^2) + 2 p2 x y).
# Each is (x, y) g(r^2) + t with a radial factor g.

Series = tuple[Floats, Floats, Floats, Floats]  # a function of s = r^2 and its first three derivatives


class Lens(ABC):
    """names: of the lens's numbers, in order. Arrays x, y of any shape; numbers (n,)."""

    name: str
    names: tuple[str, ...]

    @abstractmethod
    def packed(self, numbers: Floats) -> Floats:
        """(9,) as compiled code takes them (`cpcal.vision.camera`)."""

    def radial(self, s: Floats, numbers: Floats) -> Series:
        """g with its derivatives by s = r^2."""
        flat = np.ascontiguousarray(s, dtype=np.float64).ravel()
        out = np.empty((4, len(flat)))
        radials(self.packed(numbers), flat, out)
        g, g1, g2, g3 = out.reshape(4, *np.shape(s))
        return g, g1, g2, g3

    def jet(self, points: Floats, numbers: Floats) -> Jet:
        """d at points (..., 2) with its derivatives: those of (x, y) g, and of t as the polynomial lens has them."""
        p1, p2 = self.packed(numbers)[1:3].tolist()
        t = jet(points, np.array([0.0, 0.0, p1, p2, 0.0]))  # (x, y) + t
        one = np.eye(2)
        g, g1, g2, g3 = (d[..., None, None, None, None] for d in self.radial((points * points).sum(axis=-1), numbers))
        p = points
        pp = p[..., :, None] * p[..., None, :]
        ppp = pp[..., None] * p[..., None, None, :]
        mixed = one[:, :, None] * p[..., None, None, :] + one[:, None, :] * p[..., None, :, None]
        mixed = mixed + one * p[..., :, None, None]
        squares = np.einsum("ij,kl->ijkl", one, one) + np.einsum("ik,jl->ijkl", one, one)
        squares = squares + np.einsum("il,jk->ijkl", one, one)
        pairs = one[:, :, None, None] * pp[..., None, None, :, :] + one * pp[..., :, :, None, None]
        pairs = pairs + np.einsum("ik,...jl->...ijkl", one, pp) + np.einsum("jl,...ik->...ijkl", one, pp)
        pairs = pairs + np.einsum("il,...jk->...ijkl", one, pp) + np.einsum("jk,...il->...ijkl", one, pp)
        return Jet(
            t.value + p * (g[..., 0, 0, 0] - 1.0),
            t.first + one * (g[..., 0, 0] - 1.0) + 2.0 * g1[..., 0, 0] * pp,
            t.second + 2.0 * g1[..., 0] * mixed + 4.0 * g2[..., 0] * ppp,
            t.third + 2.0 * g1 * squares + 4.0 * g2 * pairs + 8.0 * g3 * ppp[..., None] * p[..., None, None, None, :],
        )


class Brown(Lens):
    name, names = "brown", ("k1", "k2", "p1", "p2", "k3")

    def packed(self, numbers: Floats) -> Floats:
        k1, k2, p1, p2, k3 = numbers.tolist()
        return np.array([0.0, p1, p2, k1, k2, k3, 0.0, 0.0, 0.0])

    def jet(self, points: Floats, numbers: Floats) -> Jet:
        return jet(points, numbers)  # a polynomial throughout: one product of tables


class Rational(Lens):
    name, names = "rational", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")

    def packed(self, numbers: Floats) -> Floats:
        k1, k2, p1, p2, *others = numbers.tolist()
        return np.array([0.0, p1, p2, k1, k2, *others])


class Fisheye(Lens):
    name, names = "fisheye", ("k1", "k2", "k3", "k4")

    def packed(self, numbers: Floats) -> Floats:
        return np.array([1.0, 0.0, 0.0, *numbers.tolist(), 0.0, 0.0])


LENSES: dict[str, Lens] = {lens.name: lens for lens in (Brown(), Rational(), Fisheye())}


BROWN = "brown"  # the model that cameras are calibrated with; only it has a covariance
CAMERA_NUMBERS = ("fx", "fy", "cx", "cy", *LENSES[BROWN].names)


@dataclass(frozen=True, eq=False)
class Camera(Value):
    """What makes pixels of directions.

    width, height  of the image, pixels
    focal          (2,) fx, fy in pixels
    center         (2,) cx, cy in pixels; (0, 0) is the centre of the top-left pixel
    distortion     the lens's numbers; (5,) k1, k2, p1, p2, k3 of the model "brown"
    model          of the lens: "brown", "rational" or "fisheye" (`cpcal.vision.camera`)

    With (x, y) = (X / Z, Y / Z) the image of a point is center + focal * d(x, y), and d is the lens.

    Raises InputError when the numbers make no camera.
    """

    width: int
    height: int
    focal: Floats
    center: Floats
    distortion: Floats
    model: str = BROWN

    def __post_init__(self) -> None:
        if self.model not in LENSES:
            raise InputError([Problem("camera model", f"is {shown(self.model)}", f"give one of {', '.join(LENSES)}")])
        for name, size in (("focal", 2), ("center", 2), ("distortion", len(self.lens.names))):
            array = frozen_array(getattr(self, name))
            if array.shape != (size,) or not np.isfinite(array).all():
                raise InputError([Problem(f"camera {name}", f"is not {size} finite numbers", "give pixels, see docs")])
            object.__setattr__(self, name, array)
        if min(self.width, self.height) < 1 or not (self.focal > 0.0).all():
            raise InputError([Problem("camera", "has no positive size or focal length", "give them in pixels")])

    @property
    def lens(self) -> Lens:
        return LENSES[self.model]

    @property
    def numbers(self) -> Floats:
        """fx, fy, cx, cy and the lens's numbers; (9,) in the order of CAMERA_NUMBERS for the model "brown"."""
        return np.concatenate([self.focal, self.center, self.distortion])

    @cached_property
    def packed(self) -> Floats:
        """(13,) as compiled code takes them: fx, fy, cx, cy and the lens (`cpcal.vision.camera`)."""
        return np.concatenate([self.focal, self.center, self.lens.packed(self.distortion)])

    def with_numbers(self, numbers: Floats) -> Camera:
        """The same image size and model, other numbers. Raises InputError when they make no camera."""
        return Camera(self.width, self.height, numbers[:2], numbers[2:4], numbers[4:], self.model)

    def project(self, points: npt.ArrayLike) -> Floats:
        """Pixels (..., 2) of points (..., 3) mm in the camera frame, Z > 0."""
        p = np.asarray(points, dtype=np.float64)
        return self.pixels(p[..., :2] / p[..., 2:])

    def pixels(self, normalised: npt.ArrayLike) -> Floats:
        """Pixels (..., 2) of the directions (x, y, 1), given as (..., 2)."""
        return np.asarray(self.center + self.focal * self.distorted(normalised))

    def distorted(self, normalised: npt.ArrayLike) -> Floats:
        """d(x, y), (..., 2) -> (..., 2)."""
        return self._bent(normalised)[..., :2]

    def distortion_jacobian(self, normalised: npt.ArrayLike) -> Floats:
        """The derivatives of d by (x, y), (..., 2) -> (..., 2, 2)."""
        return self._bent(normalised)[..., [[2, 3], [3, 4]]]

    def _bent(self, normalised: npt.ArrayLike) -> Floats:
        """d (2) and the three parts of its symmetric derivative, (..., 5)."""
        points = np.array(normalised, dtype=np.float64, order="C")
        out = np.empty((*points.shape[:-1], 5))
        all_bent(self.packed[4:], points.reshape(-1, 2), out.reshape(-1, 5))
        return out

    def normalised(self, pixels: npt.ArrayLike) -> Floats:
        """The directions (..., 2) that pixels (..., 2) show, by Newton's method; nan where there is none nearby."""
        wanted = np.ascontiguousarray((np.asarray(pixels, dtype=np.float64) - self.center) / self.focal)
        found = np.empty(wanted.shape)
        unbent(self.packed[4:], wanted.reshape(-1, 2), found.reshape(-1, 2))
        return found


# 1024 x 768 pixels of 4.65 micrometres behind an objective of 4.2 mm; an ordinary lens, a little off its centre
DELTALAB_CAMERA = Camera(
    1024,
    768,
    focal=np.array([903.2, 903.2]),
    center=np.array([515.3, 380.6]),
    distortion=np.array([-0.18, 0.07, 4e-4, -3e-4, 0.0]),
)


# ------------------------------------------------------------------------------------------------------------------
# Numbers that are a camera's by their form but cannot be one's: a slip of a decimal, another unit, another model.

PIXELS_MAX = 1_000_000  # of an image's side
_FOCAL = (0.05, 1000.0)  # of the image's longer side: from a fisheye to a telescope
_ASPECT = 4.0  # of fx and fy
_CENTER = 10.0  # image sides away from the image, which may be a part of a larger one
_STRETCH = 4.0  # of a direction by the distortion, and its inverse
_SHARE = 0.5  # of the image that must show directions: lenses are calibrated where something was seen
_GRID = 9  # pixels looked at, each way


def implausible(camera: Camera) -> list[tuple[str, str, str]]:
    """What no camera has: the key, what is wrong with it, and the remedy."""
    side = max(camera.width, camera.height)
    low, high = (f * side for f in _FOCAL)
    fx, fy = camera.focal.tolist()
    out = []
    if not (low <= min(fx, fy) and max(fx, fy) <= high):
        what = f"focal {fx:g}, {fy:g} is not from {low:g} to {high:g} pixels"
        out.append(("focal", what, "give the focal length in pixels: that in mm over the size of a pixel in mm"))
    elif max(fx, fy) > _ASPECT * min(fx, fy):
        out.append(("focal", f"fx is {fx:g} and fy {fy:g}: no pixel is so long", "correct the slip"))
    away = np.abs(camera.center - 0.5 * np.array([camera.width, camera.height]))
    if (away > (_CENTER + 0.5) * side).any():
        what = "center {:g}, {:g} is far from the image".format(*camera.center)
        out.append(("center", what, "give cx and cy in pixels from the centre of the top-left pixel"))
    if not out and _seen(camera) < _SHARE:
        what = "distortion bends most of the image beyond measure"
        out.append(("distortion", what, "give k1, k2, p1, p2, k3 of OpenCV's model for directions x / z, y / z"))
    return out


def _seen(camera: Camera) -> float:
    """The share of the image's pixels that show a direction not far from where a camera without distortion sees it."""
    x, y = (np.linspace(0.0, side - 1.0, _GRID) for side in (camera.width, camera.height))
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    plain = np.linalg.norm((pixels - camera.center) / camera.focal, axis=1)
    seen = np.linalg.norm(camera.normalised(pixels), axis=1)
    with np.errstate(invalid="ignore"):
        return float(((seen <= _STRETCH * plain) & (plain <= _STRETCH * seen)).mean())
