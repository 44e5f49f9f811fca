"""The figure of the enclosure of a leg's parameters against the nominal values and the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cpcal.common.arrays import Floats
from cpcal.common.numbers import plain_gap
from cpcal.report.svg import BAND, EDGE, GRID, INK, SUPPORT, figure_svg

FARTHEST = 1e6  # mm from the nominal value; what lies beyond is not drawn, an arrow points to it
_LEAST = 1e-6  # mm, half the width of what is drawn, at least
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


def enclosure_svg(data: Enclosure, *, prefix: str, label: str) -> str:
    """Bars from `lo` to `hi` with a tick at each end, so that the thinnest is seen; ids begin with `prefix`."""

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        rows = np.arange(len(data.names))
        near, far = _view(data)
        axes.set_xlim(near, far)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_yticks(rows, data.names)
        axes.tick_params(axis="y", length=0, pad=8.0)  # room for arrows
        axes.set_xlabel("parameter − nominal value [mm]")
        axes.grid(axis="x", color=GRID, linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines["left"].set_visible(False)
        axes.axvline(0.0, color=INK, linewidth=1.0, linestyle=(0, (4, 3)), zorder=3.5)
        if not data.empty:
            for k in rows:
                _bar(axes, int(k), data, near, far)
        if data.fit is not None:
            at = data.fit - data.nominal
            axes.plot(at, rows, "x", color=SUPPORT, markersize=6.0, markeredgewidth=1.5, zorder=5)
        _widths(axes, data)

    return figure_svg(draw, (4.2, 2.9), prefix=prefix, label=label)


def _bar(axes: Axes, row: int, data: Enclosure, near: float, far: float) -> None:
    """The part in view; a tick at a bound, an arrow at the edge of the view where the bound is beyond it."""
    lo, hi = float(data.lo[row] - data.nominal[row]), float(data.hi[row] - data.nominal[row])
    left, right = (float(np.clip(v, near, far)) for v in (lo, hi))
    axes.barh(row, right - left, left=left, height=0.5, facecolor=BAND, edgecolor=EDGE, linewidth=0.8, zorder=3)
    style: dict[str, Any] = {"color": EDGE, "zorder": 4, "clip_on": False}
    for bound in (lo, hi):
        if near <= bound <= far:
            axes.plot([bound], [row], "|", markersize=15.0, markeredgewidth=1.6, **style)
        else:
            arrow = "<" if bound < near else ">"
            axes.plot([near if bound < near else far], [row], arrow, markersize=8.0, **style)


def _widths(axes: Axes, data: Enclosure) -> None:
    """The width of every bar as a number at the right."""
    transform = axes.get_yaxis_transform()
    axes.text(1.05, -0.75, "width [mm]", transform=transform, va="bottom")
    for k, (lo, hi) in enumerate(zip(data.lo, data.hi, strict=True)):
        text = "none" if data.empty else plain_gap(float(lo), float(hi))
        axes.text(1.05, k, text, transform=transform, va="center")


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
