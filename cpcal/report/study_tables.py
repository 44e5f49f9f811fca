"""The tables of a study's calibration as text, the same on the terminal and on the page.

Rows called "the paper" hold what the paper prints (paper.py). The paper's measurements are not public and its robot is
not ours: they can be compared in kind, never number by number.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from cpcal.calibration import CalibrationRecord, ErrorSummary
from cpcal.calibration.record import Channel, Parameters, Rows
from cpcal.common.numbers import about, nearest
from cpcal.report import paper

SYMBOLS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
PAPER = "the paper"
BEFORE, WITH_X_C, WITH_X_C_SIGMA = "before", "with x_c", "with x_c_sigma"


@dataclass(frozen=True)
class TextTable:
    """`head` names the columns, the first of which holds the rows' names."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def leg_lengths(record: CalibrationRecord, *, paper_too: bool = True) -> TextTable:
    """Table 2: standard deviations of the leg readings, mm."""
    channels = [c for c in record.channels if c.statistics.name.startswith("L")]
    head = ("leg", *(str(k) for k in range(1, len(channels) + 1)))
    rows = [("this study", *(nearest(c.statistics.sigma, 4) for c in channels))]
    if paper_too and len(channels) == len(paper.TABLE_2):
        rows.append((PAPER, *(nearest(value, 4) for value in paper.TABLE_2)))
    return TextTable(head, tuple(rows))


def poses(record: CalibrationRecord, *, paper_too: bool = True) -> TextTable:
    """Table 3: standard deviations of the poses, angles in degrees, positions in mm."""
    channels = [c for c in record.channels if not c.statistics.name.startswith("L")]
    head = ("component", *(f"{c.statistics.name} [{'°' if c.unit == 'rad' else 'mm'}]" for c in channels))
    rows = [("this study", *(_significant(shown(c, c.statistics.sigma)) for c in channels))]
    if paper_too:
        theirs = [_significant(paper.TABLE_3[c.statistics.name]) for c in channels]
        rows.append((PAPER, *theirs))
    return TextTable(head, tuple(rows))


def shown(channel: Channel, value: float) -> float:
    """A value of a channel in the unit that is printed: mm or degrees."""
    return math.degrees(value) if channel.unit == "rad" else value


def drawing(record: CalibrationRecord) -> TextTable:
    """Table 1: the drawing's parameters, mm."""
    lines = [(str(leg), *(nearest(value, 4) for value in row)) for leg, row in enumerate(record.drawing, 1)]
    return TextTable(("leg", *SYMBOLS), tuple(lines))


def parameters(fit: Parameters) -> TextTable:
    """x_c or x_c_sigma in the frames of camera and target, mm; below each leg, after ±, the standard errors."""
    lines: list[tuple[str, ...]] = []
    for leg, (values, errors) in enumerate(zip(fit.values, fit.standard_errors, strict=True), 1):
        lines.append((str(leg), *(nearest(value, 4) for value in values)))
        lines.append(("±", *(nearest(value, 4) for value in errors)))
    return TextTable(("leg", *SYMBOLS), tuple(lines))


def moved(record: CalibrationRecord, fit: Parameters, theirs: Rows | None = None) -> TextTable:
    """Tables 4 and 5: parameters in the drawing's frames, mm; below each leg what the paper prints, where it does."""
    lines: list[tuple[str, ...]] = []
    for leg, values in enumerate(record.in_drawing(fit).tolist()):
        lines.append((str(leg + 1), *(nearest(value, 4) for value in values)))
        if theirs is not None and leg < len(theirs):
            lines.append((PAPER, *(nearest(value, 4) for value in theirs[leg])))
    return TextTable(("leg", *SYMBOLS), tuple(lines))


def validation(record: CalibrationRecord, *, paper_too: bool = False) -> TextTable:
    """Table 6: errors of the validation poses, positions in mm and orientations in degrees."""
    plain, weighted = record.validation.validation, record.validation_sigma.validation
    columns = (plain.summary_before, plain.summary_after, weighted.summary_after)
    rows: list[tuple[str, ...]] = []
    for (name, figure), theirs in zip(_FIGURES, paper.TABLE_6, strict=True):
        rows.append((name, *(_significant(figure(column)) for column in columns)))
        if paper_too:
            rows.append((PAPER, *map(_significant, theirs)))
    return TextTable(("error", BEFORE, WITH_X_C, WITH_X_C_SIGMA), tuple(rows))


_FIGURES: tuple[tuple[str, Callable[[ErrorSummary], float]], ...] = (
    ("position, mean [mm]", lambda s: s.position_mean),
    ("position, std. dev. [mm]", lambda s: s.position_deviation),
    ("orientation, mean [°]", lambda s: math.degrees(s.orientation_mean)),
    ("orientation, std. dev. [°]", lambda s: math.degrees(s.orientation_deviation)),
)


def _significant(value: float) -> str:
    return about(value) if math.isfinite(value) else "—"
