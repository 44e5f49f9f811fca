"""The figures of a leg, of all legs, and of a paving, as SVG."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.numbers import about, plain_gap, stated
from cpcal.common.values import Bools, Floats
from cpcal.questions import LegResult, Result, verdict_of
from cpcal.questions.result import HalfPlane
from cpcal.report.advice import forcing_numbers, measurement_names
from cpcal.report.svg import (
    BAND,
    DASHES,
    DOT,
    EDGE,
    GRID,
    INK,
    MASS,
    ROOM,
    SUPPORT,
    Axes,
    Figure,
    Svg,
    label_room,
    text_width,
    tick_labels,
    ticks,
)
from cpcal.robot import Campaign, rotation_matrix
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box
from cpcal.solver.search import Paving

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


def panel_svg(panel: Panel, *, label: str) -> Svg:
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


def enclosure_svg(data: Enclosure, *, label: str, unit: str = "mm", origin: str = "nominal value") -> Svg:
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


def _far(values: Floats) -> Bools:
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
    support: Bools
    eps: float
    fit: Floats | None = None
    names: Sequence[str] = ()


def residual_svg(data: Residuals, *, label: str) -> Svg:
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


# ------------------------------------------------------------------------------------------------------------------
# All legs: every leg's error against the tolerance; the platform with its poses.

COLOURS = {"explained": "good", "unexplained": "bad", "bounded": "known", "undecided": "open", "undetermined": "poor"}
COLOURS |= {"uncompared": "open"}
_WIDTH, _ROW, _LEFT, _TOP, _BELOW = 330.0, 18.0, 40.0, 18.0, 32.0  # points, of the figure of errors
_PADDING = 20.0  # of the platform's drawing
_TURN, _TILT = math.radians(-30.0), math.radians(18.0)  # from where the platform is seen
_LETTER = 11.0  # points: room for a number
_MOST_POSES = 400  # dots that are drawn
_SOFT, _PANEL = "var(--soft)", "var(--panel)"


def errors_svg(result: Result, least_squares: Sequence[float | None] = ()) -> Svg:
    """A row a leg: grey what is proved impossible, the bracket, the error of the least-squares fit, the tolerance.

    `least_squares`: of each leg, in mm, None where it is not known.
    """
    asked = result.options.tolerance
    known = [v for leg in result.legs for v in (leg.bracket.lo, leg.bracket.hi)]
    known += [v for v in (*least_squares, asked, result.options.eps) if v is not None]
    most = 1.06 * max((v for v in known if math.isfinite(v)), default=0.0) or 1.0
    count = len(result.legs)
    figure = Figure(_WIDTH, _TOP + _ROW * count + _BELOW)
    frame = (_LEFT, _TOP, _WIDTH - 12.0, _TOP + _ROW * count)
    axes = Axes(figure, frame, (0.0, most), (count - 0.5, -0.5))
    axes.x_axis(ticks(0.0, most, 6), "model error eps [mm]", grid=True)
    axes.rows([f"leg {leg.leg}" for leg in result.legs])
    for row, (leg, fit) in enumerate(zip_longest(result.legs, least_squares)):
        _bracket(axes, row, leg, f"var(--{COLOURS[verdict_of(result, leg).kind]})", most)
        if fit is not None and math.isfinite(fit):
            axes.marks([(fit, row)], "x", SUPPORT, 6.0, width=1.5)
    if asked is not None:
        axes.line([(asked, -0.5), (asked, count - 0.5)], INK, 1.2, DASHES)
        anchor = "end" if asked > 0.6 * most else "start"
        figure.text(float(axes.at([(asked, 0.0)])[0, 0]), 8.0, f"tolerance {stated(asked)} mm", anchor=anchor)
    return figure.svg("The model error of each leg, from zero, against the tolerance")


def _bracket(axes: Axes, row: int, leg: LegResult, colour: str, most: float) -> None:
    if math.isinf(leg.bracket.lo):
        axes.area(_row(0.0, most, row, 0.22), GRID)
        return
    axes.area(_row(0.0, leg.bracket.lo, row, 0.22), GRID)
    if leg.bracket.point is None or not math.isfinite(leg.bracket.hi):
        axes.marks([(leg.bracket.lo, row)], ">", colour, 9.0)
        return
    width = max(leg.bracket.hi - leg.bracket.lo, 0.012 * most)  # the narrowest is still seen
    axes.area(_row(leg.bracket.lo, leg.bracket.lo + width, row, 0.36), colour)


def _row(lo: float, hi: float, row: int, half: float) -> list[tuple[float, float]]:
    return [(lo, row - half), (hi, row - half), (hi, row + half), (lo, row + half)]


def platform_svg(campaign: Campaign, result: Result) -> Svg:
    """The nominal robot at the measured pose nearest to the middle, legs in the colour of their verdicts, all poses."""
    view = _View.of(campaign)
    kinds = {leg.leg: COLOURS[verdict_of(result, leg).kind] for leg in result.legs}
    base, mobile = (view.flat(p) for p in (campaign.robot.base, _mobile(campaign, view.nearest)))
    low, extent = view.low, np.maximum(view.extent, 1e-9)
    scale = (_WIDTH - 2.0 * _PADDING) / float(max(extent[0], 1.3 * extent[1]))
    width, height = scale * extent
    figure = Figure(_WIDTH, float(height) + 2.0 * _PADDING + 28.0)
    left = 0.5 * (_WIDTH - float(width))
    frame = (left, _PADDING, left + float(width), _PADDING + float(height))
    axes = Axes(figure, frame, (low[0], low[0] + extent[0]), (low[1], low[1] + extent[1]))
    axes.area(base, "none", INK)
    for k, (foot, head) in enumerate(zip(base, mobile, strict=True)):
        axes.line([foot, head], f"var(--{kinds.get(k + 1, 'shade')})", 2.4)
    _number(axes, base)
    axes.area(mobile, _PANEL, INK)
    forcing, at = forcing_numbers(campaign, result), view.flat(campaign.position)
    step = max(1, math.ceil(len(campaign) / _MOST_POSES))
    axes.dots([at[k] for k in range(0, len(campaign), step)], _SOFT, 3.0)
    axes.dots([at[k] for k in forcing], SUPPORT, 6.0)
    axes.hover([at[k] for k in forcing], measurement_names(campaign, forcing))
    length = ticks(0.0, 0.3 * float(extent[0]), 3)[-1]
    start = (low[0], low[1] - 30.0 / scale)
    axes.line([start, (start[0] + length, start[1])], INK, 1.6)
    x, y = axes.at([(start[0] + length, start[1])])[0]
    figure.text(float(x) + 5.0, float(y), f"{about(length)} mm")
    return figure.svg("The platform seen from the side, and the poses that were measured")


def _number(axes: Axes, feet: Floats) -> None:
    """The number of each leg below its foot, or further down where another number stands."""
    taken: list[tuple[float, float]] = []
    for k, (x, y) in enumerate(axes.at(feet).tolist()):
        down = y + _LETTER
        while any(abs(x - left) < _LETTER and abs(down - above) < _LETTER for left, above in taken):
            down += 1.0
        taken.append((x, down))
        axes.figure.text(x, down, str(k + 1), anchor="middle")


@dataclass(frozen=True, eq=False)
class _View:
    """From where the robot is seen: `axes` (2, 3) take a point of space to the sheet; `nearest`: the pose drawn."""

    axes: Floats
    low: Floats  # (2,) of all that is drawn
    extent: Floats
    nearest: int

    @classmethod
    def of(cls, campaign: Campaign) -> _View:
        middle = campaign.position.mean(axis=0)
        nearest = int(np.argmin(np.linalg.norm(campaign.position - middle, axis=1)))
        mobile, base = _mobile(campaign, nearest), campaign.robot.base
        up = _direction(mobile.mean(axis=0) - base.mean(axis=0), np.array([0.0, 0.0, 1.0]))
        side = np.cross(up, [0.0, 1.0, 0.0] if abs(up[1]) < 0.9 else [1.0, 0.0, 0.0])
        side = _direction(side, np.array([1.0, 0.0, 0.0]))
        deep = np.cross(up, side)
        right = math.cos(_TURN) * side + math.sin(_TURN) * deep
        into = -math.sin(_TURN) * side + math.cos(_TURN) * deep
        axes = np.array([right, math.cos(_TILT) * up + math.sin(_TILT) * into])
        flat = np.concatenate([base, mobile, campaign.position]) @ axes.T
        return cls(axes, flat.min(axis=0), np.ptp(flat, axis=0), nearest)

    def flat(self, points: Floats) -> Floats:
        """Points (n, 3) on the sheet (n, 2)."""
        return np.asarray(points @ self.axes.T)


def _mobile(campaign: Campaign, k: int) -> Floats:
    """The mobile joint centres (n, 3) at measurement k, base frame."""
    rotation = rotation_matrix(campaign.quaternion[k : k + 1])[0]
    return np.asarray(campaign.position[k] + campaign.robot.mobile @ rotation.T)


def _direction(vector: Floats, otherwise: Floats) -> Floats:
    length = float(np.linalg.norm(vector))
    return np.asarray(vector / length) if length > 0.0 else otherwise


# ------------------------------------------------------------------------------------------------------------------
# A paving: inside, boundary and outside boxes over two of the variables.

_OUTSIDE, _BOUNDARY, _INSIDE, _PROVED = "#e8ecf1", "#f0b429", "#2f855a", "#c53030"
_LINE = "#ffffff"


def paving_svg(paving: Paving, horizontal: str, vertical: str, *, size: float = 4.5) -> Svg:
    """A figure of `size` inches: outside boxes grey, boundary yellow, inside green, single solutions red dots.

    Of more than two variables it is the projection, without outside boxes, which mean nothing there. The same paving
    gives the same text. Raises ModelError for an unbounded or empty paving, or an unknown variable.
    """
    single = [s.box for s in paving.solutions if s.verdict is Verdict.PROVED]
    everything = [*paving.inside, *paving.outside, *paving.boundary, *single]
    if not everything or not all(box.is_bounded for box in everything):
        raise ModelError("only a paving of bounded boxes, and of at least one, can be drawn")
    pair = (everything[0].index(horizontal), everything[0].index(vertical))

    (left, right), (low, high) = (_reach(everything, i) for i in pair)
    figure, numbers = Figure(72.0 * size, 72.0 * size), ticks(low, high)
    frame = (label_room(tick_labels(numbers)) + 8.0, 6.0, 72.0 * size - 8.0, 72.0 * size - 32.0)
    axes = Axes(figure, frame, (left, right), (low, high))
    axes.x_axis(ticks(left, right), horizontal)
    axes.y_axis(numbers, vertical)
    if len(everything[0]) == 2:
        axes.areas(_corners(paving.outside, pair), _OUTSIDE, _LINE, 0.2)
    axes.areas(_corners(paving.boundary, pair), _BOUNDARY, _LINE, 0.2)
    axes.areas(_corners(paving.inside, pair), _INSIDE, _LINE, 0.2)
    axes.dots([box.mid[list(pair)] for box in single], _PROVED, 4.0)
    return figure.svg("paving")


def _reach(boxes: Sequence[Box], i: int) -> tuple[float, float]:
    """What boxes cover of variable i, with a margin."""
    lo, hi = min(float(box.lo[i]) for box in boxes), max(float(box.hi[i]) for box in boxes)
    margin = 0.05 * (hi - lo) or 0.05 * abs(lo) or 1.0
    return lo - margin, hi + margin


def _corners(boxes: Sequence[Box], pair: tuple[int, int]) -> list[Floats]:
    """The projections of boxes as rectangles."""
    ends = ((*box.lo[list(pair)].tolist(), *box.hi[list(pair)].tolist()) for box in boxes)
    return [np.array([(a, b), (c, b), (c, d), (a, d)]) for a, b, c, d in ends]
