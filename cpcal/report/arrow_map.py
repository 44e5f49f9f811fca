"""The figure of mean residuals as arrows from where they are, not to scale; a bar tells how long they are."""

from __future__ import annotations

import math

import numpy as np

from cpcal.common.numbers import about
from cpcal.report.svg import DOT, EDGE, GRID, INK, Axes, Figure, Span, label_room, tick_labels, ticks
from cpcal.vision.measure import MeanVectors

_WIDTH, _HEIGHT = 430.0, 400.0  # points: of the figure, and at most of the frame
_FOOT, _HEAD = 32.0, 24.0  # points below the frame for the axis, above it for the bar
_REACH = 0.9  # of the distance between places: how long the longest arrow is
_BARB = 3.0  # points, the longest


def arrow_svg(means: MeanVectors, x: Span, y: Span, unit: str, place: str, *, label: str, least: float = 1e-9) -> str:
    """Arrows within the frame `x`, `y` (left to right, bottom to top; places in `place`), lengths in `unit`.

    Arrows that are shorter than `least` are not blown up to be seen.
    """
    wide, high = abs(x[1] - x[0]), abs(y[1] - y[0])
    across, up = ticks(min(x), max(x), 6), ticks(min(y), max(y), 6)
    left = label_room(tick_labels(up)) + 8.0
    scale = min((_WIDTH - left - 10.0) / wide, _HEIGHT / high)  # points for each unit of place
    figure = Figure(_WIDTH, _HEAD + scale * high + _FOOT)
    axes = Axes(figure, (left, _HEAD, left + scale * wide, _HEAD + scale * high), x, y)
    corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1]), (x[0], y[0])]
    axes.line(corners, GRID, 0.8)
    axes.x_axis(across, f"x [{place}]")
    axes.y_axis(up, f"y [{place}]")
    if not len(means.at):
        return figure.svg(label)
    longest = max(float(np.hypot(*means.mean.T).max()), least)
    stretch = _REACH * _pitch(means, wide, high) / longest
    ends = means.at + stretch * means.mean
    _arrows(axes, means, ends)
    axes.dots(means.at, EDGE, 2.6)
    _bar(axes, stretch * scale, _round(longest), unit)
    lengths = np.hypot(*means.mean.T)
    told = [f"{about(v, 2)} {unit}, mean of {n}" for v, n in zip(lengths.tolist(), means.counts.tolist(), strict=True)]
    axes.hover(means.at, told, 9.0)
    return figure.svg(label)


def _arrows(axes: Axes, means: MeanVectors, ends: np.ndarray) -> None:
    """Shafts, and heads of two barbs, drawn in points of the figure and told back in data."""
    axes.lines(np.stack([means.at, ends], axis=1), DOT, 0.9)
    start, tip = axes.at(means.at), axes.at(ends)
    along = tip - start
    length = np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    back = -along / length * np.minimum(_BARB, 0.4 * length)
    across = np.stack([-back[:, 1], back[:, 0]], axis=1)
    one, two = tip + back + 0.5 * across, tip + back - 0.5 * across
    axes.lines(axes.data(np.stack([one, tip, two], axis=1)), DOT, 0.9)


def _bar(axes: Axes, points: float, length: float, unit: str) -> None:
    """`length` as it is drawn, above the frame at the right."""
    right, top = axes.frame[2], axes.frame[1]
    ends = np.array([[right - points * length, top - 10.0], [right, top - 10.0]])
    axes.line(axes.data(ends), INK, 1.4)
    axes.marks(axes.data(ends), "|", INK, 6.0, width=1.0)
    axes.figure.text(right - points * length - 6.0, top - 10.0, f"residual {about(length, 2)} {unit}", anchor="end")


def _pitch(means: MeanVectors, wide: float, high: float) -> float:
    """Distance between neighbours, about."""
    return math.sqrt(wide * high / max(len(means.at), 9))


def _round(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above it."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-9))
