"""A figure: the largest error of a pixel in each image."""

from __future__ import annotations

from collections.abc import Sequence

from cpcal.common.numbers import at_most
from cpcal.report.svg import DASHES, DOT, GRID, INK, SUPPORT, Axes, Figure, label_room, tick_labels, ticks

_SIZE = (620.0, 190.0)  # points


def image_errors_svg(images: Sequence[tuple[str, float, bool]], full: float, dashed: float, label: str) -> str:
    """Name, px and whether it is within the tolerance, of each image; two lines across, px."""
    drawn = [min(value, 1e6) for _, value, _ in images]
    top = 1.08 * max([*drawn, dashed, full, 1e-9])
    numbers = ticks(0.0, top, 5)
    figure, count = Figure(*_SIZE), len(images)
    left = label_room(tick_labels(numbers)) + 8.0
    axes = Axes(figure, (left, 6.0, _SIZE[0] - 12.0, _SIZE[1] - 32.0), (0.0, count + 1.0), (0.0, top))
    axes.y_axis(numbers, "largest error [px]", grid=True)
    axes.x_axis(
        [t for t in ticks(0.0, count + 1.0, 12, whole=True) if 1.0 <= t <= count], "image, in the order of poses.csv"
    )
    for (name, exact, ok), value, k in zip(images, drawn, range(1, count + 1), strict=True):
        axes.line([(k, 0.0), (k, value)], GRID, 1.2)
        axes.dots([(k, value)], DOT if ok else SUPPORT, 5.0)
        axes.hover([(k, value)], [f"{name}: {at_most(exact, 4)} px"])
    axes.line([(0.0, full), (count + 1.0, full)], INK, 1.0)
    axes.line([(0.0, dashed), (count + 1.0, dashed)], INK, 1.0, DASHES)
    return figure.svg(label)
