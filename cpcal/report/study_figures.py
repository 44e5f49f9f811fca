"""Figures 3, 4 and 5 of the paper for a user's study: plain floating point, nothing of it is proved."""

from __future__ import annotations

import math

import numpy as np

from cpcal.calibration import Validation
from cpcal.calibration.record import Channel
from cpcal.common.arrays import Floats
from cpcal.report.svg import (
    BAND,
    DASHES,
    DOT,
    EDGE,
    INK,
    ROOM,
    SUPPORT,
    Axes,
    Figure,
    Span,
    label_room,
    tick_labels,
    ticks,
)

_PANEL = (180.0, 136.8)  # points
_PAIR = (475.2, 180.0)
_FRAME = (32.0, 19.0, 172.0, 116.0)  # the same place in every panel
_FACTORS = {"mm": (1e3, "µm"), "rad": (1e3 * 180.0 / math.pi, "10⁻³ °")}  # of what is printed at an axis


def histogram_svg(channel: Channel, *, label: str) -> str:
    """Counts of the centred errors of one channel, with the normal curve of the same deviation."""
    factor, unit = _FACTORS[channel.unit]
    reach, counts = factor * channel.histogram.reach, np.array(channel.histogram.counts)
    edges = np.linspace(-reach, reach, len(counts) + 1)
    sigma, at = factor * channel.statistics.sigma, np.linspace(-reach, reach, 121)
    curve = np.zeros_like(at)
    if sigma > 0.0:
        scale = counts.sum() * (edges[1] - edges[0]) / (sigma * math.sqrt(2.0 * math.pi))
        curve = scale * np.exp(-0.5 * (at / sigma) ** 2)
    figure, highest = Figure(*_PANEL), 1.05 * max(float(curve.max()), float(counts.max()), 1.0)
    axes = Axes(figure, _FRAME, (-reach, reach), (0.0, highest))
    bars = zip(edges[:-1].tolist(), edges[1:].tolist(), counts.tolist(), strict=True)
    axes.areas([[(a, 0.0), (b, 0.0), (b, n), (a, n)] for a, b, n in bars if n], BAND, EDGE)
    if sigma > 0.0:
        axes.line(np.stack([at, curve], axis=1), INK, 1.0, DASHES)
    figure.text(0.5 * (_FRAME[0] + _FRAME[2]), 8.0, f"{channel.statistics.name} [{unit}]", anchor="middle")
    axes.x_axis(ticks(-0.9 * reach, 0.9 * reach, 4), "")
    axes.y_axis(ticks(0.0, highest, 4, whole=True), "")
    return figure.svg(label)


def validation_svg(found: Validation, *, label: str) -> str:
    """Left the position errors, right the improvements of the compared poses; each curve sorted ascending by itself."""
    good, figure = found.compared, Figure(*_PAIR)
    before, after = found.before.position[good], found.after.position[good]
    turned, moved = found.orientation_improvement[good], found.position_improvement[good]
    _sorted(figure, (0.0, 0.48), {ROOM: before, DOT: after}, "position error [mm]", from_zero=True)
    _sorted(figure, (0.52, 1.0), {SUPPORT: turned, DOT: moved}, "improvement [%]", from_zero=False)
    return figure.svg(label)


def _sorted(figure: Figure, part: Span, curves: dict[str, Floats], label: str, *, from_zero: bool) -> None:
    """One frame in a part of the figure's width."""
    finite = {colour: np.sort(values[np.isfinite(values)]) for colour, values in curves.items()}
    every = np.concatenate([np.zeros(1), *finite.values()])
    margin = 0.05 * float(every.max() - every.min()) or 1.0
    y = (0.0 if from_zero else float(every.min()) - margin, float(every.max()) + margin)
    count, numbers = max(map(len, finite.values())), ticks(*y, 6)
    left, right = part[0] * figure.width + label_room(tick_labels(numbers)) + 8.0, part[1] * figure.width - 10.0
    axes = Axes(figure, (left, 6.0, right, figure.height - 32.0), (0.0, count + 1.0), y)
    axes.y_axis(numbers, label, grid=True)
    if not from_zero:
        axes.line([(0.0, 0.0), (count + 1.0, 0.0)], INK, 1.0, DASHES)
    for colour, values in finite.items():
        axes.dots(np.stack([np.arange(1.0, len(values) + 1.0), values], axis=1), colour, 2.8)
    axes.x_axis(ticks(0.0, count + 1.0, 5, whole=True), "validation poses, sorted")
