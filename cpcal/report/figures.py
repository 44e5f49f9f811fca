"""The figures of a leg, of all legs, and of a paving, as SVG. They are drawn in plain floating point."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cpcal.common.numbers import stated
from cpcal.common.values import Floats
from cpcal.questions import Result, verdict_of
from cpcal.report.svg import BAND, DASHES, DOT, EDGE, GRID, INK, ROOM, SUPPORT, Plot, Span, Svg, evenly, rectangle

# ------------------------------------------------------------------------------------------------------------------
# Bars: what is proved of the errors of legs, a row each.

FARTHEST = 1e6  # what lies beyond is not drawn, an arrow points to it
_LEAST = 1e-6  # half the width of what is drawn, at least
_ROW, _TOP, _BOTTOM, _WIDE = 22.0, 22.0, 32.0, 330.0  # points
COLOURS = {"explained": "good", "unexplained": "bad", "bounded": "known", "undecided": "open", "undetermined": "poor"}
COLOURS |= {"uncompared": "open"}


def errors_svg(result: Result) -> Svg:
    """A row a leg: grey where it fails, then the bar that is open, from whose end on it passes; and the tolerance.

    A tick at each end of a bar, so that the thinnest is seen. The cross is the error of the recommended parameters for
    all readings.
    """
    asked, names, bars = result.options.tolerance, list[str](), list[tuple[float, float, float, str]]()
    for leg in result.legs:
        hi = math.inf if leg.bracket.point is None else leg.bracket.hi
        passes = hi if leg.passes_from is None else leg.passes_from.eps
        largest = math.nan if leg.recommended is None else leg.recommended.largest
        colour = f"var(--{COLOURS[verdict_of(result, leg).kind]})"
        names.append(f"leg {leg.leg}")
        bars.append((leg.bracket.lo, passes, largest, colour))
    line = asked or 0.0
    most = max([line, *(v for bar in bars for v in bar[:3] if v <= FARTHEST)])
    far, count, size = most + max(0.08 * most, _LEAST), len(bars), (_WIDE, _TOP + _ROW * len(bars) + _BOTTOM)
    spans, few = ((0.0, far), (count - 0.5, -0.5)), (evenly(0.0, far, 4), None)
    plot = Plot(size, *spans, ("tolerance [mm]", ""), ticks=few, grid="x", rows=names, margin=(_TOP, 12.0))
    for row, (lo, hi, _, colour) in enumerate(bars):
        left, right = min(lo, far), min(hi, far)
        plot.area(GRID, rectangle(0.0, row - 0.2, left, row + 0.2))
        plot.area(BAND, rectangle(left, row - 0.25, right, row + 0.25), edge=colour)
        plot.marks([(lo, row), (hi, row)], "|", colour, 15.0, 1.8)
        plot.marks([(far, row)] if hi > far else [], ">", colour, 8.0)
    plot.marks([(bar[2], row) for row, bar in enumerate(bars)], "x", SUPPORT, 6.0, 1.5)
    if asked is not None:
        plot.line(INK, [(asked, count - 0.5), (asked, -0.5)], width=1.2, dash=DASHES)
        x, anchor = float(plot.at([(asked, 0.0)])[0, 0]), "end" if asked > 0.6 * far else "start"
        plot.text(x, 9.0, f"tolerance {stated(asked)} mm", anchor=anchor)
    return plot.svg("The tolerances at which each leg fails, is open and passes, and the one that was asked about")


# ------------------------------------------------------------------------------------------------------------------
# Numbers one after the other: the residuals of a leg over its measurements.

MOST_POINTS = 500  # of more measurements, the worst of each run of neighbours are drawn
SERIES = (475.2, 194.4)  # points


def series(size: Span, count: int, seen: Floats, labels: tuple[str, str]) -> Plot:
    """A plot over 1, 2, ..., `count`, as high as the finite ones of `seen` need."""
    seen = seen[np.isfinite(seen)]
    reach = 0.07 * float(np.ptp(seen)) or 1.0
    rest = evenly(0.0, count + 1.0, 9, whole=True)
    across = [1.0, *(t for t in rest if 1.0 + 0.05 * count <= t <= count)]
    heights = float(seen.min()) - reach, float(seen.max()) + reach
    return Plot(size, (0.0, count + 1.0), heights, labels, ticks=(across, None), grid="y")


def residuals_svg(
    residual: Floats,
    room: Floats,
    fit: Floats,
    band: Span,
    wrong: Floats,
    names: Sequence[str],
    label: str,
    labels: tuple[str, str] = ("measurement, counted from 1 in the order of the campaign", "residual [mm]"),
) -> Svg:
    """Residuals (N,) with bars of sensitivity, the band that they are to be in, and residuals of a `fit`, NaN for none.

    `wrong`: (N,) bool, those that stand out; `labels` of both axes.
    """
    count, (low, high) = len(residual), band
    plot = series(SERIES, count, np.concatenate([[low, high], residual - room, residual + room, fit]), labels)
    plot.area(BAND, rectangle(0.0, low, count + 1.0, high))
    at = np.array(worst_of_neighbours(np.abs(residual) + room, wrong))
    below, points, above, fits = (
        np.stack([at + 1.0, v[at]], axis=1) for v in (residual - room, residual, residual + room, fit)
    )
    if room.any():
        plot.line(ROOM, *np.stack([below, above], axis=1), width=1.4)
    plot.marks(fits, "x", SUPPORT, 3.6, 0.9)
    plot.marks(points, "dot", DOT, 3.0)
    plot.across(band, EDGE, 1.0)
    plot.marks(points[wrong[at]], "diamond", SUPPORT, 7.5, 1.1)
    plot.hover(points, [names[k] for k in at], 6.0)
    return plot.svg(label)


def worst_of_neighbours(size: Floats, chosen: Floats) -> list[int]:
    """The measurements that are drawn, from 0: all of them, or of each run of neighbours the worst; those `chosen`."""
    runs = np.array_split(np.arange(len(size)), min(len(size), MOST_POINTS))
    worst = (int(run[np.argmax(size[run])]) for run in runs)
    return sorted({*worst, *np.flatnonzero(chosen).tolist()})
