"""Blurred ellipses fitted to dots' pixels, dot by dot, as compiled loops: Gauss-Newton steps, first on some pixels."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled
from cpcal.vision.dots.dot_pixels import gathered, reach, square
from cpcal.vision.dots.edge_model import (
    CUBIC,
    PARAMETERS,
    PLAIN,
    SCRATCH,
    Single,
    depths,
    normal_equations,
    singles,
)
from cpcal.vision.dots.grey import Grey
from cpcal.vision.scaled_solve import factored, solved, substituted

ODD = CUBIC - PLAIN  # parameters of the light
RESULTS = 14  # numbers of a fit, see `fit_dots`
_ROUGH_STEPS = 4
_FINE_STEPS = 6
_ROUGH = 0.05  # pixels: the change of the centre that ends the rough steps
_FINE = 0.018  # and the fine ones: what they leave is 1.5 % of the centre's deviation (RMS; a twentieth of one at most)
_SMALL = 4.0  # pixels of radius: of a smaller dot no one can tell an ellipse from a blur that is wider one way
_STEEPEST = 0.85  # growth of the light from a dot's centre to its edge: more of it is no light but half a dot
_RIDGE, _LEAST = 1e-7, 1e-24  # of the normal matrix, relative to its diagonal; and the least diagonal
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
        depths(singles(p), x, y, size, depth)
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
