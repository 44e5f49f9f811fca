"""How the light grows over the image, from the grey levels of dots or of the plate beside them.

A dot under light that grows to one side seems to lie on that side: by some thousandths of a pixel. Estimated dot by
dot the light would cost half of the centre's accuracy; light is smooth, so that all dots together tell it well enough.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.vision.dots.grey import Grey
from cpcal.vision.dots.segmentation import Spots
from cpcal.vision.median import median
from cpcal.vision.two_by_two import inverses

_MOST_DEGREE = 4
_EACH = 6  # dots for each coefficient
_BESIDE = 4.5  # pixels beyond the edge of a dark dot, at most
_OUTLYING = 4.0  # robust standard deviations
_TURNS = np.arange(16) * (np.pi / 8.0)
_AROUND = np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=1)
_CORNERS = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])


def light_gradient(grey: Grey, found: Spots, gap: Floats) -> Floats:
    """By which share the light grows per pixel to the right and down, at each dot: (n, 2); nan with too few dots.
    `gap` (n,) pixels lie between a dot and its neighbours.

    A polynomial of the place is fitted to the levels, twice: the second time without outliers.
    """
    degree = _MOST_DEGREE
    while degree > 0 and len(found) < _EACH * (degree + 1) * (degree + 2) // 2:
        degree -= 1
    if degree == 0:
        return np.full((len(found), 2), np.nan)
    level = _levels(grey, found, gap)
    half = 0.5 * np.array(grey.shape[::-1])
    values, to_right, to_bottom = _terms(found.center / half - 1.0, degree)
    good = np.ones(len(level), dtype=bool)
    coefficients: Floats = np.zeros(values.shape[1])
    for _ in range(2):
        some = values[good]
        normal = some.T @ some
        normal += 1e-9 * len(some) * np.eye(len(normal))  # in case dots lie on few lines
        coefficients = np.asarray(np.linalg.solve(normal, some.T @ level[good]), dtype=np.float64)
        off = np.abs(level - values @ coefficients)
        good = off <= _OUTLYING * 1.4826 * median(off) + 1e-12
    slope = np.stack([to_right @ coefficients, to_bottom @ coefficients], axis=1)
    return np.asarray(slope / (np.maximum(values @ coefficients, 1.0)[:, None] * half))


def _levels(grey: Grey, found: Spots, gap: Floats) -> Floats:
    """Grey levels (n,) of the bright surface: in the middle of bright dots, beside dark ones."""
    if found.bright:
        points = found.center[:, None, :] + _CORNERS
    else:
        inverse = inverses(found.spread)
        reach = 2.0 / np.sqrt(np.einsum("ki,nij,kj->nk", _AROUND, inverse, _AROUND))
        beside = np.clip(0.5 * gap, 1.5, _BESIDE)
        points = found.center[:, None, :] + (reach + beside[:, None])[..., None] * _AROUND
    at = np.clip(np.rint(points).astype(np.int64), 0, np.array(grey.shape[::-1]) - 1)
    return np.asarray(grey[at[..., 1], at[..., 0]].mean(axis=1))


def _terms(at: Floats, degree: int) -> tuple[Floats, Floats, Floats]:
    """The monomials of x and y up to a degree and their derivatives, each (n, terms)."""
    i, j = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]).T
    powers = np.ones((degree + 1, *at.shape))
    for k in range(degree):
        powers[k + 1] = powers[k] * at
    x, y = powers[..., 0].T, powers[..., 1].T  # (n, degree + 1)
    values = x[:, i] * y[:, j]
    by_x = i * x[:, np.maximum(i - 1, 0)] * y[:, j]
    by_y = j * x[:, i] * y[:, np.maximum(j - 1, 0)]
    return values, by_x, by_y
