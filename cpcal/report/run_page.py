"""The page of a run: one self-contained HTML page from a campaign and its result, light and dark; it checks itself."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import os
import shlex
import zlib
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from cpcal.common.errors import InputError, PluginError, printable, unusable
from cpcal.common.files import write_file
from cpcal.common.numbers import about, bracket_text, nearest, plain_gap, rounded_down, rounded_up, stated
from cpcal.common.values import Floats
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import REPORT_NAME
from cpcal.models import PARAMETERS, PLAIN, LegModel, model_residuals, reading_sensitivities
from cpcal.questions import INFORMATION, LegResult, Ranges, Result, contractors_sentences, model_of, verdict_of
from cpcal.report.figures import FARTHEST, MOST_POINTS, Bar, bars_svg, errors_svg, pair_svg, residuals_svg
from cpcal.report.section import Drawing, Mark, Page, Proof, Section, Table, Words, origin, verdict
from cpcal.report.words import (
    FEW,
    LONGER,
    QUANTIFIER,
    Fitted,
    advise,
    assumptions,
    center_sentence,
    fitted,
    leg_sentence,
    measurement_names,
    notices,
    overall,
    support_numbers,
)
from cpcal.robot import Campaign, rotation_matrix
from cpcal.robot.mistakes import suspicions
from cpcal.solver.accounts import TimeoutAnswer, Trial
from cpcal.solver.contract import Verdict

_HEAD = ("date", "operator", "serial")  # of the campaign's provenance, shown at the top of the page
_DECIMALS, _MORE = 4, 9  # of parameters in mm, of others, such as shares
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
) -> str:
    """The page as text; `study` is what `cpcal.report.study_page` shows before the legs, `run` is the folder of the run
    where the page is to check its certificates.

    Raises InputError when the result is of another campaign, or garbled.
    """
    sha256, absent = campaign_sha256(campaign), [leg.leg for leg in result.legs if leg.leg > campaign.legs]
    if result.campaign.sha256 != sha256:
        what = f"is of another campaign (sha256 {printable(str(result.campaign.sha256))}, not {sha256})"
        raise unusable("result", what, "give the campaign that was certified, or certify this one")
    if absent:
        what, remedy = f"names a leg that is not there: {absent[0]}", f"certify again: legs are 1 to {campaign.legs}"
        raise unusable("result", what, remedy)
    robot, kicker, proof = campaign.robot.name, "certified calibration", None
    above = [notices(result, campaign.legs) or "", *(f"Look at the campaign first: {s}" for s in suspicions(campaign))]
    lead: Words = ""
    if result.options.outliers:
        kicker += ", some measurements may be wrong"
        sections = [outliers_section(result)]
    else:
        lacking = ""
        try:
            model = model_of(result, model)
        except (InputError, PluginError):
            if model is not None:
                raise
            lacking = (
                f"the leg model {result.model.name!r} is not known here; install the package that provides it and "
                "write the page again with `cpcal report`"
            )
        fits = {leg.leg: fitted(campaign, result, leg, model) for leg in result.legs if model is not None}
        proof = None if run is None else embedded(Path(run), result, study=study is not None)
        legs = [leg_section(campaign, result, leg, model, fits.get(leg.leg), lacking) for leg in result.legs]
        kicker += "".join(f" · {name} {campaign.provenance[name]}" for name in _HEAD if name in campaign.provenance)
        lead, study_too = _lead(campaign, result), [] if study is None else [study]
        sections = [_answer(campaign, result, model, fits), *study_too, *legs, *_bounds(result)]
    sections += [Section("What was assumed", data=assumptions(campaign, result), name="assumed")]
    sections += [_origin(campaign, result)]
    return Page(f"Certified calibration: {robot}", kicker, robot, sections, above, lead, proof).text()


# ------------------------------------------------------------------------------------------------------------------
# What is said of all legs: the answer first, the proved bounds, how to read it, what it rests on.


def claim(
    words: Words, what: str, leg: LegResult | None = None, value: float | str | None = None, parameter: str = ""
) -> Mark:
    """Words that state what a certificate claims, exactly `value`: the page compares them."""
    data = {} if leg is None else {"leg": str(leg.leg)}
    data["claim"] = what
    if parameter:
        data["parameter"] = parameter
    if value is not None:
        data["value"] = value.hex() if isinstance(value, float) else value
    return Mark(words, data=data)


def bracket_words(leg: LegResult) -> tuple[Mark, Mark]:
    """eps_lo rounded down and eps_hi rounded up, as claims."""
    lo, hi = leg.bracket.lo, leg.bracket.hi
    down, up = bracket_text(lo, hi)
    return claim(down, "eps_lo", leg, lo), claim(up, "eps_hi", leg, hi)


def badge(result: Result, leg: LegResult) -> Mark:
    found = verdict_of(result, leg)
    return verdict(found.word, found.kind, leg=str(leg.leg), claim="verdict", value=_tolerance(result))


def _tolerance(result: Result) -> str:
    return "" if result.options.tolerance is None else result.options.tolerance.hex()


def _proof(leg: LegResult) -> Mark:
    """Where a page that checks itself says whether it accepts the leg's certificates."""
    word = "certified, not checked here" if leg.certified else "not certified"
    return Mark(word, "proof", data={"proof": str(leg.leg)})


def _lead(campaign: Campaign, result: Result) -> Words:
    tolerance, count = result.options.tolerance, claim(f"{len(campaign):,}", "count")
    if tolerance is not None:
        every = overall(result)
        of_all = every and verdict(every.word, f"big {every.kind}", claim="overall", value=tolerance.hex())
        within = claim(stated(tolerance), "tolerance", value=tolerance)
        return (of_all or "", " Do all ", count, " measurements fit to within the tolerance of ", within, " mm?")
    if result.options.eps is not None:
        return ("Do all ", count, f" measurements fit to within eps = {stated(result.options.eps)} mm?")
    rest = f" measurement{'' if len(campaign) == 1 else 's'}? No tolerance was given, so nothing passes or fails."
    return ("How well do the legs fit ", count, rest)


def _answer(campaign: Campaign, result: Result, model: LegModel | None, fits: dict[int, Fitted]) -> Section:
    if not result.legs:
        return Section(sentences=["No leg was finished."], name="answer")
    items, errors = [], {}
    for leg in result.legs:
        fit = fits.get(leg.leg)
        found = advise(campaign, result, leg, model, fit)
        look = f" Look first at {', '.join(measurement_names(campaign, found.first))}." if found.first else ""
        words: Words = (
            badge(result, leg),
            " ",
            claim(verdict_of(result, leg).sentence, "verdict", leg, _tolerance(result)),
            Mark((look, " ", Mark("Next:", "next"), f" {found.sentence} "), "look"),
            _proof(leg),
        )
        items.append((Mark(f"Leg {leg.leg}", "leg", f"#leg-{leg.leg}"), Mark(words, "sentence")))
        if fit is not None and model is not None:
            # the smallest eps at which the fit is a solution, to first order
            room = np.nan_to_num(reading_sensitivity(campaign, leg.leg, fit.x, model))
            errors[leg.leg] = max(0.0, float(np.max(np.abs(fit.residuals) - room)))
    legend = {
        "shade": "proved impossible",
        "bar": "smallest error, between two proved bounds",
        "cross": "error of least squares",
    }
    return Section(
        items=items,
        beside=[Drawing([errors_svg(result, errors)], legend)],
        notes=[
            "Measurements are counted from 1. What to look at, what to do next and whether parameters are undetermined "
            "are estimates; the bounds are proved. cpcal export RUN writes the parameters, with all digits, for a "
            "controller."
        ],
        name="answer",
        style="answers",
    )


def bounds_table(result: Result) -> Table:
    """A row a leg. Bounds are rounded to the side on which they stay proved."""
    eps = result.options.eps
    rows: list[tuple[Words, ...]] = []
    for leg in result.legs:
        bounds = bracket_words(leg) if eps is None else (stated(eps),)
        certified, support = "yes" if leg.certified else "no", str(len(leg.support.ids))
        rows.append((str(leg.leg), badge(result, leg), *bounds, certified, support))
    bounds_head = ("eps_lo [mm]", "eps_hi [mm]") if eps is None else ("eps asked [mm]",)
    return Table(("leg", "verdict", *bounds_head, "certified", "support"), rows, ("", "word"))


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
    formula = "‖P + R b − a‖ − (L + l) " if result.model.name == PLAIN.name else ""
    rounding = (
        "eps_lo is printed rounded down and eps_hi rounded up: no parameters in the box do better than eps_lo, and "
        "some reach eps_hi. "
    )
    read = [
        f"Residuals {formula}are drawn at the centres of the reading sets. Where a centre lies outside the band, "
        "that is no contradiction: some reading in its set is within it. The bars of sensitivity are first-order "
        "estimates. The pointer on a residual shows its measurement.",
        "Least squares makes the sum of squared errors small, not the largest error: its fit need not be a "
        "solution, nor lie in the ranges.",
        "A polygon much smaller than its rectangle means that the measurements tie the two parameters to each "
        "other. Every side was derived by a linear program whose answer is bounded in outward-rounded arithmetic; no "
        "certificate repeats that. The solutions may fill less than a polygon. Marks off a panel are not drawn.",
    ]
    yield Section(
        "Proved bounds",
        [Mark(f"{QUANTIFIER} {LONGER}", "quantifier")],
        tables=[bounds_table(result)],
        notes=[
            (rounding if result.options.eps is None else "")
            + "“Support” counts measurements that the search found to give the lower bound or the refutation by "
            "themselves (where no few were found to, all with a weight in the proof).",
            INFORMATION,
        ],
        parts=[Section("How to read the figures", read, folded=True)],
        name="bounds",
    )


def _origin(campaign: Campaign, result: Result) -> Section:
    options = result.options
    certificates = list(filter(None, (leg.bracket.certificate for leg in result.legs)))
    data: dict[str, Words] = {
        "Campaign, SHA-256": Mark(claim(result.campaign.sha256, "campaign"), "code"),
        "To repeat the run": (
            Mark(command(result), "command"),
            Mark("CAMPAIGN: the folder of the campaign with the SHA-256 above. RUN: a new folder.", "small"),
        ),
    }
    if certificates:
        data["To check the proofs again"] = (
            Mark("cpcal verify RUN --campaign CAMPAIGN", "command"),
            Mark(f"Exact rational arithmetic, no solver: {', '.join(certificates)}.", "small"),
        )
    box = claim(str(options.delta), "box", value=options.delta)
    data["Asked"] = (f"relative gap {options.gap}, box ±", box, f" mm, center “{options.center}”")
    data |= {k.replace("_", " "): Mark(v, "free") for k, v in campaign.provenance.items() if k not in _HEAD}
    return origin(data, f"Certified by cpcal {result.version}.")


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
    lacking: str = "",
) -> Section:
    """`model`: None where it is not known here; then nothing is said of residuals, but why (`lacking`)."""
    drawn = None if model is None else residuals_drawing(campaign, leg, model, fit)
    said = leg_sentence(result, leg).removeprefix(verdict_of(result, leg).sentence).lstrip()
    if drawn is None and lacking and leg.bracket.point is not None:
        said += f" The residuals of the proved point are not drawn: {lacking}."
    elif drawn is None:
        said += " There is no proved point whose residuals could be drawn."
    return Section(
        (f"Leg {leg.leg} ", badge(result, leg), " ", _proof(leg)),
        [said],
        figures=[] if drawn is None else [drawn],
        parts=[parameters_section(campaign, result, leg, fit), _behind(campaign, result, leg)],
        name=f"leg-{leg.leg}",
        style="leg-section",
    )


def parameters_section(campaign: Campaign, result: Result, leg: LegResult, fit: Fitted | None) -> Section:
    """A row a parameter: its range and the width of that, the certified point, the fit, the nominal value.

    Where no ranges were computed, the enclosure of the optimum stands in their place.
    """
    at: tuple[Words, ...] = ()
    enclosure, eps = leg.bracket.enclosure, result.options.eps
    if leg.ranges is not None:
        of, box, name = "ranges", leg.ranges.box, leg.ranges.certificate
        within = claim(eps_text(result, leg.ranges.eps), "ranges.eps", leg, leg.ranges.eps)
        at = ("; ranges at eps = ", within, " mm")
        certified = "no certificate holds it" if name is None else f"certified by {name}"
        more = 0.0 < leg.bracket.hi < leg.ranges.eps
        times = f" ({about(leg.ranges.eps / leg.bracket.hi)} times eps_hi)" if more else ""
        said: Words = (
            "The range holds every solution in the box with eps ≤ ",
            within,
            f" mm{times}; {certified}. So well do the measurements determine the parameter.",
        )
    elif enclosure.is_empty:
        of, box, said = "", None, "No parameters in the box satisfy the equations, so there is nothing to enclose."
    else:
        of, box, where = "enclosure", enclosure, "eps_hi" if eps is None else f"eps = {stated(eps)} mm"
        said = (
            f"No ranges were computed. “At least” and “at most” enclose every solution in the box at {where}: how "
            "sharply the optimum is known, no accuracy of the parameters."
        )
    nominal = [*campaign.robot.parameters[leg.leg - 1].tolist(), *(0.0 for _ in result.model.extra)]
    point, rows = leg.bracket.point, list[tuple[Words, ...]]()
    for k, name in enumerate(result.model.parameters):
        unit = result.model.unit(name)
        decimals = _DECIMALS if unit == "mm" else _MORE
        cells: list[Words] = [name if unit == "mm" else f"{name} [{unit}]"]
        lo, hi = (math.nan, math.nan) if box is None else (float(box.lo[k]), float(box.hi[k]))
        ends: tuple[float | str, ...] = lo, hi, ""
        for text, side, end in zip(outward(lo, hi, decimals), ("lo", "hi", "width"), ends, strict=True):
            cells.append(_UNKNOWN if box is None else claim(text, f"{of}.{side}", leg, end, name))
        cells.append(_UNKNOWN if point is None else claim(nearest(point[k], decimals), "point", leg, point[k], name))
        least = math.nan if fit is None else float(fit.x[k])
        rows.append((*cells, nearest(least, decimals), nearest(nominal[k], decimals)))
    head = ("parameter", "at least", "at most", "width", "certified", "least squares", "nominal")
    other = "" if result.model.name == PLAIN.name else ", but where another unit is given"
    return Section(
        (f"Parameters [mm{other}]", *at),
        tables=[Table(head, rows, ("", "main", "main"))],
        notes=[said],
        beside=[parameters_drawing(campaign, leg, fit)],
    )


def outward(lo: float, hi: float, decimals: int) -> tuple[str, str, str]:
    """Bounds and their distance."""
    return rounded_down(lo, decimals), rounded_up(hi, decimals), plain_gap(lo, hi)


def eps_text(result: Result, eps: float) -> str:
    """An eps that the user gave as it was given; another one rounded down: what holds to within eps, holds to within
    less."""
    return stated(eps) if eps in (result.options.eps, result.options.tolerance) else bracket_text(eps, eps)[0]


def parameters_drawing(campaign: Campaign, leg: LegResult, fit: Fitted | None = None) -> Drawing:
    """The ranges, or where there are none the enclosure, less the nominal values, with the fit."""
    box, what = (leg.bracket.enclosure, "enclosure") if leg.ranges is None else (leg.ranges.box, "range")
    bars = []
    for k, (name, nominal) in enumerate(zip(PARAMETERS, campaign.robot.parameters[leg.leg - 1].tolist(), strict=True)):
        lo, hi = float(box.lo[k]), float(box.hi[k])
        estimate = math.nan if fit is None else float(fit.x[k]) - nominal
        bars.append(Bar(name, lo - nominal, hi - nominal, estimate, "none" if box.is_empty else plain_gap(lo, hi)))
    label = f"Leg {leg.leg}: {what} of each parameter, relative to its nominal value"
    svg = bars_svg(bars, "parameter − nominal value [mm]", label, words=(math.inf, "width [mm]"))
    legend = {} if box.is_empty else {"bar": f"{what}, between two ticks"}
    legend |= {"nominal": "nominal value"} | ({} if fit is None else {"cross": "least-squares fit"})
    said = "There are no bars: no parameters in the box satisfy the equations." if box.is_empty else ""
    if any(max(abs(bar.lo), abs(bar.hi)) > FARTHEST for bar in bars):
        said = "Arrows: the bound in that direction is too far away to be drawn, or there is none."
    return Drawing([svg], legend, said, "fits")


def _behind(campaign: Campaign, result: Result, leg: LegResult) -> Section:
    """What the search did: for experts."""
    work, names = leg.work, measurement_names(campaign, support_numbers(campaign, leg))
    said: list[Words] = [f"Searched: {work.nodes:,} boxes, {work.programs:,} linear programs, {about(work.seconds)} s."]
    if center := center_sentence(result, leg):
        said.append(f"{center} (No certificate holds this about the center.)")
    if names:
        more = f", and {len(names) - _MOST_NAMES:,} more in result.json" if len(names) > _MOST_NAMES else ""
        listed = f"{', '.join(names[:_MOST_NAMES])}{more}"
        said.append(Mark(f"Support, {len(names)} measurements that were found to be enough: {listed}.", "names"))
    head = ("eps asked [mm]", "delay [s]", "answer", "eps_lo then", "eps_hi then", "nodes")
    return Section(
        "For experts: two parameters at a time, contractors, support, calls of the solver",
        said,
        contractors_sentences(leg),
        figures=[] if leg.ranges is None or not leg.ranges.projections else [_pairs(campaign, result, leg, leg.ranges)],
        tables=[Table(head, [trial_row(leg, trial) for trial in work.trials], ("", "", "word"))] * bool(work.trials),
        folded=True,
    )


def trial_row(leg: LegResult, trial: Trial) -> tuple[str, ...]:
    """A call of the solver; its bounds have the digits of the leg's own, which end the table."""
    asked, lo = (bracket_text(value, leg.bracket.hi)[0] for value in (trial.eps, trial.lo))
    hi = bracket_text(leg.bracket.lo, trial.hi)[1]
    unchecked = trial.answer is TimeoutAnswer.INFEASIBLE and not trial.checked
    answer = "infeasible, unchecked" if unchecked else trial.answer.value
    return (asked, about(trial.delay), answer, lo, hi, str(trial.nodes))


def _pairs(campaign: Campaign, result: Result, leg: LegResult, ranges: Ranges) -> Drawing:
    """Polygons that hold all solutions."""
    box, figures = ranges.box, []
    point = None if leg.bracket.point is None else np.array(leg.bracket.point)
    fit = np.array(leg.bracket.center) if result.options.center == "fit" else None
    marked = campaign.robot.parameters[leg.leg - 1], fit, point
    for pair in ranges.projections:
        k = [PARAMETERS.index(name) for name in pair.parameters]
        widths = " by ".join(plain_gap(float(box.lo[i]), float(box.hi[i])) for i in k)
        label = f"Leg {leg.leg}: polygon that holds {' and '.join(pair.parameters)}, in a rectangle of {widths} mm"
        points = [None if x is None else x[k] for x in marked]
        figures.append(pair_svg(pair.parameters, box.lo[k], box.hi[k], pair.half_planes, points, label))
    legend = {
        "polygon": "all solutions lie in here",
        "rectangle": "bounds of each parameter alone",
        "dot": "proved point",
        "cross": "least-squares fit",
        "square": "nominal value",
    }
    caption = (
        "Two parameters at a time: all parameters in the box that satisfy the equations to within "
        f"eps = {eps_text(result, ranges.eps)} mm, for some readings. "
        f"Δ counts from {'the middle of the bounds' if point is None else 'the proved point'}."
    )
    return Drawing(figures, legend, caption)


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
    legend: dict[str, Words] = {"dot": "residual of the proved point"}
    if fit is not None:
        legend["cross"] = f"of least squares, {about(fit.largest)} mm at most"
    if room.any():
        legend["room"] = "sensitivity to the reading set"
    legend["band"] = ("±eps_hi = ±", bracket_words(leg)[1], " mm")
    if support.any():
        legend["support"] = "support: these measurements were found to be enough"
    beyond = int(np.sum(np.abs(residual) > hi))
    said = [
        "Of each run of neighbours the measurement with the largest residual and bar is drawn." * (count > MOST_POINTS),
        "The readings are taken as exact." * (not room.any()),
        f"At {beyond:,} of {count:,} the centre of the reading set lies outside the band; some other reading in its "
        "set is within." * bool(room.any() and beyond),
        f"The bound rests on {len(leg.support.ids):,} measurements together." * (not small),
    ]
    label = f"Leg {leg.leg}: residuals of the proved point over the measurements, and the band of eps_hi"
    svg = residuals_svg(residual, room, fits, hi, support, measurement_names(campaign, range(count)), label)
    return Drawing([svg], legend, " ".join(filter(None, said)))


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
    if hashlib.sha256(campaign).hexdigest() != result.campaign.sha256:
        return None
    data = json.dumps({"campaign": _deflated(campaign), "certificates": certificates}).replace("<", "\\u003c")
    if len(data) > _MOST:
        return None
    scripts = files("cpcal.report") / "browser"
    script, checker = ((scripts / name).read_text(encoding="utf-8") for name in ("page.js", "checker.js"))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    compared = (
        "With the certificates: the verdict on all legs and on each, the tolerance, sentences on the error, brackets, "
        "certified parameters, ranges, enclosures and their widths, and the box; with the campaign in this page: its "
        "SHA-256 and the number of measurements. Under the pointer each says so. Not compared: figures, other prose, "
        "least squares, nominal values, what to look at and to do next"
        f"{', the tables of the study' * study}, and counts of the search. Whoever edits the scripts too is found by "
        "cpcal verify only."
    )
    return Proof(Markup(data), Markup(checker), Markup(script), f"'sha256-{digest}'", compared)


def _deflated(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()
