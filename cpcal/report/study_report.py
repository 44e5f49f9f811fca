"""The page of a whole study: the paper's tables and figures in its numbering, then the legs as in any other page."""

from __future__ import annotations

import base64
import binascii
import json
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from cpcal.calibration import Budget, CalibrationRecord, Validation
from cpcal.calibration.repeatability import KINDS
from cpcal.calibration.study_calibration import Channel, Parameters, Rows
from cpcal.common.errors import InputError, Problem
from cpcal.common.files import listed, write_file
from cpcal.common.numbers import about, bracket_text, nearest, rounded_up, stated
from cpcal.common.values import Floats
from cpcal.files import campaign_sha256
from cpcal.files.tables import json_object
from cpcal.questions import Result
from cpcal.questions.fits import CertifiedFits
from cpcal.report.page import render
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
from cpcal.robot import Campaign
from cpcal.solver.contract import Verdict

# ------------------------------------------------------------------------------------------------------------------
# Figures that the paper prints in its tables, for comparison in kind: mm and degrees.
#
# Daney, Andreff, Chabert and Papegay, Interval method for calibration of parallel robots: Vision-based experiments
# (2006).

TABLE_2 = (0.0077, 0.0127, 0.0117, 0.0102, 0.0118, 0.0190)  # mm, legs 1 to 6

# Degrees and mm (the table has m). The paper's angles are Euler angles alpha, beta, gamma; ours are the components of a
# small rotation vector, in the same order.
TABLE_3 = {"x": 0.0633, "y": 0.0230, "z": 0.0608, "rx": 9.23e-3, "ry": 1.19e-2, "rz": 8.94e-3}

TABLE_4 = (  # x_c, mm
    (-220.7358, -148.9040, -1.3908, -20.5951, -191.2210, 0.2772, 334.5216),
    (220.1908, -148.9040, -1.3908, 18.2577, -191.2210, 0.2772, 334.0422),
    (240.5155, -116.3502, -1.3908, 176.4621, 78.6322, 0.2772, 337.5156),
    (20.5843, 264.2345, 3.1014, 156.3954, 110.6810, -0.7735, 333.2639),
    (-18.3513, 265.3592, 3.9762, -155.1999, 112.7371, -0.7923, 334.7650),
    (-242.2035, -115.4354, -2.9053, -175.3203, 80.3917, 0.7341, 337.3083),
)
TABLE_5 = (  # x_c_sigma, mm
    (-226.4666, -148.8772, 7.1414, -24.6547, -191.3399, -5.5916, 345.6908),
    (226.7834, -148.8772, 7.1414, 15.9240, -191.3399, -5.5916, 345.8367),
    (244.1771, -121.0730, 7.1414, 178.4731, 75.4911, -5.5916, 345.9741),
    (17.7684, 270.0970, -16.0551, 158.2606, 109.7645, -2.2261, 347.0417),
    (-17.9290, 267.6828, -12.0433, -153.4852, 113.8857, 9.4908, 343.6362),
    (-244.3333, -118.9524, 6.6741, -174.5178, 83.5386, 9.5100, 345.9276),
)

# Rows: position mean, its deviation, orientation mean, its deviation. The labels in the paper mix degrees and mm; the
# order of the rows is what can be relied on. Columns: before, with x_c, with x_c_sigma.
TABLE_6 = ((1.32, 0.67, 1.10), (0.62, 0.40, 0.45), (0.34, 0.26, 0.26), (0.27, 0.27, 0.27))

TABLE_7_CERTIFIED = (27.38, 26.93, 32.78, 33.42, 25.46, 24.01)  # mm: no solution below
TABLE_7_ATTAINED = (27.53, 26.96, 33.12, 33.48, 25.53, 24.24)  # mm: of a valid point


# ------------------------------------------------------------------------------------------------------------------
# The tables of a study's calibration as text, the same on the terminal and on the page.
#
# Rows called "the paper" hold what the paper prints (py). The paper's measurements are not public and its robot is
# not ours: they can be compared in kind, never number by number.

SYMBOLS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
PAPER = "the paper"
BEFORE, WITH_X_C, WITH_X_C_SIGMA, WITH_OUTLIERS = "before", "with x_c", "with x_c_sigma", "with x_c, outliers kept"
EXPANDED = "U (k = 2)"
MEASURED, DRAWING = FRAMES = ("measured", "drawing")  # of camera and target; of the drawing, laid on it


@dataclass(frozen=True)
class TextTable:
    """`head` names the columns, the first of which holds the rows' names."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def leg_lengths(record: CalibrationRecord, *, paper_too: bool = True) -> TextTable:
    """Table 2: standard deviations of the leg readings, mm."""
    channels = [c for c in record.repeats.channels if c.statistics.name.startswith("L")]
    head = ("leg", *(str(k) for k in range(1, len(channels) + 1)))
    rows = _deviations(record, channels, lambda _, value: nearest(value, 4))
    if paper_too and len(channels) == len(TABLE_2):
        rows.append((PAPER, *(nearest(value, 4) for value in TABLE_2)))
    return TextTable(head, tuple(rows))


def poses(record: CalibrationRecord, *, paper_too: bool = True) -> TextTable:
    """Table 3: standard deviations of the poses, angles in degrees, positions in mm."""
    channels = [c for c in record.repeats.channels if not c.statistics.name.startswith("L")]
    head = ("component", *(f"{c.statistics.name} [{'°' if c.unit == 'rad' else 'mm'}]" for c in channels))
    rows = _deviations(record, channels, lambda channel, value: _significant(shown(channel, value)))
    if record.repeats.shared is not None:
        each = zip(channels, record.repeats.shared.pose, strict=True)
        rows.append(("shared by all images, beside it", *(_significant(shown(c, value)) for c, value in each)))
    if paper_too:
        theirs = [_significant(TABLE_3[c.statistics.name]) for c in channels]
        rows.append((PAPER, *theirs))
    return TextTable(head, tuple(rows))


def equations(record: CalibrationRecord) -> TextTable:
    """Scatter of the calibration equations between repeats, and of the robot itself where it is seen, mm."""
    rows = [("equations g between repeats", *(nearest(value, 4) for value in record.repeats.equation_sigma))]
    if any(record.repeats.robot_sigma):
        rows.append(("the robot itself", *(nearest(value, 4) for value in record.repeats.robot_sigma)))
    return TextTable(("leg", *(str(k) for k in range(1, len(record.repeats.equation_sigma) + 1))), tuple(rows))


def _deviations(
    record: CalibrationRecord, channels: list[Channel], text: Callable[[Channel, float], str]
) -> list[tuple[str, ...]]:
    """What the repeats show, robot included; what is camera's and sensors' of it; and with the outliers."""
    rows = [("this study", *(text(c, c.statistics.sigma) for c in channels))]
    if any(record.repeats.robot_sigma):
        rows.append(("without the robot's own scatter", *(text(c, c.noise) for c in channels)))
    if record.repeats.left_out:
        rows.append(("with the outliers", *(text(c, c.with_outliers) for c in channels)))
    return rows


def shown(channel: Channel, value: float) -> float:
    """A value of a channel in the unit that is printed: mm or degrees."""
    return math.degrees(value) if channel.unit == "rad" else value


def drawing(record: CalibrationRecord) -> TextTable:
    """Table 1: the drawing's parameters, mm."""
    lines = [(str(leg), *(nearest(value, 4) for value in row)) for leg, row in enumerate(record.drawing, 1)]
    return TextTable(("leg", *SYMBOLS), tuple(lines))


def parameters(fit: Parameters, frame: str = MEASURED, theirs: Rows | None = None) -> TextTable:
    """x_c or x_c_sigma, mm, in one of `FRAMES`; below each leg its expanded uncertainty, and what the paper prints,
    where it does."""
    drawn = frame == DRAWING
    values, errors = (fit.drawn, fit.drawn_errors) if drawn else (fit.values, fit.standard_errors)
    lines: list[tuple[str, ...]] = []
    for leg, row in enumerate(values):
        lines.append((str(leg + 1), *(nearest(value, 4) for value in row)))
        lines.append((EXPANDED, *(nearest(2.0 * value, 4) for value in errors[leg])))
        if theirs is not None and leg < len(theirs):
            lines.append((PAPER, *(nearest(value, 4) for value in theirs[leg])))
    return TextTable(("leg", *SYMBOLS), tuple(lines))


def validation(record: CalibrationRecord, *, paper_too: bool = False) -> TextTable:
    """Table 6: errors of the validation poses, positions in mm and orientations in degrees."""
    plain, every = record.validation.x_c, record.validation.with_outliers
    head = ["error", BEFORE, WITH_X_C, WITH_X_C_SIGMA, *([] if every is None else [WITH_OUTLIERS])]
    columns = {}
    for kind in ("position", "orientation"):
        before, after = plain.summaries(kind)
        columns[kind] = [before, after, record.validation.x_c_sigma.summaries(kind)[1]]
        columns[kind] += [] if every is None else [every.summaries(kind)[1]]
    rows: list[tuple[str, ...]] = []
    for (name, kind, figure), theirs in zip(_FIGURES, (*TABLE_6, *(4 * [None])), strict=True):
        values = (getattr(column, figure) for column in columns[kind])
        rows.append((name, *(_significant(math.degrees(v) if kind == "orientation" else v) for v in values)))
        if paper_too and theirs is not None:
            rows.append((PAPER, *map(_significant, theirs), *("" for _ in head[4:])))
    floor = plain.floor
    if floor is not None:
        means = (_significant(floor.position_mean), _significant(math.degrees(floor.orientation_mean)))
        for name, mean in zip(("position", "orientation"), means, strict=True):
            unit = "mm" if name == "position" else "°"
            rows.append((f"{name}, mean by noise alone [{unit}]", "", mean, mean, *("" for _ in head[4:])))
    return TextTable(tuple(head), tuple(rows))


def budget_tables(found: Budget) -> tuple[tuple[str, TextTable], ...]:
    """Headings and tables."""
    lines = [(str(leg), *(nearest(value, 4) for value in row)) for leg, row in enumerate(found.expanded, 1)]
    return (
        ("Uncertainty budget (GUM), parameters laid on the drawing [mm]", _budget(found)),
        (
            f"{EXPANDED} of each parameter by the budget, frame: {DRAWING} [mm]",
            TextTable(("leg", *SYMBOLS), tuple(lines)),
        ),
    )


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


_FIGURES = (
    ("position, mean [mm]", "position", "mean"),
    ("position, std. dev. [mm]", "position", "deviation"),
    ("orientation, mean [°]", "orientation", "mean"),
    ("orientation, std. dev. [°]", "orientation", "deviation"),
    ("position, 95 % of poses [mm]", "position", "at_95"),
    ("position, largest [mm]", "position", "largest"),
    ("orientation, 95 % of poses [°]", "orientation", "at_95"),
    ("orientation, largest [°]", "orientation", "largest"),
)


def _significant(value: float) -> str:
    return about(value) if math.isfinite(value) else "—"


# ------------------------------------------------------------------------------------------------------------------
# What the page of a study says of its images: some of them with what was found, counts, errors, time, pixel sets.
#
# `images.json` keeps it beside the study, as text and JPEG pictures, ready for the page.

IMAGES_NAME = "images.json"
FORMAT = "cpcal-images/1"

_JPEG = b"\xff\xd8"


@dataclass(frozen=True)
class Picture:
    """An image with what was found drawn into it; `jpeg` in base64."""

    caption: str
    width: int
    height: int
    jpeg: str


@dataclass(frozen=True)
class ImagesFound:
    """In the order of the page. Tables may be left out: None. `sets_said` introduces `sets` and `brackets`."""

    said: tuple[str, ...]
    pictures: tuple[Picture, ...]
    counts: TextTable
    errors: TextTable | None = None
    time: TextTable | None = None
    sets: TextTable | None = None
    brackets: TextTable | None = None
    sets_said: tuple[str, ...] = field(default=())


def picture(caption: str, jpeg: bytes, size: tuple[int, int]) -> Picture:
    return Picture(caption, *size, base64.b64encode(jpeg).decode("ascii"))


def save_images(found: ImagesFound, folder: Path) -> None:
    """Raises OSError."""
    text = json.dumps({"format": FORMAT, **asdict(found)}, indent=1, ensure_ascii=False)
    (folder / IMAGES_NAME).write_text(text + "\n", encoding="utf-8")


def load_images(folder: Path) -> ImagesFound | None:
    """None where there were no images. Raises InputError."""
    path = folder / IMAGES_NAME
    if not path.exists():
        return None
    try:
        return _found(json_object(path, "run cpcal demo --images", "run cpcal demo --images again"))
    except (ValueError, KeyError, TypeError) as error:
        what = f"is not what cpcal wrote: {type(error).__name__}: {error}"
        raise InputError([Problem(str(path), what[:200], "run cpcal demo --images again")]) from None


def _found(data: dict[str, Any]) -> ImagesFound:
    if data.pop("format") != FORMAT:
        raise ValueError("another format")
    tables = {name: _table(data[name]) for name in ("counts", "errors", "time", "sets", "brackets")}
    counts = tables.pop("counts")
    if counts is None:
        raise ValueError("no counts")
    pictures = tuple(_picture(entry) for entry in data["pictures"])
    introduced = _texts(data["sets_said"])
    if len(introduced) != 2 and tables["sets"] is not None:
        raise ValueError("the sets are not introduced")
    return ImagesFound(_texts(data["said"]), pictures, counts, **tables, sets_said=introduced)


def _picture(data: dict[str, Any]) -> Picture:
    jpeg = str(data["jpeg"])
    try:
        content = base64.b64decode(jpeg, validate=True)
    except binascii.Error as error:
        raise ValueError(f"a picture is garbled: {error}") from None
    if not content.startswith(_JPEG):
        raise ValueError("a picture is no JPEG")
    return Picture(str(data["caption"]), int(data["width"]), int(data["height"]), jpeg)


def _table(data: dict[str, Any] | None) -> TextTable | None:
    return None if data is None else TextTable(_texts(data["head"]), tuple(_texts(row) for row in data["rows"]))


def _texts(data: list[Any]) -> tuple[str, ...]:
    if not all(isinstance(text, str) for text in data):
        raise TypeError("a text is none")
    return tuple(data)


# ------------------------------------------------------------------------------------------------------------------
# Figures 3, 4 and 5 of the paper for a user's study: plain floating point, nothing of it is proved.

_PANEL = (180.0, 136.8)  # points
_PAIR = (475.2, 180.0)
_PLOT_FRAME = (32.0, 19.0, 172.0, 116.0)  # the same place in every panel
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
    axes = Axes(figure, _PLOT_FRAME, (-reach, reach), (0.0, highest))
    bars = zip(edges[:-1].tolist(), edges[1:].tolist(), counts.tolist(), strict=True)
    axes.areas([[(a, 0.0), (b, 0.0), (b, n), (a, n)] for a, b, n in bars if n], BAND, EDGE)
    if sigma > 0.0:
        axes.line(np.stack([at, curve], axis=1), INK, 1.0, DASHES)
    figure.text(0.5 * (_PLOT_FRAME[0] + _PLOT_FRAME[2]), 8.0, f"{channel.statistics.name} [{unit}]", anchor="middle")
    axes.x_axis(ticks(-0.9 * reach, 0.9 * reach, 4), "")
    axes.y_axis(ticks(0.0, highest, 4, whole=True), "")
    return figure.svg(label)


def validation_svg(found: Validation, *, label: str) -> str:
    """Left the position errors, right the improvements of the compared poses; each curve sorted ascending by itself."""
    figure = Figure(*_PAIR)
    before, after = found.errors("position")
    turned, moved = found.improvement("orientation"), found.improvement("position")
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


@dataclass(frozen=True)
class StudyFound:
    """Everything that a study led to, all of the same campaign.

    result   brackets by branch and bound; timeout  those by the paper's timeout method, with a time limit
    checked  a sentence on what the checker made of the certificates
    images   where the poses came from images
    """

    campaign: Campaign
    record: CalibrationRecord
    fits: CertifiedFits
    result: Result
    timeout: Result
    checked: str
    images: ImagesFound | None = None


def write_study_page(
    found: StudyFound, file: str | os.PathLike[str], *, run: str | os.PathLike[str] | None = None
) -> Path:
    """Write the page to `file`, all or nothing; its path. Raises InputError: parts of different campaigns, too."""
    return write_file(file, render_study(found, run))


def render_study(found: StudyFound, run: str | os.PathLike[str] | None = None) -> str:
    """The page as text; the same parts give the same text. `run`: the folder whose certificates the page checks."""
    expected, remedy = campaign_sha256(found.campaign), "give the parts of one study"
    for name, sha256 in (
        ("calibration record", found.record.campaign_sha256),
        ("certified fits", found.fits.campaign_sha256),
        ("result of the timeout method", found.timeout.campaign_sha256),
    ):
        if sha256 != expected:
            raise InputError([Problem(name, "is of another campaign", remedy)])
    for name, fits in found.fits.both:
        if any(fit.point != tuple(getattr(found.record, name).values[fit.leg - 1]) for fit in fits):
            raise InputError([Problem("certified fits", f"{name} is not the calibration record's", remedy)])
    return render(found.campaign, found.result, _context(found), run=run)


def _context(found: StudyFound) -> dict[str, Any]:
    record = found.record
    lengths = [c for c in record.repeats.channels if c.statistics.name.startswith("L")]
    of_poses = [c for c in record.repeats.channels if not c.statistics.name.startswith("L")]
    six = len(record.drawing) == len(TABLE_4)
    return {
        "record": record,
        "checked": found.checked,
        "table1": drawing(record),
        "table2": leg_lengths(record),
        "table3": poses(record),
        "table4": parameters(record.x_c, DRAWING, TABLE_4 if six else None),
        "table5": parameters(record.x_c_sigma, DRAWING, TABLE_5 if six else None),
        "equations": equations(record),
        "table6": validation(record, paper_too=True),
        "budget": () if record.budget is None else budget_tables(record.budget),
        "table7": _table7(found),
        "fits_table": _fits_table(found.fits),
        "fits": [_fit_sentence(name, [fit.verified.verdict for fit in fits]) for name, fits in found.fits.both],
        "figure3": [_histogram(channel) for channel in lengths],
        "figure4": [_histogram(channel) for channel in of_poses],
        "figure5": [_validation(name, getattr(record.validation, name)) for name in ("x_c", "x_c_sigma")],
        "apart": _apart(record),
        "errors": about(
            max(2.0 * max(row) for fit in (record.x_c, record.x_c_sigma) for row in fit.standard_errors), 2
        ),
        "loose": _loose(found.result),
        "exact": _exact_sentence(found.result),
        "images": found.images,
        "timeout_seconds": stated(found.timeout.options.time_limit or 0.0),
        "factor": stated(record.sets.factor),
        "delta": stated(found.result.options.delta),
    }


def _histogram(channel: Channel) -> dict[str, Any]:
    name = channel.statistics.name
    svg = histogram_svg(channel, label=f"Centred errors of {name}: histogram")
    return {"svg": Markup(svg), "sentence": channel.statistics.sentence()}  # names of channels are ours


def _validation(name: str, found: Validation) -> dict[str, Any]:
    label = f"Errors and improvements of the validation poses with {name}"
    svg = validation_svg(found, label=label)
    return {"name": name, "svg": Markup(svg), "sentence": found.sentence}


def _table7(found: StudyFound) -> TextTable:
    """Both methods' brackets, lower ends rounded down and upper ends up, beside the paper's; a column a leg, mm."""
    legs = [leg.leg for leg in found.result.legs]
    timed = {leg.leg: leg for leg in found.timeout.legs}
    bounds = [bracket_text(leg.eps_lo, leg.eps_hi) for leg in found.result.legs]
    tried = [bracket_text(timed[leg].eps_lo, timed[leg].eps_hi) if leg in timed else ("—", "—") for leg in legs]
    rows = [
        ("bound: none below", *(lo for lo, _ in bounds)),
        ("bound: attained", *(hi for _, hi in bounds)),
        ("timeout: none below", *(lo for lo, _ in tried)),
        ("timeout: attained", *(hi for _, hi in tried)),
    ]
    if max(legs, default=0) <= len(TABLE_7_CERTIFIED):
        rows.append(("the paper: none below", *(nearest(TABLE_7_CERTIFIED[leg - 1], 2) for leg in legs)))
        rows.append(("the paper: attained", *(nearest(TABLE_7_ATTAINED[leg - 1], 2) for leg in legs)))
    return TextTable(("leg", *map(str, legs)), tuple(rows))


def _fits_table(fits: CertifiedFits) -> TextTable:
    rows = []
    for name, verified in fits.both:
        rows.append((f"{name}: satisfied", *(str(fit.verified.holds) for fit in verified)))
        rows.append((f"{name}: refuting", *(str(fit.verified.fails) for fit in verified)))
    return TextTable(("leg", *(str(fit.leg) for fit in fits.x_c)), tuple(rows))


def _fit_sentence(name: str, verdicts: list[Verdict]) -> str:
    refuted = sum(verdict is Verdict.REFUTED for verdict in verdicts)
    proved = sum(verdict is Verdict.PROVED for verdict in verdicts)
    legs = f"of {len(verdicts)} legs"
    if refuted == len(verdicts):
        return f"{name} is no solution for any leg verified: refuted by measurements, with proof."
    return f"{name} is a solution for {proved} {legs} and refuted for {refuted}; of the others nothing is proved."


def _apart(record: CalibrationRecord) -> dict[str, Any]:
    """Where x_c and x_c_sigma differ most, mm."""
    difference = np.abs(np.array(record.x_c.drawn) - np.array(record.x_c_sigma.drawn))
    leg, k = np.unravel_index(int(np.argmax(difference)), difference.shape)
    return {
        "mm": about(float(difference[leg, k]), 2),
        "name": SYMBOLS[int(k)],
        "leg": int(leg) + 1,
    }


def _loose(result: Result) -> dict[str, Any] | None:
    """The widest proved bounds among the polygons' boxes: how far parameters may move for a little more eps."""
    boxes = [(leg.leg, leg.projections) for leg in result.legs if leg.projections is not None]
    if not boxes:
        return None
    leg, projections = max(boxes, key=lambda pair: float(np.max(pair[1].box.width)))
    k = int(np.argmax(projections.box.width))
    width = float(projections.box.width[k])
    eps = bracket_text(projections.eps, projections.eps)[0]
    return {"leg": leg, "name": SYMBOLS[k], "mm": rounded_up(width, 1), "eps": eps}


def _exact_sentence(result: Result) -> str:
    """The paper's second question: has any x in the box no model error at all?"""
    none = [str(leg.leg) for leg in result.legs if leg.eps_lo > 0.0]
    some = [str(leg.leg) for leg in result.legs if leg.not_refuted]
    rest = [str(leg.leg) for leg in result.legs if not leg.not_refuted and leg.eps_lo <= 0.0]
    said, delta = [], stated(result.options.delta)
    if none:
        said.append(f"proved: no parameters within ±{delta} mm satisfy all equations exactly (leg {', '.join(none)})")
    if some:
        said.append(f"proved: some parameters do (leg {', '.join(some)})")
    if rest:
        said.append(f"not known (leg {', '.join(rest)})")
    text = "; ".join(said)
    return f"{text[0].upper()}{text[1:]}." if text else "No leg was finished."


# ------------------------------------------------------------------------------------------------------------------
# What matters of a calibration in at most twelve lines, for a terminal: doubts first. The tables say the rest.

_NAMED = 6  # channels


def summary(record: CalibrationRecord) -> tuple[str, ...]:
    """Sentences; lengths in mm and angles in degrees."""
    budget = () if record.budget is None else record.budget.sentences[:1]
    return (
        f"{record.robot}: {record.repeats.readings:,} readings of {record.repeats.configurations} configurations. "
        f"{record.repeats.screening}",
        *_doubts(record),
        record.repeats.scatter,
        f"x_c_sigma: {record.x_c_sigma.sentence}",
        _known(record),
        *budget,
        f"Validation of x_c_sigma: {record.validation.x_c_sigma.sentence}",
        record.diagnosis.sentence,
    )


def _doubts(record: CalibrationRecord) -> Iterator[str]:
    """What speaks against independent normal noise; one sentence where nothing does."""
    statistics = [channel.statistics for channel in record.repeats.channels]
    names = [one.name for one in statistics if one.not_normal()]
    said = [f"NOT NORMAL (backlash, drift?): {listed(names, _NAMED)}."] if names else []
    said += [record.repeats.tests.sentence(kind) for kind in KINDS if record.repeats.tests.found(kind)]
    yield from said or ["Repeats scatter as independent noise does, as far as it can be tested."]


def _known(record: CalibrationRecord) -> str:
    """How well the parameters are known, by least squares."""
    errors = 2.0 * np.array(record.x_c_sigma.standard_errors)
    finite = errors[np.isfinite(errors)]
    if not finite.size:
        return "No parameter has a known uncertainty."
    least, most = (about(float(value), 3) for value in (finite.min(), finite.max()))
    without = "" if finite.size == errors.size else f"; of {errors.size - finite.size} parameters nothing is known"
    known = f"Parameters have expanded uncertainties U (k = 2) of {least} to {most} mm"
    return f"{known}, in the frames of camera and target{without}."
