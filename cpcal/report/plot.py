"""The figure of the residuals of a proved point over the measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cpcal.common.arrays import Floats
from cpcal.report.svg import BAND, DOT, EDGE, GRID, MASS, ROOM, SUPPORT, figure_svg

MOST_POINTS = 500  # more measurements are drawn as an envelope
_BINS = 250


@dataclass(frozen=True)
class Residuals:
    """What is drawn of a leg, in mm: `residual` and `sensitivity` (N,), `support` (N,) bool, the band `+-eps`."""

    residual: Floats
    sensitivity: Floats
    support: npt.NDArray[np.bool_]
    eps: float


def residual_svg(data: Residuals, *, prefix: str, label: str) -> str:
    """The residuals over the measurements with the band; ids in the SVG begin with `prefix`."""

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        _axes(axes, len(data.residual))
        axes.axhspan(-data.eps, data.eps, facecolor=BAND, edgecolor="none", zorder=1)
        for edge in (-data.eps, data.eps):
            axes.axhline(edge, color=EDGE, linewidth=1.0, zorder=4.5)
        if len(data.residual) > MOST_POINTS:
            _envelope(axes, data)
        else:
            _points(axes, data)
        _support(axes, data)

    return figure_svg(draw, (6.6, 2.7), prefix=prefix, label=label)


def _axes(axes: Axes, count: int) -> None:
    axes.set_xlabel("measurement, in the order of the campaign")
    axes.set_ylabel("residual [mm]")
    axes.set_xlim(0.0, count + 1.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="y", color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.use_sticky_edges = False
    axes.margins(y=0.07)


def _points(axes: Axes, data: Residuals) -> None:
    numbers = np.arange(1, len(data.residual) + 1)
    if data.sensitivity.any():
        gaps = np.full(len(numbers), np.nan)
        bars = np.stack([data.residual - data.sensitivity, data.residual + data.sensitivity, gaps], axis=1)
        axes.plot(np.repeat(numbers, 3), bars.ravel(), color=ROOM, linewidth=1.4, zorder=3)
    axes.plot(numbers, data.residual, "o", color=DOT, markersize=3.0, markeredgewidth=0.0, zorder=4)


def _envelope(axes: Axes, data: Residuals) -> None:
    """Smallest and largest value of each run of neighbours: what N points would cover, in a small file."""
    starts = np.linspace(0, len(data.residual), _BINS, endpoint=False).astype(int)
    ends = np.append(starts[1:], len(data.residual))
    at = np.append(starts + 1.0, ends[-1])

    def fill(lo: Floats, hi: Floats, color: str, zorder: int) -> None:
        low, high = np.minimum.reduceat(lo, starts), np.maximum.reduceat(hi, starts)
        low, high = np.append(low, low[-1]), np.append(high, high[-1])
        axes.fill_between(at, low, high, step="post", facecolor=color, edgecolor="none", zorder=zorder)

    if data.sensitivity.any():
        fill(data.residual - data.sensitivity, data.residual + data.sensitivity, ROOM, 3)
    fill(data.residual, data.residual, MASS, 4)


def _support(axes: Axes, data: Residuals) -> None:
    at = np.flatnonzero(data.support)
    axes.plot(
        at + 1,
        data.residual[at],
        "D",
        markersize=5.5,
        fillstyle="none",
        color=SUPPORT,
        markeredgewidth=1.1,
        zorder=5,
    )
