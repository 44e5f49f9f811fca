"""What light that is not symmetric about a dot would make of it, compiled: see `cpcal.vision.dots.own_light`."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.solver.compiled import compiled

TERMS = 6  # of the light: its growth, and its cubic
_HOPELESS = 9.0  # variance of such a move, relative to the centre's: the dot is too small to tell its light
_WORTH = 0.004  # pixels: a smaller move is not worth the accuracy that light of a dot's own costs


@compiled
def term_values(odd: Floats, first: int, last: int, values: Floats, inverse: Floats) -> None:
    """The values (n, last - first) of the terms from `first` to `last` had they been fitted, and their covariances
    (n, last - first, last - first); 0 where nothing tells.

    odd  (n, TERMS, TERMS + 3): inverse covariance of the terms, times that their values, how each moves the dot
    """
    size = last - first
    information = np.empty((size, size))
    for i in range(len(odd)):
        for a in range(size):
            for b in range(size):
                information[a, b] = odd[i, first + a, first + b]
        if not _inverted(information, inverse[i]):
            inverse[i] = 0.0
        for a in range(size):
            values[i, a] = 0.0
            for b in range(size):
                values[i, a] += inverse[i, a, b] * odd[i, first + b, TERMS]


@compiled
def excesses(
    odd: Floats,
    values: Floats,
    inverse: Floats,
    sharpness: Floats,
    variance: Floats,
    common: Floats,
    shapes: Floats,
    moves: Floats,
    worth: Bools,
) -> None:
    """The chi-squares (n,) of the last terms, `values` and `inverse` as `term_values` tells them, against those in
    `common` (TERMS,), and of the moves of the centre that they make; zero where there is nothing to tell. And where
    (n,) such a move is worth to be known.

    sharpness  (n,) share of a dot's information that is believed; variance (n,) px^2 of its centre, of both axes
    """
    size = values.shape[1]
    first = TERMS - size
    for i in range(len(odd)):
        shape, x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for a in range(size):
            right, down = odd[i, first + a, TERMS + 1], odd[i, first + a, TERMS + 2]
            value, by_x, by_y, off = values[i, a] - common[first + a], 0.0, 0.0, 0.0
            for b in range(size):
                off += odd[i, first + a, first + b] * (values[i, b] - common[first + b])
                by_x += inverse[i, a, b] * odd[i, first + b, TERMS + 1]
                by_y += inverse[i, a, b] * odd[i, first + b, TERMS + 2]
            shape += sharpness[i] * off * value
            x, y = x + value * right, y + value * down
            xx, xy, yy = xx + right * by_x, xy + right * by_y, yy + down * by_y
        shapes[i], moves[i], worth[i] = 0.0, 0.0, False
        if not (inverse[i, 0, 0] > 0.0 and sharpness[i] > 0.0):
            continue
        xx, xy, yy = xx / sharpness[i], xy / sharpness[i], yy / sharpness[i]
        worth[i] = xx + yy < _HOPELESS * variance[i] and x * x + y * y > _WORTH**2
        more = 1e-9 * (xx + yy) + 1e-30
        xx, yy = xx + more, yy + more
        shapes[i], moves[i] = shape, (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)


@compiled
def _inverted(matrix: Floats, out: Floats) -> bool:
    """The inverse of a matrix, a billionth of its trace added to its diagonal, by elimination."""
    size, trace = len(matrix), 0.0
    for a in range(size):
        trace += matrix[a, a]
    out[:] = 0.0
    if not (trace > 0.0 and np.isfinite(trace)):
        return False
    for a in range(size):
        matrix[a, a] += 1e-9 * trace
        out[a, a] = 1.0
    for k in range(size):  # positive definite: without pivoting
        pivot = matrix[k, k]
        if not pivot > 0.0:
            return False
        for b in range(size):
            matrix[k, b] /= pivot
            out[k, b] /= pivot
        for a in range(size):
            share = matrix[a, k]
            if a != k:
                for b in range(size):
                    matrix[a, b] -= share * matrix[k, b]
                    out[a, b] -= share * out[k, b]
    return True
