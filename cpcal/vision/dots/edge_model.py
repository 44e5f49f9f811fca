"""The grey levels that a blurred ellipse under light makes of pixels, and the normal equations of its parameters.

The parameters p, lengths in units of the dot's radius, places from a pixel of its own:

0, 1 centre; 2, 3, 4 the conic's xx, xy, yy; 5 grey level around; 6 contrast; 7 logarithm of the blur; 8, 9 how the
blur's square differs by the edge's direction a: by the share p8 cos 2a + p9 sin 2a (motion); 10, 11 the light's growth
to the right and down; 12 to 15 the light's growth by x^3, x^2 y, x y^2, y^3.

A derivative is an array over the dot's pixels, in single precision. Each loop runs over pixels without a branch and
without calls of the mathematics library and writes one or two arrays: of such loops the compiler can prove that nothing
overlaps, and treats sixteen pixels at once.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled

Single = npt.NDArray[np.float32]

PARAMETERS = 16
PLAIN = 10  # of them, under a light that is known
LINEAR, CUBIC = 12, 16  # under light of the dot's own
SCRATCH = 5  # arrays beside the derivatives and the residuals
_DIM = np.float32(0.05)  # light, at least, relative to that at the centre; and width
_TINY, _FLAT = np.float32(1e-12), np.float32(1e-8)  # of squares next to the centre
_ZERO, _HALF, _ONE, _TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
_BELL = np.float32(0.3989422804014327)  # 1 / sqrt(2 pi)
_FAR, _PART = np.float32(20.0), np.float32(1.0 / 64.0)
_C3, _C4, _C5 = np.float32(1.0 / 6.0), np.float32(1.0 / 24.0), np.float32(1.0 / 120.0)
_A0, _A1, _A2, _A3 = np.float32(0.33267), np.float32(0.4361836), np.float32(-0.1201676), np.float32(0.9372980)


@compiled
def normal_equations(p: Floats, x: Single, y: Single, level: Single, count: int, used: int, rows: Single) -> Single:
    """The products (used + 1, used + 1) of the first `used` derivatives (PLAIN or PARAMETERS), and in the last row and
    column those of the residuals, over the first `count` pixels; `rows` is room for 1 + PARAMETERS + SCRATCH
    arrays of them."""
    s = singles(p)
    r = rows[: (1 + PARAMETERS + SCRATCH) * count].reshape(1 + PARAMETERS + SCRATCH, count)
    slope, depth, double, twice, wide = r[used + 1], r[used + 2], r[used + 3], r[used + 4], r[used + 5]
    sharp = np.float32(np.exp(-p[7]))
    _slopes(s, x, y, count, slope)
    _directions(s, x, y, slope, count, double, twice)
    _widths(s[8], s[9], double, twice, count, wide)
    depths(s, x, y, count, depth)
    light, share, bell = r[5], r[6], r[7]
    _lights(s, x, y, count, light)
    _shares(sharp, depth, wide, count, bell, share)
    _residuals(s[5], s[6], level, light, share, count, r[used])
    _steepness(sharp * s[6], wide, light, count, bell)
    _by_center(s, x, y, bell, slope, count, r[0], r[1])
    _by_form(s, x, y, bell, slope, count, r[2], r[3])
    _by_last_form(s[1], y, bell, slope, count, r[4])
    if used > PLAIN:
        _even(s[5], s[6], share, count, slope)  # slopes are no longer needed
        _by_growth(s, x, y, slope, count, r[10], r[11])
        _by_cubes(s, x, y, r[10], count, r[12], r[14])
        _by_cubes(s, x, y, r[11], count, r[13], r[15])
    _times(light, count, share)
    _by_blur(depth, count, bell)
    _by_width(bell, wide, double, count, r[8])
    _by_width(bell, wide, twice, count, r[9])
    products: Single = np.dot(r[: used + 1], r[: used + 1].T)
    return products


@compiled
def singles(p: Floats) -> Single:
    out = np.empty(PARAMETERS, np.float32)
    for i in range(PARAMETERS):
        out[i] = p[i]
    return out


@compiled
def depths(s: Single, x: Single, y: Single, count: int, depth: Single) -> None:
    """The signed distances of pixels inside the ellipse, to first order (exact for circles)."""
    px, py, a, b, c = s[0], s[1], s[2], s[3], s[4]
    for k in range(count):
        dx, dy = x[k] - px, y[k] - py
        to_x, to_y = a * dx + b * dy, b * dx + c * dy
        root = np.sqrt(max(to_x * dx + to_y * dy, _TINY))
        depth[k] = (_ONE - root) * root / np.sqrt(max(to_x * to_x + to_y * to_y, _FLAT))


@compiled
def _slopes(s: Single, x: Single, y: Single, count: int, slope: Single) -> None:
    """One over the quadratic form's half gradient."""
    px, py, a, b, c = s[0], s[1], s[2], s[3], s[4]
    for k in range(count):
        dx, dy = x[k] - px, y[k] - py
        to_x, to_y = a * dx + b * dy, b * dx + c * dy
        slope[k] = _ONE / np.sqrt(max(to_x * to_x + to_y * to_y, _FLAT))


@compiled
def _directions(s: Single, x: Single, y: Single, slope: Single, count: int, double: Single, twice: Single) -> None:
    """cos 2a and sin 2a of the gradient's direction a."""
    px, py, a, b, c = s[0], s[1], s[2], s[3], s[4]
    for k in range(count):
        dx, dy = x[k] - px, y[k] - py
        to_x, to_y = (a * dx + b * dy) * slope[k], (b * dx + c * dy) * slope[k]
        double[k], twice[k] = to_x * to_x - to_y * to_y, _TWO * to_x * to_y


@compiled
def _widths(p8: np.float32, p9: np.float32, double: Single, twice: Single, count: int, wide: Single) -> None:
    """One over the square of the blur across the edge relative to its mean."""
    for k in range(count):
        wide[k] = _ONE / max(_ONE + p8 * double[k] + p9 * twice[k], _DIM)


@compiled
def _lights(s: Single, x: Single, y: Single, count: int, light: Single) -> None:
    px, py, gx, gy, c0, c1, c2, c3 = s[0], s[1], s[10], s[11], s[12], s[13], s[14], s[15]
    for k in range(count):
        dx, dy = x[k] - px, y[k] - py
        to_right, down = gx + dx * (c0 * dx + c1 * dy), gy + dy * (c2 * dx + c3 * dy)
        light[k] = max(_ONE + to_right * dx + down * dy, _DIM)


@compiled
def _shares(sharp: np.float32, depth: Single, wide: Single, count: int, bell: Single, share: Single) -> None:
    """The normal distribution's density and function (to 1e-5: Abramowitz and Stegun 26.2.16)."""
    for k in range(count):
        z = depth[k] * sharp * np.sqrt(wide[k])
        t = min(_HALF * z * z, _FAR) * _PART  # exp(-z^2 / 2) as the 64th power of a short series
        power = _ONE - t * (_ONE - t * (_HALF - t * (_C3 - t * (_C4 - t * _C5))))
        power = power * power
        power = power * power
        power = power * power
        power = power * power
        power = power * power
        power = power * power * _BELL
        w = _ONE / (_ONE + _A0 * abs(z))
        tail = ((_A3 * w + _A2) * w + _A1) * w * power
        bell[k] = power
        share[k] = _ONE - tail if z > _ZERO else tail


@compiled
def _residuals(
    back: np.float32, contrast: np.float32, level: Single, light: Single, share: Single, count: int, out: Single
) -> None:
    for k in range(count):
        out[k] = level[k] - light[k] * (back + contrast * share[k])


@compiled
def _steepness(factor: np.float32, wide: Single, light: Single, count: int, bell: Single) -> None:
    """The density becomes the levels' derivative by the depth."""
    for k in range(count):
        bell[k] = factor * bell[k] * light[k] * np.sqrt(wide[k])


@compiled
def _by_center(
    s: Single, x: Single, y: Single, steep: Single, slope: Single, count: int, right: Single, down: Single
) -> None:
    px, py, a, b, c = s[0], s[1], s[2], s[3], s[4]
    for k in range(count):
        dx, dy, by_form = x[k] - px, y[k] - py, steep[k] * slope[k]
        right[k], down[k] = by_form * (a * dx + b * dy), by_form * (b * dx + c * dy)


@compiled
def _by_form(s: Single, x: Single, y: Single, steep: Single, slope: Single, count: int, xx: Single, xy: Single) -> None:
    px, py = s[0], s[1]
    for k in range(count):
        dx, dy, by_form = x[k] - px, y[k] - py, steep[k] * slope[k]
        xx[k], xy[k] = -_HALF * by_form * dx * dx, -by_form * dx * dy


@compiled
def _by_last_form(py: np.float32, y: Single, steep: Single, slope: Single, count: int, yy: Single) -> None:
    for k in range(count):
        dy = y[k] - py
        yy[k] = -_HALF * steep[k] * slope[k] * dy * dy


@compiled
def _even(back: np.float32, contrast: np.float32, share: Single, count: int, out: Single) -> None:
    """The levels under even light."""
    for k in range(count):
        out[k] = back + contrast * share[k]


@compiled
def _by_growth(s: Single, x: Single, y: Single, even: Single, count: int, right: Single, down: Single) -> None:
    px, py = s[0], s[1]
    for k in range(count):
        right[k], down[k] = even[k] * (x[k] - px), even[k] * (y[k] - py)


@compiled
def _by_cubes(s: Single, x: Single, y: Single, growth: Single, count: int, first: Single, second: Single) -> None:
    """A growth times dx^2 and dy^2: of x these are x^3 and x y^2, of y x^2 y and y^3."""
    px, py = s[0], s[1]
    for k in range(count):
        dx, dy = x[k] - px, y[k] - py
        first[k], second[k] = growth[k] * dx * dx, growth[k] * dy * dy


@compiled
def _times(light: Single, count: int, share: Single) -> None:
    for k in range(count):
        share[k] = share[k] * light[k]


@compiled
def _by_blur(depth: Single, count: int, steep: Single) -> None:
    """The steepness becomes the derivative by the logarithm of the blur."""
    for k in range(count):
        steep[k] = -steep[k] * depth[k]


@compiled
def _by_width(by_blur: Single, wide: Single, direction: Single, count: int, out: Single) -> None:
    for k in range(count):
        out[k] = _HALF * by_blur[k] * wide[k] * direction[k]
