"""The figure of the residuals of a proved point over the measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.report.svg import BAND, DOT, EDGE, MASS, ROOM, SUPPORT, Axes, Figure, label_room, tick_labels, ticks

MOST_POINTS = 500  # more measurements are drawn as an envelope
_BINS = 250
_SIZE = (475.2, 194.4)  # points
_MARGIN = 0.07  # of the height, above and below


@dataclass(frozen=True)
class Residuals:
    """What is drawn of a leg, in mm: `residual` and `sensitivity` (N,), `support` (N,) bool, the band `+-eps`.

    `fit` (N,): residuals of the least-squares fit, None without one. `names`: of the measurements, for the pointer.
    """

    residual: Floats
    sensitivity: Floats
    support: npt.NDArray[np.bool_]
    eps: float
    fit: Floats | None = None
    names: Sequence[str] = ()


def residual_svg(data: Residuals, *, label: str) -> str:
    """The residuals over the measurements with the band."""
    figure, count = Figure(*_SIZE), len(data.residual)
    lo, hi = _span(data)
    numbers = ticks(lo, hi)
    left = label_room(tick_labels(numbers)) + 8.0
    axes = Axes(figure, (left, 5.0, _SIZE[0] - 12.0, _SIZE[1] - 32.0), (0.0, count + 1.0), (lo, hi))
    axes.area([(0.0, -data.eps), (count + 1.0, -data.eps), (count + 1.0, data.eps), (0.0, data.eps)], BAND)
    axes.y_axis(numbers, "residual [mm]", grid=True)
    if count > MOST_POINTS:
        _envelope(axes, data)
    else:
        _points(axes, data)
    axes.lines([[(0.0, edge), (count + 1.0, edge)] for edge in (-data.eps, data.eps)], EDGE)
    at = np.flatnonzero(data.support)
    axes.marks(np.stack([at + 1.0, data.residual[at]], axis=1), "D", SUPPORT, 7.5, width=1.1)
    axes.x_axis(_counted(count), "measurement, counted from 1 in the order of the campaign")
    if count <= MOST_POINTS and data.names:
        axes.hover(np.stack([np.arange(1.0, count + 1.0), data.residual], axis=1), data.names, 6.0)
    return figure.svg(label)


def _span(data: Residuals) -> tuple[float, float]:
    """Of residuals, their bars and the band, with a margin."""
    lo = min(-data.eps, float((data.residual - data.sensitivity).min()))
    hi = max(data.eps, float((data.residual + data.sensitivity).max()))
    if data.fit is not None:
        lo, hi = min(lo, float(data.fit.min())), max(hi, float(data.fit.max()))
    reach = _MARGIN * max(hi - lo, 1e-300) if hi > lo else 1.0
    return lo - reach, hi + reach


def _counted(count: int) -> list[float]:
    """Ticks that count from 1."""
    rest = [t for t in ticks(0.0, count + 1.0, 9, whole=True) if 0.0 < t <= count]
    return [1.0, *(t for t in rest if t >= 1.0 + 0.05 * count)]


def _points(axes: Axes, data: Residuals) -> None:
    numbers = np.arange(1.0, len(data.residual) + 1.0)
    if data.sensitivity.any():
        ends = [np.stack([numbers, data.residual + way * data.sensitivity], axis=1) for way in (-1.0, 1.0)]
        axes.lines(np.stack(ends, axis=1), ROOM, 1.4)
    if data.fit is not None:
        axes.marks(np.stack([numbers, data.fit], axis=1), "x", SUPPORT, 3.6, width=0.9)
    axes.dots(np.stack([numbers, data.residual], axis=1), DOT, 3.0)


def _envelope(axes: Axes, data: Residuals) -> None:
    """Smallest and largest value of each run of neighbours: what N points would cover, in a small file."""
    starts = np.linspace(0, len(data.residual), _BINS, endpoint=False).astype(int)
    at = np.append(starts + 1.0, float(len(data.residual)))

    def fill(lo: Floats, hi: Floats, colour: str) -> None:
        low, high = np.minimum.reduceat(lo, starts), np.maximum.reduceat(hi, starts)
        steps = np.repeat(at, 2)[1:-1]
        above, below = np.stack([steps, np.repeat(high, 2)], axis=1), np.stack([steps, np.repeat(low, 2)], axis=1)
        axes.area(np.concatenate([above, below[::-1]]), colour)

    if data.sensitivity.any():
        fill(data.residual - data.sensitivity, data.residual + data.sensitivity, ROOM)
    fill(data.residual, data.residual, MASS)
    if data.fit is not None:
        ends = [np.minimum.reduceat(data.fit, starts), np.maximum.reduceat(data.fit, starts)]
        middles = 0.5 * (at[:-1] + at[1:])
        for end in ends:
            axes.line(np.stack([middles, end], axis=1), SUPPORT, 0.8)
