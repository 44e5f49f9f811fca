"""Blurred ellipses fitted to the grey levels round dots: the likeliest centre for pixels' noise.

The model of a pixel at signed distance d inside the ellipse is light (back + contrast Phi(d / blur)): the edge spread
of a Gaussian blur (the pixel's own square is part of it), which may be wider in one direction (motion), under light
that grows linearly. The ellipse is where the grey is half-way between back and dot; the
centre is freed of what a blur makes of steep light (`edge_fit._moves`). Gauss-Newton steps
on all pixels use every bit of information on the edge that the image holds, so errors are close to the Cramer-Rao
bound, and the inverse normal matrix is their covariance. What the model leaves out and is symmetric about the centre
moves the ellipse but not its centre; what is not symmetric, light, is tested for.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import numpy.typing as npt

from cpcal.common.values import AnyArray, Floats, Ints
from cpcal.solver.compiled import compiled
from cpcal.vision.opencv import Grey
from cpcal.vision.projection import eigenvalues, solved

# ------------------------------------------------------------------------------------------------------------------
# The grey levels that a blurred ellipse under light makes of pixels, and the normal equations of its parameters.
#
# The parameters p, lengths in units of the dot's radius, places from a pixel of its own:
#
# 0, 1 centre; 2, 3, 4 the conic's xx, xy, yy; 5 grey level around; 6 contrast; 7 logarithm of the blur; 8, 9 how the
# blur's square differs by the edge's direction a: by the share p8 cos 2a + p9 sin 2a (motion); 10, 11 the light's
# growth to the right and down.
#
# A derivative is an array over the dot's pixels, in single precision. Each loop runs over pixels without a branch and
# without calls of the mathematics library and writes one or two arrays: of such loops the compiler can prove that
# nothing overlaps, and treats sixteen pixels at once.

Single = npt.NDArray[np.float32]

PARAMETERS = LINEAR = 12  # under light of the dot's own
PLAIN = 10  # of them, under a light that is known
SCRATCH = 5  # arrays beside the derivatives and the residuals
_DIM = np.float32(0.05)  # light, at least, relative to that at the centre; and width
_TINY, _FLAT = np.float32(1e-12), np.float32(1e-8)  # of squares next to the centre
_ZERO, _HALF, _ONE, _TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
_BELL = np.float32(0.3989422804014327)  # 1 / sqrt(2 pi)
_FAR, _PART = np.float32(20.0), np.float32(1.0 / 64.0)
_C3, _C4, _C5 = np.float32(1.0 / 6.0), np.float32(1.0 / 24.0), np.float32(1.0 / 120.0)
_A0, _A1, _A2, _A3 = np.float32(0.33267), np.float32(0.4361836), np.float32(-0.1201676), np.float32(0.9372980)


@compiled
def normal_equations(p: Floats, x: Single, y: Single, level: Single, used: int, rows: Single) -> Single:
    """The products (used + 1, used + 1) of the first `used` derivatives (PLAIN or PARAMETERS), and in the last row and
    column those of the residuals, over the pixels; `rows` is room for 1 + PARAMETERS + SCRATCH arrays of
    them."""
    s, sharp, count = p.astype(np.float32), np.float32(np.exp(-p[7])), len(x)
    px, py, a, b, c, back, contrast, p8, p9 = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[8], s[9]
    gx, gy, factor = s[10], s[11], sharp * contrast
    r = rows[: (1 + PARAMETERS + SCRATCH) * count].reshape(1 + PARAMETERS + SCRATCH, count)
    depth, slope, double, twice, wide = r[used + 1], r[used + 2], r[used + 3], r[used + 4], r[used + 5]
    light, share, bell, residual = r[5], r[6], r[7], r[used]
    depths(s, x, y, count, depth, slope)
    for k in range(count):  # cos 2a and sin 2a of the gradient's direction a
        dx, dy = x[k] - px, y[k] - py
        to_x, to_y = (a * dx + b * dy) * slope[k], (b * dx + c * dy) * slope[k]
        double[k], twice[k] = to_x * to_x - to_y * to_y, _TWO * to_x * to_y
    for k in range(count):  # one over the square of the blur across the edge relative to its mean
        wide[k] = _ONE / max(_ONE + p8 * double[k] + p9 * twice[k], _DIM)
    for k in range(count):
        light[k] = max(_ONE + gx * (x[k] - px) + gy * (y[k] - py), _DIM)
    for k in range(count):  # the normal distribution's density and function (to 1e-5: Abramowitz and Stegun 26.2.16)
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
    for k in range(count):
        residual[k] = level[k] - light[k] * (back + contrast * share[k])
    if used > PLAIN:
        to_right, down = r[10], r[11]
        for k in range(count):
            even = back + contrast * share[k]
            to_right[k], down[k] = even * (x[k] - px), even * (y[k] - py)
    for k in range(count):  # the density becomes the levels' derivative by the depth, and the share that by contrast
        bell[k], share[k] = factor * bell[k] * light[k] * np.sqrt(wide[k]), share[k] * light[k]
    by_x, by_y, by_xx, by_xy, by_yy, by_even, by_odd = r[0], r[1], r[2], r[3], r[4], r[8], r[9]
    for k in range(count):
        dx, dy, by_form = x[k] - px, y[k] - py, bell[k] * slope[k]
        by_x[k], by_y[k] = by_form * (a * dx + b * dy), by_form * (b * dx + c * dy)
    for k in range(count):
        dx, dy, by_form = x[k] - px, y[k] - py, bell[k] * slope[k]
        by_xx[k], by_xy[k] = -_HALF * by_form * dx * dx, -by_form * dx * dy
    for k in range(count):
        dy = y[k] - py
        by_yy[k] = -_HALF * bell[k] * slope[k] * dy * dy
    for k in range(count):  # the steepness becomes the derivative by the logarithm of the blur
        bell[k] = -bell[k] * depth[k]
    for k in range(count):
        by_even[k], by_odd[k] = _HALF * bell[k] * wide[k] * double[k], _HALF * bell[k] * wide[k] * twice[k]
    products: Single = np.dot(r[: used + 1], r[: used + 1].T)
    return products


# ------------------------------------------------------------------------------------------------------------------
# Which pixels a dot's fit takes, compiled: a square round the dot, of which those near its edge are kept.

OUTSIDE = 3.0  # pixels beyond the edge that take part
INSIDE = 3.5  # pixels inside the edge that take part, at least


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
def gathered(grey: Grey, at_x: int, at_y: int, unit: float, room: float, p: Floats, far: int, rows: Single) -> int:
    """The pixels in a square round the dot that are the dot's: how many, and their places, depths and grey levels in
    the first four of the `rows`."""
    height, width = grey.shape
    x, y, depth, level, slope = rows[0], rows[1], rows[2], rows[3], rows[4]
    size = 0
    for row in range(max(-far, -at_y), min(far, height - 1 - at_y) + 1):
        for column in range(max(-far, -at_x), min(far, width - 1 - at_x) + 1):
            x[size], y[size], level[size] = column / unit, row / unit, grey[at_y + row, at_x + column]
            size += 1
    depths(p.astype(np.float32), x, y, size, depth, slope)
    count, least, most = 0, -room / unit, INSIDE / unit
    for k in range(size):
        if least < depth[k] < most:
            x[count], y[count], depth[count], level[count] = x[k], y[k], depth[k], level[k]
            count += 1
    return count


# ------------------------------------------------------------------------------------------------------------------
# Blurred ellipses fitted to dots' pixels, dot by dot, as compiled loops: Gauss-Newton steps, first on some pixels.

ODD = LINEAR - PLAIN  # parameters of the light
RESULTS = 13  # numbers of a fit, see `fit_dots`
_MANY = 150  # pixels, of which a third does for rough steps
_ROUGH_STEPS, _FINE_STEPS = 4, 6
_ROUGH = 0.05  # pixels: the change of the centre that ends the rough steps
_FINE = 0.018  # and the fine ones: what they leave is 1.5 % of the centre's deviation (RMS; a twentieth of one at most)
_SMALL = 4.0  # pixels of radius: of a smaller dot no one can tell an ellipse from a blur that is wider one way
_STEEPEST = 0.85  # growth of the light from a dot's centre to its edge: more of it is no light but half a dot
_RIDGE, _LEAST = 1e-7, 1e-24  # of the normal matrix, relative to its diagonal; and the least diagonal
_SOFT = 0.5  # of a spot's second moments: where a fit that failed begins again
_LONGEST = np.array([0.3, 0.3, 0.5, 0.5, 0.5, np.inf, np.inf, 0.7, 0.3, 0.3, 0.2, 0.2])  # of a parameter's steps
_SHRUNK = 0.7  # of a spot's area, at least: what of it is the dot's by its grey levels
_EVEN = 0.1  # standard deviation of the parameters 8 and 9 before anything is seen: only motion makes them large


@compiled
def fit_dots(
    grey: Grey,
    center: Floats,
    spread: Floats,
    reach: Ints,
    room: Floats,
    light: Floats,
    used: int,
    out: Floats,
    odd: Floats,
) -> None:
    """Fits of dots from `center` (n, 2) and second moments `spread` (n, 2, 2), pixels; none reaches farther than
    `reach` (n,) pixels from its own, `room` (n,) pixels beyond the edge included; `light` (n, 2) is its growth per
    pixel, where the fit begins (or stays: `used` is PLAIN).

    out (n, RESULTS): centre, conic xx xy yy, back, contrast, blur, covariance xx xy yy of the centre, noise, variance
    of the grey levels; left as it is (nan) where a fit fails. odd (n, ODD, ODD + 3): of the light's growth,
    had it been fitted as well, the inverse covariance, times that the values, and how far (pixels, x and y)
    each moves the centre.
    """
    most = (2 * reach.max() + 1) ** 2
    pixels, rows = np.empty((5, most), np.float32), np.empty((1 + PARAMETERS + SCRATCH) * most, np.float32)
    x, y, depth, level = pixels[0], pixels[1], pixels[2], pixels[3]
    for i in range(len(center)):
        p = np.zeros(PARAMETERS)
        unit = _begin(p, center[i], spread[i], light[i])
        at_x, at_y = int(np.rint(center[i, 0])), int(np.rint(center[i, 1]))
        count = gathered(grey, at_x, at_y, unit, room[i], p, reach[i], pixels)
        if count <= 2 * PLAIN:
            continue
        variance = _levels(p, unit, depth[:count], level[:count])
        _run(p, unit, x[:count], y[:count], level[:count], used, rows, out[i], odd[i])
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
def _levels(p: Floats, unit: float, depth: Single, level: Single) -> float:
    """Back, contrast, size and blur to begin with; returns the variance of the levels."""
    out, deep = -1.5 / unit, min(1.5 / unit, 0.4 * max(depth.max(), 0.0))
    total, squares, outer, inner, outside, inside, within = 0.0, 0.0, 0.0, 0.0, 0, 0, 0
    for k in range(len(level)):
        grey, d = float(level[k]), depth[k]
        total, squares, within = total + grey, squares + grey * grey, within + (d > _ZERO)
        outer, outside = outer + grey * (d < out), outside + (d < out)
        inner, inside = inner + grey * (d > deep), inside + (d > deep)
    back, mean = outer / max(outside, 1), total / len(level)
    p[5], p[6], p[7] = back, inner / max(inside, 1) - back, -np.log(unit)  # a blur of one pixel
    beyond = (total - back * len(level)) / p[6] - within  # pixels' worth of the dot, whatever the blur
    p[2:5] /= min(max(1.0 + beyond / (np.pi * unit * unit), _SHRUNK), 1.0 / _SHRUNK)
    return squares / len(level) - mean * mean


@compiled
def _run(
    p: Floats, unit: float, x: Single, y: Single, level: Single, used: int, rows: Single, out: Floats, odd: Floats
) -> None:
    """Gauss-Newton steps: rough ones on every third pixel, fine ones on all."""
    step, moved, count = np.zeros(PARAMETERS), np.inf, len(x)
    thin = 3 if count >= _MANY else 1
    some_x, some_y, some = x[::thin].copy(), y[::thin].copy(), level[::thin].copy()
    for _ in range(_ROUGH_STEPS):
        moved = _stepped(p, unit, used, len(some), normal_equations(p, some_x, some_y, some, used, rows), step)
        if not moved > _ROUGH:
            break
    for _ in range(_FINE_STEPS):
        if np.isnan(moved):
            return
        matrix = normal_equations(p, x, y, level, PARAMETERS, rows)
        moved = _stepped(p, unit, used, count, matrix, step)
        if moved <= _FINE and np.hypot(p[10], p[11]) < _STEEPEST:
            _result(p, unit, used, count, matrix, step, out)
            if used == PLAIN:
                _further(matrix, _moves(p), unit, out[11] ** 2, odd)
            return


@compiled
def _stepped(p: Floats, unit: float, used: int, count: int, matrix: Single, step: Floats) -> float:
    """Takes a step; returns how far it moves the centre, pixels, or a tenth of the shape; nan where there is none,
    or it leads nowhere."""
    prior = max(matrix[-1, -1], 1e-12) / max(count, 1) / (_EVEN if unit > _SMALL else 0.01 * _EVEN) ** 2
    for i in range(8, PLAIN):
        matrix[i, i] += prior
        matrix[-1, i] -= prior * p[i]
    if not solved(matrix, used, _RIDGE, _LEAST, matrix[-1], step) or not np.isfinite(step[:used]).all():
        return np.nan
    for i in range(used):
        p[i] += min(max(step[i], -_LONGEST[i]), _LONGEST[i])
    for i in range(8, PLAIN):
        p[i] = min(max(p[i], -0.65), 0.65)
    fine = p[2] > 0.0 and p[2] * p[4] - p[3] ** 2 > 1e-3 and max(p[2], p[4]) < 20.0
    if not (fine and max(abs(p[0]), abs(p[1])) < 1.0 and abs(p[7]) < 6.0):
        return np.nan
    shape = max(abs(step[2]), abs(step[3]), abs(step[4]), abs(step[7]))
    moved: float = max(abs(step[0]), abs(step[1]), 0.1 * shape) * unit
    return moved


@compiled
def _result(p: Floats, unit: float, used: int, count: int, matrix: Single, step: Floats, out: Floats) -> None:
    squares = matrix[-1, -1]
    for i in range(used):  # after the step, to first order
        squares -= matrix[-1, i] * step[i]
    variance = max(squares, 0.0) / max(count - used, 1)
    moves, by = _moves(p), np.zeros((2, used))
    for k in range(2):
        solved(matrix, used, _RIDGE, _LEAST, moves[k], by[k])  # as the step was
        out[k] = np.dot(moves[k], p) * unit
    out[2:5], out[5:7], out[7] = p[2:5] / unit**2, p[5:7], np.exp(p[7]) * unit
    scale = variance * unit * unit
    out[8], out[9] = scale * np.dot(moves[0, :used], by[0]), scale * np.dot(moves[1, :used], by[0])
    out[10] = scale * np.dot(moves[1, :used], by[1])
    out[11] = np.sqrt(variance)


@compiled
def _moves(p: Floats) -> Floats:
    """How the centre (x, y) depends on the parameters, (2, PARAMETERS).

    Light falls on the plate before the optics blur it: a blur of the covariance B makes of a step S under light l not
    l S but l S + (B grad l) . grad S, a step moved by -B grad l / l. The fit's ellipse is so moved; this takes it back.
    """
    square = np.exp(p[7]) ** 2
    xx, xy, yy = square * (1.0 + p[8]), square * p[9], square * (1.0 - p[8])
    out = np.zeros((2, PARAMETERS))
    out[0, 0], out[1, 1] = 1.0, 1.0
    out[0, 10], out[0, 11], out[1, 10], out[1, 11] = xx, xy, xy, yy
    return out


@compiled
def _further(matrix: Single, moves: Floats, unit: float, variance: float, odd: Floats) -> None:
    """What the light's growth would be: information and right side after the centre was eliminated, and how it would
    move the centre."""
    full = matrix.astype(np.float64)
    xx, xy, yy, by_x, by_y = full[0, 0], full[0, 1], full[1, 1], full[0, PLAIN:], full[1, PLAIN:]
    det = xx * yy - xy * xy
    x, y = (yy * by_x - xy * by_y) / det, (xx * by_y - xy * by_x) / det
    for i in range(ODD):
        odd[i, :3] = (full[PLAIN + i, PLAIN:] - x[i] * by_x - y[i] * by_y) / max(variance, 1e-12)
        odd[i, 3], odd[i, 4] = unit * (moves[0, PLAIN + i] - x[i]), unit * (moves[1, PLAIN + i] - y[i])


@dataclass(frozen=True, eq=False)
class Edges:
    """The fits of n dots, nan where one failed.

    center      (n, 2) pixels
    conic       (n, 2, 2): the edge is (p - center)^T conic (p - center) = 1
    covariance  (n, 2, 2) px^2 of the centre, by the residuals
    contrast    (n,) grey levels by which the dot is brighter than around it
    blur        (n,) standard deviation of the edge's spread, pixels
    noise       (n,) standard deviation of the residuals, grey levels
    variance    (n,) of the grey levels that took part
    odd         (n, 2, 5): light's growth to the right and down, per dot's radius, had it been fitted as well: the
                inverse covariance, times that the values, and how far (pixels, x and y) each moves the centre; zero
                where it was fitted
    """

    center: Floats
    conic: Floats
    covariance: Floats
    contrast: Floats
    blur: Floats
    noise: Floats
    variance: Floats
    odd: Floats

    def kept(self, members: AnyArray) -> Edges:
        return Edges(*(getattr(self, field.name)[members] for field in fields(self)))

    def replaced(self, members: AnyArray, others: Edges) -> Edges:
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


def fitted_edges(grey: Grey, center: Floats, spread: Floats, room: Floats, light: Floats, used: int = PLAIN) -> Edges:
    """The blurred ellipses next to those of `center` (n, 2) and second moments `spread` (n, 2, 2), pixels; `room` (n,)
    pixels beyond the edge are the dot's own; `light` (n, 2) the share by which it grows per pixel. With `used` LINEAR
    each dot tells the light's growth itself. Where the fit fails the numbers are nan."""
    out, odd = np.full((len(center), RESULTS), np.nan), np.zeros((len(center), ODD, ODD + 3))
    todo = np.arange(len(center))
    for soft in (1.0, _SOFT):  # a soft dot's spot reaches beyond its edge
        if todo.size:
            some, again, odd_again = soft * spread[todo], out[todo], odd[todo]
            reach = (2.0 * np.sqrt(eigenvalues(some)[:, 1]) + OUTSIDE + 1.7).astype(np.int64)
            fit_dots(grey, center[todo], some, reach, room[todo], light[todo], used, again, odd_again)
            out[todo], odd[todo] = again, odd_again
        todo = np.flatnonzero(np.isnan(out[:, 0]))
    contrast, blur, noise, variance = out[:, [6, 7, 11, 12]].T
    pairs = out[:, :2], out[:, [[2, 3], [3, 4]]], out[:, [[8, 9], [9, 10]]]
    return Edges(*pairs, contrast, blur, noise, variance, odd)
