"""The figure of the enclosure of a leg's parameters against the nominal values and the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.numbers import plain_gap
from cpcal.report.svg import BAND, DASHES, EDGE, INK, SUPPORT, Axes, Figure, text_width, ticks

FARTHEST = 1e6  # mm from the nominal value; what lies beyond is not drawn, an arrow points to it
_LEAST = 1e-6  # mm, half the width of what is drawn, at least
_SIZE = (302.4, 208.8)  # points
_FRAME_LEFT = 14.0  # and the width of the names
_WIDTHS = 66.0  # at the right, for the widths
_MARGIN = 0.08  # of that width, on each side


@dataclass(frozen=True)
class Enclosure:
    """What is drawn of a leg, a row a parameter, in mm: NaN bounds when nothing is enclosed, `fit` None without one."""

    names: tuple[str, ...]
    nominal: Floats
    lo: Floats
    hi: Floats
    fit: Floats | None

    @property
    def empty(self) -> bool:
        return bool(np.isnan(self.lo).any() or np.isnan(self.hi).any())

    @property
    def unbounded(self) -> bool:
        """Whether some bound is too far away to be drawn."""
        return bool((_far(self.lo - self.nominal) | _far(self.hi - self.nominal)).any()) and not self.empty

    @property
    def fit_beyond(self) -> bool:
        """Whether the fit lies off the drawing in some row."""
        return self.fit is not None and bool((~(np.abs(self.fit - self.nominal) <= FARTHEST)).any())


def enclosure_svg(data: Enclosure, *, label: str, unit: str = "mm", origin: str = "nominal value") -> str:
    """Bars from `lo` to `hi` with a tick at each end, so that the thinnest is seen."""
    figure, count, (near, far) = Figure(*_SIZE), len(data.names), _view(data)
    frame = (_FRAME_LEFT + text_width(data.names), 22.0, _SIZE[0] - _WIDTHS, _SIZE[1] - 32.0)
    axes = Axes(figure, frame, (near, far), (count - 0.5, -0.5))
    axes.x_axis(ticks(near, far, 5), f"parameter − {origin} [{unit}]", grid=True)
    axes.rows(data.names)
    if not data.empty:
        for k in range(count):
            _bar(axes, k, data, near, far)
    axes.line([(0.0, count - 0.5), (0.0, -0.5)], INK, 1.0, DASHES)
    if data.fit is not None:
        at = np.stack([data.fit - data.nominal, np.arange(float(count))], axis=1)
        axes.marks(at[(at[:, 0] >= near) & (at[:, 0] <= far)], "x", SUPPORT, 6.0, width=1.5)
    _widths(axes, data, unit)
    return figure.svg(label)


def _bar(axes: Axes, row: int, data: Enclosure, near: float, far: float) -> None:
    """The part in view; a tick at a bound, an arrow at the edge of the view where the bound is beyond it."""
    lo, hi = float(data.lo[row] - data.nominal[row]), float(data.hi[row] - data.nominal[row])
    left, right = (float(np.clip(v, near, far)) for v in (lo, hi))
    axes.area([(left, row - 0.25), (right, row - 0.25), (right, row + 0.25), (left, row + 0.25)], BAND, EDGE)
    for bound in (lo, hi):
        if near <= bound <= far:
            axes.marks([(bound, row)], "|", EDGE, 15.0, width=1.6)
        else:
            axes.marks([(near if bound < near else far, row)], "<" if bound < near else ">", EDGE, 8.0)


def _widths(axes: Axes, data: Enclosure, unit: str) -> None:
    """The width of every bar as a number at the right."""
    x = axes.frame[2] + 8.0
    axes.figure.text(x, 9.0, f"width [{unit}]")
    for k, (lo, hi) in enumerate(zip(data.lo, data.hi, strict=True)):
        text = "none" if data.empty else plain_gap(float(lo), float(hi))
        axes.figure.text(x, float(axes.at([(axes.x[0], k)])[0, 1]), text)


def _view(data: Enclosure) -> tuple[float, float]:
    """From and to on the axis: 0 and all that is not too far away."""
    values = [np.zeros(1), data.lo - data.nominal, data.hi - data.nominal]
    if data.fit is not None:
        values.append(data.fit - data.nominal)
    every = np.concatenate(values)
    every = every[np.abs(every) <= FARTHEST]
    least, most = float(every.min()), float(every.max())
    half = max(0.5 * (most - least), _LEAST) * (1.0 + 2.0 * _MARGIN)
    middle = 0.5 * (least + most)
    return middle - half, middle + half


def _far(values: Floats) -> npt.NDArray[np.bool_]:
    return np.abs(values) > FARTHEST
