"""Mean residuals by place in the image and by dot of the target, beside what noise alone would leave of them.

Noise has no place: the mean of n residuals shrinks with the root of n. What stays is an error that images share: of the
lens where it follows the place in the image, of the plate where it follows the dot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats, Ints

_A_CELL = 20  # residuals, about
_CELLS = (4, 16)  # columns of the image, at least and at most
_FEWEST, _FEWEST_OF_DOT = 8, 3  # residuals of a mean


@dataclass(frozen=True, eq=False)
class Residuals:
    """Of n dots, found minus predicted centres.

    at              (n, 2) pixels, where they are
    off             (n, 2) pixels
    variance        (n, 2) px^2, as stated, along x and y
    numbers         (n,) of the target's dots
    plate_off       (n, 2) mm, the same residuals along the plate's x and y
    plate_variance  (n, 2) mm^2
    """

    at: Floats
    off: Floats
    variance: Floats
    numbers: Ints
    plate_off: Floats
    plate_variance: Floats

    @classmethod
    def joined(cls, parts: Sequence[Residuals]) -> Residuals:
        """Of several images, or of none."""
        none = np.zeros((0, 2))
        every = [cls(none, none, none, np.zeros(0, dtype=np.intp), none, none), *parts]
        names = ("at", "off", "variance", "numbers", "plate_off", "plate_variance")
        return cls(*(np.concatenate([getattr(part, name) for part in every]) for name in names))


@dataclass(frozen=True, eq=False)
class MeanVectors:
    """Mean residuals (k, 2) at k places (k, 2), in the unit of the residuals; `noise` (k, 2): their variance if nothing
    but the dots' stated noise made them; `counts` (k,) of the residuals of each mean."""

    at: Floats
    mean: Floats
    noise: Floats
    counts: Ints

    @property
    def rms(self) -> float:
        """Of the means, per axis; nan without any."""
        return _rms(self.mean**2)

    @property
    def noise_rms(self) -> float:
        """What noise alone would make of `rms`."""
        return _rms(self.noise)


def over_image(residuals: Residuals, width: int, height: int) -> MeanVectors:
    """Means by cell of the image; the more residuals, the more cells. Places are the cells' middles, pixels."""
    columns = int(np.clip(np.sqrt(len(residuals.at) / _A_CELL * width / height), *_CELLS))
    rows = max(round(columns * height / width), 1)
    size = np.array([width / columns, height / rows])
    cells = np.clip(np.floor((residuals.at + 0.5) / size), 0, [columns - 1, rows - 1]).astype(np.intp)
    middles = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    places = (middles + 0.5) * size - 0.5
    return _means(cells[:, 1] * columns + cells[:, 0], places, residuals.off, residuals.variance, _FEWEST)


def over_plate(residuals: Residuals, dots: Floats) -> MeanVectors:
    """Means by dot of the target, mm along the plate's axes; `dots` (n, 2) mm."""
    return _means(residuals.numbers, dots, residuals.plate_off, residuals.plate_variance, _FEWEST_OF_DOT)


def _means(groups: Ints, places: Floats, off: Floats, variance: Floats, fewest: int) -> MeanVectors:
    """Of the groups, numbers of places (k, 2), that have enough members."""
    count = np.bincount(groups, minlength=len(places))
    enough = count >= fewest

    def total(values: Floats) -> Floats:
        both = [np.bincount(groups, values[:, axis], minlength=len(places)) for axis in (0, 1)]
        return np.stack(both, axis=1)[enough].astype(np.float64)

    n = count[enough]
    return MeanVectors(places[enough], total(off) / n[:, None], total(variance) / n[:, None] ** 2, n)


def _rms(squares: Floats) -> float:
    return float(np.sqrt(squares.mean())) if squares.size else float("nan")
