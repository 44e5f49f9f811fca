"""The page of a run: one self-contained HTML page from a campaign and its result, light and dark; it checks itself."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import shlex
import zlib
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from cpcal.common.errors import unusable
from cpcal.common.files import StrPath, write_file
from cpcal.common.numbers import (
    about,
    at_least,
    at_most,
    bracket_text,
    gap_text,
    nearest,
    rounded_down,
    rounded_up,
    short,
    stated,
)
from cpcal.common.values import ArrayPair
from cpcal.models import PLAIN, LegModel, model_residuals, reading_moves
from cpcal.questions import INFORMATION, LegResult, Result, model_of, recommendation, verdict_of
from cpcal.questions.result import check_campaign
from cpcal.report.figures import MOST_POINTS, errors_svg, residuals_svg
from cpcal.report.section import Drawing, Mark, Page, Proof, Section, Table, Words, origin, verdict
from cpcal.report.words import (
    LONGER,
    QUANTIFIER,
    Advice,
    Fitted,
    advise,
    assumptions,
    badge,
    claim,
    claimed_by,
    leg_lines,
    leg_sentence,
    notices,
    overall,
)
from cpcal.robot import Campaign
from cpcal.robot.mistakes import suspicions

REPORT_NAME = "report.html"
_HEAD = ("date", "operator", "serial")  # of the campaign's provenance, shown at the top of the page
_DECIMALS, _MORE = 4, 9  # of parameters in mm, of others, such as shares
_MOST_NAMES = 120  # measurements listed for a leg
_DRAWN = (
    "Dots: errors of the recommended parameters at the readings; bars: within the reading sets. A leg passes where "
    "every bar lies within the band, ± the tolerance (without one, ± their largest error). Diamonds: measure again."
)
_RANGES = (
    "Least squares, weighted by the stated deviations, or among the parameters that pass. Each range holds every value "
    "that the parameter can have if the model holds to within the number of mm that is named, for some readings; "
    "certified, but where it says otherwise. Lengths in mm, in the frames of the campaign."
)
_ROUNDED = (
    "eps_lo is printed rounded down and eps_hi rounded up: no parameters in the box do better than eps_lo, and some "
    "reach eps_hi."
)
_LONGEST = 100  # characters; longer values of the provenance stand in campaign.json only


def write_report(campaign: Campaign, result: Result, folder: StrPath, model: LegModel | None = None) -> Path:
    """Write the page to `report.html` in `folder`, all or nothing; both are made if missing. Its path.

    The same campaign and result give the same bytes. Bounds are printed rounded to the side on which they stay proved;
    every answer is for SOME reading in the set of each measurement. The page holds the certificates of the run that
    lie in the folder, and checks them in the browser. `model`: the result's leg model, where no installed
    package provides it. Raises InputError when it is not known, when the result is of another campaign, or when the
    file cannot be written.
    """
    page = render(campaign, result, model=model, run=folder)
    return write_file(Path(folder) / REPORT_NAME, page)


def render(
    campaign: Campaign,
    result: Result,
    study: Section | None = None,
    model: LegModel | None = None,
    run: StrPath | None = None,
) -> str:
    """The page as text; `study` is what `cpcal.report.study_page` shows before the legs, `run` is the folder of the run
    where the page is to check its certificates.

    Raises InputError when the result is of another campaign, or garbled.
    """
    remedy = "give the campaign that was certified, or certify this one"
    check_campaign(campaign, {"result": result.campaign.sha256}, remedy)
    if absent := [leg.leg for leg in result.legs if leg.leg > campaign.legs]:
        what, remedy = f"names a leg that is not there: {absent[0]}", f"certify again: legs are 1 to {campaign.legs}"
        raise unusable("result", what, remedy)
    kicker = "certified calibration" + ", some measurements may be wrong" * bool(result.options.outliers)
    above = [notices(result, campaign.legs), *(f"Look at the campaign first: {s}" for s in suspicions(campaign))]
    model = model_of(result, model)
    found = advice(campaign, result, model)
    proof = None if run is None or result.options.outliers else embedded(Path(run), result, study=study is not None)
    kicker += "".join(f" · {name} {campaign.provenance[name]}" for name in _HEAD if name in campaign.provenance)
    legs = [leg_section(campaign, result, leg, model, found[leg.leg]) for leg in result.legs]
    sections = [
        answer_section(result, found),
        *([] if study is None else [study]),
        *([outliers_section(result)] if result.options.outliers else []),
        Section(
            "Recommended parameters",
            parts=[parameters_section(campaign, result, leg) for leg in result.legs],
            notes=[_RANGES],
            name="parameters",
            style="parameters",
        ),
        Section("Measurement by measurement", [_DRAWN], parts=legs, name="legs", style="legs"),
        *_bounds(result),
        Section("What was assumed", data=assumptions(campaign, result), name="assumed"),
        _origin(campaign, result),
    ]
    title, lead = campaign.title, _lead(campaign, result)
    return Page(f"{title}: certified calibration", kicker, title, sections, above, lead, proof).text()


def advice(campaign: Campaign, result: Result, model: LegModel) -> dict[int, Advice]:
    """The cause and the next step of each leg, with its fit."""
    return {leg.leg: advise(campaign, result, leg, model) for leg in result.legs}


# ------------------------------------------------------------------------------------------------------------------
# What is said of all legs: the answer first, the proved bounds, how to read it, what it rests on.


def _lead(campaign: Campaign, result: Result) -> Words:
    tolerance, count = result.options.tolerance, claim(f"{len(campaign):,}", "count")
    what = (count, " measurements")
    if tolerance is None:
        return (*what, "; no tolerance was given, so nothing passes or fails" * (result.options.eps is None), ".")
    every = overall(result)
    of_all = every and verdict(every.word, f"big {every.kind}", claim="overall", value=tolerance.hex())
    return (of_all or "", " at a tolerance of ", claim(stated(tolerance), "tolerance", value=tolerance), " mm; ", *what)


def answer_section(result: Result, found: Mapping[int, Advice]) -> Section:
    """The first screen, and what a terminal prints: a line for each leg that passes, two for each other one."""
    if not result.legs:
        return Section(sentences=["No leg was finished."], name="answer")
    items = [leg_lines(result, leg, found[leg.leg]) for leg in result.legs]
    if result.options.outliers:
        return Section(items=items, name="answer", style="answers")
    legend = {
        "shade": "fails, proved",
        "bar": "open: fails or passes",
        "cross": "passes with the recommended parameters",
    }
    return Section(
        items=items,
        beside=[Drawing([errors_svg(result)], legend)],
        notes=[
            "Fails: no parameters meet the tolerance, whatever the readings are. Passes: the recommended parameters "
            "meet it for all readings within their stated uncertainty. Between the two the readings are too uncertain "
            "to say. Causes and next steps are estimates. cpcal export RUN writes the parameters for a controller."
        ],
        name="answer",
        style="answers",
    )


def bounds_table(result: Result) -> Table:
    """A row a leg. Bounds are rounded to the side on which they stay proved."""
    eps, some_wrong = result.options.eps, result.options.outliers
    rows = []
    for leg in result.legs:
        ends = leg.bracket.lo, leg.bracket.hi
        named = zip(bracket_text(*ends), ("eps_lo", "eps_hi"), ends, strict=True)
        bounds = [claim(text, side, leg, end) for text, side, end in named]
        rest = "yes" if leg.certified else "no", str(len(leg.support))
        if some_wrong:
            rest = ", ".join(leg.bracket.left_out) or "none", str(len(leg.bracket.proofs))
        rows.append((str(leg.leg), badge(result, leg), *(bounds if eps is None else [stated(eps)]), *rest))
    bounds_head = ("eps_lo [mm]", "eps_hi [mm]") if eps is None else ("eps asked [mm]",)
    rest = ("left out", "proofs") if some_wrong else ("certified", "support")
    return Table(("leg", "verdict", *bounds_head, *rest), rows, ("", "word", "", "", "word"))


def outliers_section(result: Result) -> Section:
    """The brackets when some measurements may be wrong, nobody knows which."""
    said = (
        f"Whichever {result.options.outliers} measurements of a leg are wrong, no parameters in the box explain the "
        "others better than eps_lo; some explain all but those left out to within eps_hi. Both bounds are proved. "
        "This page does not check them: cpcal verify RUN does."
    )
    return Section("Proved bounds", [said], tables=[bounds_table(result)], name="bounds")


def _bounds(result: Result) -> Iterator[Section]:
    if not result.legs or result.options.outliers:
        return
    formula = "‖P + R b − a‖ − (L + l) " if result.model.name == PLAIN.name else ""
    read = (
        f"Residuals {formula}are drawn at the centres of the reading sets, with first-order bars for the sets. The "
        "pointer on a residual shows its measurement."
    )
    bounds = Section(
        "Proved bounds, and how to read the figures",
        [Mark(f"{QUANTIFIER} {LONGER}", "quantifier"), read],
        tables=[bounds_table(result)],
        notes=[
            (f"{_ROUNDED} " if result.options.eps is None else "")
            + "“Support” counts measurements that the search found to give the lower bound or the refutation by "
            "themselves (where no few were found to, all with a weight in the proof).",
            INFORMATION,
        ],
        folded=True,
    )
    yield Section("For experts", parts=[bounds], name="bounds")


def _origin(campaign: Campaign, result: Result) -> Section:
    options = result.options
    widths = ", ".join(f"{name} = {width!r}" for name, width in options.half_widths.items())
    where = "CAMPAIGN: the folder of the campaign with the SHA-256 above"
    where += f", with the half-widths {widths} in its [model]" * bool(widths)
    data = {
        "Campaign, SHA-256": Mark(claim(result.campaign.sha256, "campaign"), "code"),
        "To repeat the run": (Mark(command(result), "command"), Mark(f"{where}. RUN: a new folder.", "small")),
    }
    if any(leg.certified for leg in result.legs):
        data["To check the proofs again"] = (
            Mark("cpcal verify RUN --campaign CAMPAIGN", "command"),
            Mark("Exact rational arithmetic, no solver.", "small"),
        )
    box = claim(str(options.delta), "box", value=options.delta)
    data["Asked"] = (f"relative gap {options.gap}, box ±", box, f" mm, center “{options.center}”")
    for name, words in campaign.provenance.items():
        if name not in _HEAD and len(words) <= _LONGEST:
            data[name.replace("_", " ")] = Mark(words, "free")
    return origin(data, f"Certified by cpcal {result.version}.")


def command(result: Result) -> str:
    """The `cpcal certify` command that asks the same again, for a shell; the two folders are placeholders."""
    return shlex.join(["cpcal", "certify", "CAMPAIGN", "-o", "RUN", *result.options.words()])


# ------------------------------------------------------------------------------------------------------------------
# One leg: its residuals, its parameters, and what stands behind them.


def leg_section(campaign: Campaign, result: Result, leg: LegResult, model: LegModel, found: Advice) -> Section:
    """Folded where it passes."""
    tolerance = result.options.tolerance
    drawn = residuals_drawing(campaign, leg, model, found.fit, tolerance=tolerance, wrong=found.wrong)
    said = [leg_sentence(result, leg)] if result.options.eps is not None or leg.not_certified else []
    word = "certified, not checked here" if leg.certified else "not certified"
    proof = Mark(word, "proof", data={"proof": str(leg.leg)})  # the page says there whether it accepts the certificates
    return Section(
        (f"Leg {leg.leg} ", badge(result, leg), " ", proof),
        said,
        figures=[drawn],
        parts=[_behind(campaign, result, leg, found.fit)],
        name=f"leg-{leg.leg}",
        folded=verdict_of(result, leg).passes,
    )


def parameters_section(campaign: Campaign, result: Result, leg: LegResult) -> Section:
    """A row a parameter: what to load, and its range; where none was computed, the enclosure of the optimum."""
    _, bounds, held = _range(result, leg)
    best, said = leg.recommended, []
    if math.isfinite(best.largest):
        known = claimed_by(best.certificate, at_most(best.largest), "recommended.largest", leg, best.largest)
        said = ["Off by ", known, " mm at most for all readings. "]
    if bounds is not None and not ((bounds[0] <= best.point) & (best.point <= bounds[1])).all():
        held = (*held, " Values to load that lie outside fail that at some measurement, whatever its readings are.")
    table = _table(campaign, result, leg, ("parameter", "load", "at least", "at most"), ("", "main"))
    return Section(f"Leg {leg.leg}: {recommendation(result, leg)}", [(*said, *held)], tables=[table])


def _table(
    campaign: Campaign,
    result: Result,
    leg: LegResult,
    head: Sequence[str],
    columns: Sequence[str] = (),
    fit: Fitted | None = None,
) -> Table:
    """A row a parameter, of what is known of it what `head` names."""
    (of, bounds, _), best, point = _range(result, leg), leg.recommended, leg.bracket.point
    nominal = [*campaign.robot.parameters[leg.leg - 1].tolist(), *(0.0 for _ in result.model.extra)]
    rows = []
    for k, name in enumerate(result.model.parameters):
        unit = result.model.unit(name)
        decimals, called = (_DECIMALS, name) if unit == "mm" else (_MORE, f"{name} [{unit}]")
        load = claimed_by(best.certificate, nearest(best.point[k], decimals), "recommended", leg, best.point[k], name)
        row = {"parameter": called, "nominal": nearest(nominal[k], decimals), "load": load}
        if fit is not None:
            row["fit"] = nearest(float(fit.x[k]), decimals)
        if point is not None:
            row["witness"] = claim(nearest(point[k], decimals), "point", leg, point[k], name)
        if bounds is not None:
            lo, hi = (float(end[k]) for end in bounds)
            row["at least"] = claim(rounded_down(lo, decimals), f"{of}.lo", leg, lo, name)
            row["at most"] = claim(rounded_up(hi, decimals), f"{of}.hi", leg, hi, name)
            row["width"] = claim(gap_text(lo, hi), f"{of}.width", leg, "", name)
        rows.append([row.get(column, "—") for column in head])
    return Table(head, rows, columns)


def _range(result: Result, leg: LegResult) -> tuple[str, ArrayPair | None, tuple[Words, ...]]:
    """Which bounds of the parameters are proved, lower and upper ones, and under which condition, in words."""
    enclosure, eps = leg.bracket.enclosure, result.options.eps
    if leg.ranges is not None:
        at = leg.ranges.eps  # rounded down, where it was not given: what holds to within eps, holds to within less
        text = stated(at) if at in (eps, result.options.tolerance) else at_least(at)
        within = claim(text, "ranges.eps", leg, at)
        open_ = " (no certificate holds it)" * (leg.ranges.certificate is None)
        held = ("Ranges if the model holds to within ", within, f" mm{open_}.")
        return "ranges", (leg.ranges.box.lo, leg.ranges.box.hi), held
    if enclosure.is_empty:
        return "", None, ("No parameters in the box satisfy the equations, so there is nothing to enclose.",)
    where = "eps_hi" if eps is None else f"eps = {stated(eps)} mm"
    return (
        "enclosure",
        (enclosure.lo, enclosure.hi),
        (f"No ranges were computed: the best parameters, if the model holds to within {where}.",),
    )


def _behind(campaign: Campaign, result: Result, leg: LegResult, fit: Fitted) -> Section:
    """The witness of eps_hi, other parameters, and what the search did: for experts."""
    work, support = leg.work, set(leg.support)
    names = [f"{k} ({name})" for k, name in enumerate(campaign.measurement_ids, 1) if name in support]
    said: list[Words] = [
        f"{leg_sentence(result, leg)} The witness reaches eps_hi; it is no recommendation. Width: of the range.",
        f"Searched: {work.nodes:,} boxes, {work.programs:,} linear programs, {about(work.seconds)} s.",
    ]
    if names:
        more = f", and {len(names) - _MOST_NAMES:,} more in result.json" if len(names) > _MOST_NAMES else ""
        listed = f"{', '.join(names[:_MOST_NAMES])}{more}"
        said.append(Mark(f"Support, {len(names)} measurements that were found to be enough: {listed}.", "names"))
    return Section(
        f"Leg {leg.leg} for experts",
        said,
        tables=[_table(campaign, result, leg, ("parameter", "witness", "fit", "nominal", "width"), fit=fit)],
        folded=True,
    )


def residuals_drawing(
    campaign: Campaign,
    leg: LegResult,
    model: LegModel = PLAIN,
    fit: Fitted | None = None,
    *,
    tolerance: float | None = None,
    wrong: Sequence[int] = (),
) -> Drawing:
    """The residuals of the recommended parameters, with bars for their reading sets, and the band of the tolerance;
    without a tolerance that of their error."""
    best, at = leg.recommended, leg.recommended.point
    count = len(campaign)
    residual, room = model_residuals(campaign, leg.leg, at, model), reading_moves(campaign, leg.leg, at).sum(axis=1)
    least = best.largest
    band = tolerance or (least if 0.0 < least < math.inf else float(np.nanmax(np.abs(residual) + room)))
    fits = np.full(count, np.nan) if fit is None or best.why == "least squares" else fit.residuals
    said = "Of each run of neighbours the worst measurement is drawn." if count > MOST_POINTS else ""
    label = f"Leg {leg.leg}: residuals over the measurements, and the band that they must be within"
    names = [f"{k} ({name})" for k, name in enumerate(campaign.measurement_ids, 1)]
    figure = residuals_svg(residual, room, fits, (-band, band), np.isin(np.arange(count), wrong), names, label)
    return Drawing([figure], caption=said)


# ------------------------------------------------------------------------------------------------------------------
# Several models compared: a table for terminal and page, a line a leg, a page beside those of the models' runs.

COMPARISON_PAGE = "compare.html"


Compared = Mapping[str, Result]  # of one campaign, by the leg model; what was asked is the same in all


def passing(found: Compared) -> dict[int, list[str]]:
    """The models that pass for each leg."""
    good: dict[int, list[str]] = {leg.leg: [] for result in found.values() for leg in result.legs}
    for model, result in found.items():
        for leg in result.legs:
            good[leg.leg] += [model] * verdict_of(result, leg).passes
    return dict(sorted(good.items()))


def comparison_section(found: Compared) -> Section:
    """A line a leg: what each model reaches, and at a tolerance the first model that passes. The proved bounds, with a
    row a leg and model, are a part of it; they are rounded to the side on which they stay proved."""
    items, rows = [], []
    at = next(iter(found.values())).options.tolerance
    for number, good in passing(found).items():
        each = []
        for model, result in found.items():
            for leg in (leg for leg in result.legs if leg.leg == number):
                bracket, judged, ranges = leg.bracket, verdict_of(result, leg), []
                reached = at_most(bracket.hi) if math.isfinite(bracket.hi) else f"above {at_least(bracket.lo)}"
                each.append(f"{model} {reached}" + f" {judged.word}" * (at is not None))
                for name in () if bracket.enclosure.is_empty else result.model.parameters[7:]:
                    side = bracket.enclosure[name]
                    ranges.append(f"{name} in [{', '.join(map(short, bracket_text(side.lo, side.hi)))}]")
                ends, word = bracket_text(bracket.lo, bracket.hi), verdict(judged.word, judged.kind)
                file = bracket.certificate or "none"
                rows.append((f"leg {number}", model, *ends, word, file, ", ".join(ranges)))
        step = f"accept {good[0]}" if good else "no model passes"
        items.append(f"leg {number}: {', '.join(each)}" + f"; next: {step}" * (at is not None))
    asked = "verdict" if at is None else f"at {stated(at)} mm"
    head = ("of", "model", "eps_lo [mm]", "eps_hi [mm]", asked, "certificate", "extra parameters")
    bounds = Section(
        sentences=[Mark(f"{QUANTIFIER} {LONGER}", "quantifier")],
        tables=[Table(head, rows, ("", "word", "", "", "word", "word", "word"), "compared")],
        notes=[
            f"{_ROUNDED} Without a certificate both are proved in outward-rounded arithmetic only. Extra "
            "parameters: all parameters with eps ≤ eps_hi lie there."
        ],
    )
    return Section("Smallest error of each model, mm", items=items, parts=[bounds], style="names")


def write_comparison(found: Compared, folder: StrPath, *, stopped: bool = False, title: str | None = None) -> Path:
    """Write `compare.html`, headed by the campaign's title, beside the runs of the models; its path. The same results
    give the same bytes."""
    first = next(iter(found.values()))
    at, heading = first.options.tolerance, title or first.campaign.robot
    models = Section(
        "The models",
        data={
            name: Mark(f"The length of a leg is {result.model.summary}.", "names", link=f"{quote(name)}/{REPORT_NAME}")
            for name, result in found.items()
        },
        notes=[
            "All models look for (a, b, l) in the same box, and contain the plain one where their extra parameters "
            "vanish: none has a larger smallest eps than the plain one.",
            *(result.model.not_compared for result in found.values()),
        ],
    )
    about = "FOLDER: where this page is. It holds a run of each model, with its certificates and a page of its own."
    rests = {
        "Campaign, SHA-256": Mark(first.campaign.sha256, "code"),
        "To check the proofs again": (Mark("cpcal verify FOLDER --campaign CAMPAIGN", "command"), Mark(about, "small")),
    }
    page = Page(
        f"{heading}: models compared",
        "models compared",
        heading,
        [comparison_section(found), models, origin(rests)],
        ["Interrupted: what is shown was proved until then; the rest is missing."] if stopped else [],
        "" if at is None else f"Which models do the measurements refute at {stated(at)} mm?",
    )
    return page.write(Path(folder) / COMPARISON_PAGE)


# ------------------------------------------------------------------------------------------------------------------
# What a page holds so that it can check itself: campaign, certificates, checker, script.

_CAMPAIGN = "campaign.json"
_MOST = 4_000_000  # characters; a page with more is too slow to open


def embedded(run: Path, result: Result, *, study: bool) -> Proof | None:
    """Of the folder of a run; None where it holds no certificate of the result, or more than a page should.

    The same files give the same text.
    """
    certificates = []
    for leg in result.legs:
        best, passes, reduced = leg.recommended, leg.passes_from, leg.reduced
        claims = {"bracket": leg.bracket, "ranges": leg.ranges, "recommended": best}
        for kind, of in (claims | {"passes": passes, "reduced": reduced}).items():
            name = of and of.certificate
            if name and (run / name).is_file():
                content = (run / name).read_bytes()
                certificates.append({"leg": leg.leg, "kind": kind, "name": name, "deflated": content})
    if not certificates or not (run / _CAMPAIGN).is_file():
        return None
    campaign = (run / _CAMPAIGN).read_bytes()
    if hashlib.sha256(campaign).hexdigest() != result.campaign.sha256:
        return None
    stated = {"campaign": campaign, "certificates": certificates}
    data = json.dumps(stated, default=lambda content: base64.b64encode(zlib.compress(content)).decode())
    data = data.replace("<", "\\u003c")
    if len(data) > _MOST:
        return None
    scripts = files("cpcal.report") / "browser"
    script, checker = ((scripts / name).read_text(encoding="utf-8") for name in ("page.js", "checker.js"))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    compared = (
        "With the certificates: the verdict on all legs and on each, the tolerance, thresholds, brackets, "
        "certified parameters, ranges, enclosures and their widths, and the box; with the campaign in this page: its "
        "SHA-256 and the number of measurements. Under the pointer each says so. Not compared: figures, other prose, "
        "least squares, nominal values, what to look at and to do next"
        f"{', the tables of the study' * study}, and counts of the search. Whoever edits the scripts too is found by "
        "cpcal verify only."
    )
    return Proof(Markup(data), Markup(checker), Markup(script), f"'sha256-{digest}'", compared)
