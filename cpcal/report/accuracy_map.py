"""The map of an accuracy certificate: slices of the workspace, each cell shaded by its proved bound."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from cpcal.accuracy.findings import CellAccuracy, WorkspaceAccuracy
from cpcal.common.numbers import at_most, nearest
from cpcal.report.svg import DASHES, EDGE, INK, SUPPORT, Axes, Figure, ticks

_SIDE, _LEFT, _TOP, _GAP, _BOTTOM = 150.0, 44.0, 18.0, 22.0, 36.0  # points
_STEPS = 5  # shades


def slices(found: WorkspaceAccuracy) -> list[float]:
    """Heights, mm."""
    lo, hi = found.lo[2], found.hi[2]
    return [lo] if lo == hi else [lo + share * (hi - lo) for share in (1 / 6, 0.5, 5 / 6)]


def shades(found: WorkspaceAccuracy) -> list[float]:
    """Upper ends of the shades, mm."""
    bounds = [cell.position_bound for cell in found.cells if cell.proved]
    if not bounds:
        return []
    low, high = min(bounds), max(bounds)
    return [low + (high - low) * (k + 1) / _STEPS for k in range(_STEPS)]


def fill(share: float) -> str:
    """Of a shade from 0 to 1."""
    return f"{EDGE}; fill-opacity: {nearest(0.1 + 0.75 * share, 2)}"


def map_svg(found: WorkspaceAccuracy) -> str:
    """Slices side by side, seen from above."""
    heights = slices(found)
    figure = Figure(_LEFT + len(heights) * (_SIDE + _GAP), _TOP + _SIDE + _BOTTOM)
    span = [(found.lo[k] - 0.5 * (lo == hi), found.hi[k] + 0.5 * (lo == hi)) for k, lo, hi in _spans(found)]
    ends = shades(found)
    for n, height in enumerate(heights):
        left = _LEFT + n * (_SIDE + _GAP)
        axes = Axes(figure, (left, _TOP, left + _SIDE, _TOP + _SIDE), span[0], span[1])
        figure.text(left + 0.5 * _SIDE, 7.0, f"z = {nearest(height, 0)} mm", anchor="middle")
        for cell in _cells_at(found, height):
            _draw(axes, cell, ends)
        if n == 0:
            axes.y_axis(ticks(*span[1], 5), "y [mm]")
        axes.x_axis(ticks(*span[0], 5), "x [mm]")
        if abs(found.worst_pose[2] - height) <= 0.5 * _thickness(found, heights):
            axes.marks([found.worst_pose[:2]], "x", INK, 7.0, width=1.4)
    return figure.svg("Slices of the workspace, each cell shaded by the proved bound of the position")


def _spans(found: WorkspaceAccuracy) -> list[tuple[int, float, float]]:
    return [(k, found.lo[k], found.hi[k]) for k in (0, 1)]


def _thickness(found: WorkspaceAccuracy, heights: list[float]) -> float:
    return (found.hi[2] - found.lo[2]) / len(heights) or np.inf


def _cells_at(found: WorkspaceAccuracy, height: float) -> list[CellAccuracy]:
    """Cells that the slice meets; of those with other rotations the worst is drawn last."""
    met = [cell for cell in found.cells if cell.lo[2] <= height <= cell.hi[2]]
    return sorted(met, key=lambda cell: (not cell.proved, cell.position_bound if cell.proved else 0.0))


def _draw(axes: Axes, cell: CellAccuracy, ends: list[float]) -> None:
    (x0, y0), (x1, y1) = cell.lo[:2], cell.hi[:2]
    if not cell.proved:
        axes.area([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], "none", SUPPORT, 1.0, DASHES)
        return
    shade = next((k for k, end in enumerate(ends) if cell.position_bound <= end), _STEPS - 1)
    square = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    axes.area(square, "var(--paper)")
    axes.area(square, fill(shade / (_STEPS - 1)))


def key(found: WorkspaceAccuracy) -> list[tuple[str, str]]:
    """Fill, and what it means."""
    return [(fill(k / (_STEPS - 1)), f"up to {at_most(end)} mm") for k, end in enumerate(shades(found))]


def dominating(
    found: WorkspaceAccuracy, where: Callable[[CellAccuracy], bool] = lambda _: True
) -> list[tuple[str, float]]:
    """Pairs of legs whose uncertainty moves the platform most, and the share of the proved volume where they do."""
    volume: Counter[tuple[int, int]] = Counter()
    for cell in found.cells:
        if cell.proved and where(cell):
            first, second = sorted(np.argsort(-np.array(cell.shares))[:2].tolist())
            sides = [hi - lo for lo, hi in zip(cell.lo, cell.hi, strict=True) if hi > lo]
            volume[(first + 1, second + 1)] += float(np.prod(sides))  # type: ignore[assignment]
    total = sum(volume.values())
    return [(f"{a} and {b}", share / total) for (a, b), share in volume.most_common()]
