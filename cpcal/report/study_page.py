"""The page of a whole study: the paper's tables and figures in its numbering, then the legs as in any other page."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cpcal.calibration import Budget, CalibrationRecord, Validation
from cpcal.calibration.repeatability import KINDS
from cpcal.calibration.study_calibration import Channel, Parameters, Rows
from cpcal.common.errors import InputError, Problem
from cpcal.common.files import listed
from cpcal.common.numbers import about, bracket_text, nearest, rounded_up, stated
from cpcal.files import campaign_sha256
from cpcal.files.codec import load, save
from cpcal.questions import Result
from cpcal.questions.fits import CertifiedFits
from cpcal.report.run_page import DrawingFrames, render
from cpcal.report.section import Drawing, Mark, Section, Table
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
    Svg,
    chart,
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


def leg_lengths(record: CalibrationRecord, *, paper_too: bool = True) -> Table:
    """Table 2: standard deviations of the leg readings, mm."""
    channels = [c for c in record.repeats.channels if c.statistics.name.startswith("L")]
    rows = _deviations(record, channels, lambda _, value: nearest(value, 4))
    if paper_too and len(channels) == len(TABLE_2):
        rows.append(_row(PAPER, TABLE_2))
    return Table(_legs(len(channels)), rows)


def poses(record: CalibrationRecord, *, paper_too: bool = True) -> Table:
    """Table 3: standard deviations of the poses, angles in degrees, positions in mm."""
    channels = [c for c in record.repeats.channels if not c.statistics.name.startswith("L")]
    rows = _deviations(record, channels, lambda channel, value: _significant(shown(channel, value)))
    if record.repeats.shared is not None:
        each = zip(channels, record.repeats.shared.pose, strict=True)
        rows.append(("shared by all images, beside it", *(_significant(shown(c, value)) for c, value in each)))
    if paper_too:
        rows.append((PAPER, *(_significant(TABLE_3[c.statistics.name]) for c in channels)))
    units = (f"{c.statistics.name} [{'°' if c.unit == 'rad' else 'mm'}]" for c in channels)
    return Table(("component", *units), rows)


def equations(record: CalibrationRecord) -> Table:
    """Scatter of the calibration equations between repeats, and of the robot itself where it is seen, mm."""
    found = record.repeats
    rows = [_row("equations g between repeats", found.equation_sigma)]
    rows += [_row("the robot itself", found.robot_sigma)] if any(found.robot_sigma) else []
    return Table(_legs(len(found.equation_sigma)), rows)


def _legs(count: int) -> tuple[str, ...]:
    return ("leg", *map(str, range(1, count + 1)))


def _row(name: str, values: Iterable[float], decimals: int = 4) -> tuple[str, ...]:
    return (name, *(nearest(value, decimals) for value in values))


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


def of_legs(rows: Rows) -> Table:
    """Of each leg its seven parameters, mm; of the drawing it is table 1."""
    return Table(("leg", *SYMBOLS), [_row(str(leg), row) for leg, row in enumerate(rows, 1)])


def parameters(fit: Parameters, frame: str = MEASURED, theirs: Rows | None = None) -> Table:
    """x_c or x_c_sigma, mm, in one of `FRAMES`; below each leg its expanded uncertainty, and what the paper prints,
    where it does."""
    values, errors = (fit.drawn, fit.drawn_errors) if frame == DRAWING else (fit.values, fit.standard_errors)
    rows: list[tuple[str, ...]] = []
    for leg, (row, error) in enumerate(zip(values, errors, strict=True)):
        rows += [_row(str(leg + 1), row), _row(EXPANDED, (2.0 * value for value in error))]
        rows += [_row(PAPER, theirs[leg])] if theirs is not None and leg < len(theirs) else []
    return Table(("leg", *SYMBOLS), rows)


def validation(record: CalibrationRecord, *, paper_too: bool = False) -> Table:
    """Table 6: errors of the validation poses, positions in mm and orientations in degrees."""
    found = record.validation
    plain, every = found.x_c, found.with_outliers
    head = ["error", BEFORE, WITH_X_C, WITH_X_C_SIGMA, *([] if every is None else [WITH_OUTLIERS])]
    columns = {}
    for kind in ("position", "orientation"):
        fits = [found.x_c_sigma, *([] if every is None else [every])]
        columns[kind] = [*plain.summaries(kind), *(one.summaries(kind)[1] for one in fits)]
    rows: list[tuple[str, ...]] = []
    for k, (name, kind, figure) in enumerate(_FIGURES):
        values = (getattr(column, figure) for column in columns[kind])
        rows.append((name, *(_significant(math.degrees(v) if kind == "orientation" else v) for v in values)))
        if paper_too and k < len(TABLE_6):
            rows.append((PAPER, *map(_significant, TABLE_6[k]), *("" for _ in head[4:])))
    if plain.floor is not None:
        floors = ("position", "mm", plain.floor.position_mean), ("orientation", "°", plain.floor.orientation_mean)
        for name, unit, value in floors:
            mean = _significant(value if unit == "mm" else math.degrees(value))
            rows.append((f"{name}, mean by noise alone [{unit}]", "", mean, mean, *("" for _ in head[4:])))
    return Table(head, rows)


def budget_tables(found: Budget) -> tuple[tuple[str, Table], ...]:
    """Headings and tables."""
    rows = []
    for one in found.contributions:
        stated_one = _significant(one.uncertainty) if one.uncertainty else "not stated"
        sizes = (_significant(value) if one.uncertainty else "—" for value in (one.rms, one.largest))
        rows.append((one.source.replace("_", " "), "" if math.isnan(one.uncertainty) else stated_one, *sizes))
    for name, times in (("combined, u_c", 1.0), (EXPANDED, 2.0)):
        rows.append((name, "", _significant(times * found.rms), _significant(times * found.largest)))
    budget = Table(("source", "stated", "on average (rms)", "largest"), rows)
    return (
        ("Uncertainty budget (GUM), parameters laid on the drawing [mm]", budget),
        (f"{EXPANDED} of each parameter by the budget, frame: {DRAWING} [mm]", of_legs(found.expanded)),
    )


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

IMAGES_NAME = "images.json"  # beside the study
FORMAT = "cpcal-images/3"


@dataclass(frozen=True)
class ImagePart:
    """Of `table` the first row names the columns."""

    title: str
    sentences: tuple[str, ...] = ()
    table: tuple[tuple[str, ...], ...] = ()

    def section(self) -> Section:
        tables = [Table(self.table[0], self.table[1:])] if self.table else []
        return Section(self.title, self.sentences, tables=tables)


@dataclass(frozen=True)
class ImagesFound:
    parts: tuple[ImagePart, ...]


def save_images(found: ImagesFound, folder: Path) -> None:
    """Raises InputError."""
    save(found, folder / IMAGES_NAME, FORMAT)


def load_images(folder: Path) -> ImagesFound | None:
    """None where there were no images. Raises InputError."""
    path = folder / IMAGES_NAME
    return load(ImagesFound, path, FORMAT, remedy="run cpcal demo --images again") if path.exists() else None


# ------------------------------------------------------------------------------------------------------------------
# Figures 3, 4 and 5 of the paper for a user's study: plain floating point, nothing of it is proved.

_PANEL = (180.0, 136.8)  # points
_PAIR = (475.2, 180.0)
_PLOT_FRAME = (32.0, 19.0, 172.0, 116.0)  # the same place in every panel
_FACTORS = {"mm": (1e3, "µm"), "rad": (1e3 * 180.0 / math.pi, "10⁻³ °")}  # of what is printed at an axis


def histogram_svg(channel: Channel, *, label: str) -> Svg:
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
    axes.area(BAND, *([(a, 0.0), (b, 0.0), (b, n), (a, n)] for a, b, n in bars if n), edge=EDGE)
    if sigma > 0.0:
        axes.line(INK, np.stack([at, curve], axis=1), dash=DASHES)
    figure.text(0.5 * (_PLOT_FRAME[0] + _PLOT_FRAME[2]), 8.0, f"{channel.statistics.name} [{unit}]", anchor="middle")
    axes.x_axis(ticks(-0.9 * reach, 0.9 * reach, 4), "")
    axes.y_axis(ticks(0.0, highest, 4, whole=True), "")
    return figure.svg(label)


def validation_svg(found: Validation, *, label: str) -> Svg:
    """Left the position errors, right the improvements of the compared poses; each curve sorted ascending by itself."""
    before, after = found.errors("position")
    turned, moved = found.improvement("orientation"), found.improvement("position")
    figure = Figure(*_PAIR)
    for part, name, curves in (
        ((0.0, 0.48), "position error [mm]", {ROOM: before, DOT: after}),
        ((0.52, 1.0), "improvement [%]", {SUPPORT: turned, DOT: moved}),
    ):
        finite = {colour: np.sort(values[np.isfinite(values)]) for colour, values in curves.items()}
        every = np.concatenate([np.zeros(1), *finite.values()])
        margin, count = 0.05 * float(np.ptp(every)) or 1.0, max(map(len, finite.values()))
        x, y = (0.0, count + 1.0), (float(every.min()) - margin * ("%" in name), float(every.max()) + margin)
        across, labels = ticks(*x, 5, whole=True), ("validation poses, sorted", name)
        axes = chart(figure, x, y, labels, across=across, grid=True, most=6, part=part)
        if "%" in name:
            axes.across((0.0,), INK, 1.0, DASHES)
        for colour, values in finite.items():
            axes.dots(np.stack([np.arange(1.0, len(values) + 1.0), values], axis=1), colour, 2.8)
    return figure.svg(label)


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


def render_study(found: StudyFound, run: str | os.PathLike[str] | None = None) -> str:
    """The page as text; the same parts give the same text. `run`: the folder whose certificates the page checks.

    Raises InputError for parts of different campaigns.
    """
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
    return render(found.campaign, found.result, _study(found), run=run, frames=DrawingFrames.of(found.record))


def _study(found: StudyFound) -> Section:
    record = found.record
    missing = (
        "Figure 1 there shows the robot; it has"
        if found.images
        else "Figures 1 and 2 there show the robot and the set-up; they have"
    )
    return Section(
        "The study, in the paper’s order",
        [
            f"{record.repeats.readings:,} readings of {record.repeats.configurations} configurations: statistics of "
            "the repeats, the frames of camera and target, least squares, validation, certification. Tables and "
            f"figures have the numbers that they have in Daney, Andreff, Chabert and Papegay (2006). {missing} no "
            "counterpart here.",
            Mark(
                "What can be compared: the paper’s measurements are not public, and its robot is another one. Its "
                "printed values stand in rows called “the paper” for their kind and size; agreement digit by digit "
                "would mean nothing, and disagreement neither. What is proved here is proved of the readings of this "
                "study only. Statistics, fits and validation are ordinary floating-point estimates, not proofs.",
                "quantifier",
            ),
        ],
        parts=[
            Section("Table 1: the drawing’s parameters [mm]", tables=[of_legs(record.drawing)]),
            *(part.section() for part in (found.images.parts if found.images else ())),
            *_repeats(record),
            *_fits(found),
            *_validated(record),
            *_certified(found),
        ],
        name="study",
        style="study",
    )


def _repeats(record: CalibrationRecord) -> Iterator[Section]:
    yield Section("Table 2: standard deviation of the leg readings [mm]", tables=[leg_lengths(record)])
    yield Section(
        "Table 3: standard deviation of the pose’s components",
        tables=[poses(record)],
        notes=[
            "Camera frame. As in the paper, a deviation is from the mean of the configuration and holds “both "
            "measurement repeatability and robot repeatability”. Angles here are components of a small rotation "
            "vector (rx, ry, rz), the paper’s are Euler angles. A row of this study’s tables may be the mean of "
            "several images, the paper’s deviations are of single ones: a mean of ten scatters less by the root of "
            "ten."
        ],
    )
    shared = [record.repeats.shared.sentence] if record.repeats.shared else []
    tests = [*record.repeats.tests.sentences, record.diagnosis.sentence]
    yield Section(sentences=[record.repeats.scatter, *shared], items=tests, tables=[equations(record)])
    names = [channel.statistics.name for channel in record.repeats.channels]
    histograms = [
        histogram_svg(c, label=f"Centred errors of {c.statistics.name}: histogram") for c in record.repeats.channels
    ]
    order = sorted(range(len(names)), key=lambda k: not names[k].startswith("L"))  # figure 3, then figure 4
    legend = {
        "bar": "readings, less their configuration’s mean",
        "dashed": "normal distribution of the same standard deviation",
    }
    caption = (
        "Figure 3: leg readings L1, L2, …; figure 4: the pose. Bins reach four standard deviations to each side, the "
        "outermost hold what is beyond."
    )
    yield Section(
        "Figures 3 and 4: centred distributions",
        figures=[Drawing([histograms[k] for k in order], legend, caption)],
        parts=[
            Section(
                "Each distribution in words (mm, rad)",
                items=[record.repeats.channels[k].statistics.sentence for k in order],
                folded=True,
            ),
            Section(sentences=[record.repeats.screening, record.frames.sentence, record.sets.sentence]),
        ],
    )


def _fits(found: StudyFound) -> Iterator[Section]:
    record = found.record
    six = len(record.drawing) == len(TABLE_4)
    plain = parameters(record.x_c, DRAWING, TABLE_4 if six else None)
    yield Section("Table 4: x_c, plain least squares [mm]", tables=[plain])
    explained = record.x_c_sigma.explained
    doubt = (
        ""
        if explained
        else ", which the model does not explain: errors of the model are not in it, and IT DOES NOT COVER THEM"
    )
    yield Section(
        "Table 5: x_c_sigma, weighted by the noise [mm]",
        tables=[parameters(record.x_c_sigma, DRAWING, TABLE_5 if six else None)],
        notes=[
            "Laid on the drawing: base and mobile centres each moved rigidly so that they are nearest to the "
            "drawing’s. (The paper’s are in frames that hang on three of the centres: kind and size can be compared, "
            f"no more.) U (k = 2) is the expanded uncertainty: about 95 %, from the {record.x_c_sigma.source}{doubt}."
        ],
    )
    apart = np.abs(np.array(record.x_c.drawn) - np.array(record.x_c_sigma.drawn))
    leg, k = np.unravel_index(int(np.argmax(apart)), apart.shape)
    largest = max(2.0 * max(row) for fit in (record.x_c, record.x_c_sigma) for row in fit.standard_errors)
    said = (
        f"The two fits differ by up to {about(float(apart.max()), 2)} mm ({SYMBOLS[int(k)]} of leg {int(leg) + 1}). "
        "The paper’s differ by up to 19 "
        "mm (a_z of leg 4), of which most is the frame: A2 and A3, 40 mm apart, are a hinge about which the plane of "
        "the first three centres turns. Laid on each other rigidly, the paper’s base centres differ by 6.3 mm at "
        "most, the mobile ones by 1.4 mm. The largest U of a parameter, in the frames of camera and target, is "
        f"{about(largest, 2)} mm."
    )
    yield Section(sentences=[said + _loose(found.result)])
    words = [f"x_c: {record.x_c.sentence}", f"x_c_sigma: {record.x_c_sigma.sentence}"]
    yield Section("The fits in words", words, folded=True)


def _loose(result: Result) -> str:
    """The widest proved bounds among the polygons' boxes: how far parameters may move for a little more eps."""
    boxes = [(leg.leg, leg.projections) for leg in result.legs if leg.projections is not None]
    if not boxes:
        return ""
    leg, projections = max(boxes, key=lambda pair: float(np.max(pair[1].box.width)))
    k = int(np.argmax(projections.box.width))
    eps = bracket_text(projections.eps, projections.eps)[0]
    return (
        f" What the measurements determine is less: of all parameters that satisfy leg {leg}’s equations to within "
        f"{eps} mm, {SYMBOLS[k]} is only enclosed to a width of {rounded_up(float(projections.box.width[k]), 1)} mm."
    )


def _validated(record: CalibrationRecord) -> Iterator[Section]:
    yield Section(
        "Table 6: errors of the validation poses",
        tables=[validation(record, paper_too=True)],
        notes=[
            "The row labels of the paper’s Table 6 mix degrees and mm. Its rows are taken in their order: position "
            "mean, its deviation, orientation mean, its deviation.",
            "“By noise alone” is what perfect parameters would show on these poses: the noise of their own readings. "
            f"{record.validation.screening}",
        ],
    )
    for heading, table in () if record.budget is None else budget_tables(record.budget):
        yield Section(heading, tables=[table])
    drawings = []
    for name, letter, errors in (("x_c", "a", record.validation.x_c), ("x_c_sigma", "b", record.validation.x_c_sigma)):
        svg = validation_svg(errors, label=f"Errors and improvements of the validation poses with {name}")
        drawings.append(Drawing([svg], caption=f"({letter}) {name}. {errors.sentence}"))
    legend = {
        "dot": "position, after calibration",
        "mark room": "position, before",
        "mark warm": "orientation, improvement",
    }
    yield Section(
        "Figure 5: validation pose by pose",
        figures=[drawings[0], replace(drawings[1], legend=legend)],
        notes=[
            "Improvement: 100 (before − after) / before, in percent; below the dashed line the error grew. Every "
            "curve is sorted by itself, so that points above each other need not be of the same pose."
        ],
    )


def _certified(found: StudyFound) -> Iterator[Section]:
    count, delta = len(found.campaign), stated(found.result.options.delta)
    yield Section(
        "Section 5.1.2: are x_c and x_c_sigma solutions?",
        [_fit_sentence(name, [fit.verified.verdict for fit in fits]) for name, fits in found.fits.both],
        tables=[_fits_table(found.fits)],
        notes=[
            f"Of {count:,} measurements at eps = 0: “satisfied” counts those with some reading in their set at which "
            "the leg equation holds exactly, “refuting” those with none. Both are proved, with certificates; where "
            "they do not add up to all, nothing is proved of the rest. The paper’s answer was no, for both of its "
            "fits."
        ],
    )
    yield Section(
        sentences=[
            f"Does any x in the box do better, with no model error at all? {_exact_sentence(found.result)}",
            "A refutation leaves two explanations: reading sets that are too small (the paper’s H-1), or equations "
            f"that are not this robot’s (H-2). {found.record.sets.sentence} How large an error of the equations would "
            "do is the next question.",
        ]
    )
    yield Section(
        "Table 7: the smallest model error eps, leg by leg [mm]",
        tables=[_table7(found)],
        notes=[
            f"“None below”: no parameters within ±{delta} mm of the leg’s least-squares fit have a smaller eps, "
            "proved; “attained”: some have this one, proved. “Bound” is branch and bound, with certificates; "
            "“timeout” is the paper’s method (section 5.2.1), which had "
            f"{stated(found.timeout.options.time_limit or 0.0)} s a leg: the table says what it reached in that time. "
            "Its bounds were derived in outward-rounded arithmetic, and no certificates are written of them."
        ],
    )
    yield Section(
        sentences=[
            "The paper’s 24 to 33 mm are hard to reconcile with its Table 6, whose mean errors after calibration are "
            "0.67 and 1.10 mm: residuals of that size would take gross outliers among the calibration poses, or "
            "other units. Nothing here was tuned to reproduce them.",
            found.checked,
            "Figure 6, the solution set in two dimensions, is drawn for each leg below, as polygons proved to hold all "
            "solutions.",
        ]
    )


def _table7(found: StudyFound) -> Table:
    """Both methods' brackets, lower ends rounded down and upper ends up, beside the paper's; a column a leg, mm."""
    legs = [leg.leg for leg in found.result.legs]
    rows: list[tuple[str, ...]] = []
    for name, result in (("bound", found.result), ("timeout", found.timeout)):
        bounds = {leg.leg: bracket_text(leg.bracket.lo, leg.bracket.hi) for leg in result.legs}
        for side, end in enumerate(("none below", "attained")):
            rows.append((f"{name}: {end}", *(bounds.get(leg, ("—", "—"))[side] for leg in legs)))
    if max(legs, default=0) <= len(TABLE_7_CERTIFIED):
        for name, theirs in (("none below", TABLE_7_CERTIFIED), ("attained", TABLE_7_ATTAINED)):
            rows.append(_row(f"the paper: {name}", (theirs[leg - 1] for leg in legs), 2))
    return Table(("leg", *map(str, legs)), rows)


def _fits_table(fits: CertifiedFits) -> Table:
    rows = []
    for name, verified in fits.both:
        rows.append((f"{name}: satisfied", *(str(fit.verified.holds) for fit in verified)))
        rows.append((f"{name}: refuting", *(str(fit.verified.fails) for fit in verified)))
    return Table(("leg", *(str(fit.leg) for fit in fits.x_c)), rows)


def _fit_sentence(name: str, verdicts: list[Verdict]) -> str:
    refuted = sum(verdict is Verdict.REFUTED for verdict in verdicts)
    proved = sum(verdict is Verdict.PROVED for verdict in verdicts)
    legs = f"of {len(verdicts)} legs"
    if refuted == len(verdicts):
        return f"{name} is no solution for any leg verified: refuted by measurements, with proof."
    return f"{name} is a solution for {proved} {legs} and refuted for {refuted}; of the others nothing is proved."


def _exact_sentence(result: Result) -> str:
    """The paper's second question: has any x in the box no model error at all?"""
    none = [str(leg.leg) for leg in result.legs if leg.bracket.lo > 0.0]
    some = [str(leg.leg) for leg in result.legs if leg.not_refuted]
    rest = [str(leg.leg) for leg in result.legs if not leg.not_refuted and leg.bracket.lo <= 0.0]
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
    names = [one.name for one in statistics if one.not_normal]
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
