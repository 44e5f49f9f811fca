"""The figures of two parameters at a time: what proved half-planes leave of the plane, and where points lie in it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from matplotlib.ticker import MaxNLocator

from cpcal.common.arrays import Floats
from cpcal.common.numbers import about
from cpcal.report.svg import BAND, DOT, EDGE, GRID, INK, SUPPORT, figure_svg
from cpcal.results.projection import HalfPlane

_MARGIN = 0.12  # of the rectangle's width, on each side
_UNITS = (
    (1e4, 1e-3, "m"),
    (1e-2, 1.0, "mm"),
    (1e-5, 1e3, "µm"),
    (0.0, 1e6, "nm"),
)  # by half the width, mm
_DASHES = (0, (4, 2.5))
_AXES = (0.27, 0.2, 0.68, 0.76)  # the same place in every panel: no need for a layout of its own


@dataclass(frozen=True)
class Panel:
    """Two parameters of a leg, in mm: a rectangle `lo` to `hi` (2,) and half-planes that hold the solutions.

    `origin` (2,) is where the axes count from. Points: the proved one, the least-squares `fit`, the `nominal` one.
    """

    names: tuple[str, str]
    lo: Floats
    hi: Floats
    half_planes: tuple[HalfPlane, ...]
    origin: Floats
    point: Floats | None
    fit: Floats | None
    nominal: Floats


def in_view(panel: Panel, point: Floats | None) -> bool:
    """Whether a point is drawn."""
    if point is None:
        return False
    reach = _MARGIN * (panel.hi - panel.lo)
    return bool(((point >= panel.lo - reach) & (point <= panel.hi + reach)).all())


def panel_svg(panel: Panel, *, prefix: str, label: str) -> str:
    """The rectangle, the polygon in it and the points in view; ids in the SVG begin with `prefix`."""
    units = [_unit(0.5 * float(hi - lo)) for lo, hi in zip(panel.lo, panel.hi, strict=True)]
    scale = np.array([factor for factor, _ in units])

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")
        axes = figure.add_axes(_AXES)
        lo, hi = (scale * (end - panel.origin) for end in (panel.lo, panel.hi))
        _axes(axes, lo, hi, [f"Δ{name} [{unit}]" for name, (_, unit) in zip(panel.names, units, strict=True)])
        width, height = hi - lo
        axes.add_patch(Rectangle((lo[0], lo[1]), width, height, fill=False, edgecolor=INK, linestyle=_DASHES, zorder=3))
        corners = scale * (polygon(panel.lo, panel.hi, panel.half_planes) - panel.origin)
        if len(corners):
            axes.add_patch(Polygon(corners, facecolor=BAND, edgecolor=EDGE, linewidth=1.4, zorder=2))
        # the largest first, so that all are seen where they coincide
        _mark(axes, panel, scale, panel.nominal, marker="s", fillstyle="none", color=INK, markersize=9.0)
        _mark(axes, panel, scale, panel.fit, marker="x", color=SUPPORT, markersize=6.5)
        _mark(axes, panel, scale, panel.point, marker="o", color=DOT, markersize=4.0)

    return figure_svg(draw, (2.5, 2.4), prefix=prefix, label=label)


def polygon(lo: Floats, hi: Floats, half_planes: Iterable[HalfPlane]) -> Floats:
    """Corners (n, 2) of what half-planes leave of a rectangle: plain floating point, for drawing."""
    middle, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for u, v, c in half_planes:
        normal = np.array([u, v])
        excess = corners @ (normal * half) - (c - float(normal @ middle))
        corners = _clipped(corners, excess)
    return np.asarray(middle + half * corners)


def _clipped(corners: Floats, excess: Floats) -> Floats:
    """A convex polygon without the side where `excess`, a linear function at its corners, is positive."""
    kept: list[Floats] = []
    for k in range(len(corners)):
        before, here = excess[k - 1], excess[k]
        if (before > 0.0) != (here > 0.0):
            kept.append(corners[k - 1] + before / (before - here) * (corners[k] - corners[k - 1]))
        if here <= 0.0:
            kept.append(corners[k])
    return np.array(kept).reshape(len(kept), 2)


def _axes(axes: Axes, lo: Floats, hi: Floats, labels: list[str]) -> None:
    reach = _MARGIN * (hi - lo)
    axes.set_xlim(lo[0] - reach[0], hi[0] + reach[0])
    axes.set_ylim(lo[1] - reach[1], hi[1] + reach[1])
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.yaxis.set_label_coords(-0.27, 0.5)
    for axis, least, most in zip((axes.xaxis, axes.yaxis), lo, hi, strict=True):
        # none in the margins, where a number would not fit in
        ticks = [value for value in MaxNLocator(nbins=3).tick_values(least, most) if least <= value <= most]
        axis.set_ticks(ticks, [about(value, 6).replace("-", "−") for value in ticks])
    axes.tick_params(length=3.0, pad=2.0)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)


def _mark(axes: Axes, panel: Panel, scale: Floats, point: Floats | None, **style: Any) -> None:
    if point is not None and in_view(panel, point):
        x, y = scale * (point - panel.origin)
        axes.plot([x], [y], markeredgewidth=1.4, zorder=5, clip_on=False, **style)


def _unit(half: float) -> tuple[float, str]:
    """Factor and name of a unit in which so many mm are read easily."""
    return next((factor, name) for least, factor, name in _UNITS if half >= least)
