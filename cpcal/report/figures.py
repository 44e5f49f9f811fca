"""Figures as inline SVG, drawn from arrays: points (1/72 inch), the page's own colours and fonts, no date, no chance.

A `Plot` is a figure with one frame; it maps data to points and draws axes, lines, areas and marks. No text of the
user's is markup: what is written is escaped. What is drawn is plain floating point.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files

import numpy as np
from markupsafe import Markup

from cpcal.common.numbers import stated
from cpcal.common.values import ArrayLike, Bools, Floats, floats
from cpcal.questions import Result, verdict_of

INK, GRID, BAND, EDGE, ROOM, DOT, SUPPORT = (
    f"var(--{name})" for name in ("ink", "grid", "band", "edge", "room", "dot", "support")
)
DASHES = "5 3.5"
_FONT = "font: 9px system-ui, sans-serif"
_LETTER = 5.6  # points: how wide a letter or a digit is, about
_BELOW = 32.0  # points below the frame, for the axis
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # between ticks, times a power of ten
_SHAPES = {  # polylines within a square from -1 to 1
    "x": (((-1, -1), (1, 1)), ((-1, 1), (1, -1))),
    "|": (((0, -1), (0, 1)),),
    "diamond": (((0, -1), (1, 0), (0, 1), (-1, 0), (0, -1)),),
    ">": (((-1, -1), (1, 0), (-1, 1)),),
}
Span = tuple[float, float]


class Svg(Markup):
    """A figure: an <svg> element in the page's colours. A notebook shows it as a document of its own, in light ones."""

    def document(self) -> str:
        css = (files("cpcal.report") / "templates" / "report.css").read_text(encoding="utf-8")
        colours = dict(re.findall(r"--([\w-]+): ([^;]+);", css[: css.index("@media")]))
        text = re.sub(r"var\(--([\w-]+)\)", lambda name: colours[name[1]], str(self))
        return text.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"

    _repr_svg_ = document


class Plot:
    """A frame whose left and right edges are the data `x`, whose bottom and top edges are `y`, and what is drawn in it.

    size    width and height in points; labels  of both axes
    ticks   of both axes; left out they are chosen, and so are texts. grid: the axes at whose ticks lines are drawn
    margin  points above and at the right
    """

    def __init__(
        self,
        size: Span,
        x: Span,
        y: Span,
        labels: tuple[str, str],
        *,
        ticks: tuple[Sequence[float] | None, Sequence[float] | Mapping[float, str] | None] = (None, None),
        grid: str = "",
        margin: Span = (6.0, 12.0),
    ) -> None:
        self.size, self.x, self.y = size, x, y
        self.elements: list[str] = []
        along, up = ticks[0] or evenly(*x), ticks[1] or evenly(min(y), max(y))
        texts = [*up.values()] if isinstance(up, Mapping) else tick_labels(up)
        left = _LETTER * max(map(len, texts), default=0) + (24.0 if labels[1] else 14.0)
        top, right, bottom = margin[0], size[0] - margin[1], size[1] - _BELOW
        self.frame = left, top, right, bottom
        if "x" in grid:
            self.line(GRID, *([(t, y[0]), (t, y[1])] for t in along), width=0.6)
        if "y" in grid:
            self.across(up)
        places = self.at([(t, y[0]) for t in along])[:, 0].tolist()
        for place, text in zip(places, tick_labels(along), strict=True):
            self.text(place, bottom + 10.5, text, anchor="middle")
        self.text(0.5 * (left + right), bottom + 22.5, labels[0], anchor="middle")
        heights = self.at([(x[0], t) for t in up])[:, 1].tolist()
        for height, text in zip(heights, texts, strict=True):
            self.text(left - 5.5, height, text, anchor="end")
        self.text(8.0, 0.5 * (top + bottom), labels[1], anchor="middle", turned=True)
        track = f"M{_n(left)} {_n(top)}V{_n(bottom)}H{_n(right)}" + "".join(f"M{_n(p)} {_n(bottom)}v3" for p in places)
        self._path(track + "".join(f"M{_n(left)} {_n(h)}h-3" for h in heights), INK, 0.8)

    def svg(self, label: str) -> Svg:
        """`label` says what is seen, to those who do not."""
        box = f"0 0 {_n(self.size[0])} {_n(self.size[1])}"
        head = f'<svg viewBox="{box}" role="img" aria-label="{escape(label)}" style="{_FONT}">'
        return Svg("\n".join([head, *self.elements, "</svg>"]))

    def text(self, x: float, y: float, words: str, *, anchor: str = "start", turned: bool = False) -> None:
        """Words whose middle height is at y, in points; turned ones run upwards."""
        turn = f' transform="rotate(-90 {_n(x)} {_n(y)})"' if turned else ""
        style = f"fill: {INK}; text-anchor: {anchor}"
        self.elements.append(
            f'<text x="{_n(x)}" y="{_n(y)}" dy="0.35em"{turn} style="{style}">{escape(words, quote=False)}</text>'
        )

    def at(self, points: ArrayLike) -> Floats:
        """Data (n, 2) in points."""
        left, top, right, bottom = self.frame
        start, end = np.array([self.x, self.y]).T
        share = (floats(points).reshape(-1, 2) - start) / (end - start)
        return np.asarray(np.array([left, bottom]) + share * np.array([right - left, top - bottom]))

    def area(self, fill: str, polygon: ArrayLike, edge: str = "none", width: float = 0.8, dash: str = "") -> None:
        """A polygon (n, 2)."""
        self._path(_track(self.at(polygon)) + "Z", edge, width, dash, fill)

    def line(self, colour: str, *tracks: ArrayLike, width: float = 1.0, dash: str = "") -> None:
        """Polylines (n, 2) that look alike."""
        self._path("".join(_track(self.at(points)) for points in tracks), colour, width, dash)

    def across(self, heights: Iterable[float], colour: str = GRID, width: float = 0.6) -> None:
        """Lines from left to right at these heights."""
        self.line(colour, *([(self.x[0], h), (self.x[1], h)] for h in heights), width=width)

    def marks(self, points: ArrayLike, shape: str, colour: str, size: float, width: float = 1.4) -> None:
        """Marks of that size where points lie in the frame: "dot", or one of _SHAPES, drawn with a line of `width`."""
        places = self.at(points)
        low, high = np.reshape(self.frame, (2, 2)) + [[-0.01], [0.01]]
        places = places[((places >= low) & (places <= high)).all(axis=1)]
        if shape == "dot":
            track = "".join(f"M{_n(x)} {_n(y)}h0" for x, y in places.tolist())
            self._path(track, f"{colour}; stroke-linecap: round", size)
        else:
            lines = [np.array(line, np.float64) for line in _SHAPES[shape]]
            self._path("".join(_track(place + 0.5 * size * line) for place in places for line in lines), colour, width)

    def hover(self, points: ArrayLike, texts: Sequence[str]) -> None:
        """What is said of each point when the pointer is on it, within a disc."""
        for (x, y), text in zip(self.at(points).tolist(), texts, strict=True):
            disc = f'<circle cx="{_n(x)}" cy="{_n(y)}" r="3" style="fill: transparent">'
            self.elements.append(f"{disc}<title>{escape(text, quote=False)}</title></circle>")

    def _path(self, track: str, stroke: str, width: float, dash: str = "", fill: str = "none") -> None:
        if track:
            dashes = f"; stroke-dasharray: {dash}" if dash else ""
            style = f"fill: {fill}; stroke: {stroke}; stroke-width: {_n(width)}{dashes}"
            self.elements.append(f'<path d="{track}" style="{style}"/>')


def evenly(lo: float, hi: float, most: int = 6, *, whole: bool = False) -> list[float]:
    """Round numbers from `lo` to `hi`, about `most` steps between them at most; `whole`: integers."""
    least = (hi - lo) / most
    power = 10.0 ** math.floor(math.log10(least))
    step = next(power * s for s in _STEPS if power * s >= least * (1.0 - 1e-9))
    if whole:
        step = max(1.0, 2.0 if step == 2.5 else step)
    first, last = math.ceil(lo / step - 1e-9), math.floor(hi / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def tick_labels(values: Sequence[float]) -> list[str]:
    """Numbers with as many decimals as all of them need."""
    size = max(map(abs, values), default=0.0)
    if size and not 1e-4 <= size < 1e6:
        texts = [f"{v:.3g}".replace("e-0", "e-").replace("e+0", "e") for v in values]
    else:
        decimals = next((d for d in range(8) if all(abs(v - round(v, d)) <= 1e-9 * size for v in values)), 8)
        texts = [f"{v:.{decimals}f}" for v in values]
    return [text.replace("-", "−") for text in texts]


def rectangle(left: float, low: float, right: float, high: float) -> list[tuple[float, float]]:
    return [(left, low), (right, low), (right, high), (left, high)]


def _track(points: Floats) -> str:
    return "M" + "L".join(f"{_n(x)} {_n(y)}" for x, y in points.tolist())


def _n(value: float) -> str:
    """A coordinate, to a hundredth of a point."""
    return f"{round(value, 2) + 0.0:g}"


# ------------------------------------------------------------------------------------------------------------------
# Bars: what is proved of the errors of legs, a row each.

FARTHEST = 1e6  # what lies beyond is not drawn, an arrow points to it
_LEAST = 1e-6  # half the width of what is drawn, at least
_ROW, _TOP, _BOTTOM, _WIDE = 22.0, 22.0, 32.0, 330.0  # points
COLOURS = {
    "explained": "good",
    "unexplained": "bad",
    "bounded": "known",
    "undecided": "open",
    "undetermined": "poor",
    "uncompared": "open",
}


def errors_svg(result: Result) -> Svg:
    """A row a leg: grey where it fails, then the bar that is open, from whose end on it passes; and the tolerance.

    A tick at each end of a bar, so that the thinnest is seen. The cross is the error of the recommended parameters for
    all readings.
    """
    asked, names, bars = result.options.tolerance, dict[float, str](), list[tuple[float, float, float, str]]()
    for leg in result.legs:
        passes = leg.bracket.hi if leg.passes_from is None else leg.passes_from.eps
        colour = f"var(--{COLOURS[verdict_of(result, leg).kind]})"
        names[len(bars)] = f"leg {leg.leg}"
        bars.append((leg.bracket.lo, passes, leg.recommended.largest, colour))
    most = max([asked or 0.0, *(v for bar in bars for v in bar[:3] if v <= FARTHEST)])
    far, count = most + max(0.08 * most, _LEAST), len(bars)
    plot = Plot(
        (_WIDE, _TOP + _ROW * count + _BOTTOM),
        (0.0, far),
        (count - 0.5, -0.5),
        ("tolerance [mm]", ""),
        ticks=(evenly(0.0, far, 4), names),
        grid="x",
        margin=(_TOP, 12.0),
    )
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
    wrong: Bools,
    names: Sequence[str],
    label: str,
    labels: tuple[str, str] = ("measurement, counted from 1 in the order of the campaign", "residual [mm]"),
) -> Svg:
    """Residuals (N,) with bars of sensitivity, the band that they are to be in, and residuals of a `fit`, NaN for none.

    `wrong`: (N,), those that stand out; `labels` of both axes.
    """
    count, (low, high) = len(residual), band
    plot = series(SERIES, count, np.concatenate([[low, high], residual - room, residual + room, fit]), labels)
    plot.area(BAND, rectangle(0.0, low, count + 1.0, high))
    # what is drawn: all measurements, or of each run of neighbours the worst, and those that stand out
    size, runs = np.abs(residual) + room, np.array_split(np.arange(count), min(count, MOST_POINTS))
    at = np.union1d([run[np.argmax(size[run])] for run in runs], np.flatnonzero(wrong))
    below, points, above, fits = (
        np.stack([at + 1.0, v[at]], axis=1) for v in (residual - room, residual, residual + room, fit)
    )
    if room.any():
        plot.line(ROOM, *np.stack([below, above], axis=1), width=1.4)
    plot.marks(fits, "x", SUPPORT, 3.6, 0.9)
    plot.marks(points, "dot", DOT, 3.0)
    plot.across(band, EDGE, 1.0)
    plot.marks(points[wrong[at]], "diamond", SUPPORT, 7.5, 1.1)
    plot.hover(points, [names[k] for k in at])
    return plot.svg(label)
