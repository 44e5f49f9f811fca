"""The figures of two parameters at a time: what proved half-planes leave of the plane, and where points lie in it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.report.svg import BAND, DOT, EDGE, INK, SUPPORT, Axes, Figure
from cpcal.results.projection import HalfPlane

_MARGIN = 0.12  # of the rectangle's width, on each side
_UNITS = (
    (1e4, 1e-3, "m"),
    (1e-2, 1.0, "mm"),
    (1e-5, 1e3, "µm"),
    (0.0, 1e6, "nm"),
)  # by half the width, mm
_SIZE = (180.0, 172.8)  # points
_FRAME = (48.6, 6.9, 171.0, 138.2)
_LABEL = 37.0  # points from the frame


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


def panel_svg(panel: Panel, *, label: str) -> str:
    """The rectangle, the polygon in it and the points in view."""
    units = [_unit(0.5 * float(hi - lo)) for lo, hi in zip(panel.lo, panel.hi, strict=True)]
    scale = np.array([factor for factor, _ in units])
    lo, hi = (scale * (end - panel.origin) for end in (panel.lo, panel.hi))
    (left, low), (right, high) = lo - _MARGIN * (hi - lo), hi + _MARGIN * (hi - lo)
    figure = Figure(*_SIZE)
    axes = Axes(figure, _FRAME, (left, right), (low, high))
    labels = [f"Δ{name} [{unit}]" for name, (_, unit) in zip(panel.names, units, strict=True)]
    axes.x_axis(_ends(lo[0], hi[0]), labels[0], grid=True)
    axes.y_axis(_ends(lo[1], hi[1]), labels[1], grid=True, away=_LABEL)
    corners = scale * (polygon(panel.lo, panel.hi, panel.half_planes) - panel.origin)
    if len(corners):
        axes.area(corners, BAND, EDGE, 1.4)
    axes.area([(lo[0], lo[1]), (hi[0], lo[1]), (hi[0], hi[1]), (lo[0], hi[1])], "none", INK, 1.0, "4 2.5")
    # the largest first, so that all are seen where they coincide
    if in_view(panel, panel.nominal):
        axes.marks([scale * (panel.nominal - panel.origin)], "s", INK, 9.0, width=1.4)
    if panel.fit is not None and in_view(panel, panel.fit):
        axes.marks([scale * (panel.fit - panel.origin)], "x", SUPPORT, 6.5, width=1.4)
    if panel.point is not None and in_view(panel, panel.point):
        axes.dots([scale * (panel.point - panel.origin)], DOT, 5.0)
    return figure.svg(label)


def _ends(lo: float, hi: float) -> list[float]:
    """Ticks at both ends, to a hundredth of their distance or so, and at 0 where that is not too near to them."""
    step = 10.0 ** math.floor(math.log10(hi - lo) - 1.0)
    first, last = math.ceil(lo / step - 1e-9) * step, math.floor(hi / step + 1e-9) * step
    room = 0.25 * (last - first)
    return [first, *([0.0] if first + room < 0.0 < last - room else []), last]


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


def _unit(half: float) -> tuple[float, str]:
    """Factor and name of a unit in which so many mm are read easily."""
    return next((factor, name) for least, factor, name in _UNITS if half >= least)
