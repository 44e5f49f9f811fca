"""The page of a run: one self-contained HTML page from a campaign and its result, light and dark; it checks itself."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import os
import shlex
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from cpcal.calibration import CalibrationRecord
from cpcal.common.errors import InputError, PluginError, Problem, printable
from cpcal.common.files import write_file
from cpcal.common.numbers import about, bracket_text, gap_text, nearest, plain_gap, rounded_down, rounded_up, stated
from cpcal.common.values import Floats
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import REPORT_NAME
from cpcal.models import PARAMETERS, PLAIN, LegModel, model_residuals, reading_sensitivities
from cpcal.questions import INFORMATION, LegResult, Result, contractors_sentences, model_of, verdict_of
from cpcal.report.advice import FEW, Fitted, advise, fitted, forcing_numbers, measurement_names, support_numbers
from cpcal.report.figures import (
    MOST_POINTS,
    Enclosure,
    Panel,
    Residuals,
    enclosure_svg,
    errors_svg,
    in_view,
    panel_svg,
    platform_svg,
    residual_svg,
)
from cpcal.report.section import Drawing, Mark, Page, Proof, Section, Table, Words, origin, verdict
from cpcal.report.words import (
    FRAME,
    LONGER,
    QUANTIFIER,
    assumptions,
    center_sentence,
    fit_sentence,
    leg_sentence,
    notices,
    overall,
    summary,
)
from cpcal.robot import Campaign, rotation_matrix
from cpcal.robot.mistakes import suspicions
from cpcal.solver.accounts import TimeoutAnswer, Trial
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box

_HEAD = ("date", "operator", "serial")  # of the campaign's provenance, shown at the top of the page
_DECIMALS = {"mm": 4}  # of parameters in this unit
_MORE = 9  # of others, such as shares
_MOST_NAMES = 120  # measurements listed for a leg
_UNKNOWN = "—"


def write_report(
    campaign: Campaign,
    result: Result,
    folder: str | os.PathLike[str],
    model: LegModel | None = None,
    *,
    checker: bool = True,
) -> Path:
    """Write the page to `report.html` in `folder`, all or nothing; both are made if missing. Its path.

    The same campaign and result give the same bytes. Bounds are printed rounded to the side on which they stay proved;
    every answer is for SOME reading in the set of each measurement. `checker`: the page holds the certificates of the
    run that lie in the folder, and checks them in the browser. `model`: the result's leg model, where no installed
    package provides it; without it the page says which figures it lacks. Raises InputError when the result is of
    another campaign, or when the file cannot be written.
    """
    page = render(campaign, result, model=model, run=folder if checker else None)
    return write_file(Path(folder) / REPORT_NAME, page)


def render(
    campaign: Campaign,
    result: Result,
    study: Section | None = None,
    model: LegModel | None = None,
    run: str | os.PathLike[str] | None = None,
    frames: DrawingFrames | None = None,
) -> str:
    """The page as text; `study` is what `cpcal.report.study_page` shows before the legs, `frames` are the drawing's,
    `run` is the folder of the run where the page is to check its certificates.

    Raises InputError when the result is of another campaign, or garbled.
    """
    sha256, absent = campaign_sha256(campaign), [leg.leg for leg in result.legs if leg.leg > campaign.legs]
    if result.campaign_sha256 != sha256:
        what = f"is of another campaign (sha256 {printable(str(result.campaign_sha256))}, not {sha256})"
        raise InputError([Problem("result", what, "give the campaign that was certified, or certify this one")])
    if absent:
        what, remedy = f"names a leg that is not there: {absent[0]}", f"certify again: legs are 1 to {campaign.legs}"
        raise InputError([Problem("result", what, remedy)])
    robot, above = campaign.robot.name, [notices(result, campaign.legs) or ""]
    title, kicker, last = f"Certified calibration: {robot}", "certified calibration", list(_about(campaign, result))
    if result.options.outliers:
        kicker += ", some measurements may be wrong"
        return Page(title, kicker, robot, [outliers_section(result), *last], above).text()
    known, lacking = _known(result, model)
    fits = [None if known is None else fitted(campaign, result, leg, known) for leg in result.legs]
    proof = None if run is None else embedded(Path(run), result, study=study is not None)
    checked = proof is not None
    legs = [
        leg_section(campaign, result, leg, known, fit, frames, lacking=lacking, checked=checked)
        for leg, fit in zip(result.legs, fits, strict=True)
    ]
    first = _answer(campaign, result, known, fits, checked=checked)
    kicker += "".join(f" · {name} {campaign.provenance[name]}" for name in _HEAD if name in campaign.provenance)
    sections = [first, *([] if study is None else [study]), *legs, *_bounds(result), *last]
    above += [f"Look at the campaign first: {s}" for s in suspicions(campaign)]
    return Page(title, kicker, robot, sections, above, _lead(campaign, result), proof).text()


def _known(result: Result, model: LegModel | None) -> tuple[LegModel | None, str]:
    """The leg model; or None and, for the page, why the residuals cannot be drawn. Raises InputError for another one
    that is given."""
    try:
        return model_of(result, model), ""
    except (InputError, PluginError):
        if model is not None:
            raise
        why = f"the leg model {result.model.name!r} is not known here"
        return None, f"{why}; install the package that provides it and write the page again with `cpcal report`"


# ------------------------------------------------------------------------------------------------------------------
# What is said of all legs: the answer first, the proved bounds, how to read it, what it rests on.


def claim(
    words: Words, what: str, leg: LegResult | None = None, value: float | str | None = None, parameter: str = ""
) -> Mark:
    """Words that state what a certificate claims, exactly `value`: the page compares them."""
    exact = value.hex() if isinstance(value, float) else value
    number = None if leg is None else str(leg.leg)
    data = {"leg": number, "claim": what, "parameter": parameter or None, "value": exact}
    return Mark(words, data={name: text for name, text in data.items() if text is not None})


def badge(result: Result, leg: LegResult) -> Mark:
    found = verdict_of(result, leg)
    return verdict(found.word, found.kind, leg=str(leg.leg), claim="verdict", value=_tolerance(result))


def _tolerance(result: Result) -> str:
    return "" if result.options.tolerance is None else result.options.tolerance.hex()


def _lead(campaign: Campaign, result: Result) -> Words:
    tolerance, count = result.options.tolerance, claim(f"{len(campaign):,}", "count")
    if tolerance is None:
        if result.options.eps is not None:
            return ("Do all ", count, f" measurements fit to within eps = {stated(result.options.eps)} mm?")
        rest = f" measurement{'' if len(campaign) == 1 else 's'}? No tolerance was given, so nothing passes or fails."
        return ("How well do the legs fit ", count, rest)
    every = overall(result)
    of_all = "" if every is None else verdict(every.word, f"big {every.kind}", claim="overall", value=tolerance.hex())
    within = claim(stated(tolerance), "tolerance", value=tolerance)
    said = claim(summary(result), "summary", value=tolerance)
    return (of_all, " Do all ", count, " measurements fit to within the tolerance of ", within, " mm? ", said)


def _answer(
    campaign: Campaign, result: Result, model: LegModel | None, fits: Sequence[Fitted | None], *, checked: bool
) -> Section:
    if not result.legs:
        return Section(sentences=["No leg was finished."], name="answer")
    items, errors = [], []
    for leg, fit in zip(result.legs, fits, strict=True):
        found, said = advise(campaign, result, leg, model, fit), fit_sentence(verdict_of(result, leg))
        look = f" Look first at {', '.join(measurement_names(campaign, found.first))}." if found.first else ""
        words: Words = (
            badge(result, leg),
            " ",
            claim(said, "verdict", leg, _tolerance(result)),
            Mark(look, "look"),
            Mark((" ", Mark("Next:", "next"), f" {found.sentence}"), "look"),
            *_note(leg, checked=checked),
        )
        items.append((Mark(f"Leg {leg.leg}", "leg", f"#leg-{leg.leg}"), Mark(words, "sentence")))
        errors.append(None if fit is None or model is None else fit_error(campaign, leg, model, fit))
    legend = {
        "shade": "proved impossible",
        "bracket": "smallest error, between two proved bounds",
        "cross": "error of least squares",
    }
    seen = {"mark soft": "measured pose", "mark warm": "forces the error of a leg"}
    if not forcing_numbers(campaign, result):
        del seen["mark warm"]
    return Section(
        items=items,
        beside=[
            Drawing([errors_svg(result, errors)], legend),
            Drawing([platform_svg(campaign, result)], {**seen, "": "legs in the colours of their verdicts"}),
        ],
        notes=[
            "Measurements are counted from 1. What to look at, what to do next and whether parameters are undetermined "
            "are estimates; the bounds are proved. cpcal export RUN writes the parameters for a controller."
        ],
        name="answer",
        style="answers",
    )


def _note(leg: LegResult, *, checked: bool) -> list[Words]:
    """Where the page says whether it accepts the leg's certificates."""
    word = "not checked" if leg.certified else "not certified"
    return [" ", Mark(word, "proof", data={"proof": str(leg.leg)})] if checked else []


def bounds_table(result: Result) -> Table:
    """A row a leg. Bounds are rounded to the side on which they stay proved."""
    eps = result.options.eps
    bounds = ("eps_lo [mm]", "eps_hi [mm]", "gap [mm]") if eps is None else ("eps asked [mm]",)
    rows: list[Sequence[Words]] = []
    for leg in result.legs:
        lo, hi = leg.bracket.lo, leg.bracket.hi
        ends = zip(bracket_text(lo, hi), ("eps_lo", "eps_hi"), (lo, hi), strict=True)
        between = [claim(text, name, leg, end) for text, name, end in ends]
        cells = [*between, gap_text(lo, hi)] if eps is None else [stated(eps)]
        work = f"{leg.work.nodes:,}", f"{leg.work.programs:,}", nearest(leg.work.seconds, 2)
        certified = "yes" if leg.certified else "no"
        rows.append((str(leg.leg), badge(result, leg), *cells, certified, str(len(leg.support.ids)), *work))
    return Table(("leg", "verdict", *bounds, "certified", "support", "nodes", "LPs", "seconds"), rows, ("", "word"))


def outliers_section(result: Result) -> Section:
    """The brackets when some measurements may be wrong, nobody knows which."""
    rows = []
    for leg in result.legs:
        of, left_out = leg.bracket, ", ".join(leg.bracket.left_out) or "none"
        closed = "closed" if of.verdict is Verdict.PROVED else "open: the search stopped at a limit"
        rows.append((str(leg.leg), *bracket_text(of.lo, of.hi), closed, left_out, str(len(of.proofs))))
    said = (
        f"Whichever {result.options.outliers} measurements of a leg are wrong, no parameters in the box explain the "
        "others better than eps_lo; some explain all but those left out to within eps_hi. Both bounds are proved."
    )
    head = ("leg", "eps_lo [mm]", "eps_hi [mm]", "gap", "left out", "proofs")
    return Section(sentences=[said], tables=[Table(head, rows, ("", "", "", "word", "word"))], name="answer")


def _bounds(result: Result) -> Iterator[Section]:
    if not result.legs:
        return
    rounding = (
        "eps_lo is printed rounded down and eps_hi rounded up, so that both stay proved: no parameters in the box do "
        "better than eps_lo, and some reach eps_hi. "
    )
    support = (
        "“Support” counts measurements that the search found to give the lower bound or the refutation by themselves "
        "(where no few were found to, all with a weight in the proof); “LPs” the linear programs solved."
    )
    yield Section(
        "Proved bounds",
        [Mark(f"{QUANTIFIER} {LONGER}", "quantifier")],
        tables=[bounds_table(result)],
        notes=[(rounding if result.options.eps is None else "") + support, INFORMATION],
        name="bounds",
    )
    formula = "‖P + R b − a‖ − (L + l) " if result.model.name == PLAIN.name else ""
    yield Section(
        "How to read the figures",
        [
            f"Residuals {formula}are drawn at the centres of the reading sets. Where a centre lies outside the band, "
            "that is no contradiction: some reading in its set is within it. The bars of sensitivity are drawn to "
            "first order in floating point; the proof does not use them. The pointer on a residual shows its "
            "measurement.",
            "Least squares makes the sum of squared errors small, not the largest error: its fit need not be a "
            "solution, nor lie in the ranges. Where the two ticks of a range touch, it is thinner than can be drawn; "
            "its width is written at the right, rounded up.",
            "A polygon much smaller than its rectangle means that the measurements tie the two parameters to each "
            "other. Every side of a polygon was derived by a linear program whose answer is bounded in "
            "outward-rounded float64 arithmetic; corners are drawn in plain floating point. The polygons are outer "
            "ones: the solutions may fill less, and a mark within them all need not be a solution. Marks that lie "
            "off a panel are not drawn. The certificates do not repeat the proofs of polygons.",
        ],
        name="read",
    )


def _about(campaign: Campaign, result: Result) -> Iterator[Section]:
    yield Section("What was assumed", data=dict(assumptions(campaign, result)), name="assumed")
    options = result.options
    certificates = [leg.bracket.certificate for leg in result.legs if leg.bracket.certificate is not None]
    data: dict[str, Words] = {
        "Campaign, SHA-256": Mark(claim(result.campaign_sha256, "campaign"), "code"),
        "To repeat the run": (
            Mark(command(result), "command"),
            Mark("CAMPAIGN: the folder of the campaign with the SHA-256 above. RUN: a new folder.", "small"),
        ),
    }
    if certificates:
        data["To check the proofs again"] = (
            Mark("cpcal verify RUN --campaign CAMPAIGN", "command"),
            Mark(
                f"Exact rational arithmetic, no solver: {', '.join(certificates)}. The certificates claim what the "
                "exact rule proved, which may be a part of the gap less than the table says.",
                "small",
            ),
        )
    box = claim(str(options.delta), "box", value=options.delta)
    data["Asked"] = (f"relative gap {options.gap}, box ±", box, f" mm, center “{options.center}”")
    data |= {k.replace("_", " "): Mark(v, "free") for k, v in campaign.provenance.items() if k not in _HEAD}
    yield origin(data, f"Certified by cpcal {result.version}.")


def command(result: Result) -> str:
    """The `cpcal certify` command that asks the same again, for a shell; the two folders are placeholders."""
    return shlex.join(["cpcal", "certify", "CAMPAIGN", "-o", "RUN", *result.options.words()])


# ------------------------------------------------------------------------------------------------------------------
# One leg: its residuals, its parameters, and what stands behind them.


def leg_section(
    campaign: Campaign,
    result: Result,
    leg: LegResult,
    model: LegModel | None,
    fit: Fitted | None,
    frames: DrawingFrames | None = None,
    *,
    lacking: str = "",
    checked: bool = False,
) -> Section:
    """`model`: None where it is not known here; then nothing is said of residuals. `frames`: of the drawing."""
    found, center = verdict_of(result, leg), center_sentence(result, leg)
    sentences: list[Words] = [
        (
            claim(found.sentence, "verdict", leg, _tolerance(result)),
            leg_sentence(result, leg).removeprefix(found.sentence),
            f" {center} (No certificate holds this about the center.)" if center else "",
        )
    ]
    drawn = None if model is None else residuals_drawing(campaign, leg, model, fit)
    if drawn is None and lacking and leg.bracket.point is not None:
        sentences.append(f"The residuals of the proved point are not drawn: {lacking}.")
    elif drawn is None:
        sentences.append("There is no proved point whose residuals could be drawn.")
    return Section(
        (f"Leg {leg.leg} ", badge(result, leg), *_note(leg, checked=checked)),
        sentences,
        figures=[] if drawn is None else [drawn],
        parts=[
            parameters_section(campaign, result, leg, fit),
            *_enclosed(result, leg, frames),
            *_behind(campaign, result, leg),
        ],
        name=f"leg-{leg.leg}",
        style="leg-section",
    )


def parameters_section(campaign: Campaign, result: Result, leg: LegResult, fit: Fitted | None) -> Section:
    """A row a parameter: its range and the width of that, the certified point, the fit, the nominal value."""
    other = "" if result.model.name == PLAIN.name else ", but where another unit is given"
    at: list[Words] = []
    if leg.ranges is not None:
        eps = claim(eps_text(result, leg.ranges.eps), "ranges.eps", leg, leg.ranges.eps)
        at, name = ["; ranges at eps = ", eps, " mm"], leg.ranges.certificate
        uncertified = "Proved in outward-rounded arithmetic; no certificate holds it."
        said: Words = (
            "The range holds every solution in the box with eps ≤ ",
            eps,
            f" mm{_times(leg, leg.ranges.eps, ', ')}: so well do the measurements determine the parameter. ",
            uncertified if name is None else f"Certified by {name}.",
        )
    elif leg.bracket.enclosure.is_empty:
        said = "No parameters in the box satisfy the equations, so there is nothing to enclose."
    else:
        said = "No ranges were computed, for no tolerance is known to be reached."
    nominal = [*campaign.robot.parameters[leg.leg - 1], *(0.0 for _ in result.model.extra)]
    rows = []
    for k, (label, decimals) in enumerate(_labels(result)):
        sides = (_UNKNOWN,) * 3 if leg.ranges is None else _claimed_sides(leg, "ranges", leg.ranges.box, k, decimals)
        least = _UNKNOWN if fit is None else nearest(float(fit.x[k]), decimals)
        rows.append((label, *sides, _point(result, leg, k, decimals), least, nearest(float(nominal[k]), decimals)))
    head = ("parameter", "at least", "at most", "width", "certified", "least squares", "nominal")
    digits = " All digits are in result.json; cpcal export writes them." if leg.bracket.point is not None else ""
    return Section(
        (f"Parameters [mm{other}]", *at),
        tables=[Table(head, rows, ("", "main", "main"))],
        notes=[(f"{FRAME} ", said, digits)],
        beside=[parameters_drawing(campaign, leg, fit)],
    )


def _times(leg: LegResult, eps: float, begin: str) -> str:
    """How many times eps_hi an eps is, where it is more."""
    return f"{begin}{about(eps / leg.bracket.hi)} times eps_hi" if 0.0 < leg.bracket.hi < eps else ""


def _labels(result: Result) -> list[tuple[str, int]]:
    """Of each parameter how it is called in a table, and its decimals."""
    units = [(name, result.model.unit(name)) for name in result.parameters]
    return [(name if unit == "mm" else f"{name} [{unit}]", _DECIMALS.get(unit, _MORE)) for name, unit in units]


def _point(result: Result, leg: LegResult, k: int, decimals: int) -> Words:
    if leg.bracket.point is None:
        return _UNKNOWN
    value = leg.bracket.point[k]
    return claim(nearest(value, decimals), "point", leg, value, result.parameters[k])


def _claimed_sides(leg: LegResult, of: str, box: Box, k: int, decimals: int) -> tuple[Words, ...]:
    """The bounds of one parameter and their distance, rounded outward, as claims of `of`: ranges or enclosure."""
    exact: tuple[float | str, ...] = (float(box.lo[k]), float(box.hi[k]), "")
    texts = zip(_sides(box, k, decimals), ("lo", "hi", "width"), exact, strict=True)
    return tuple(claim(text, f"{of}.{side}", leg, value, box.names[k]) for text, side, value in texts)


def _sides(box: Box, k: int, decimals: int) -> tuple[str, str, str]:
    lo, hi = float(box.lo[k]), float(box.hi[k])
    return rounded_down(lo, decimals), rounded_up(hi, decimals), plain_gap(lo, hi)


def eps_text(result: Result, eps: float) -> str:
    """An eps that the user gave as it was given; another one rounded down: what holds to within eps, holds to within
    less."""
    return stated(eps) if eps in (result.options.eps, result.options.tolerance) else bracket_text(eps, eps)[0]


def parameters_drawing(campaign: Campaign, leg: LegResult, fit: Fitted | None = None) -> Drawing:
    """The ranges, or where there are none the enclosure, against nominal values and fit."""
    box, what = (leg.bracket.enclosure, "enclosure") if leg.ranges is None else (leg.ranges.box, "range")
    at_fit = None if fit is None else fit.x[:7]
    data = Enclosure(PARAMETERS, campaign.robot.parameters[leg.leg - 1], box.lo[:7], box.hi[:7], at_fit)
    svg = enclosure_svg(data, label=f"Leg {leg.leg}: {what} of each parameter, relative to its nominal value")
    legend = {} if data.empty else {"bar": f"{what}, between two ticks"}
    legend |= {"nominal": "nominal value"} | ({} if fit is None else {"cross": "least-squares fit"})
    said = [
        "There are no bars: no parameters in the box satisfy the equations." * data.empty,
        "Arrows: the bound in that direction is too far away to be drawn, or there is none." * data.unbounded,
        "Where no cross is drawn, the fit is too far away." * data.fit_beyond,
    ]
    return Drawing([svg], legend, " ".join(filter(None, said)), "fits")


def _enclosed(result: Result, leg: LegResult, frames: DrawingFrames | None) -> Iterator[Section]:
    """Further tables: the enclosure at eps_hi, and the ranges in the drawing's frames."""
    if not leg.bracket.enclosure.is_empty:
        asked = result.options.eps
        at, where = ("eps_hi", "eps_hi") if asked is None else (f"{stated(asked)} mm", f"eps = {stated(asked)} mm")
        rows = [
            (
                label,
                _point(result, leg, k, decimals + 2),
                *_claimed_sides(leg, "enclosure", leg.bracket.enclosure, k, decimals + 2),
            )
            for k, (label, decimals) in enumerate(_labels(result))
        ]
        title = f"Enclosure at {where}: how sharply the optimum is known, no accuracy of the parameters"
        note = (
            f"“At least” and “at most” enclose every solution in the box with eps ≤ {at}: hardly more than one "
            f"point reaches eps_hi. {FRAME}"
        )
        table = Table(("parameter", "proved point", "at least", "at most", "width"), rows)
        yield Section(title, tables=[table], notes=[note], folded=True)
    if frames is not None and leg.bracket.point is not None and leg.ranges is not None:
        point, ends = frames.point(np.array(leg.bracket.point)), frames.box(leg.ranges.box.lo, leg.ranges.box.hi)
        box, decimals = Box(leg.ranges.box.names, *ends), _DECIMALS["mm"]
        moved = [
            (name, nearest(float(point[k]), decimals), *_sides(box, k, decimals)) for k, name in enumerate(box.names)
        ]
        table = Table(("parameter", "certified", "at least", "at most", "width"), moved)
        title = "The same ranges in the frames of the robot’s drawing"
        yield Section(title, tables=[table], notes=[DRAWING_FRAME], folded=True)


def _behind(campaign: Campaign, result: Result, leg: LegResult) -> Iterator[Section]:
    """Parameters two at a time, calls of the solver, contractors, support."""
    if leg.projections is not None:
        yield Section("Two parameters at a time", figures=[_pairs(campaign, result, leg)])
    if leg.work.trials:
        head = ("eps asked [mm]", "delay [s]", "answer", "eps_lo then", "eps_hi then", "nodes")
        table = Table(head, [_trial(leg, trial) for trial in leg.work.trials], ("", "", "word"))
        yield Section(f"Calls of the solver: {len(leg.work.trials)}", tables=[table], folded=True)
    used = contractors_sentences(leg)
    if used:
        yield Section("Contractors: how often each ran, and the steps it made", items=used, folded=True)
    names = measurement_names(campaign, support_numbers(campaign, leg))
    if names:
        more = f", and {len(names) - _MOST_NAMES:,} more in result.json" if len(names) > _MOST_NAMES else ""
        title = (
            f"Support: the {len(names)} measurements, counted from 1, that were found to be enough (not proved "
            "without a certificate of its own)"
        )
        yield Section(title, [Mark(f"{', '.join(names[:_MOST_NAMES])}{more}", "names")], folded=True)


def _trial(leg: LegResult, trial: Trial) -> tuple[str, ...]:
    """A call of the solver; its bounds have the digits of the leg's own, which end the table."""
    asked, lo = (bracket_text(value, leg.bracket.hi)[0] for value in (trial.eps, trial.lo))
    hi = bracket_text(leg.bracket.lo, trial.hi)[1]
    unchecked = trial.answer is TimeoutAnswer.INFEASIBLE and not trial.checked
    answer = "infeasible, unchecked" if unchecked else trial.answer.value
    return (asked, about(trial.delay), answer, lo, hi, str(trial.nodes))


def _pairs(campaign: Campaign, result: Result, leg: LegResult) -> Drawing:
    assert leg.projections is not None
    eps, box = leg.projections.eps, leg.projections.box
    point = None if leg.bracket.point is None else np.array(leg.bracket.point[:7])
    fit = np.array(leg.bracket.center) if result.options.center == "fit" else None
    nominal, start = campaign.robot.parameters[leg.leg - 1], box.mid[:7] if point is None else point
    panels, figures = [], []
    for pair in leg.projections.pairs:
        k = [PARAMETERS.index(name) for name in pair.parameters]
        points = (None if point is None else point[k], None if fit is None else fit[k], nominal[k])
        panels.append(Panel(pair.parameters, box.lo[k], box.hi[k], pair.half_planes, start[k], *points))
        widths = " by ".join(plain_gap(float(box.lo[i]), float(box.hi[i])) for i in k)
        label = f"Leg {leg.leg}: polygon that holds {' and '.join(pair.parameters)}, in a rectangle of {widths} mm"
        figures.append(panel_svg(panels[-1], label=label))
    signs = (
        ("polygon", "all solutions lie in here", True),
        ("rectangle", "bounds of each parameter alone", True),
        ("dot", "proved point", point is not None),
        ("cross", "least-squares fit", any(in_view(panel, panel.fit) for panel in panels)),
        ("square", "nominal value", any(in_view(panel, panel.nominal) for panel in panels)),
    )
    caption = (
        "Solutions are here all parameters in the box that satisfy the equations to within "
        f"eps = {eps_text(result, eps)} mm, for some readings"
        f"{_times(leg, eps, ': ') if result.options.eps is None else ''}. "
        f"Δ counts from {'the middle of the bounds' if point is None else 'the proved point'}."
    )
    return Drawing(figures, {sign: words for sign, words, drawn in signs if drawn}, caption)


def residuals_drawing(
    campaign: Campaign, leg: LegResult, model: LegModel = PLAIN, fit: Fitted | None = None
) -> Drawing | None:
    """The residuals of the proved point over the measurements, beside those of the fit; None without such a point."""
    if leg.bracket.point is None or not math.isfinite(leg.bracket.hi):
        return None
    count, small, hi = len(campaign), len(leg.support.ids) <= FEW, leg.bracket.hi
    residual = model_residuals(campaign, leg.leg, leg.bracket.point, model)
    room = reading_sensitivity(campaign, leg.leg, leg.bracket.point, model)
    support = np.zeros(count, dtype=bool)
    support[list(support_numbers(campaign, leg))] = small
    fits = np.full(count, np.nan) if fit is None else fit.residuals
    data = Residuals(residual, room, support, hi, fits, measurement_names(campaign, range(count)))
    legend: dict[str, Words] = {"dot": "residual of the proved point"}
    if fit is not None:
        legend["cross"] = f"of least squares, {about(fit.largest)} mm at most"
    if room.any():
        legend["room"] = "sensitivity to the reading set"
    legend["band"] = ("±eps_hi = ±", claim(bracket_text(hi, hi)[1], "eps_hi", leg, hi), " mm")
    if support.any():
        legend["support"] = "support: these measurements were found to be enough"
    beyond, said = int(np.sum(np.abs(residual) > hi)), []
    if count > MOST_POINTS:
        said.append("Of each run of neighbours the measurement with the largest residual and bar is drawn.")
    if not room.any():
        said.append(
            "The readings are taken as exact, so all residuals of the proved point lie in the band, up to the "
            "rounding of this drawing."
        )
    elif beyond:
        said.append(
            f"At {beyond:,} of {count:,} the centre of the reading set lies outside the band; some other reading "
            "in its set is within, as its bar shows by reaching it."
        )
    if not small:
        said.append(
            f"The bound rests on {len(leg.support.ids):,} measurements together: "
            "no few of them were found to be enough."
        )
    label = f"Leg {leg.leg}: residuals of the proved point over the measurements, and the band of eps_hi"
    return Drawing([residual_svg(data, label=label)], legend, " ".join(said))


def fit_error(campaign: Campaign, leg: LegResult, model: LegModel, found: Fitted) -> float:
    """The smallest eps at which the fit is a solution, to first order: what readings in their sets cannot explain."""
    room = reading_sensitivity(campaign, leg.leg, found.x, model)
    return max(0.0, float(np.max(np.abs(found.residuals) - np.nan_to_num(room))))


def reading_sensitivity(campaign: Campaign, leg: int, parameters: npt.ArrayLike, model: LegModel = PLAIN) -> Floats:
    """How far the residual of each measurement moves while its reading stays in its set, (N,) mm, to first order.

    With v = P + R b - a and b' = R b: `sum p_i |v_i|/|v| + sum r_j |(b' x (P - a))_j|/|v| + lambda`
    (DESIGN section 5); of other models by their derivatives. Plain floating point, for drawing; no proof rests on it.
    0 for exact readings.
    """
    if model.name != PLAIN.name:
        return reading_sensitivities(campaign, leg, parameters, model)
    x = np.asarray(parameters, np.float64)
    arm, base = rotation_matrix(campaign.quaternion) @ x[3:6], campaign.position - x[:3]
    vector = base + arm
    distance = np.linalg.norm(vector, axis=1)
    moved = np.sum(campaign.position_radius * np.abs(vector), axis=1)
    turned = np.sum(campaign.rotation_radius * np.abs(np.cross(arm, base)), axis=1)
    safe = np.where(distance > 0.0, distance, 1.0)
    return np.asarray((moved + turned) / safe + campaign.length_radius[:, leg - 1])


# ------------------------------------------------------------------------------------------------------------------
# Parameters in the frames of the robot's drawing, where a study found how camera and target stand in them.

DRAWING_FRAME = (
    "a: base joint centre, in the base frame of the robot's drawing; b: mobile joint centre, in its mobile frame; "
    "l: length offset. These frames are estimates of the study: certified values were moved by them, ranges are the "
    "hulls of the moved boxes."
)
_ROUNDING = 1e-9  # mm, more than moving a box in float64 can lose


@dataclass(frozen=True, eq=False)
class DrawingFrames:
    """Camera in the base frame and target in the mobile frame: rotations (3, 3) and positions (3,), mm."""

    camera: tuple[Floats, Floats]
    target: tuple[Floats, Floats]

    @classmethod
    def of(cls, record: CalibrationRecord) -> DrawingFrames:
        camera, target = (
            (rotation_matrix(np.array([frame.quaternion]))[0], np.array(frame.position))
            for frame in (record.frames.camera_in_base, record.frames.target_in_mobile)
        )
        return cls(camera, target)

    def point(self, x: Floats) -> Floats:
        """Parameters (n,); those of the model, after l, stay."""
        (turn, at), (other, there) = self.camera, self.target
        return np.concatenate([turn @ x[:3] + at, other @ x[3:6] + there, x[6:]])

    def box(self, lo: Floats, hi: Floats) -> tuple[Floats, Floats]:
        """A box that holds all parameters of the box `lo`, `hi` (n,)."""
        middle, half = self.point(0.5 * (lo + hi)), 0.5 * (hi - lo)
        (turn, _), (other, _) = self.camera, self.target
        radius = np.concatenate([np.abs(turn) @ half[:3], np.abs(other) @ half[3:6], half[6:]])
        return middle - radius - _ROUNDING, middle + radius + _ROUNDING


def frames_of_run(result: Result, record: CalibrationRecord, where: str) -> DrawingFrames:
    """The frames of the study that the run's campaign comes from.

    Raises InputError where the record is of another, and for a model whose own parameters depend on the frames.
    """
    if record.campaign_sha256 != result.campaign_sha256:
        what = "holds the frames of another study: the SHA-256 of its campaign differs"
        raise InputError([Problem(where, what, "name the folder that cpcal calibrate wrote with the run's campaign")])
    if result.model.name not in ("plain", "gain", "lateral"):
        what = f"has the model {result.model.name!r}, whose own parameters depend on the frames"
        raise InputError([Problem("run", what, "export it in the campaign's frames")])
    return DrawingFrames.of(record)


# ------------------------------------------------------------------------------------------------------------------
# What a page holds so that it can check itself: campaign, certificates, checker, script.

_CAMPAIGN = "campaign.json"
_MOST = 4_000_000  # characters; a page with more is too slow to open


def embedded(run: Path, result: Result, *, study: bool = False) -> Proof | None:
    """Of the folder of a run; None where it holds no certificate of the result, or more than a page should.

    The same files give the same text.
    """
    certificates = []
    for leg in result.legs:
        named = {"bracket": leg.bracket.certificate, "ranges": None if leg.ranges is None else leg.ranges.certificate}
        for kind, name in named.items():
            if name is not None and (run / name).is_file():
                content = _deflated((run / name).read_bytes())
                certificates.append({"leg": leg.leg, "kind": kind, "name": name, "deflated": content})
    if not certificates or not (run / _CAMPAIGN).is_file():
        return None
    campaign = (run / _CAMPAIGN).read_bytes()
    if hashlib.sha256(campaign).hexdigest() != result.campaign_sha256:
        return None
    data = json.dumps({"campaign": _deflated(campaign), "certificates": certificates}).replace("<", "\\u003c")
    if len(data) > _MOST:
        return None
    scripts = files("cpcal.report") / "browser"
    script = (scripts / "page.js").read_text(encoding="utf-8")
    checker = (scripts / "checker.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    compared = (
        "With the certificates: the verdict on all legs and on each, the tolerance, sentences on the error, brackets, "
        "certified parameters, ranges, enclosures and their widths, and the box; with the campaign in this page: its "
        "SHA-256 and the number of measurements. Under the pointer each says so. Not compared: figures, other prose, "
        "least squares, nominal values, other frames, what to look at and to do next"
        f"{', the tables of the study' * study}, and counts of the search. Whoever edits the scripts too is found by "
        "cpcal verify only."
    )
    return Proof(Markup(data), Markup(checker), Markup(script), f"'sha256-{digest}'", compared)


def _deflated(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()
