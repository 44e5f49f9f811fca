"""The tables of a study's calibration as text, the same on the terminal and on the page.

Rows called "the paper" hold what the paper prints (paper.py). The paper's measurements are not public and its robot is
not ours: they can be compared in kind, never number by number.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpcal.calibration import CalibrationRecord, ErrorSummary
from cpcal.calibration.budget import Budget
from cpcal.calibration.record import Channel, Parameters, Rows
from cpcal.calibration.validation import PosePerformance
from cpcal.common.numbers import about, nearest
from cpcal.report import paper

SYMBOLS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
PAPER = "the paper"
BEFORE, WITH_X_C, WITH_X_C_SIGMA, WITH_OUTLIERS = "before", "with x_c", "with x_c_sigma", "with x_c, outliers kept"
EXPANDED = "U (k = 2)"
MEASURED, DRAWING, CENTROID = "measured", "drawing", "centroid"
FRAMES = (MEASURED, DRAWING, CENTROID)  # of camera and target; of the drawing; of the joint centres themselves


@dataclass(frozen=True)
class TextTable:
    """`head` names the columns, the first of which holds the rows' names."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def leg_lengths(record: CalibrationRecord, *, paper_too: bool = True) -> TextTable:
    """Table 2: standard deviations of the leg readings, mm."""
    channels = [c for c in record.channels if c.statistics.name.startswith("L")]
    head = ("leg", *(str(k) for k in range(1, len(channels) + 1)))
    rows = _deviations(record, channels, lambda _, value: nearest(value, 4))
    if paper_too and len(channels) == len(paper.TABLE_2):
        rows.append((PAPER, *(nearest(value, 4) for value in paper.TABLE_2)))
    return TextTable(head, tuple(rows))


def poses(record: CalibrationRecord, *, paper_too: bool = True) -> TextTable:
    """Table 3: standard deviations of the poses, angles in degrees, positions in mm."""
    channels = [c for c in record.channels if not c.statistics.name.startswith("L")]
    head = ("component", *(f"{c.statistics.name} [{'°' if c.unit == 'rad' else 'mm'}]" for c in channels))
    rows = _deviations(record, channels, lambda channel, value: _significant(shown(channel, value)))
    if record.shared is not None:
        each = zip(channels, record.shared.pose, strict=True)
        rows.append(("shared by all images, beside it", *(_significant(shown(c, value)) for c, value in each)))
    if paper_too:
        theirs = [_significant(paper.TABLE_3[c.statistics.name]) for c in channels]
        rows.append((PAPER, *theirs))
    return TextTable(head, tuple(rows))


def equations(record: CalibrationRecord) -> TextTable:
    """Scatter of the calibration equations between repeats, and of the robot itself where it is seen, mm."""
    rows = [("equations g between repeats", *(nearest(value, 4) for value in record.equation_sigma))]
    if any(record.robot_sigma):
        rows.append(("the robot itself", *(nearest(value, 4) for value in record.robot_sigma)))
    return TextTable(("leg", *(str(k) for k in range(1, len(record.equation_sigma) + 1))), tuple(rows))


def _deviations(
    record: CalibrationRecord, channels: list[Channel], text: Callable[[Channel, float], str]
) -> list[tuple[str, ...]]:
    """What the repeats show, robot included; what is camera's and sensors' of it; and with the outliers."""
    rows = [("this study", *(text(c, c.statistics.sigma) for c in channels))]
    if any(record.robot_sigma):
        rows.append(("without the robot's own scatter", *(text(c, c.noise) for c in channels)))
    if record.left_out:
        rows.append(("with the outliers", *(text(c, c.with_outliers) for c in channels)))
    return rows


def shown(channel: Channel, value: float) -> float:
    """A value of a channel in the unit that is printed: mm or degrees."""
    return math.degrees(value) if channel.unit == "rad" else value


def drawing(record: CalibrationRecord) -> TextTable:
    """Table 1: the drawing's parameters, mm."""
    lines = [(str(leg), *(nearest(value, 4) for value in row)) for leg, row in enumerate(record.drawing, 1)]
    return TextTable(("leg", *SYMBOLS), tuple(lines))


def parameters(
    record: CalibrationRecord, fit: Parameters, frame: str = MEASURED, theirs: Rows | None = None
) -> TextTable:
    """x_c, x_c_sigma or x_c_f, mm, in one of `FRAMES`; below each leg its expanded uncertainty, where that is known in
    the frame, and what the paper prints, where it does."""
    values, errors = in_frame(record, fit, frame)
    lines: list[tuple[str, ...]] = []
    for leg, row in enumerate(values):
        lines.append((str(leg + 1), *(nearest(value, 4) for value in row)))
        if errors is not None:
            lines.append((EXPANDED, *(nearest(2.0 * value, 4) for value in errors[leg])))
        if theirs is not None and leg < len(theirs):
            lines.append((PAPER, *(nearest(value, 4) for value in theirs[leg])))
    return TextTable(("leg", *SYMBOLS), tuple(lines))


def in_frame(record: CalibrationRecord, fit: Parameters, frame: str) -> tuple[Rows, Rows | None]:
    """Parameters and standard errors, where these are known; as measured where the centres define no frame."""
    if frame == DRAWING:
        return tuple(tuple(row) for row in record.in_drawing(fit).tolist()), None
    shown = fit.own if frame == CENTROID and fit.own is not None else fit
    return shown.values, shown.standard_errors


def validation(record: CalibrationRecord, *, paper_too: bool = False) -> TextTable:
    """Table 6: errors of the validation poses, positions in mm and orientations in degrees."""
    plain, weighted = record.validation.validation, record.validation_sigma.validation
    columns = [plain.summary_before, plain.summary_after, weighted.summary_after]
    head = ["error", BEFORE, WITH_X_C, WITH_X_C_SIGMA]
    if record.validation_all is not None:
        columns.append(record.validation_all.validation.summary_after)
        head.append(WITH_OUTLIERS)
    rows: list[tuple[str, ...]] = []
    for (name, figure), theirs in zip(_FIGURES, (*paper.TABLE_6, *(4 * [None])), strict=True):
        rows.append((name, *(_significant(figure(column)) for column in columns)))
        if paper_too and theirs is not None:
            rows.append((PAPER, *map(_significant, theirs), *("" for _ in columns[3:])))
    floor = plain.floor
    if floor is not None:
        means = (_significant(floor.position_mean), _significant(math.degrees(floor.orientation_mean)))
        for name, mean in zip(("position", "orientation"), means, strict=True):
            unit = "mm" if name == "position" else "°"
            rows.append((f"{name}, mean by noise alone [{unit}]", "", mean, mean, *("" for _ in columns[3:])))
    return TextTable(tuple(head), tuple(rows))


def standards(record: CalibrationRecord) -> tuple[tuple[str, TextTable], ...]:
    """What the standards of the trade ask for, as far as the study has it: headings and tables."""
    found: list[tuple[str, TextTable]] = []
    if record.performance is not None:
        found.append(("Pose accuracy AP and repeatability RP (formulas of ISO 9283)", _performance(record.performance)))
    if record.budget is not None:
        found.append(("Uncertainty budget (GUM), parameters in their own frames [mm]", _budget(record.budget)))
        found.append((f"{EXPANDED} of each parameter by the budget, frame: {CENTROID} [mm]", _expanded(record.budget)))
    return tuple(found)


def _performance(found: PosePerformance) -> TextTable:
    """Means and largest over the poses; of angles, of all three axes."""
    rows = []
    degrees = [np.degrees(np.array(part)).ravel() for part in (found.angle_before, found.angle_after)]
    again = np.degrees(np.array(found.angle_repeatability)).ravel()
    positions = [np.array(part) for part in (found.accuracy_before, found.accuracy_after, found.repeatability)]
    for unit, values in (("mm", positions), ("°", [*degrees, again])):
        axis = "" if unit == "mm" else "a,b,c"
        for name, column in zip(
            (f"AP{axis}, drawing [{unit}]", f"AP{axis}, {WITH_X_C_SIGMA[5:]} [{unit}]", f"RP{axis} [{unit}]"),
            values,
            strict=True,
        ):
            good = column[np.isfinite(column)]
            figures = (float(good.mean()), float(good.max())) if len(good) else (math.nan, math.nan)
            rows.append((name, *map(_significant, figures)))
    return TextTable((f"{len(found.names)} poses", "mean", "largest"), tuple(rows))


def _budget(found: Budget) -> TextTable:
    rows = [
        (
            one.source.replace("_", " "),
            "" if math.isnan(one.uncertainty) else _significant(one.uncertainty) if one.uncertainty else "not stated",
            *(_significant(value) if one.uncertainty else "—" for value in (one.rms, one.largest)),
        )
        for one in found.contributions
    ]
    rows.append(("combined, u_c", "", _significant(found.rms), _significant(found.largest)))
    rows.append((EXPANDED, "", _significant(2.0 * found.rms), _significant(2.0 * found.largest)))
    return TextTable(("source", "stated", "on average (rms)", "largest"), tuple(rows))


def _expanded(found: Budget) -> TextTable:
    lines = [(str(leg), *(nearest(value, 4) for value in row)) for leg, row in enumerate(found.expanded, 1)]
    return TextTable(("leg", *SYMBOLS), tuple(lines))


_FIGURES: tuple[tuple[str, Callable[[ErrorSummary], float]], ...] = (
    ("position, mean [mm]", lambda s: s.position_mean),
    ("position, std. dev. [mm]", lambda s: s.position_deviation),
    ("orientation, mean [°]", lambda s: math.degrees(s.orientation_mean)),
    ("orientation, std. dev. [°]", lambda s: math.degrees(s.orientation_deviation)),
    ("position, 95 % of poses [mm]", lambda s: s.position_95),
    ("position, largest [mm]", lambda s: s.position_largest),
    ("orientation, 95 % of poses [°]", lambda s: math.degrees(s.orientation_95)),
    ("orientation, largest [°]", lambda s: math.degrees(s.orientation_largest)),
)


def _significant(value: float) -> str:
    return about(value) if math.isfinite(value) else "—"
