"""How the light grows over the image, from the grey levels of dots or of the plate beside them.

A dot under light that grows to one side seems to lie on that side: by some thousandths of a pixel. Estimated dot by
dot the light would cost half of the centre's accuracy; light is smooth, so that all dots together tell it well enough.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled
from cpcal.vision.dots.grey import Grey
from cpcal.vision.dots.segmentation import Spots
from cpcal.vision.median import median

_MOST_DEGREE = 4
_EACH = 6  # dots for each coefficient
_BESIDE = 4.5  # pixels beyond the edge of a dark dot, at most
_OUTLYING = 4.0  # robust standard deviations


def light_gradient(grey: Grey, found: Spots, gap: Floats) -> Floats:
    """By which share the light grows per pixel to the right and down, at each dot: (n, 2); nan with too few dots.
    `gap` (n,) pixels lie between a dot and its neighbours.

    A polynomial of the place is fitted to the levels, twice: the second time without outliers.
    """
    slope = _polynomial(grey, found, gap)
    return np.full((len(found), 2), np.nan) if slope is None else slope[0]


def light_misfit(grey: Grey, found: Spots, gap: Floats) -> float:
    """The median of what that polynomial leaves of the grey levels at the dots; 0 with too few dots for one."""
    slope = _polynomial(grey, found, gap)
    return 0.0 if slope is None else slope[1]


def _polynomial(grey: Grey, found: Spots, gap: Floats) -> tuple[Floats, float] | None:
    """The growth of the fitted polynomial, relative to it, and the median of what it leaves; None with too few dots."""
    degree = _MOST_DEGREE
    while degree > 0 and len(found) < _EACH * (degree + 1) * (degree + 2) // 2:
        degree -= 1
    if degree == 0:
        return None
    level = _levels(grey, found, gap)
    half = 0.5 * np.array(grey.shape[::-1])
    values, to_right, to_bottom = _terms(found.center / half - 1.0, degree)
    good = np.ones(len(level), dtype=bool)
    coefficients: Floats = np.zeros(values.shape[1])
    left = 0.0
    for _ in range(2):
        some = values[good]
        normal = some.T @ some
        normal += 1e-9 * len(some) * np.eye(len(normal))  # in case dots lie on few lines
        coefficients = np.asarray(np.linalg.solve(normal, some.T @ level[good]), dtype=np.float64)
        off = np.abs(level - values @ coefficients)
        left = median(off)
        good = off <= _OUTLYING * 1.4826 * left + 1e-12
    slope = np.stack([to_right @ coefficients, to_bottom @ coefficients], axis=1)
    return np.asarray(slope / (np.maximum(values @ coefficients, 1.0)[:, None] * half)), left


def _levels(grey: Grey, found: Spots, gap: Floats) -> Floats:
    """Grey levels (n,) of the bright surface: in the middle of bright dots, beside dark ones."""
    out = np.empty(len(found))
    if found.bright:
        _middles(grey, found.center, out)
    else:
        _surroundings(grey, found.center, found.spread, np.clip(0.5 * gap, 1.5, _BESIDE), out)
    return out


@compiled
def _middles(grey: Grey, center: Floats, out: Floats) -> None:
    """The mean of the nine pixels about each centre."""
    height, width = grey.shape
    for i in range(len(center)):
        total = 0.0
        for k in range(9):
            x, y = int(np.rint(center[i, 0] + k % 3 - 1)), int(np.rint(center[i, 1] + k // 3 - 1))
            total += grey[min(max(y, 0), height - 1), min(max(x, 0), width - 1)]
        out[i] = total / 9.0


@compiled
def _surroundings(grey: Grey, center: Floats, spread: Floats, beside: Floats, out: Floats) -> None:
    """The mean of sixteen pixels round each ellipse, so many beyond its edge."""
    height, width = grey.shape
    for i in range(len(center)):
        total = 0.0
        xx, xy, yy = spread[i, 0, 0], spread[i, 0, 1], spread[i, 1, 1]
        for k in range(16):
            right, down = np.cos(np.pi / 8.0 * k), np.sin(np.pi / 8.0 * k)
            square = (yy * right * right - 2.0 * xy * right * down + xx * down * down) / (xx * yy - xy * xy)
            reach = 2.0 / np.sqrt(square) + beside[i]
            x, y = int(np.rint(center[i, 0] + reach * right)), int(np.rint(center[i, 1] + reach * down))
            total += grey[min(max(y, 0), height - 1), min(max(x, 0), width - 1)]
        out[i] = total / 16.0


def _terms(at: Floats, degree: int) -> tuple[Floats, Floats, Floats]:
    """The monomials of x and y up to a degree and their derivatives, each (n, terms)."""
    terms = (degree + 1) * (degree + 2) // 2
    out = np.zeros((3, len(at), terms))
    _monomials(at, degree, out)
    return out[0], out[1], out[2]


@compiled
def _monomials(at: Floats, degree: int, out: Floats) -> None:
    for n in range(len(at)):
        term, by_x = 0, 1.0  # x^i
        for i in range(degree + 1):
            by_y = by_x
            for j in range(degree + 1 - i):
                out[0, n, term] = by_y
                if i > 0:
                    out[1, n, term] = i * at[n, 1] ** j * at[n, 0] ** (i - 1)
                if j > 0:
                    out[2, n, term] = j * by_x * at[n, 1] ** (j - 1)
                by_y *= at[n, 1]
                term += 1
            by_x *= at[n, 0]
