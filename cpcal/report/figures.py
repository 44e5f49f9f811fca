"""The figures of a leg, of all legs, and of a paving, as SVG."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.numbers import about, plain_gap, stated
from cpcal.common.values import Floats
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
    ROOM,
    SUPPORT,
    Axes,
    Figure,
    Span,
    Svg,
    chart,
    counted,
    text_width,
    ticks,
)
from cpcal.robot import Campaign, rotation_matrix
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box
from cpcal.solver.search import Paving

# ------------------------------------------------------------------------------------------------------------------
# The figures of two parameters at a time: what proved half-planes leave of the plane, and where points lie in it.

_PANEL_MARGIN = 0.12  # of the rectangle's width, on each side
_UNITS = ((1e4, 1e-3, "m"), (1e-2, 1.0, "mm"), (1e-5, 1e3, "µm"), (0.0, 1e6, "nm"))  # by half the width, mm
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
    halves = 0.5 * (panel.hi - panel.lo)
    units = [next(unit for unit in _UNITS if half >= unit[0]) for half in halves]
    scale = np.array([factor for _, factor, _ in units])
    lo, hi = (scale * (end - panel.origin) for end in (panel.lo, panel.hi))
    (left, low), (right, high) = lo - _PANEL_MARGIN * (hi - lo), hi + _PANEL_MARGIN * (hi - lo)
    figure = Figure(*_PANEL_SIZE)
    axes = Axes(figure, _FRAME, (left, right), (low, high))
    labels = [f"Δ{name} [{unit}]" for name, (_, _, unit) in zip(panel.names, units, strict=True)]
    axes.x_axis(_ends(lo[0], hi[0]), labels[0], grid=True)
    axes.y_axis(_ends(lo[1], hi[1]), labels[1], grid=True, away=_LABEL)
    corners = scale * (polygon(panel.lo, panel.hi, panel.half_planes) - panel.origin)
    if len(corners):
        axes.area(BAND, corners, edge=EDGE, width=1.4)
    axes.area("none", _rectangle(*lo, *hi), edge=INK, width=1.0, dash="4 2.5")
    # the largest first, so that all are seen where they coincide
    for point, shape, colour, size in (
        (panel.nominal, "s", INK, 9.0),
        (panel.fit, "x", SUPPORT, 6.5),
        (panel.point, "o", DOT, 5.0),
    ):
        if point is not None and in_view(panel, point):
            axes.marks([scale * (point - panel.origin)], shape, colour, size, width=1.4)
    return figure.svg(label)


def _ends(lo: float, hi: float) -> list[float]:
    """Ticks at both ends, to a hundredth of their distance or so, and at 0 where that is not too near to them."""
    step = 10.0 ** math.floor(math.log10(hi - lo) - 1.0)
    first, last = math.ceil(lo / step - 1e-9) * step, math.floor(hi / step + 1e-9) * step
    room = 0.25 * (last - first)
    return [first, *([0.0] if first + room < 0.0 < last - room else []), last]


def _rectangle(left: float, low: float, right: float, high: float) -> list[tuple[float, float]]:
    return [(left, low), (right, low), (right, high), (left, high)]


def polygon(lo: Floats, hi: Floats, half_planes: Iterable[HalfPlane]) -> Floats:
    """Corners (n, 2) of what half-planes leave of a rectangle: plain floating point, for drawing."""
    middle, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    corners = np.array(_rectangle(-1.0, -1.0, 1.0, 1.0))
    for u, v, c in half_planes:
        normal = np.array([u, v])
        excess = corners @ (normal * half) - (
            c - float(normal @ middle)
        )  # the polygon is kept where it is not positive
        kept: list[Floats] = []
        for k in range(len(corners)):
            before, here = excess[k - 1], excess[k]
            if (before > 0.0) != (here > 0.0):
                kept.append(corners[k - 1] + before / (before - here) * (corners[k] - corners[k - 1]))
            if here <= 0.0:
                kept.append(corners[k])
        corners = np.array(kept).reshape(len(kept), 2)
    return np.asarray(middle + half * corners)


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

    names: Sequence[str]
    nominal: Floats
    lo: Floats
    hi: Floats
    fit: Floats | None

    @property
    def empty(self) -> bool:
        return bool(np.isnan([self.lo, self.hi]).any())

    @property
    def unbounded(self) -> bool:
        """Whether some bound is too far away to be drawn."""
        return bool((np.abs([self.lo - self.nominal, self.hi - self.nominal]) > FARTHEST).any()) and not self.empty

    @property
    def fit_beyond(self) -> bool:
        """Whether the fit lies off the drawing in some row."""
        return self.fit is not None and not (np.abs(self.fit - self.nominal) <= FARTHEST).all()


def enclosure_svg(data: Enclosure, *, label: str, unit: str = "mm", origin: str = "nominal value") -> Svg:
    """Bars from `lo` to `hi` with a tick at each end, so that the thinnest is seen; widths as numbers at the right."""
    lo, hi = data.lo - data.nominal, data.hi - data.nominal
    fit = np.full(len(data.names), np.nan) if data.fit is None else data.fit - data.nominal
    every = np.concatenate([np.zeros(1), lo, hi, fit])
    seen = every[np.abs(every) <= FARTHEST]
    middle = 0.5 * float(seen.min() + seen.max())
    half = max(0.5 * float(np.ptp(seen)), _LEAST) * (1.0 + 2.0 * _BAR_MARGIN)
    near, far = middle - half, middle + half

    figure, count = Figure(*_BAR_SIZE), len(data.names)
    frame = (_FRAME_LEFT + text_width(data.names), 22.0, _BAR_SIZE[0] - _WIDTHS, _BAR_SIZE[1] - 32.0)
    axes = Axes(figure, frame, (near, far), (count - 0.5, -0.5))
    axes.x_axis(ticks(near, far, 5), f"parameter − {origin} [{unit}]", grid=True)
    axes.rows(data.names)
    for row in range(0 if data.empty else count):
        left, right = np.clip([lo[row], hi[row]], near, far).tolist()
        axes.area(BAND, _rectangle(left, row - 0.25, right, row + 0.25), edge=EDGE)
        for bound in (lo[row], hi[row]):
            if near <= bound <= far:
                axes.marks([(bound, row)], "|", EDGE, 15.0, width=1.6)
            else:
                axes.marks([(near if bound < near else far, row)], "<" if bound < near else ">", EDGE, 8.0)
    axes.line(INK, [(0.0, count - 0.5), (0.0, -0.5)], dash=DASHES)
    at = np.stack([fit, np.arange(float(count))], axis=1)
    axes.marks(at[(fit >= near) & (fit <= far)], "x", SUPPORT, 6.0, width=1.5)
    x, heights = axes.frame[2] + 8.0, axes.at([(near, row) for row in range(count)])[:, 1].tolist()
    figure.text(x, 9.0, f"width [{unit}]")
    for y, low, high in zip(heights, data.lo, data.hi, strict=True):
        figure.text(x, y, "none" if data.empty else plain_gap(float(low), float(high)))
    return figure.svg(label)


# ------------------------------------------------------------------------------------------------------------------
# The figure of the residuals of a proved point over the measurements.

MOST_POINTS = 500  # of more measurements, the worst of each run of neighbours are drawn
_SIZE = (475.2, 194.4)  # points
_MARGIN = 0.07  # of the height, above and below


@dataclass(frozen=True)
class Residuals:
    """What is drawn of a leg, in mm: `residual` and `sensitivity` (N,), `support` (N,) bool, the band `+-eps`.

    `fit` (N,): residuals of the least-squares fit, NaN without one. `names`: of the measurements, for the pointer.
    """

    residual: Floats
    sensitivity: Floats
    support: Floats
    eps: float
    fit: Floats
    names: Sequence[str]


def residual_svg(data: Residuals, *, label: str) -> Svg:
    """The residuals over the measurements with the band."""
    count, room = len(data.residual), data.sensitivity
    ends = [-data.eps, data.eps, (data.residual - room).min(), (data.residual + room).max()]
    ends += data.fit[np.isfinite(data.fit)].tolist()
    reach = _MARGIN * max(max(ends) - min(ends), 1e-300) if max(ends) > min(ends) else 1.0
    x, y = (0.0, count + 1.0), (float(min(ends)) - reach, float(max(ends)) + reach)
    labels = "measurement, counted from 1 in the order of the campaign", "residual [mm]"
    figure = Figure(*_SIZE)
    axes = chart(figure, x, y, labels, across=counted(count, 9), grid=False)
    axes.area(BAND, _rectangle(x[0], -data.eps, x[1], data.eps))
    axes.across(ticks(*y))
    at = np.array(worst_of_neighbours(np.abs(data.residual) + room, data.support))
    points = np.stack([at + 1.0, data.residual[at]], axis=1)
    if room.any():
        bars = [points + way * np.stack([np.zeros(len(at)), room[at]], axis=1) for way in (-1.0, 1.0)]
        axes.line(ROOM, *np.stack(bars, axis=1), width=1.4)
    fits = np.stack([at + 1.0, data.fit[at]], axis=1)
    axes.marks(fits[np.isfinite(fits[:, 1])], "x", SUPPORT, 3.6, width=0.9)
    axes.dots(points, DOT, 3.0)
    axes.across((-data.eps, data.eps), EDGE, 1.0)
    axes.marks(points[data.support[at]], "D", SUPPORT, 7.5, width=1.1)
    axes.hover(points, [data.names[k] for k in at], 6.0)
    return figure.svg(label)


def worst_of_neighbours(size: Floats, chosen: Floats) -> list[int]:
    """The measurements that are drawn, from 0: all of them, or of each run of neighbours the worst; those `chosen`."""
    runs = np.array_split(np.arange(len(size)), min(len(size), MOST_POINTS))
    worst = (int(run[np.argmax(size[run])]) for run in runs)
    return sorted({*worst, *np.flatnonzero(chosen).tolist()})


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
        axes.line(INK, [(asked, -0.5), (asked, count - 0.5)], width=1.2, dash=DASHES)
        anchor = "end" if asked > 0.6 * most else "start"
        figure.text(float(axes.at([(asked, 0.0)])[0, 0]), 8.0, f"tolerance {stated(asked)} mm", anchor=anchor)
    return figure.svg("The model error of each leg, from zero, against the tolerance")


def _bracket(axes: Axes, row: int, leg: LegResult, colour: str, most: float) -> None:
    lo, hi = leg.bracket.lo, leg.bracket.hi
    axes.area(GRID, _rectangle(0.0, row - 0.22, min(lo, most), row + 0.22))
    if leg.bracket.point is not None and math.isfinite(hi):
        right = lo + max(hi - lo, 0.012 * most)  # the narrowest is still seen
        axes.area(colour, _rectangle(lo, row - 0.36, right, row + 0.36))
    elif math.isfinite(lo):
        axes.marks([(lo, row)], ">", colour, 9.0)


def platform_svg(campaign: Campaign, result: Result) -> Svg:
    """The nominal robot at the measured pose nearest to the middle, legs in the colour of their verdicts, all poses."""
    position = campaign.position
    nearest = int(np.argmin(np.linalg.norm(position - position.mean(axis=0), axis=1)))
    turn = rotation_matrix(campaign.quaternion[nearest : nearest + 1])[0]
    base, mobile = campaign.robot.base, position[nearest] + campaign.robot.mobile @ turn.T
    sheet = _sheet(mobile.mean(axis=0) - base.mean(axis=0))
    feet, heads, at = (points @ sheet.T for points in (base, mobile, position))
    every = np.concatenate([feet, heads, at])
    low, extent = every.min(axis=0), np.maximum(np.ptp(every, axis=0), 1e-9)
    scale = (_WIDTH - 2.0 * _PADDING) / float(max(extent[0], 1.3 * extent[1]))
    width, height = (scale * extent).tolist()
    figure, left = Figure(_WIDTH, height + 2.0 * _PADDING + 28.0), 0.5 * (_WIDTH - width)
    frame = (left, _PADDING, left + width, _PADDING + height)
    axes = Axes(figure, frame, (low[0], low[0] + extent[0]), (low[1], low[1] + extent[1]))
    axes.area("none", feet, edge=INK)
    kinds = {leg.leg: COLOURS[verdict_of(result, leg).kind] for leg in result.legs}
    for k, ends in enumerate(zip(feet, heads, strict=True)):
        axes.line(f"var(--{kinds.get(k + 1, 'shade')})", ends, width=2.4)
    _number(axes, feet)
    axes.area(_PANEL, heads, edge=INK)
    forcing = list(forcing_numbers(campaign, result))
    axes.dots(at[:: max(1, math.ceil(len(campaign) / _MOST_POSES))], _SOFT, 3.0)
    axes.dots(at[forcing], SUPPORT, 6.0)
    axes.hover(at[forcing], measurement_names(campaign, forcing))
    length = ticks(0.0, 0.3 * float(extent[0]), 3)[-1]
    start, end = [low + (along, -30.0 / scale) for along in (0.0, length)]
    axes.line(INK, [start, end], width=1.6)
    x, y = axes.at([end])[0].tolist()
    figure.text(x + 5.0, y, f"{about(length)} mm")
    return figure.svg("The platform seen from the side, and the poses that were measured")


def _sheet(up: Floats) -> Floats:
    """(2, 3), which takes points of space to the sheet: the robot is seen from the side, a little from above."""

    def direction(vector: Floats, otherwise: tuple[float, float, float]) -> Floats:
        length = float(np.linalg.norm(vector))
        return np.asarray(vector / length if length > 0.0 else otherwise)

    up = direction(up, (0.0, 0.0, 1.0))
    side = direction(np.cross(up, [0.0, 1.0, 0.0] if abs(up[1]) < 0.9 else [1.0, 0.0, 0.0]), (1.0, 0.0, 0.0))
    deep = np.cross(up, side)
    right, into = math.cos(_TURN) * side + math.sin(_TURN) * deep, math.cos(_TURN) * deep - math.sin(_TURN) * side
    return np.array([right, math.cos(_TILT) * up + math.sin(_TILT) * into])


def _number(axes: Axes, feet: Floats) -> None:
    """The number of each leg below its foot, or further down where another number stands."""
    taken: list[tuple[float, float]] = []
    for k, (x, y) in enumerate(axes.at(feet).tolist()):
        down = y + _LETTER
        while any(abs(x - left) < _LETTER and abs(down - above) < _LETTER for left, above in taken):
            down += 1.0
        taken.append((x, down))
        axes.figure.text(x, down, str(k + 1), anchor="middle")


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
    pair = [everything[0].index(horizontal), everything[0].index(vertical)]
    x, y = (_reach(everything, i) for i in pair)
    figure = Figure(72.0 * size, 72.0 * size)
    axes = chart(figure, x, y, (horizontal, vertical), across=ticks(*x), grid=False)
    outside = paving.outside if len(everything[0]) == 2 else ()
    for boxes, colour in ((outside, _OUTSIDE), (paving.boundary, _BOUNDARY), (paving.inside, _INSIDE)):
        corners = (_rectangle(*box.lo[pair].tolist(), *box.hi[pair].tolist()) for box in boxes)
        axes.area(colour, *corners, edge=_LINE, width=0.2)
    axes.dots([box.mid[pair] for box in single], _PROVED, 4.0)
    return figure.svg("paving")


def _reach(boxes: Sequence[Box], i: int) -> Span:
    """What boxes cover of variable i, with a margin."""
    lo, hi = min(float(box.lo[i]) for box in boxes), max(float(box.hi[i]) for box in boxes)
    margin = 0.05 * (hi - lo) or 0.05 * abs(lo) or 1.0
    return lo - margin, hi + margin
