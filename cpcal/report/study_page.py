"""The page of a whole study: the paper's tables and figures in its numbering, then the legs as in any other page."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cpcal.common.errors import unusable
from cpcal.common.files import StrPath
from cpcal.common.numbers import about, bracket_text, nearest, stated
from cpcal.common.values import Floats, Names
from cpcal.models import PARAMETERS
from cpcal.questions import Budget, CalibrationRecord, Result
from cpcal.questions.points import Fits
from cpcal.questions.result import check_campaign
from cpcal.questions.study_calibration import Channel, Parameters, RepeatRecord, Rows
from cpcal.report.figures import DOT, ROOM, Svg, series
from cpcal.report.run_page import render
from cpcal.report.section import Drawing, Mark, Section, Table
from cpcal.robot import Campaign, Robot

# ------------------------------------------------------------------------------------------------------------------
# Figures that the paper prints in its tables, for comparison in kind: mm and degrees.
#
# Daney, Andreff, Chabert and Papegay, Interval method for calibration of parallel robots: Vision-based experiments
# (2006). Its measurements are not public and its robot is not ours: no number can be compared with one of ours.

TABLE_2 = (0.0077, 0.0127, 0.0117, 0.0102, 0.0118, 0.0190)  # mm, legs 1 to 6

# Degrees and mm (the table has m). The paper's angles are Euler angles alpha, beta, gamma; ours are the components of a
# small rotation vector, in the same order.
TABLE_3 = {"x": 0.0633, "y": 0.0230, "z": 0.0608, "rx": 9.23e-3, "ry": 1.19e-2, "rz": 8.94e-3}

# Rows: position mean, its deviation, orientation mean, its deviation. The labels in the paper mix degrees and mm; the
# order of the rows is what can be relied on. Columns: before, with x_c, with x_c_sigma.
TABLE_6 = ((1.32, 0.67, 1.10), (0.62, 0.40, 0.45), (0.34, 0.26, 0.26), (0.27, 0.27, 0.27))

TABLE_7_CERTIFIED = (27.38, 26.93, 32.78, 33.42, 25.46, 24.01)  # mm: no solution below
TABLE_7_ATTAINED = (27.53, 26.96, 33.12, 33.48, 25.53, 24.24)  # mm: of a valid point


# ------------------------------------------------------------------------------------------------------------------
# The tables of a study's calibration.

PAPERS_WAY = (
    "Where this differs from the paper: a row is the mean of ten images, if single ones were not asked for; x_c "
    "minimises g (mm) instead of f (mm²); the frames begin with a closed form."
)
COMPARED = (
    "Rows called “the paper” show its printed values for their kind and size only: its measurements are not public, "
    "and its robot is another one. What is proved here is proved of the readings of this study. Statistics, fits and "
    "validation are floating-point estimates, not proofs."
)
PAPER = "the paper"
EXPANDED = "U (k = 2)"


def scatter(repeats: RepeatRecord, channels: list[Channel], shared: Sequence[float] | None = None) -> list[Names]:
    """Standard deviations, mm or degrees: what the repeats show, robot included; what is camera's and sensors' of it;
    what all images share."""
    found: list[tuple[str, Iterable[float]]] = [("this study", (c.sigma for c in channels))]
    if any(repeats.robot_sigma):
        found.append(("without the robot's own scatter", (c.noise for c in channels)))
    if shared is not None:
        found.append(("shared by all images, beside it", shared))
    units = [math.degrees(1.0) if c.unit == "rad" else 1.0 for c in channels]
    return [(name, *(about(u * v) for u, v in zip(units, values, strict=True))) for name, values in found]


def _row(name: str, values: Iterable[float], decimals: int = 4) -> Names:
    return (name, *(nearest(value, decimals) for value in values))


def of_legs(rows: Rows, errors: Rows | None = None) -> Table:
    """Of each leg its seven parameters, mm; below each its expanded uncertainty."""
    out = []
    for k, row in enumerate(rows):
        out.append(_row(str(k + 1), row))
        if errors is not None:
            out.append(_row(EXPANDED, (2.0 * error for error in errors[k])))
    return Table(("leg", *PARAMETERS), out)


def validation(record: CalibrationRecord) -> Table:
    """Table 6: errors of the validation poses, positions in mm and orientations in degrees."""
    plain, weighted = record.validation.x_c, record.validation.x_c_sigma
    rows = []
    for k, (kind, figure) in enumerate(_FIGURES):
        unit, size = ("[°]", math.degrees(1.0)) if kind == "orientation" else ("[mm]", 1.0)
        values = (*plain.figures(kind)[figure], weighted.figures(kind)[figure][1])
        rows.append((f"{kind}, {figure} {unit}", *(about(size * float(value)) for value in values)))
        if k < len(TABLE_6):
            rows.append((PAPER, *map(about, TABLE_6[k])))
        if figure == "rms" and plain.floor is not None and weighted.floor is not None:
            floors = (about(size * one.floor[kind == "orientation"]) for one in (plain, weighted) if one.floor)
            rows.append((f"{kind}, rms by noise alone {unit}", "", *floors))
    return Table(("error", "before", "with x_c", "with x_c_sigma"), rows)


_FIGURES = [
    (kind, figure)
    for figures in (("mean", "std. dev."), ("rms", "largest"))
    for kind in ("position", "orientation")
    for figure in figures
]


def budgeted(found: Budget) -> Section:
    rows = []
    for one in found.contributions:
        size, sizes = about(one.uncertainty), (about(one.rms), about(one.largest))
        if not one.uncertainty:
            size, sizes = "not stated", ("—", "—")
        rows.append((one.source.replace("_", " "), "" if math.isnan(one.uncertainty) else size, *sizes))
    for name, times in (("combined, u_c", 1.0), (EXPANDED, 2.0)):
        rows.append((name, "", about(times * found.rms), about(times * found.largest)))
    table = Table(("source", "stated", "on average (rms)", "largest"), rows)
    each = f"{EXPANDED} of each parameter by the budget, laid on the drawing [mm]"
    title = "Uncertainty budget (GUM), parameters laid on the drawing [mm]"
    return Section(title, [found.sentence], tables=[table], parts=[Section(each, tables=[of_legs(found.expanded)])])


# ------------------------------------------------------------------------------------------------------------------
# Figure 5 of the paper for a user's study: plain floating point, nothing of it is proved.


def sorted_svg(curves: dict[str, Floats], label: str) -> Svg:
    """Position errors (mm) of validation poses by their colours, each curve sorted ascending by itself."""
    values = {colour: np.sort(of[np.isfinite(of)]) for colour, of in curves.items()}
    every, count = np.concatenate([np.zeros(1), *values.values()]), max(map(len, values.values()))
    plot = series((230.0, 180.0), count, every, ("validation poses, sorted", "position error [mm]"))
    for colour, of in values.items():
        plot.marks(np.stack([np.arange(1.0, len(of) + 1.0), of], axis=1), "dot", colour, 2.8)
    return plot.svg(label)


# ------------------------------------------------------------------------------------------------------------------
# The page.


class StudyFound(NamedTuple):
    """Everything that a study led to, all of the same campaign.

    result   brackets by branch and bound; timeout  those by the paper's timeout method, with a time limit
    checked  a sentence on what the checker made of the certificates
    truth    of a simulated study: the robot behind it, in the campaign's frames
    """

    campaign: Campaign
    record: CalibrationRecord
    fits: Fits
    result: Result
    timeout: Result
    checked: str
    truth: Robot | None


def render_study(found: StudyFound, run: StrPath | None = None) -> str:
    """The page as text; the same parts give the same text. `run`: the folder whose certificates the page checks.

    Raises InputError for parts of different campaigns.
    """
    remedy = "give the parts of one study"
    parts = {
        "calibration record": found.record.campaign_sha256,
        "result of the timeout method": found.timeout.campaign.sha256,
    }
    check_campaign(found.campaign, parts, remedy)
    for name, fits in found.fits.items():
        if any(fit.point != tuple(getattr(found.record, name).values[fit.leg - 1]) for fit in fits):
            raise unusable("certified fits", f"{name} is not the calibration record's", remedy)
    return render(found.campaign, found.result, _study(found), run=run)


def _study(found: StudyFound) -> Section:
    record = found.record
    said = (
        f"{record.repeats.readings:,} readings of {record.repeats.configurations} configurations: statistics of "
        "the repeats, the frames of camera and target, least squares, validation, certification. Tables and "
        "figures have the numbers that they have in Daney, Andreff, Chabert and Papegay (2006)."
    )
    parts = [
        Section("Table 1: the drawing’s parameters [mm]", tables=[of_legs(record.drawing)]),
        *calibration(record),
        *_certified(found),
        *_true(found),
    ]
    title = "The study, in the paper’s order"
    return Section(title, [said, PAPERS_WAY, Mark(COMPARED, "quantifier")], parts=parts, name="study", style="study")


def calibration(record: CalibrationRecord) -> Iterator[Section]:
    """Statistics of the repeats, fits and validation: the same on the terminal and on the page."""
    repeats = record.repeats
    sensors = [c for c in repeats.channels if c.name.startswith("L")]
    camera = [c for c in repeats.channels if c not in sensors]
    rows = scatter(repeats, sensors)
    if len(sensors) == len(TABLE_2):
        rows.append(_row(PAPER, TABLE_2))
    legs = ("leg", *(str(k) for k in range(1, len(sensors) + 1)))
    yield Section("Table 2: standard deviation of the leg readings [mm]", tables=[Table(legs, rows)])
    rows = scatter(repeats, camera, repeats.shared)
    rows.append((PAPER, *(about(TABLE_3[c.name]) for c in camera)))
    units = (f"{c.name} [{'°' if c.unit == 'rad' else 'mm'}]" for c in camera)
    yield Section(
        "Table 3: standard deviation of the pose’s components",
        tables=[Table(("component", *units), rows)],
        notes=[
            "Camera frame. As in the paper, a deviation is from the mean of the configuration and holds “both "
            "measurement repeatability and robot repeatability”. Angles are components of a small rotation vector "
            "(rx, ry, rz), the paper’s are Euler angles. A row may be the mean of several images, the paper’s "
            "deviations are of single ones: a mean of ten scatters less by the root of ten."
        ],
    )
    said = [repeats.scatter, *filter(None, [repeats.shared_sentence])]
    rows = [_row("equations g between repeats", repeats.equation_sigma)]
    rows += [_row("the robot itself", repeats.robot_sigma)] if any(repeats.robot_sigma) else []
    yield Section(sentences=said, items=[sentence for _, sentence in repeats.tests], tables=[Table(legs, rows)])
    yield Section(sentences=[repeats.screening, record.frames, record.sets])
    plain, weighted = record.x_c, record.x_c_sigma
    title = "Table 4: x_c, plain least squares [mm]"
    yield Section(title, tables=[of_legs(plain.drawn, plain.drawn_errors)])
    doubt = ", which the model does not explain: errors of the model are not in it, and IT DOES NOT COVER THEM"
    apart = np.abs(np.array(plain.drawn) - np.array(weighted.drawn))
    leg, k = np.unravel_index(int(np.argmax(apart)), apart.shape)
    fits = [f"x_c: {plain.sentence}", f"x_c_sigma: {weighted.sentence}"]
    yield Section(
        "Table 5: x_c_sigma, weighted by the noise [mm]",
        tables=[of_legs(weighted.drawn, weighted.drawn_errors)],
        notes=[
            "Laid on the drawing: base and mobile centres each moved rigidly so that they are nearest to the "
            "drawing’s. U (k = 2) is the expanded uncertainty: about 95 %, from the "
            f"{weighted.source}{'' if weighted.explained else doubt}. The two fits differ by up to "
            f"{about(float(apart.max()), 2)} mm ({PARAMETERS[int(k)]} of leg {int(leg) + 1})."
        ],
        parts=[Section("The fits in words", fits, folded=True)],
    )
    yield Section(
        "Table 6: errors of the validation poses",
        tables=[validation(record)],
        notes=[
            "The row labels of the paper’s Table 6 mix degrees and mm; its rows are taken in their order. “By noise "
            "alone” is what perfect parameters would show on these poses: the noise of their own readings. "
            f"{record.validation.screening}"
        ],
    )
    if record.budget is not None:
        yield budgeted(record.budget)
    figures, said = [], []
    for name, found in (("x_c", record.validation.x_c), ("x_c_sigma", record.validation.x_c_sigma)):
        before, after = found.errors("position")
        figures.append(sorted_svg({ROOM: before, DOT: after}, f"Errors of the validation poses with {name}"))
        said.append(f"{name}: {found.sentence}")
    legend = {"dot": "after calibration", "mark room": "before"}
    drawing = Drawing(figures, legend, "x_c at the left, x_c_sigma at the right; each curve is sorted by itself.")
    yield Section("Figure 5: position errors of the validation poses", said, figures=[drawing])


def solutions(fits: Fits) -> list[str]:
    """Whether each fit is a solution, within the stated reading uncertainty: a sentence each."""
    said = []
    for name, points in fits.items():
        legs: dict[str, list[str]] = {}
        for fit in points:
            legs.setdefault(fit.verified.verdict.value, []).append(str(fit.leg))
        words = [f"{word} for leg {', '.join(some)}" for word, some in sorted(legs.items())]
        said.append(f"Is {name} a solution, within the stated reading uncertainty? {'; '.join(words).capitalize()}.")
    return said


def _certified(found: StudyFound) -> Iterator[Section]:
    delta, fits = stated(found.result.options.delta), found.fits
    rows = []
    for name, points in fits.items():
        rows.append((f"{name}: satisfied", *(str(fit.verified.holds) for fit in points)))
        rows.append((f"{name}: refuting", *(str(fit.verified.fails) for fit in points)))
    yield Section(
        "Section 5.1.2: are x_c and x_c_sigma solutions?",
        solutions(fits),
        tables=[Table(("leg", *(str(fit.leg) for fit in fits["x_c"])), rows)],
        notes=[
            f"Of {len(found.campaign):,} measurements at eps = 0: “satisfied” counts those with some reading in their "
            "set at which the leg equation holds exactly, “refuting” those with none. Both are proved, with "
            "certificates; where they do not add up to all, nothing is proved of the rest. The paper’s answer was no, "
            "for both of its fits."
        ],
    )
    yield Section(
        sentences=[
            f"Does any x in the box do better, with no model error at all? {_exact_sentence(found.result)}",
            "A refutation leaves two explanations: reading sets that are too small (the paper’s H-1), or equations "
            f"that are not this robot’s (H-2). {found.record.sets} How large an error of the equations would "
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
            f"{stated(found.timeout.options.time_limit or 0.0)} s a leg. Its bounds were derived in outward-rounded "
            "arithmetic, and no certificates are written of them. The paper’s 24 to 33 mm are hard to reconcile with "
            "its Table 6, whose mean errors after calibration are 0.67 and 1.10 mm.",
            found.checked,
        ],
    )


def _table7(found: StudyFound) -> Table:
    """Both methods' brackets, lower ends rounded down and upper ends up, beside the paper's; a column a leg, mm."""
    legs = [leg.leg for leg in found.result.legs]
    rows = []
    for name, result in (("bound", found.result), ("timeout", found.timeout)):
        bounds = {leg.leg: bracket_text(leg.bracket.lo, leg.bracket.hi) for leg in result.legs}
        for side, end in enumerate(("none below", "attained")):
            rows.append((f"{name}: {end}", *(bounds.get(leg, ("—", "—"))[side] for leg in legs)))
    if max(legs, default=0) <= len(TABLE_7_CERTIFIED):
        for name, theirs in (("none below", TABLE_7_CERTIFIED), ("attained", TABLE_7_ATTAINED)):
            rows.append(_row(f"{PAPER}: {name}", (theirs[leg - 1] for leg in legs), 2))
    return Table(("leg", *map(str, legs)), rows)


def _true(found: StudyFound) -> Iterator[Section]:
    """How many of the true parameters of a simulated study lie where they are said to be."""
    if found.truth is None:
        return
    truth, legs = found.truth.parameters, found.result.legs
    ranges = {leg.leg: (leg.ranges.box.lo, leg.ranges.box.hi) for leg in legs if leg.ranges is not None}
    ends = {"proved ranges": ranges}
    for name in ("x_c", "x_c_sigma"):
        fit: Parameters = getattr(found.record, name)
        x, reach = np.array(fit.values), 2.0 * np.array(fit.standard_errors)
        ends[f"{name} ± U"] = {k: (x[k - 1] - reach[k - 1], x[k - 1] + reach[k - 1]) for k in (leg.leg for leg in legs)}
    told = []
    for name, each in ends.items():
        inside = sum(int(np.sum((lo <= truth[k - 1]) & (truth[k - 1] <= hi))) for k, (lo, hi) in each.items())
        told += [f"{inside} of {7 * len(each)} inside {name}"] * bool(each)
    yield Section(
        "The truth, which only a simulation knows",
        [
            f"True parameters: {'; '.join(told)}. Of U (k = 2) about 95 % are expected inside. Where fewer are, the "
            "legs are not as the model says: ranges hold if it holds to within their eps, and what it lacks is in no "
            "parameter’s U. The U of a pose, which cpcal accuracy states, takes it from the residuals."
        ],
    )


def _exact_sentence(result: Result) -> str:
    """The paper's second question: has any x in the box no model error at all?"""
    box = f"within ±{stated(result.options.delta)} mm"
    answers: dict[str, list[str]] = {
        f"proved: no parameters {box} satisfy all equations within the stated reading uncertainty": [],
        "proved: some parameters do": [],
        "not known": [],
    }
    none, some, rest = answers.values()
    for leg in result.legs:
        (none if leg.bracket.lo > 0.0 else some if leg.bracket.hi == 0.0 else rest).append(str(leg.leg))
    text = "; ".join(f"{answer} (leg {', '.join(legs)})" for answer, legs in answers.items() if legs)
    return f"{text[0].upper()}{text[1:]}." if text else "No leg was finished."


# ------------------------------------------------------------------------------------------------------------------
# What matters of a calibration in at most twelve lines, for a terminal: doubts first. The tables say the rest.


def summary(record: CalibrationRecord) -> Names:
    """Sentences; lengths in mm and angles in degrees."""
    budget = () if record.budget is None else (record.budget.sentence,)
    doubts = [sentence for bad, sentence in record.repeats.tests if bad]
    return (
        f"{record.robot}: {record.repeats.readings:,} readings of {record.repeats.configurations} configurations. "
        f"{record.repeats.screening}",
        *(doubts or ["Repeats scatter as independent noise does, as far as it can be tested."]),
        record.repeats.scatter,
        f"x_c_sigma: {record.x_c_sigma.sentence}",
        _known(record),
        *budget,
        f"Validation of x_c_sigma: {record.validation.x_c_sigma.sentence}",
    )


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
