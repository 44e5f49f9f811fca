"""Figures as inline SVG, drawn from arrays: points (1/72 inch), the page's own colours and fonts, no date, no chance.

An `Axes` is a frame in a `Figure`; it maps data to points and draws axes with ticks, lines, areas and marks. No text of
the user's is markup: what is written is escaped.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from cpcal.common.files import write_file
from cpcal.common.values import Floats

INK, GRID, BAND, EDGE, ROOM, DOT, SUPPORT = (
    f"var(--{name})" for name in ("ink", "grid", "band", "edge", "room", "dot", "support")
)
DASHES = "5 3.5"
_FONT = "font: 9px system-ui, sans-serif"
_LETTER = 5.6  # points: how wide a letter or a digit is, about
_TICK, _PAD = 3.0, 2.5  # of an axis: length of a tick, and the distance to its label
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # between ticks, times a power of ten
_SHAPES = {  # within a square from -1 to 1; those that are not closed have no inside
    "s": ((-1, -1), (1, -1), (1, 1), (-1, 1)),
    "D": ((0, -1), (1, 0), (0, 1), (-1, 0)),
    "^": ((0, -1), (1, 1), (-1, 1)),
    "<": ((-1, 0), (1, -1), (1, 1)),
    ">": ((1, 0), (-1, -1), (-1, 1)),
}
Frame = tuple[float, float, float, float]  # left, top, right, bottom, in points from the figure's top left
Span = tuple[float, float]


class Svg(Markup):
    """A figure: an <svg> element in the page's colours. A notebook shows it as a document of its own, in light ones."""

    def document(self) -> str:
        css = (files("cpcal.report") / "templates" / "report.css").read_text(encoding="utf-8")
        colours = dict(re.findall(r"--([\w-]+): ([^;]+);", css[: css.index("@media")]))
        text = re.sub(r"var\(--([\w-]+)\)", lambda name: colours[name[1]], str(self))
        return text.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"

    def save(self, file: str | Path) -> Path:
        """Raises InputError where it cannot be written."""
        return write_file(file, self.document())

    def _repr_svg_(self) -> str:
        return self.document()


@dataclass(frozen=True)
class Figure:
    """Width and height in points, and the elements drawn so far."""

    width: float
    height: float
    elements: list[str] = field(default_factory=list)

    def svg(self, label: str) -> Svg:
        """`label` says what is seen, to those who do not."""
        head = (
            f'<svg viewBox="0 0 {_n(self.width)} {_n(self.height)}" role="img" aria-label="{escape(label)}" '
            f'style="{_FONT}">'
        )
        return Svg("\n".join([head, *self.elements, "</svg>"]))

    def text(self, x: float, y: float, words: str, *, anchor: str = "start", turned: bool = False) -> None:
        """Words whose middle height is at y; turned ones run upwards."""
        turn = f' transform="rotate(-90 {_n(x)} {_n(y)})"' if turned else ""
        style = f"fill: {INK}; text-anchor: {anchor}"
        self.elements.append(
            f'<text x="{_n(x)}" y="{_n(y)}" dy="0.35em"{turn} style="{style}">{escape(words, quote=False)}</text>'
        )


@dataclass(frozen=True)
class Axes:
    """A frame whose left and right edges are the data `x`, whose bottom and top edges are `y`."""

    figure: Figure
    frame: Frame
    x: Span
    y: Span

    def at(self, points: npt.ArrayLike) -> Floats:
        """Data (n, 2) in points."""
        left, top, right, bottom = self.frame
        data = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        start = np.array([self.x[0], self.y[0]])
        share = (data - start) / (np.array([self.x[1], self.y[1]]) - start)
        return np.asarray(np.array([left, bottom]) + share * np.array([right - left, top - bottom]))

    def data(self, points: npt.ArrayLike) -> Floats:
        """The other way: points (..., 2) of the figure in data."""
        left, top, right, bottom = self.frame
        share = (np.asarray(points, dtype=np.float64) - (left, bottom)) / (right - left, top - bottom)
        return np.asarray((self.x[0], self.y[0]) + share * (self.x[1] - self.x[0], self.y[1] - self.y[0]))

    def x_axis(self, ticks: Sequence[float], label: str, *, grid: bool = False) -> None:
        """Below the frame."""
        left, _, right, bottom = self.frame
        if grid:
            self.line(GRID, *([(t, self.y[0]), (t, self.y[1])] for t in ticks), width=0.6)
        places = self.at([(t, self.y[0]) for t in ticks])[:, 0].tolist()
        ends = "".join(f"M{_n(x)} {_n(bottom)}v{_n(_TICK)}" for x in places)
        self._path(f"M{_n(left)} {_n(bottom)}H{_n(right)}{ends}", _stroke(INK, 0.8))
        for x, text in zip(places, tick_labels(ticks), strict=True):
            self.figure.text(x, bottom + _TICK + _PAD + 5.0, text, anchor="middle")
        self.figure.text(0.5 * (left + right), bottom + _TICK + _PAD + 17.0, label, anchor="middle")

    def y_axis(self, ticks: Sequence[float], label: str, *, grid: bool = False, away: float | None = None) -> None:
        """At the left of the frame; the label is `away` from it, else as close as the numbers let it be."""
        left, top, _, bottom = self.frame
        if grid:
            self.across(ticks)
        places, texts = self.at([(self.x[0], t) for t in ticks])[:, 1].tolist(), tick_labels(ticks)
        ends = "".join(f"M{_n(left)} {_n(y)}h{_n(-_TICK)}" for y in places)
        self._path(f"M{_n(left)} {_n(top)}V{_n(bottom)}{ends}", _stroke(INK, 0.8))
        for y, text in zip(places, texts, strict=True):
            self.figure.text(left - _TICK - _PAD, y, text, anchor="end")
        self.figure.text(
            left - (label_room(texts) if away is None else away),
            0.5 * (top + bottom),
            label,
            anchor="middle",
            turned=True,
        )

    def rows(self, names: Sequence[str]) -> None:
        """Names at the left, at the heights 0, 1, ..."""
        for k, name in enumerate(names):
            self.figure.text(self.frame[0] - 9.0, float(self.at([(self.x[0], k)])[0, 1]), name, anchor="end")

    def area(
        self, fill: str, *polygons: npt.ArrayLike, edge: str | None = None, width: float = 0.8, dash: str = ""
    ) -> None:
        """Polygons (n, 2) that look alike."""
        line = "" if edge is None else _line(edge, width, dash) + "; "
        self._path("".join(_track(self.at(points)) + "Z" for points in polygons), f"{line}fill: {fill}")

    def line(self, colour: str, *tracks: npt.ArrayLike, width: float = 1.0, dash: str = "") -> None:
        """Polylines (n, 2) that look alike."""
        self._path("".join(_track(self.at(points)) for points in tracks), _stroke(colour, width, dash))

    def across(self, ticks: Iterable[float], colour: str = GRID, width: float = 0.6, dash: str = "") -> None:
        """Lines from left to right at these heights."""
        self.line(colour, *([(self.x[0], t), (self.x[1], t)] for t in ticks), width=width, dash=dash)

    def dots(self, points: npt.ArrayLike, colour: str, size: float) -> None:
        """Discs of that diameter, all of them one path."""
        places = "".join(f"M{_n(x)} {_n(y)}h0" for x, y in self.at(points).tolist())
        self._path(places, f"{_stroke(colour, size)}; stroke-linecap: round")

    def marks(self, points: npt.ArrayLike, shape: str, colour: str, size: float, *, width: float = 0.0) -> None:
        """Marks of that size: o, x, |, or one of _SHAPES: filled, or with a line of `width` hollow."""
        if shape == "o":
            self.dots(points, colour, size)
            return
        tracks, h = "", 0.5 * size
        for x, y in self.at(points).tolist():
            if shape == "x":
                tracks += f"M{_n(x - h)} {_n(y - h)}l{_n(size)} {_n(size)}m0 {_n(-size)}l{_n(-size)} {_n(size)}"
            elif shape == "|":
                tracks += f"M{_n(x)} {_n(y - h)}v{_n(size)}"
            else:
                tracks += _track(np.array([x, y]) + h * np.array(_SHAPES[shape], dtype=np.float64)) + "Z"
        filled = shape in _SHAPES and not width
        self._path(tracks, f"fill: {colour}" if filled else _stroke(colour, width))

    def hover(self, points: npt.ArrayLike, texts: Sequence[str], size: float = 10.0) -> None:
        """What is said of each point when the pointer is on it, within a disc of that diameter."""
        for (x, y), text in zip(self.at(points).tolist(), texts, strict=True):
            disc = f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(0.5 * size)}" style="fill: transparent">'
            self.figure.elements.append(f"{disc}<title>{escape(text, quote=False)}</title></circle>")

    def _path(self, d: str, style: str) -> None:
        if d:
            self.figure.elements.append(f'<path d="{d}" style="{style}"/>')


def chart(
    figure: Figure,
    x: Span,
    y: Span,
    labels: tuple[str, str],
    *,
    across: Sequence[float],
    grid: bool,
    most: int = 8,
    part: Span = (0.0, 1.0),
) -> Axes:
    """Axes with numbers in a part of a figure's width; `across`: ticks of x, `most`: so many of y; `grid`: at these."""
    numbers = ticks(*y, most)
    left, right = part[0] * figure.width + label_room(tick_labels(numbers)) + 8.0, part[1] * figure.width - 12.0
    axes = Axes(figure, (left, 6.0, right, figure.height - 32.0), x, y)
    axes.y_axis(numbers, labels[1], grid=grid)
    axes.x_axis(across, labels[0])
    return axes


def counted(count: int, most: int = 8) -> list[float]:
    """Ticks that count from 1."""
    rest = ticks(0.0, count + 1.0, most, whole=True)
    return [1.0, *(t for t in rest if 1.0 + 0.05 * count <= t <= count)]


def ticks(lo: float, hi: float, most: int = 8, *, whole: bool = False) -> list[float]:
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


def label_room(texts: Sequence[str]) -> float:
    """How far left of its axis the label stands beside numbers."""
    return _TICK + _PAD + text_width(texts) + 10.0


def text_width(texts: Iterable[str]) -> float:
    """Of the longest, about."""
    return _LETTER * max(map(len, texts), default=0)


def _track(points: Floats) -> str:
    return "M" + "L".join(f"{_n(x)} {_n(y)}" for x, y in points.tolist())


def _stroke(colour: str, width: float, dash: str = "") -> str:
    return f"fill: none; {_line(colour, width, dash)}"


def _line(colour: str, width: float, dash: str) -> str:
    return f"stroke: {colour}; stroke-width: {_n(width)}" + (f"; stroke-dasharray: {dash}" if dash else "")


def _n(value: float) -> str:
    """A coordinate, to a hundredth of a point."""
    return f"{round(value, 2) + 0.0:g}" if abs(value) < 1e4 else f"{value:.2f}"
