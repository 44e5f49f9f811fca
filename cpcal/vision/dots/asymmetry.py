"""What light that is not symmetric about a dot would make of it, compiled: see `cpcal.vision.dots.own_light`."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.solver.compiled import compiled

TERMS = 6  # of the light: its growth, and its cubic
_HOPELESS = 9.0  # variance of such a move, relative to the centre's: the dot is too small to tell its light
_WORTH = 0.004  # pixels: a smaller move is not worth the accuracy that light of a dot's own costs


@compiled
def excesses(
    odd: Floats,
    sharpness: Floats,
    variance: Floats,
    common: Floats,
    first: int,
    shapes: Floats,
    moves: Floats,
    worth: Bools,
) -> None:
    """The chi-squares (n,) of the terms from `first` on against those in `common` (TERMS,), and of the moves of the
    centre that they make; zero where there is nothing to tell. And where (n,) such a move is worth to be known.

    odd        (n, TERMS, TERMS + 3): inverse covariance of the terms, times that their values, how each moves the dot
    sharpness  (n,) share of a dot's information that is believed; variance (n,) px^2 of its centre, of both axes
    """
    size = TERMS - first
    information, inverse, off = np.empty((size, size)), np.empty((size, size)), np.empty(size)
    for i in range(len(odd)):
        shapes[i], moves[i], worth[i] = 0.0, 0.0, False
        for a in range(size):
            off[a] = odd[i, first + a, TERMS]
            for b in range(size):
                information[a, b] = odd[i, first + a, first + b]
                off[a] -= information[a, b] * common[first + b]
        information *= sharpness[i]
        off *= sharpness[i]
        if not _inverted(information, inverse):
            continue
        shape, x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for a in range(size):
            right, down = odd[i, first + a, TERMS + 1], odd[i, first + a, TERMS + 2]
            value, by_x, by_y = 0.0, 0.0, 0.0
            for b in range(size):
                value += inverse[a, b] * off[b]
                by_x += inverse[a, b] * odd[i, first + b, TERMS + 1]
                by_y += inverse[a, b] * odd[i, first + b, TERMS + 2]
            shape += off[a] * value
            x, y = x + value * right, y + value * down
            xx, xy, yy = xx + right * by_x, xy + right * by_y, yy + down * by_y
        worth[i] = xx + yy < _HOPELESS * variance[i] and x * x + y * y > _WORTH**2
        more = 1e-9 * (xx + yy) + 1e-30
        xx, yy = xx + more, yy + more
        shapes[i], moves[i] = shape, (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)


@compiled
def term_values(odd: Floats, first: int, last: int, out: Floats) -> None:
    """The values (n, last - first) of the terms from `first` to `last` had they been fitted, 0 where nothing tells."""
    size = last - first
    information, inverse = np.empty((size, size)), np.empty((size, size))
    for i in range(len(odd)):
        for a in range(size):
            for b in range(size):
                information[a, b] = odd[i, first + a, first + b]
        sound = _inverted(information, inverse)
        for a in range(size):
            out[i, a] = 0.0
            for b in range(size if sound else 0):
                out[i, a] += inverse[a, b] * odd[i, first + b, TERMS]


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
