"""The figures of a leg, of all legs, and of a paving, as SVG. They are drawn in plain floating point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.numbers import stated
from cpcal.common.values import Floats
from cpcal.questions import Result, verdict_of
from cpcal.report.svg import BAND, DASHES, DOT, EDGE, GRID, INK, ROOM, SUPPORT, Plot, Span, Svg, evenly, rectangle

# ------------------------------------------------------------------------------------------------------------------
# Bars: what is proved of some numbers, a row each: of the errors of legs, and of the parameters of one.

FARTHEST = 1e6  # what lies beyond is not drawn, an arrow points to it
_LEAST = 1e-6  # half the width of what is drawn, at least
_ROW, _TOP, _BOTTOM, _WIDE = 22.0, 22.0, 32.0, 330.0  # points
COLOURS = {"explained": "good", "unexplained": "bad", "bounded": "known", "undecided": "open", "undetermined": "poor"}
COLOURS |= {"uncompared": "open"}


@dataclass(frozen=True)
class Bar:
    """Proved bounds, NaN for none; an estimate, NaN for none; `text` stands at the right."""

    name: str
    lo: float
    hi: float
    estimate: float
    text: str = ""
    colour: str = EDGE


def bars_svg(
    bars: Sequence[Bar], axis: str, label: str, *, line: float = 0.0, shade: bool = False, words: tuple[float, str]
) -> Svg:
    """A tick at each end, so that the thinnest bar is seen; a dashed `line`; `words` above a place, or above the texts.

    `shade`: what is below the bars, from 0, is shaded: proved impossible.
    """
    ends = [v for bar in bars for v in (bar.lo, bar.hi, bar.estimate)]
    seen = [0.0, line, *(v for v in ends if abs(v) <= FARTHEST)]
    reach = max(0.08 * (max(seen) - min(seen)), _LEAST)
    near, far = 0.0 if shade else min(seen) - reach, max(seen) + reach
    count, right = len(bars), 66.0 if any(bar.text for bar in bars) else 12.0
    size = _WIDE, _TOP + _ROW * count + _BOTTOM
    names = [bar.name for bar in bars]
    spans, few = ((near, far), (count - 0.5, -0.5)), (evenly(near, far, 4), None)
    plot = Plot(size, *spans, (axis, ""), ticks=few, grid="x", rows=names, margin=(_TOP, right))
    for row, bar in enumerate(bars):
        lo, hi = (min(max(v, near), far) for v in (bar.lo, bar.hi))
        if shade:
            plot.area(GRID, rectangle(0.0, row - 0.2, lo, row + 0.2))
        if bar.lo <= bar.hi:
            plot.area(BAND, rectangle(lo, row - 0.25, hi, row + 0.25), edge=bar.colour)
            plot.marks([(bar.lo, row), (bar.hi, row)], "|", bar.colour, 15.0, 1.8)
            plot.marks([(near, row)] if bar.lo < near else [], "<", bar.colour, 8.0)
            plot.marks([(far, row)] if bar.hi > far else [], ">", bar.colour, 8.0)
        plot.text(size[0] - right + 8.0, float(plot.at([(near, row)])[0, 1]), bar.text)
    plot.marks([(bar.estimate, row) for row, bar in enumerate(bars)], "x", SUPPORT, 6.0, 1.5)
    plot.line(INK, [(line, count - 0.5), (line, -0.5)], width=1.2, dash=DASHES)
    place, text = words
    x = size[0] - right + 8.0 if place > far else float(plot.at([(place, 0.0)])[0, 0])
    plot.text(x, 9.0, text, anchor="end" if far >= place > 0.6 * far else "start")
    return plot.svg(label)


def errors_svg(result: Result) -> Svg:
    """A row a leg: grey where it fails, then the bar that is open, from whose end on it passes; and the tolerance.

    The cross is the error of the recommended parameters for all readings.
    """
    asked = result.options.tolerance
    bars = []
    for leg in result.legs:
        colour = f"var(--{COLOURS[verdict_of(result, leg).kind]})"
        hi = math.inf if leg.bracket.point is None else leg.bracket.hi
        passes = hi if leg.passes_from is None else leg.passes_from.eps
        largest = math.nan if leg.recommended is None else leg.recommended.largest
        bars.append(Bar(f"leg {leg.leg}", leg.bracket.lo, passes, largest, "", colour))
    label = "The tolerances at which each leg fails, is open and passes, and the one that was asked about"
    words = (0.0, "") if asked is None else (asked, f"tolerance {stated(asked)} mm")
    return bars_svg(bars, "tolerance [mm]", label, line=asked or 0.0, shade=True, words=words)


# ------------------------------------------------------------------------------------------------------------------
# Numbers one after the other: the residuals of a leg over its measurements.

MOST_POINTS = 500  # of more measurements, the worst of each run of neighbours are drawn
SERIES = (475.2, 194.4)  # points


def series(size: Span, count: int, seen: Floats, labels: tuple[str, str], *, floor: float = -math.inf) -> Plot:
    """A plot over 1, 2, ..., `count`, as high as the finite ones of `seen` need, no lower than `floor`."""
    seen = seen[np.isfinite(seen)]
    reach = 0.07 * float(np.ptp(seen)) or 1.0
    rest = evenly(0.0, count + 1.0, 9, whole=True)
    across = [1.0, *(t for t in rest if 1.0 + 0.05 * count <= t <= count)]
    heights = max(float(seen.min()) - reach, floor), float(seen.max()) + reach
    return Plot(size, (0.0, count + 1.0), heights, labels, ticks=(across, None), grid="y")


def residuals_svg(
    residual: Floats, room: Floats, fit: Floats, eps: float, support: Floats, names: Sequence[str], label: str
) -> Svg:
    """Residuals (N,) in mm with bars of sensitivity, the band of +-eps, and residuals of a `fit`, NaN for none.

    `support`: (N,) bool.
    """
    count = len(residual)
    labels = "measurement, counted from 1 in the order of the campaign", "residual [mm]"
    plot = series(SERIES, count, np.concatenate([[-eps, eps], residual - room, residual + room, fit]), labels)
    plot.area(BAND, rectangle(0.0, -eps, count + 1.0, eps))
    at = np.array(worst_of_neighbours(np.abs(residual) + room, support))
    below, points, above, fits = (
        np.stack([at + 1.0, v[at]], axis=1) for v in (residual - room, residual, residual + room, fit)
    )
    if room.any():
        plot.line(ROOM, *np.stack([below, above], axis=1), width=1.4)
    plot.marks(fits, "x", SUPPORT, 3.6, 0.9)
    plot.marks(points, "dot", DOT, 3.0)
    plot.across((-eps, eps), EDGE, 1.0)
    plot.marks(points[support[at]], "diamond", SUPPORT, 7.5, 1.1)
    plot.hover(points, [names[k] for k in at], 6.0)
    return plot.svg(label)


def worst_of_neighbours(size: Floats, chosen: Floats) -> list[int]:
    """The measurements that are drawn, from 0: all of them, or of each run of neighbours the worst; those `chosen`."""
    runs = np.array_split(np.arange(len(size)), min(len(size), MOST_POINTS))
    worst = (int(run[np.argmax(size[run])]) for run in runs)
    return sorted({*worst, *np.flatnonzero(chosen).tolist()})
