"""Figures as inline SVG, drawn from arrays: points (1/72 inch), the page's own colours and fonts, no date, no chance.

An `Axes` is a frame in a `Figure`; it maps data to points and draws axes with ticks, lines, areas and marks. No text of
the user's is markup: what is written is escaped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np
import numpy.typing as npt

from cpcal.common.numbers import plain_gap
from cpcal.common.values import Floats
from cpcal.questions.result import HalfPlane

INK, GRID, BAND, EDGE, ROOM, DOT, MASS, SUPPORT = (
    f"var(--{name})" for name in ("ink", "grid", "band", "edge", "room", "dot", "mass", "support")
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


@dataclass(frozen=True)
class Figure:
    """Width and height in points, and the elements drawn so far."""

    width: float
    height: float
    elements: list[str] = field(default_factory=list)

    def svg(self, label: str) -> str:
        """The <svg> element; `label` is markup: text of ours alone."""
        head = f'<svg viewBox="0 0 {_n(self.width)} {_n(self.height)}" role="img" aria-label="{label}" style="{_FONT}">'
        return "\n".join([head, *self.elements, "</svg>"])

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
            self.lines([[(t, self.y[0]), (t, self.y[1])] for t in ticks], GRID, 0.6)
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
            self.lines([[(self.x[0], t), (self.x[1], t)] for t in ticks], GRID, 0.6)
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
        self, points: npt.ArrayLike, fill: str, edge: str | None = None, width: float = 0.8, dash: str = ""
    ) -> None:
        """A polygon (n, 2)."""
        self.areas([points], fill, edge, width, dash)

    def areas(
        self, polygons: Iterable[npt.ArrayLike], fill: str, edge: str | None = None, width: float = 0.8, dash: str = ""
    ) -> None:
        """Polygons that look alike."""
        line = "" if edge is None else _line(edge, width, dash) + "; "
        self._path("".join(_track(self.at(points)) + "Z" for points in polygons), f"{line}fill: {fill}")

    def line(self, points: npt.ArrayLike, colour: str, width: float = 1.0, dash: str = "") -> None:
        """A polyline (n, 2)."""
        self.lines([points], colour, width, dash)

    def lines(self, tracks: Iterable[npt.ArrayLike], colour: str, width: float = 1.0, dash: str = "") -> None:
        """Polylines that look alike."""
        self._path("".join(_track(self.at(points)) for points in tracks), _stroke(colour, width, dash))

    def dots(self, points: npt.ArrayLike, colour: str, size: float) -> None:
        """Discs of that diameter, all of them one path."""
        places = "".join(f"M{_n(x)} {_n(y)}h0" for x, y in self.at(points).tolist())
        self._path(places, f"{_stroke(colour, size)}; stroke-linecap: round")

    def marks(self, points: npt.ArrayLike, shape: str, colour: str, size: float, *, width: float = 0.0) -> None:
        """Marks of that size: x, |, or one of _SHAPES: filled, or with a line of `width` hollow."""
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


# ------------------------------------------------------------------------------------------------------------------
# The figures of two parameters at a time: what proved half-planes leave of the plane, and where points lie in it.

_PANEL_MARGIN = 0.12  # of the rectangle's width, on each side
_UNITS = (
    (1e4, 1e-3, "m"),
    (1e-2, 1.0, "mm"),
    (1e-5, 1e3, "µm"),
    (0.0, 1e6, "nm"),
)  # by half the width, mm
_PANEL_SIZE = (180.0, 172.8)  # points
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
    reach = _PANEL_MARGIN * (panel.hi - panel.lo)
    return bool(((point >= panel.lo - reach) & (point <= panel.hi + reach)).all())


def panel_svg(panel: Panel, *, label: str) -> str:
    """The rectangle, the polygon in it and the points in view."""
    units = [_unit(0.5 * float(hi - lo)) for lo, hi in zip(panel.lo, panel.hi, strict=True)]
    scale = np.array([factor for factor, _ in units])
    lo, hi = (scale * (end - panel.origin) for end in (panel.lo, panel.hi))
    (left, low), (right, high) = lo - _PANEL_MARGIN * (hi - lo), hi + _PANEL_MARGIN * (hi - lo)
    figure = Figure(*_PANEL_SIZE)
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


# ------------------------------------------------------------------------------------------------------------------
# The figure of the enclosure of a leg's parameters against the nominal values and the fit.

FARTHEST = 1e6  # mm from the nominal value; what lies beyond is not drawn, an arrow points to it
_LEAST = 1e-6  # mm, half the width of what is drawn, at least
_BAR_SIZE = (302.4, 208.8)  # points
_FRAME_LEFT = 14.0  # and the width of the names
_WIDTHS = 66.0  # at the right, for the widths
_BAR_MARGIN = 0.08  # of that width, on each side


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


def enclosure_svg(data: Enclosure, *, label: str, unit: str = "mm", origin: str = "nominal value") -> str:
    """Bars from `lo` to `hi` with a tick at each end, so that the thinnest is seen."""
    figure, count, (near, far) = Figure(*_BAR_SIZE), len(data.names), _view(data)
    frame = (_FRAME_LEFT + text_width(data.names), 22.0, _BAR_SIZE[0] - _WIDTHS, _BAR_SIZE[1] - 32.0)
    axes = Axes(figure, frame, (near, far), (count - 0.5, -0.5))
    axes.x_axis(ticks(near, far, 5), f"parameter − {origin} [{unit}]", grid=True)
    axes.rows(data.names)
    if not data.empty:
        for k in range(count):
            _bar(axes, k, data, near, far)
    axes.line([(0.0, count - 0.5), (0.0, -0.5)], INK, 1.0, DASHES)
    if data.fit is not None:
        at = np.stack([data.fit - data.nominal, np.arange(float(count))], axis=1)
        axes.marks(at[(at[:, 0] >= near) & (at[:, 0] <= far)], "x", SUPPORT, 6.0, width=1.5)
    _widths(axes, data, unit)
    return figure.svg(label)


def _bar(axes: Axes, row: int, data: Enclosure, near: float, far: float) -> None:
    """The part in view; a tick at a bound, an arrow at the edge of the view where the bound is beyond it."""
    lo, hi = float(data.lo[row] - data.nominal[row]), float(data.hi[row] - data.nominal[row])
    left, right = (float(np.clip(v, near, far)) for v in (lo, hi))
    axes.area([(left, row - 0.25), (right, row - 0.25), (right, row + 0.25), (left, row + 0.25)], BAND, EDGE)
    for bound in (lo, hi):
        if near <= bound <= far:
            axes.marks([(bound, row)], "|", EDGE, 15.0, width=1.6)
        else:
            axes.marks([(near if bound < near else far, row)], "<" if bound < near else ">", EDGE, 8.0)


def _widths(axes: Axes, data: Enclosure, unit: str) -> None:
    """The width of every bar as a number at the right."""
    x = axes.frame[2] + 8.0
    axes.figure.text(x, 9.0, f"width [{unit}]")
    for k, (lo, hi) in enumerate(zip(data.lo, data.hi, strict=True)):
        text = "none" if data.empty else plain_gap(float(lo), float(hi))
        axes.figure.text(x, float(axes.at([(axes.x[0], k)])[0, 1]), text)


def _view(data: Enclosure) -> tuple[float, float]:
    """From and to on the axis: 0 and all that is not too far away."""
    values = [np.zeros(1), data.lo - data.nominal, data.hi - data.nominal]
    if data.fit is not None:
        values.append(data.fit - data.nominal)
    every = np.concatenate(values)
    every = every[np.abs(every) <= FARTHEST]
    least, most = float(every.min()), float(every.max())
    half = max(0.5 * (most - least), _LEAST) * (1.0 + 2.0 * _BAR_MARGIN)
    middle = 0.5 * (least + most)
    return middle - half, middle + half


def _far(values: Floats) -> npt.NDArray[np.bool_]:
    return np.abs(values) > FARTHEST


# ------------------------------------------------------------------------------------------------------------------
# The figure of the residuals of a proved point over the measurements.

MOST_POINTS = 500  # more measurements are drawn as an envelope
_BINS = 250
_SIZE = (475.2, 194.4)  # points
_MARGIN = 0.07  # of the height, above and below


@dataclass(frozen=True)
class Residuals:
    """What is drawn of a leg, in mm: `residual` and `sensitivity` (N,), `support` (N,) bool, the band `+-eps`.

    `fit` (N,): residuals of the least-squares fit, None without one. `names`: of the measurements, for the pointer.
    """

    residual: Floats
    sensitivity: Floats
    support: npt.NDArray[np.bool_]
    eps: float
    fit: Floats | None = None
    names: Sequence[str] = ()


def residual_svg(data: Residuals, *, label: str) -> str:
    """The residuals over the measurements with the band."""
    figure, count = Figure(*_SIZE), len(data.residual)
    lo, hi = _span(data)
    numbers = ticks(lo, hi)
    left = label_room(tick_labels(numbers)) + 8.0
    axes = Axes(figure, (left, 5.0, _SIZE[0] - 12.0, _SIZE[1] - 32.0), (0.0, count + 1.0), (lo, hi))
    axes.area([(0.0, -data.eps), (count + 1.0, -data.eps), (count + 1.0, data.eps), (0.0, data.eps)], BAND)
    axes.y_axis(numbers, "residual [mm]", grid=True)
    if count > MOST_POINTS:
        _envelope(axes, data)
    else:
        _points(axes, data)
    axes.lines([[(0.0, edge), (count + 1.0, edge)] for edge in (-data.eps, data.eps)], EDGE)
    at = np.flatnonzero(data.support)
    axes.marks(np.stack([at + 1.0, data.residual[at]], axis=1), "D", SUPPORT, 7.5, width=1.1)
    axes.x_axis(_counted(count), "measurement, counted from 1 in the order of the campaign")
    if count <= MOST_POINTS and data.names:
        axes.hover(np.stack([np.arange(1.0, count + 1.0), data.residual], axis=1), data.names, 6.0)
    return figure.svg(label)


def _span(data: Residuals) -> tuple[float, float]:
    """Of residuals, their bars and the band, with a margin."""
    lo = min(-data.eps, float((data.residual - data.sensitivity).min()))
    hi = max(data.eps, float((data.residual + data.sensitivity).max()))
    if data.fit is not None:
        lo, hi = min(lo, float(data.fit.min())), max(hi, float(data.fit.max()))
    reach = _MARGIN * max(hi - lo, 1e-300) if hi > lo else 1.0
    return lo - reach, hi + reach


def _counted(count: int) -> list[float]:
    """Ticks that count from 1."""
    rest = [t for t in ticks(0.0, count + 1.0, 9, whole=True) if 0.0 < t <= count]
    return [1.0, *(t for t in rest if t >= 1.0 + 0.05 * count)]


def _points(axes: Axes, data: Residuals) -> None:
    numbers = np.arange(1.0, len(data.residual) + 1.0)
    if data.sensitivity.any():
        ends = [np.stack([numbers, data.residual + way * data.sensitivity], axis=1) for way in (-1.0, 1.0)]
        axes.lines(np.stack(ends, axis=1), ROOM, 1.4)
    if data.fit is not None:
        axes.marks(np.stack([numbers, data.fit], axis=1), "x", SUPPORT, 3.6, width=0.9)
    axes.dots(np.stack([numbers, data.residual], axis=1), DOT, 3.0)


def _envelope(axes: Axes, data: Residuals) -> None:
    """Smallest and largest value of each run of neighbours: what N points would cover, in a small file."""
    starts = np.linspace(0, len(data.residual), _BINS, endpoint=False).astype(int)
    at = np.append(starts + 1.0, float(len(data.residual)))

    def fill(lo: Floats, hi: Floats, colour: str) -> None:
        low, high = np.minimum.reduceat(lo, starts), np.maximum.reduceat(hi, starts)
        steps = np.repeat(at, 2)[1:-1]
        above, below = np.stack([steps, np.repeat(high, 2)], axis=1), np.stack([steps, np.repeat(low, 2)], axis=1)
        axes.area(np.concatenate([above, below[::-1]]), colour)

    if data.sensitivity.any():
        fill(data.residual - data.sensitivity, data.residual + data.sensitivity, ROOM)
    fill(data.residual, data.residual, MASS)
    if data.fit is not None:
        ends = [np.minimum.reduceat(data.fit, starts), np.maximum.reduceat(data.fit, starts)]
        middles = 0.5 * (at[:-1] + at[1:])
        for end in ends:
            axes.line(np.stack([middles, end], axis=1), SUPPORT, 0.8)
