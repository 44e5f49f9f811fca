"""The figure of a comparison: for every subject a row, for every model a mark at its smallest eps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cpcal.report.svg import DOT, EDGE, GRID, INK, MASS, SUPPORT, figure_svg
from cpcal.results import Comparison, Entry

MOST_ROWS = 40  # subjects that are drawn
_MARKS = (("o", DOT), ("s", EDGE), ("D", SUPPORT), ("^", MASS))
_DASHES = (0, (4, 2.5))


def comparison_svg(comparison: Comparison, *, prefix: str) -> str:
    """Marks between eps_lo and eps_hi, a line between the two where they differ, the tolerance as a dashed line."""
    subjects = list(dict.fromkeys(entry.subject for entry in comparison.entries))[:MOST_ROWS]
    models = list(comparison.models)

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_ylim(len(subjects) - 0.5, -0.5)
        axes.set_yticks(range(len(subjects)))
        axes.set_yticklabels(subjects, parse_math=False)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="x", color=GRID, linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines["left"].set_visible(False)
        axes.set_xlabel("smallest eps" + (" [mm]" if comparison.campaign_sha256 else ""))
        for entry in comparison.entries:
            if entry.subject in subjects and math.isfinite(entry.eps_lo):
                _mark(axes, subjects.index(entry.subject), entry, models)
        if comparison.tolerance is not None:
            axes.axvline(comparison.tolerance, color=INK, linewidth=1.0, linestyle=_DASHES)
        axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))

    size = (5.4, 0.7 + 0.32 * len(subjects))
    return figure_svg(draw, size, prefix=prefix, label="The smallest eps of every model, a row for each leg or subject")


def legend(models: Sequence[str]) -> list[tuple[str, str]]:
    """Name and mark of every model, for the caption."""
    signs = {"o": "●", "s": "■", "D": "◆", "^": "▲"}
    return [(name, signs[_style(k)[0]]) for k, name in enumerate(models)]


def _style(number: int) -> tuple[str, str]:
    return _MARKS[number % len(_MARKS)]


def _mark(axes: Axes, row: int, entry: Entry, models: Sequence[str]) -> None:
    marker, colour = _style(models.index(entry.model))
    style: dict[str, Any] = {"color": colour, "zorder": 4, "clip_on": False}
    if math.isfinite(entry.eps_hi):
        axes.plot([entry.eps_lo, entry.eps_hi], [row, row], "-", linewidth=1.5, **style)
        axes.plot([0.5 * (entry.eps_lo + entry.eps_hi)], [row], marker, markersize=6.0, **style)
    else:  # known from below only
        axes.plot([entry.eps_lo], [row], ">", markersize=6.0, **style)
