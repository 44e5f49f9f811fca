"""Figures as inline SVG: no colours and fonts of their own (the page's CSS has them), no date, no chance."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

Floats = npt.NDArray[np.float64]

MOST_POINTS = 500  # more measurements are drawn as an envelope
_BINS = 250

# Colours that stand for CSS variables of the page.
_INK, _GRID, _BAND, _EDGE, _ROOM, _DOT, _MASS, _SUPPORT = (f"#0102{k:02x}" for k in range(1, 9))
_VARIABLES = {
    _INK: "ink",
    _GRID: "grid",
    _BAND: "band",
    _EDGE: "edge",
    _ROOM: "room",
    _DOT: "dot",
    _MASS: "mass",
    _SUPPORT: "support",
}
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cpcal",
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "text.color": _INK,
    "axes.labelcolor": _INK,
    "axes.edgecolor": _INK,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
}
_NO_METADATA = {"Creator": None, "Date": None, "Format": None, "Type": None}


@dataclass(frozen=True)
class Residuals:
    """What is drawn of a leg, in mm: `residual` and `room` (N,), `support` (N,) bool, the band `+-eps`."""

    residual: Floats
    room: Floats
    support: npt.NDArray[np.bool_]
    eps: float


def residual_svg(data: Residuals, *, prefix: str, label: str) -> str:
    """The residuals over the measurements with the band; ids in the SVG begin with `prefix`."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=(6.6, 2.7), layout="constrained")
        axes = figure.add_subplot()
        _axes(axes, len(data.residual))
        axes.axhspan(-data.eps, data.eps, facecolor=_BAND, edgecolor="none", zorder=1)
        for edge in (-data.eps, data.eps):
            axes.axhline(edge, color=_EDGE, linewidth=1.0, zorder=4.5)
        if len(data.residual) > MOST_POINTS:
            _envelope(axes, data)
        else:
            _points(axes, data)
        _support(axes, data)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata=_NO_METADATA)
    return _inline(buffer.getvalue(), prefix, label)


def _axes(axes: Axes, count: int) -> None:
    axes.set_xlabel("measurement, in the order of the campaign")
    axes.set_ylabel("residual [mm]")
    axes.set_xlim(0.0, count + 1.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="y", color=_GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.use_sticky_edges = False
    axes.margins(y=0.07)


def _points(axes: Axes, data: Residuals) -> None:
    numbers = np.arange(1, len(data.residual) + 1)
    if data.room.any():
        gaps = np.full(len(numbers), np.nan)
        bars = np.stack([data.residual - data.room, data.residual + data.room, gaps], axis=1)
        axes.plot(np.repeat(numbers, 3), bars.ravel(), color=_ROOM, linewidth=1.4, zorder=3)
    axes.plot(numbers, data.residual, "o", color=_DOT, markersize=3.0, markeredgewidth=0.0, zorder=4)


def _envelope(axes: Axes, data: Residuals) -> None:
    """Smallest and largest value of each run of neighbours: what N points would cover, in a small file."""
    starts = np.linspace(0, len(data.residual), _BINS, endpoint=False).astype(int)
    ends = np.append(starts[1:], len(data.residual))
    at = np.append(starts + 1.0, ends[-1])

    def fill(lo: Floats, hi: Floats, color: str, zorder: int) -> None:
        low, high = np.minimum.reduceat(lo, starts), np.maximum.reduceat(hi, starts)
        low, high = np.append(low, low[-1]), np.append(high, high[-1])
        axes.fill_between(at, low, high, step="post", facecolor=color, edgecolor="none", zorder=zorder)

    if data.room.any():
        fill(data.residual - data.room, data.residual + data.room, _ROOM, 3)
    fill(data.residual, data.residual, _MASS, 4)


def _support(axes: Axes, data: Residuals) -> None:
    at = np.flatnonzero(data.support)
    axes.plot(
        at + 1,
        data.residual[at],
        "D",
        markersize=5.5,
        fillstyle="none",
        color=_SUPPORT,
        markeredgewidth=1.1,
        zorder=5,
    )


def _inline(svg: str, prefix: str, label: str) -> str:
    """The <svg> element alone, for an HTML page that holds several: own ids, the page's colours and fonts."""
    svg = svg[svg.index("<svg") :].strip()
    svg = re.sub(r"\bid=\"", f'id="{prefix}', svg)
    svg = re.sub(r"xlink:href=\"#", f'href="#{prefix}', svg)
    svg = svg.replace("url(#", f"url(#{prefix}")
    for colour, name in _VARIABLES.items():
        svg = svg.replace(colour, f"var(--{name})")
    svg = svg.replace("'DejaVu Sans'", "system-ui, sans-serif")
    box = re.search(r'viewBox="[^"]*"', svg)
    assert box is not None
    head = f'<svg {box.group()} role="img" aria-label="{label}">'
    return re.sub(r"<svg[^>]*>", lambda _: head, svg, count=1)
