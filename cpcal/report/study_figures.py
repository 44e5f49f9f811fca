"""Figures 3, 4 and 5 of the paper for a user's study: plain floating point, nothing of it is proved."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cpcal.calibration import Validation
from cpcal.calibration.record import Channel
from cpcal.report.svg import BAND, DOT, EDGE, GRID, INK, ROOM, SUPPORT, figure_svg

_DASHES = (0, (4, 3))
_PANEL = (0.2, 0.16, 0.75, 0.7)  # the same place in every panel
_FACTORS = {"mm": (1e3, "µm"), "rad": (1e3 * 180.0 / math.pi, "10⁻³ °")}  # of what is printed at an axis


def histogram_svg(channel: Channel, *, prefix: str, label: str) -> str:
    """Counts of the centred errors of one channel, with the normal curve of the same deviation."""
    factor, unit = _FACTORS[channel.unit]
    reach, counts = factor * channel.histogram.reach, np.array(channel.histogram.counts)
    edges = np.linspace(-reach, reach, len(counts) + 1)

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")
        axes = figure.add_axes(_PANEL)
        axes.bar(edges[:-1], counts, np.diff(edges), align="edge", facecolor=BAND, edgecolor=EDGE, linewidth=0.8)
        sigma = factor * channel.statistics.sigma
        if sigma > 0.0:
            at = np.linspace(-reach, reach, 121)
            scale = counts.sum() * (edges[1] - edges[0]) / (sigma * math.sqrt(2.0 * math.pi))
            axes.plot(at, scale * np.exp(-0.5 * (at / sigma) ** 2), color=INK, linewidth=1.0, linestyle=_DASHES)
        axes.set_xlim(-reach, reach)
        axes.set_title(f"{channel.statistics.name} [{unit}]", fontsize=9.0, color=INK)
        axes.xaxis.set_major_locator(MaxNLocator(nbins=4, symmetric=True, prune="both"))
        axes.yaxis.set_major_locator(MaxNLocator(nbins=3, integer=True))
        axes.tick_params(length=3.0, pad=2.0)

    return figure_svg(draw, (2.5, 1.9), prefix=prefix, label=label)


def validation_svg(found: Validation, *, prefix: str, label: str) -> str:
    """Left the position errors, right the improvements of the compared poses; each curve sorted ascending by itself."""
    good = found.compared

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        _sorted(left, found.before.position[good], ROOM)
        _sorted(left, found.after.position[good], DOT)
        _sorted(right, found.orientation_improvement[good], SUPPORT)
        _sorted(right, found.position_improvement[good], DOT)
        right.axhline(0.0, color=INK, linewidth=1.0, linestyle=_DASHES)
        left.set_ylabel("position error [mm]")
        right.set_ylabel("improvement [%]")
        left.set_ylim(bottom=0.0)
        for axes in (left, right):
            axes.set_xlabel("validation poses, sorted")
            axes.grid(axis="y", color=GRID, linewidth=0.6)
            axes.set_axisbelow(True)
            axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))

    return figure_svg(draw, (6.6, 2.5), prefix=prefix, label=label)


def _sorted(axes: Axes, values: np.ndarray[tuple[int, ...], np.dtype[np.float64]], color: str) -> None:
    values = np.sort(values[np.isfinite(values)])
    axes.plot(np.arange(1, len(values) + 1), values, "o", color=color, markersize=2.8, markeredgewidth=0.0)
