"""The camera: a pinhole and a lens."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpcal.common.errors import shown, unusable
from cpcal.common.values import ArrayLike, Floats, Value, floats, freeze, norms
from cpcal.solver.compiled import compiled

# ------------------------------------------------------------------------------------------------------------------
# The lenses that cameras have, compiled: how a direction (x, y) = (X / Z, Y / Z) is bent, with derivatives, and back.
#
# With r^2 = x^2 + y^2 and the numbers in OpenCV's order
#
#     brown     k1, k2, p1, p2, k3              d = (x, y) c(k1, k2, k3) + t
#     rational  k1, k2, p1, p2, k3, k4, k5, k6  d = (x, y) c(k1, k2, k3) / c(k4, k5, k6) + t
#     fisheye   k1, k2, k3, k4                  d = (x, y) (a / r) (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8),  a = atan r
#
# where c(k, l, m) = 1 + k r^2 + l r^4 + m r^6 and
# t = (2 p1 x y + p2 (r^2 + 2 x^2), p1 (r^2 + 2 y^2) + 2 p2 x y).
# Each is (x, y) g(r^2) + t with a radial factor g, and the gradient of a function: all its derivatives are symmetric.
#
# A lens is packed as (9,) numbers: 1 for a fisheye and 0 otherwise; p1, p2; k1 to k6 (k4 to k6 are zero for "brown", k5
# and k6 for "fisheye").

LENSES = {
    "brown": ("k1", "k2", "p1", "p2", "k3"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
PACKED = ("fisheye", "p1", "p2", "k1", "k2", "k3", "k4", "k5", "k6")
JET = 9  # numbers of `jet`
_NEAR = 1e-2  # below this r^2 the series of atan(r) / r has all digits
_TERMS = 12
_NEWTON_STEPS = 50
_LAST = 1e-8  # of a normalised coordinate: after so short a step of Newton the error is its square
_EXACT = 1e-9  # how near the inverse must come
_GRID = 9  # pixels that stand for the image, each way

Three = tuple[float, float, float]


@compiled
def radial(lens: Floats, s: float) -> Three:
    """The factor g(s), s = r^2, and its first two derivatives by s."""
    if lens[0] != 0.0:
        return _fisheye(lens, s)
    n, n1, n2 = _cubic(s, lens[3], lens[4], lens[5])
    if lens[6] == 0.0 and lens[7] == 0.0 and lens[8] == 0.0:
        return n, n1, n2
    d, d1, d2 = _cubic(s, lens[6], lens[7], lens[8])
    g = n / d
    g1 = (n1 - g * d1) / d
    return g, g1, (n2 - 2.0 * g1 * d1 - g * d2) / d


@compiled
def _cubic(s: float, a: float, b: float, c: float) -> Three:
    """1 + a s + b s^2 + c s^3."""
    return 1.0 + s * (a + s * (b + s * c)), a + s * (2.0 * b + s * 3.0 * c), 2.0 * b + s * 6.0 * c


@compiled
def _fisheye(lens: Floats, s: float) -> Three:
    h = _angle_by_radius(s)
    square = _product((s, 1.0, 0.0), _product(h, h))  # a^2
    total = (0.0, 0.0, 0.0)
    for k in (lens[6], lens[5], lens[4], lens[3], 1.0):  # Horner's rule
        value, first, second = _product(total, square)
        total = (value + k, first, second)
    return _product(h, total)


@compiled
def _product(f: Three, g: Three) -> Three:
    """Leibniz's rule."""
    return f[0] * g[0], f[1] * g[0] + f[0] * g[1], f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2]


@compiled
def _angle_by_radius(s: float) -> Three:
    """h = atan(r) / r; away from 0 from 2 s h' + h = 1 / (1 + s) and that, derived: near it by the series."""
    if s < _NEAR:
        h, h1, h2, power = 0.0, 0.0, 0.0, 1.0
        for k in range(_TERMS):  # of (-1)^k s^k / (2 k + 1), and derived
            sign = 1.0 - 2.0 * (k % 2)
            h += sign * power / (2 * k + 1)
            h1 -= sign * power * (k + 1) / (2 * k + 3)
            h2 += sign * power * (k + 1) * (k + 2) / (2 * k + 5)
            power *= s
        return h, h1, h2
    r = np.sqrt(s)
    h = np.arctan(r) / r
    h1 = (1.0 / (1.0 + s) - h) / (2.0 * s)
    return h, h1, (-1.0 / (1.0 + s) ** 2 - 3.0 * h1) / (2.0 * s)


@compiled
def jet(lens: Floats, x: float, y: float, out: Floats) -> None:
    """d (2), and its derivatives of the first (3: xx, xy, yy) and second order (4) at (x, y)."""
    p1, p2 = lens[1], lens[2]
    xx, xy, yy = x * x, x * y, y * y
    g, g1, g2 = radial(lens, xx + yy)
    out[0] = x * g + 2.0 * p1 * xy + p2 * (3.0 * xx + yy)
    out[1] = y * g + p1 * (xx + 3.0 * yy) + 2.0 * p2 * xy
    out[2] = g + 2.0 * g1 * xx + 2.0 * p1 * y + 6.0 * p2 * x
    out[3] = 2.0 * g1 * xy + 2.0 * p1 * x + 2.0 * p2 * y
    out[4] = g + 2.0 * g1 * yy + 6.0 * p1 * y + 2.0 * p2 * x
    out[5] = 6.0 * g1 * x + 4.0 * g2 * x * xx + 6.0 * p2
    out[6] = 2.0 * g1 * y + 4.0 * g2 * xx * y + 2.0 * p1
    out[7] = 2.0 * g1 * x + 4.0 * g2 * x * yy + 2.0 * p2
    out[8] = 6.0 * g1 * y + 4.0 * g2 * y * yy + 6.0 * p1


@compiled
def jets(lens: Floats, points: Floats, out: Floats) -> None:
    """`jet` of points (n, 2), into (n, JET)."""
    for i in range(len(points)):
        jet(lens, points[i, 0], points[i, 1], out[i])


@compiled
def unbent(lens: Floats, wanted: Floats, out: Floats) -> None:
    """The directions (n, 2) that are bent to those wanted (n, 2), by Newton's method; nan where there is none
    nearby."""
    bend = np.empty(JET)
    for i in range(len(wanted)):
        u, v = wanted[i, 0], wanted[i, 1]
        x, y = u, v
        for _ in range(_NEWTON_STEPS):
            jet(lens, x, y, bend)
            off_x, off_y, xx, xy, yy = u - bend[0], v - bend[1], bend[2], bend[3], bend[4]
            determinant = xx * yy - xy * xy
            step_x, step_y = (yy * off_x - xy * off_y) / determinant, (xx * off_y - xy * off_x) / determinant
            x, y = x + step_x, y + step_y
            if not (abs(step_x) > _LAST or abs(step_y) > _LAST):
                break
        jet(lens, x, y, bend)
        near = abs(bend[0] - u) < _EXACT and abs(bend[1] - v) < _EXACT
        out[i, 0], out[i, 1] = (x, y) if near else (np.nan, np.nan)


BROWN = "brown"  # the model that cameras are calibrated with; only it has a covariance
CAMERA_NUMBERS = ("fx", "fy", "cx", "cy", *LENSES[BROWN])


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
            raise unusable("camera model", f"is {shown(self.model)}", f"give one of {', '.join(LENSES)}")
        for name, size in (("focal", 2), ("center", 2), ("distortion", len(LENSES[self.model]))):
            freeze(self, name)
            if getattr(self, name).shape != (size,) or not np.isfinite(getattr(self, name)).all():
                raise unusable(f"camera {name}", f"is not {size} finite numbers", "give pixels, see docs")
        if min(self.width, self.height) < 1 or not (self.focal > 0.0).all():
            raise unusable("camera", "has no positive size or focal length", "give them in pixels")

    @property
    def numbers(self) -> Floats:
        """fx, fy, cx, cy and the lens's numbers; (9,) in the order of CAMERA_NUMBERS for the model "brown"."""
        return np.concatenate([self.focal, self.center, self.distortion])

    @cached_property
    def packed(self) -> Floats:
        """(13,) as compiled code takes them: fx, fy, cx, cy and the lens (`cpcal.vision.camera`)."""
        given = dict(zip(LENSES[self.model], self.distortion.tolist(), strict=True), fisheye=self.model == "fisheye")
        return np.array([*self.focal, *self.center, *(given.get(name, 0.0) for name in PACKED)])

    @cached_property
    def spread(self) -> Floats:
        """(81, 2) pixels over the whole image, its border included."""
        x, y = (np.linspace(-0.5, side - 0.5, _GRID) for side in (self.width, self.height))
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    def with_numbers(self, numbers: Floats) -> "Camera":
        """The same image size and model, other numbers. Raises InputError when they make no camera."""
        return Camera(self.width, self.height, numbers[:2], numbers[2:4], numbers[4:], self.model)

    def project(self, points: ArrayLike) -> Floats:
        """Pixels (..., 2) of points (..., 3) mm in the camera frame, Z > 0."""
        p = floats(points)
        return self.pixels(p[..., :2] / p[..., 2:])

    def pixels(self, normalised: ArrayLike) -> Floats:
        """Pixels (..., 2) of the directions (x, y, 1), given as (..., 2)."""
        return self.center + self.focal * self.jets(normalised)[..., :2]

    def jets(self, normalised: ArrayLike) -> Floats:
        """d with its derivatives up to the second, (..., 2) -> (..., JET), see `jet`."""
        points = np.array(normalised, np.float64, order="C")
        out = np.empty((*points.shape[:-1], JET))
        jets(self.packed[4:], points.reshape(-1, 2), out.reshape(-1, JET))
        return out

    def normalised(self, pixels: ArrayLike) -> Floats:
        """The directions (..., 2) that pixels (..., 2) show, by Newton's method; nan where there is none nearby."""
        wanted = np.ascontiguousarray((floats(pixels) - self.center) / self.focal)
        if self.model == BROWN and not self.distortion.any():
            return wanted
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
    if not out:  # how far the pixels' directions are from where a camera without distortion sees them
        plain = norms((camera.spread - camera.center) / camera.focal)
        seen = norms(camera.normalised(camera.spread))
        with np.errstate(invalid="ignore"):
            near = (seen <= _STRETCH * plain) & (plain <= _STRETCH * seen)
    if not out and near.mean() < _SHARE:
        what = "distortion bends most of the image beyond measure"
        out.append(("distortion", what, "give k1, k2, p1, p2, k3 of OpenCV's model for directions x / z, y / z"))
    return out
