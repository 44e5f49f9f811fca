"""The figure of a comparison: for every subject a row, for every model a mark at its smallest eps."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cpcal.report.svg import DASHES, DOT, EDGE, INK, MASS, SUPPORT, Axes, Figure, text_width, ticks
from cpcal.results import Comparison, Entry

MOST_ROWS = 40  # subjects that are drawn
_MARKS = (("o", DOT), ("s", EDGE), ("D", SUPPORT), ("^", MASS))
_WIDTH, _ROW = 388.8, 23.0  # points


def comparison_svg(comparison: Comparison) -> str:
    """Marks between eps_lo and eps_hi, a line between the two where they differ, the tolerance as a dashed line."""
    subjects = list(dict.fromkeys(entry.subject for entry in comparison.entries))[:MOST_ROWS]
    models = list(comparison.models)

    shown = [e for e in comparison.entries if e.subject in subjects and math.isfinite(e.eps_lo)]
    most = max([*_ends(shown), comparison.tolerance or 0.0]) or 1.0
    figure = Figure(_WIDTH, 40.0 + _ROW * len(subjects))
    frame = (14.0 + text_width(subjects), 6.0, _WIDTH - 10.0, figure.height - 32.0)
    axes = Axes(figure, frame, (0.0, 1.05 * most), (len(subjects) - 0.5, -0.5))
    label = "smallest eps" + (" [mm]" if comparison.campaign_sha256 else "")
    axes.x_axis(ticks(*axes.x), label, grid=True)
    axes.rows(subjects)
    for entry in shown:
        _mark(axes, subjects.index(entry.subject), entry, models)
    if comparison.tolerance is not None:
        at = comparison.tolerance
        axes.line([(at, len(subjects) - 0.5), (at, -0.5)], INK, 1.0, DASHES)
    return figure.svg("The smallest eps of every model, a row for each leg or subject")


def _ends(entries: Sequence[Entry]) -> list[float]:
    return [end for entry in entries for end in (entry.eps_lo, entry.eps_hi) if math.isfinite(end)]


def legend(models: Sequence[str]) -> list[tuple[str, str, str]]:
    """Name, mark and colour of every model, for the caption."""
    signs = {"o": "●", "s": "■", "D": "◆", "^": "▲"}
    return [(name, signs[_style(k)[0]], _style(k)[1]) for k, name in enumerate(models)]


def _style(number: int) -> tuple[str, str]:
    return _MARKS[number % len(_MARKS)]


def _mark(axes: Axes, row: int, entry: Entry, models: Sequence[str]) -> None:
    shape, colour = _style(models.index(entry.model))
    if math.isfinite(entry.eps_hi):
        axes.line([(entry.eps_lo, row), (entry.eps_hi, row)], colour, 1.5)
        middle = [(0.5 * (entry.eps_lo + entry.eps_hi), row)]
        if shape == "o":
            axes.dots(middle, colour, 6.0)
        else:
            axes.marks(middle, shape, colour, 6.0)
    else:  # known from below only
        axes.marks([(entry.eps_lo, row)], ">", colour, 6.0)
