"""Blurred ellipses fitted to the grey levels round dots: the likeliest centre for pixels' noise.

The model of a pixel at signed distance d inside the ellipse is light (back + contrast Phi(d / blur)): the edge spread
of a Gaussian blur (the pixel's own square is part of it), which may be wider in one direction (motion), under light
that grows linearly, or by a cubic. The ellipse is where the grey is half-way between back and dot; the
centre is freed of what a blur makes of steep light (`edge_fit._moves`). Gauss-Newton steps
on all pixels use every bit of information on the edge that the image holds, so errors are close to the Cramer-Rao
bound, and the inverse normal matrix is their covariance. What the model leaves out and is symmetric about the centre
moves the ellipse but not its centre; what is not symmetric, light, is tested for.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Floats
from cpcal.solver.compiled import compiled
from cpcal.vision.dots.segmentation import Grey
from cpcal.vision.pose import factored, solved, substituted
from cpcal.vision.projection import eigenvalues

__all__ = ["CUBIC", "LINEAR", "OUTSIDE", "PLAIN", "Edges", "fitted_edges"]

# ------------------------------------------------------------------------------------------------------------------
# The grey levels that a blurred ellipse under light makes of pixels, and the normal equations of its parameters.
#
# The parameters p, lengths in units of the dot's radius, places from a pixel of its own:
#
# 0, 1 centre; 2, 3, 4 the conic's xx, xy, yy; 5 grey level around; 6 contrast; 7 logarithm of the blur; 8, 9 how the
# blur's square differs by the edge's direction a: by the share p8 cos 2a + p9 sin 2a (motion); 10, 11 the light's
# growth to the right and down; 12 to 15 the light's growth by x^3, x^2 y, x y^2, y^3.
#
# A derivative is an array over the dot's pixels, in single precision. Each loop runs over pixels without a branch and
# without calls of the mathematics library and writes one or two arrays: of such loops the compiler can prove that
# nothing overlaps, and treats sixteen pixels at once.

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
    s = p.astype(np.float32)
    r = rows[: (1 + PARAMETERS + SCRATCH) * count].reshape(1 + PARAMETERS + SCRATCH, count)
    slope, depth, double, twice, wide = r[used + 1], r[used + 2], r[used + 3], r[used + 4], r[used + 5]
    sharp = np.float32(np.exp(-p[7]))
    depths(s, x, y, count, depth, slope)
    _directions(s, x, y, slope, count, double, twice)
    _widths(s[8], s[9], double, twice, count, wide)
    light, share, bell = r[5], r[6], r[7]
    _lights(s, x, y, count, light)
    _shares(sharp, depth, wide, count, bell, share)
    _residuals(s[5], s[6], level, light, share, count, r[used])
    if used > PLAIN:
        _by_growth(s, x, y, share, count, r[10], r[11])
        _by_cubes(s, x, y, r[10], count, r[12], r[14])
        _by_cubes(s, x, y, r[11], count, r[13], r[15])
    _by_levels(sharp * s[6], wide, light, count, bell, share)
    _by_center(s, x, y, bell, slope, count, r[0], r[1])
    _by_form(s, x, y, bell, slope, count, r[2], r[3])
    _by_last_form(s[1], y, bell, slope, count, r[4])
    _by_blur(depth, count, bell)
    _by_width(bell, wide, double, count, r[8])
    _by_width(bell, wide, twice, count, r[9])
    products: Single = np.dot(r[: used + 1], r[: used + 1].T)
    return products


@compiled
def depths(s: Single, x: Single, y: Single, count: int, depth: Single, slope: Single) -> None:
    """The signed distances of pixels inside the ellipse, to first order (exact for circles), and one over the quadratic
    form's half gradient."""
    px, py, a, b, c = s[0], s[1], s[2], s[3], s[4]
    for k in range(count):
        dx, dy = x[k] - px, y[k] - py
        to_x, to_y = a * dx + b * dy, b * dx + c * dy
        root = np.sqrt(max(to_x * dx + to_y * dy, _TINY))
        slope[k] = _ONE / np.sqrt(max(to_x * to_x + to_y * to_y, _FLAT))
        depth[k] = (_ONE - root) * root * slope[k]


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
def _by_levels(factor: np.float32, wide: Single, light: Single, count: int, bell: Single, share: Single) -> None:
    """The density becomes the levels' derivative by the depth, and the share that by the contrast."""
    for k in range(count):
        bell[k], share[k] = factor * bell[k] * light[k] * np.sqrt(wide[k]), share[k] * light[k]


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
def _by_growth(s: Single, x: Single, y: Single, share: Single, count: int, right: Single, down: Single) -> None:
    px, py, back, contrast = s[0], s[1], s[5], s[6]
    for k in range(count):
        even = back + contrast * share[k]
        right[k], down[k] = even * (x[k] - px), even * (y[k] - py)


@compiled
def _by_cubes(s: Single, x: Single, y: Single, growth: Single, count: int, first: Single, second: Single) -> None:
    """A growth times dx^2 and dy^2: of x these are x^3 and x y^2, of y x^2 y and y^3."""
    px, py = s[0], s[1]
    for k in range(count):
        dx, dy = x[k] - px, y[k] - py
        first[k], second[k] = growth[k] * dx * dx, growth[k] * dy * dy


@compiled
def _by_blur(depth: Single, count: int, steep: Single) -> None:
    """The steepness becomes the derivative by the logarithm of the blur."""
    for k in range(count):
        steep[k] = -steep[k] * depth[k]


@compiled
def _by_width(by_blur: Single, wide: Single, direction: Single, count: int, out: Single) -> None:
    for k in range(count):
        out[k] = _HALF * by_blur[k] * wide[k] * direction[k]


# ------------------------------------------------------------------------------------------------------------------
# Which pixels a dot's fit takes, compiled: a square round the dot, of which those near its edge are kept.

OUTSIDE = 3.0  # pixels beyond the edge that take part
INSIDE = 3.5  # pixels inside the edge that take part, at least
_FEW = 150  # pixels, of which the rough steps take them all


@compiled
def reach(spread: Floats) -> int:
    """How many pixels from its own a dot reaches, room included."""
    half = 0.5 * (spread[0, 0] + spread[1, 1])
    long = half + np.sqrt(max(0.25 * (spread[0, 0] - spread[1, 1]) ** 2 + spread[0, 1] ** 2, 0.0))
    return int(2.0 * np.sqrt(long) + OUTSIDE + 0.7) + 1


@compiled
def square(
    shape: tuple[int, int], at_x: int, at_y: int, far: int, unit: float, x: Single, y: Single
) -> tuple[int, int]:
    """The places of the pixels in a square round the dot, every third one first; how many, and how many of these."""
    height, width = shape
    low, high = max(-far, -at_x), min(far, width - 1 - at_x)
    size, third = 0, 0
    for turn in range(2):
        for row in range(max(-far, -at_y), min(far, height - 1 - at_y) + 1):
            first = low + (row - low) % 3  # the first column of those that are taken in the first turn
            if turn == 0:
                for column in range(first, high + 1, 3):
                    x[size], y[size] = column / unit, row / unit
                    size += 1
                continue
            for column in range(low, high + 1):
                if column == first:
                    first += 3
                else:
                    x[size], y[size] = column / unit, row / unit
                    size += 1
        third = size if turn == 0 else third
    return size, third


@compiled
def gathered(
    grey: Grey,
    at_x: int,
    at_y: int,
    unit: float,
    room: float,
    size: int,
    third: int,
    x: Single,
    y: Single,
    depth: Single,
    level: Single,
) -> tuple[int, int]:
    """Keeps the pixels of a square that are the dot's: how many, and how many of these the rough steps take."""
    count, rough = 0, 0
    least, most = -room / unit, INSIDE / unit
    for k in range(size):
        if least < depth[k] < most:
            x[count], y[count], depth[count] = x[k], y[k], depth[k]
            level[count] = grey[at_y + int(np.rint(y[k] * unit)), at_x + int(np.rint(x[k] * unit))]
            count += 1
            rough += k < third
    return count, (rough if count >= _FEW else count)


# ------------------------------------------------------------------------------------------------------------------
# Blurred ellipses fitted to dots' pixels, dot by dot, as compiled loops: Gauss-Newton steps, first on some pixels.

ODD = CUBIC - PLAIN  # parameters of the light
RESULTS = 14  # numbers of a fit, see `fit_dots`
_ROUGH_STEPS = 4
_FINE_STEPS = 6
_ROUGH = 0.05  # pixels: the change of the centre that ends the rough steps
_FINE = 0.018  # and the fine ones: what they leave is 1.5 % of the centre's deviation (RMS; a twentieth of one at most)
_SMALL = 4.0  # pixels of radius: of a smaller dot no one can tell an ellipse from a blur that is wider one way
_STEEPEST = 0.85  # growth of the light from a dot's centre to its edge: more of it is no light but half a dot
_RIDGE, _LEAST = 1e-7, 1e-24  # of the normal matrix, relative to its diagonal; and the least diagonal
_SOFT = 0.5  # of a spot's second moments: where a fit that failed begins again
_EVEN = 0.1  # standard deviation of the parameters 8 and 9 before anything is seen: only motion makes them large


@compiled
def fit_dots(
    grey: Grey, center: Floats, spread: Floats, room: Floats, light: Floats, used: int, out: Floats, odd: Floats
) -> None:
    """Fits of dots from `center` (n, 2) and second moments `spread` (n, 2, 2), pixels; `room` (n,) pixels beyond the
    edge are the dot's own; `light` (n, 2) is its growth per pixel, where the fit begins (or stays: `used` is PLAIN).

    out (n, RESULTS): centre, conic xx xy yy, back, contrast, blur, covariance xx xy yy of the centre, noise, variance
    of the grey levels, pixels; left as it is (nan) where a fit fails. odd (n, ODD, ODD + 3): of the light's further
    parameters, had they been fitted as well, the inverse covariance, times that their values, and how far (pixels, x
    and y) each of them moves the centre.
    """
    longest = 0
    for i in range(len(center)):
        longest = max(longest, reach(spread[i]))
    most = (2 * longest + 1) ** 2
    x, y, depth = np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.float32)
    level, rows = np.empty(most, np.float32), np.empty((1 + PARAMETERS + SCRATCH) * most, np.float32)
    for i in range(len(center)):
        p = np.zeros(PARAMETERS)
        unit = _begin(p, center[i], spread[i], light[i])
        at_x, at_y = int(np.rint(center[i, 0])), int(np.rint(center[i, 1]))
        size, third = square(grey.shape, at_x, at_y, reach(spread[i]), unit, x, y)
        depths(p.astype(np.float32), x, y, size, depth, level)  # the levels are not there yet
        count, rough = gathered(grey, at_x, at_y, unit, room[i], size, third, x, y, depth, level)
        if count <= 2 * PLAIN:
            continue
        variance = _levels(p, unit, depth, level, count)
        _run(p, unit, x, y, level, count, rough, used, rows, out[i], odd[i])
        out[i, 0] += at_x
        out[i, 1] += at_y
        out[i, 12] = variance


@compiled
def _begin(p: Floats, center: Floats, spread: Floats, light: Floats) -> float:
    """Place, shape and light; returns the unit of length, pixels."""
    det = spread[0, 0] * spread[1, 1] - spread[0, 1] ** 2
    unit: float = 2.0 * np.sqrt(np.sqrt(max(det, 1e-12)))
    p[0], p[1] = (center[0] - np.rint(center[0])) / unit, (center[1] - np.rint(center[1])) / unit
    scale = 0.25 * unit * unit / max(det, 1e-12)
    p[2], p[3], p[4] = scale * spread[1, 1], -scale * spread[0, 1], scale * spread[0, 0]
    p[10], p[11] = light[0] * unit, light[1] * unit
    return unit


@compiled
def _levels(p: Floats, unit: float, depth: Single, level: Single, count: int) -> float:
    """Back, contrast and blur to begin with; returns the variance of the levels about the back's."""
    deep = 0.0
    for k in range(count):
        deep = max(deep, depth[k])
    deep = min(1.5 / unit, 0.4 * deep)
    outer, outers, inner, inners = 0.0, 0, 0.0, 0
    for k in range(count):
        if depth[k] < -1.5 / unit:
            outer, outers = outer + level[k], outers + 1
        elif depth[k] > deep:
            inner, inners = inner + level[k], inners + 1
    back = outer / max(outers, 1)
    p[5], p[6], p[7] = back, inner / max(inners, 1) - back, -np.log(unit)  # a blur of one pixel
    total, squares = 0.0, 0.0
    for k in range(count):
        total, squares = total + level[k] - back, squares + (level[k] - back) ** 2
    return squares / count - (total / count) ** 2


@compiled
def _run(
    p: Floats,
    unit: float,
    x: Single,
    y: Single,
    level: Single,
    count: int,
    rough: int,
    used: int,
    rows: Single,
    out: Floats,
    odd: Floats,
) -> None:
    """Gauss-Newton steps: rough ones on some pixels, fine ones on all."""
    step, moved = np.zeros(PARAMETERS), np.inf
    for _ in range(_ROUGH_STEPS):
        matrix = normal_equations(p, x, y, level, rough, PLAIN if used == PLAIN else PARAMETERS, rows)
        moved = _stepped(p, unit, used, rough, matrix, step)
        if not moved > _ROUGH:
            break
    for _ in range(_FINE_STEPS):
        if np.isnan(moved):
            return
        matrix = normal_equations(p, x, y, level, count, PARAMETERS, rows)
        moved = _stepped(p, unit, used, count, matrix, step)
        if moved <= _FINE and _growth(p) < _STEEPEST:
            _result(p, unit, used, count, matrix, step, out)
            if used < CUBIC:
                _further(matrix, _moves(p), unit, used, out[11] ** 2, odd)
            return


@compiled
def _stepped(p: Floats, unit: float, used: int, count: int, matrix: Single, step: Floats) -> float:
    """Takes a step; returns how far it moves the centre, pixels, or a tenth of the shape; nan where there is none,
    or it leads nowhere."""
    prior = max(matrix[-1, -1], 1e-12) / max(count, 1) / (_EVEN if unit > _SMALL else 0.01 * _EVEN) ** 2
    for i in range(8, PLAIN):
        matrix[i, i] += prior
        matrix[-1, i] -= prior * p[i]
    if not _solved(matrix, used, matrix[-1], step):
        return np.nan
    for i in range(used):
        limit = 0.3 if i < 2 or 8 <= i < 10 else 0.5 if i < 5 else np.inf if i < 7 else 0.7 if i == 7 else 0.2
        p[i] += min(max(step[i], -limit), limit)
    for i in range(8, PLAIN):
        p[i] = min(max(p[i], -0.65), 0.65)
    fine = p[2] > 0.0 and p[2] * p[4] - p[3] ** 2 > 1e-3 and max(abs(p[2]), abs(p[3]), abs(p[4])) < 20.0
    if not (fine and max(abs(p[0]), abs(p[1])) < 1.0 and abs(p[7]) < 6.0):
        return np.nan
    shape = max(abs(step[2]), abs(step[3]), abs(step[4]), abs(step[7]))
    moved: float = max(abs(step[0]), abs(step[1]), 0.1 * shape) * unit
    return moved


@compiled
def _solved(matrix: Single, size: int, right: Floats, out: Floats) -> bool:
    """out = matrix^-1 right, of the first `size`, all finite."""
    if not solved(matrix, size, _RIDGE, _LEAST, right, out):
        return False
    total = 0.0
    for i in range(size):
        total += abs(out[i])
    return bool(np.isfinite(total))


@compiled
def _growth(p: Floats) -> float:
    """How much the light grows, relative to that at the centre, from there to the edge of a round dot, at most."""
    most = 0.0
    for k in range(8):
        x, y = np.cos(np.pi / 8 * k), np.sin(np.pi / 8 * k)
        cubic = ((p[12] * x + p[13] * y) * x + p[14] * y * y) * x + p[15] * y**3
        most = max(most, abs(p[10] * x + p[11] * y + cubic))
    return most


@compiled
def _result(p: Floats, unit: float, used: int, count: int, matrix: Single, step: Floats, out: Floats) -> None:
    squares = matrix[-1, -1]
    for i in range(used):  # after the step, to first order
        squares -= matrix[-1, i] * step[i]
    variance = max(squares, 0.0) / max(count - used, 1)
    moves, by_x, by_y = _moves(p), np.zeros(used), np.zeros(used)
    factor, scales = np.empty((used, used)), np.empty(used)
    if not factored(matrix, used, _RIDGE, _LEAST, factor, scales):
        return
    substituted(factor, scales, used, moves[0], by_x)
    substituted(factor, scales, used, moves[1], by_y)
    out[0], out[1] = np.dot(moves[0], p) * unit, np.dot(moves[1], p) * unit
    for i in range(3):
        out[2 + i] = p[2 + i] / unit**2
    out[5], out[6], out[7] = p[5], p[6], np.exp(p[7]) * unit
    scale = variance * unit * unit
    out[8], out[9] = scale * np.dot(moves[0, :used], by_x), scale * np.dot(moves[1, :used], by_x)
    out[10] = scale * np.dot(moves[1, :used], by_y)
    out[11], out[13] = np.sqrt(variance), count


@compiled
def _moves(p: Floats) -> Floats:
    """How the centre (x, y) depends on the parameters, (2, PARAMETERS).

    Light falls on the plate before the optics blur it: a blur of the covariance B makes of a step S under light l not
    l S but l S + (B grad l) . grad S, a step moved by -B grad l / l. The fit's ellipse is so moved; this takes it back.
    Of the gradient of a cubic the first harmonic on the dot's edge counts.
    """
    square = np.exp(p[7]) ** 2
    xx, xy, yy = square * (1.0 + p[8]), square * p[9], square * (1.0 - p[8])
    out = np.zeros((2, PARAMETERS))
    out[0, 0], out[1, 1] = 1.0, 1.0
    for i in range(2):
        along_x, along_y = (xx, xy) if i == 0 else (xy, yy)
        out[i, 10], out[i, 11] = along_x, along_y
        out[i, 12], out[i, 13], out[i, 14], out[i, 15] = (
            2.25 * along_x,
            0.75 * along_y,
            0.75 * along_x,
            2.25 * along_y,
        )
    return out


@compiled
def _further(matrix: Single, moves: Floats, unit: float, used: int, variance: float, odd: Floats) -> None:
    """What the light's parameters from `used` on would be: information and right side after the odd ones before them
    (centre, and light as far as it was fitted) were eliminated, and how they would move the centre."""
    size, before = 2 + ODD, 2 + used - PLAIN
    block = np.empty((size, size + 1))
    for i in range(size):
        at = i if i < 2 else i - 2 + PLAIN
        for j in range(size):
            block[i, j] = matrix[at, j if j < 2 else j - 2 + PLAIN]
        block[i, size] = matrix[-1, at]
    for k in range(before):
        pivot = block[k, k]
        for j in range(k, size + 1):
            block[k, j] /= pivot
        for i in range(size):
            share = block[i, k]
            if i != k and (i > k or i < before):
                for j in range(k, size + 1):
                    block[i, j] -= share * block[k, j]
    scale = 1.0 / max(variance, 1e-12)
    for i in range(before, size):
        odd[i - 2, ODD] = scale * block[i, size]
        for axis in range(2):
            move = moves[axis, i - 2 + PLAIN]
            for k in range(before):
                move -= moves[axis, k if k < 2 else k - 2 + PLAIN] * block[k, i]
            odd[i - 2, ODD + 1 + axis] = unit * move
        for j in range(before, size):
            odd[i - 2, j - 2] = scale * block[i, j]


@dataclass(frozen=True, eq=False)
class Edges:
    """The fits of n dots, nan where one failed.

    center      (n, 2) pixels
    conic       (n, 2, 2): the edge is (p - center)^T conic (p - center) = 1
    covariance  (n, 2, 2) px^2 of the centre, by the residuals
    back, contrast  (n,) grey levels around the dot, and how much brighter it is
    blur        (n,) standard deviation of the edge's spread, pixels
    noise       (n,) standard deviation of the residuals, grey levels
    variance    (n,) of the grey levels that took part
    odd         (n, 6, 9): light's growth (2) and its cubic (4), per dot's radius, had they been fitted as well: their
                inverse covariance, times that their values, and how far (pixels, x and y) each moves the centre; zero
                for those that were fitted
    """

    center: Floats
    conic: Floats
    covariance: Floats
    back: Floats
    contrast: Floats
    blur: Floats
    noise: Floats
    variance: Floats
    odd: Floats

    def kept(self, members: npt.NDArray[Any]) -> Edges:
        return Edges(*(getattr(self, field.name)[members] for field in fields(self)))

    def replaced(self, members: npt.NDArray[Any], others: Edges) -> Edges:
        """With `others` in the place of its `members`."""
        arrays = [getattr(self, field.name).copy() for field in fields(self)]
        for array, field in zip(arrays, fields(self), strict=True):
            array[members] = getattr(others, field.name)
        return Edges(*arrays)

    @cached_property
    def axes(self) -> Floats:
        """(n, 2) semi-axes, pixels, the longer first."""
        conic = np.where(np.isfinite(self.conic), self.conic, np.eye(2))
        axes = 1.0 / np.sqrt(np.maximum(eigenvalues(conic), 1e-12))
        axes[np.isnan(self.blur)] = np.nan
        return axes

    @property
    def extent(self) -> Floats:
        """(n, 2) half the sides of the upright box around the ellipse, pixels."""
        xx, xy, yy = self.conic[:, 0, 0], self.conic[:, 0, 1], self.conic[:, 1, 1]
        return np.sqrt(np.stack([yy, xx], axis=1) / (xx * yy - xy * xy)[:, None])


def fitted_edges(grey: Grey, center: Floats, spread: Floats, room: Floats, light: Floats, used: int = PLAIN) -> Edges:
    """The blurred ellipses next to those of `center` (n, 2) and second moments `spread` (n, 2, 2), pixels; `room` (n,)
    pixels beyond the edge are the dot's own; `light` (n, 2) the share by which it grows per pixel. With `used` LINEAR
    or CUBIC each dot tells the light's growth, or also its cubic, itself. Where the fit fails the numbers are nan."""
    out, odd = np.full((len(center), RESULTS), np.nan), np.zeros((len(center), ODD, ODD + 3))
    fit_dots(grey, center, spread, room, light, used, out, odd)
    if (failed := np.flatnonzero(np.isnan(out[:, 0]))).size:  # a soft dot's spot reaches beyond its edge
        again, odd_again = out[failed], odd[failed]
        fit_dots(grey, center[failed], _SOFT * spread[failed], room[failed], light[failed], used, again, odd_again)
        out[failed], odd[failed] = again, odd_again
    conic, covariance = out[:, [[2, 3], [3, 4]]], out[:, [[8, 9], [9, 10]]]
    back, contrast, blur, noise, variance = out[:, [5, 6, 7, 11, 12]].T
    return Edges(out[:, :2], conic, covariance, back, contrast, blur, noise, variance, odd)
