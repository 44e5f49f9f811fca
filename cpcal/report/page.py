"""One self-contained HTML page from a campaign and its result: no network, no script, light and dark."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, PluginError
from cpcal.common.numbers import about, bracket_text, nearest, rounded_down, rounded_up, stated
from cpcal.legs import PARAMETERS, PLAIN, LegModel, model_residuals
from cpcal.report.assumptions import assumptions
from cpcal.report.bars import Enclosure, enclosure_svg
from cpcal.report.match import check_match
from cpcal.report.origin import command, versions
from cpcal.report.pairs import pairs
from cpcal.report.plot import MOST_POINTS, Residuals, residual_svg
from cpcal.report.sensitivity import reading_sensitivity
from cpcal.report.table import result_table
from cpcal.report.template import rendered
from cpcal.report.words import LONGER, QUANTIFIER, center_sentence, leg_sentence, missing_legs, summary
from cpcal.results import INFORMATION, LegResult, Result, contractors_sentences, model_of, verdict_of
from cpcal.robot import Campaign
from cpcal.robot.suspicions import suspicions
from cpcal.solver.optimize import Answer, Trial

REPORT_NAME = "report.html"

_DECIMALS = 6  # of parameters, mm
_MOST_NAMES = 120  # measurement ids listed for a leg


def write_report(
    campaign: Campaign, result: Result, folder: str | os.PathLike[str], model: LegModel | None = None
) -> Path:
    """`write_page` to `report.html` in `folder`, made if missing; its path."""
    return write_page(campaign, result, Path(folder) / REPORT_NAME, model)


def write_page(campaign: Campaign, result: Result, file: str | os.PathLike[str], model: LegModel | None = None) -> Path:
    """Write the page to `file`, all or nothing, in a folder that is made if missing; its path.

    The same campaign and result give the same bytes. Bounds are printed rounded to the side on which they
    stay proved; every answer is for SOME reading in the set of each measurement. Raises InputError when the
    result is of another campaign, or when the file cannot be written. `model`: the result's leg model, where no
    installed package provides it; without it the page says which figures it lacks.
    """
    return write_file(file, render(campaign, result, model=model))


def render(
    campaign: Campaign, result: Result, study: dict[str, Any] | None = None, model: LegModel | None = None
) -> str:
    """The page as text; `study` is what study.html.j2 shows before the legs (see `cpcal.report.study`).

    Raises InputError when the result is of another campaign, or garbled.
    """
    check_match(campaign, result)
    return rendered("report.html.j2", {"study": study, **_context(campaign, result, model)})


def _context(campaign: Campaign, result: Result, model: LegModel | None) -> dict[str, Any]:
    table = result_table(result)
    model, lacking = _known(result, model)
    return {
        "robot": campaign.robot.name,
        "count": len(campaign),
        "result": result,
        "tolerance": None if result.options.tolerance is None else stated(result.options.tolerance),
        "summary": summary(result),
        "asked": None if result.options.eps is None else stated(result.options.eps),
        "interrupted": missing_legs(result, campaign.legs),
        "table": table,
        "legs": [_leg(campaign, result, leg, model) for leg in result.legs],
        "quantifier": QUANTIFIER,
        "longer": LONGER,
        "lacking": lacking,
        "plain": result.model.name == PLAIN.name,
        "suspicions": suspicions(campaign),
        "information": INFORMATION,
        "assumptions": assumptions(campaign, result),
        "provenance": campaign.provenance,
        "versions": versions(),
        "command": command(result),
    }


def _known(result: Result, model: LegModel | None) -> tuple[LegModel | None, str | None]:
    """The leg model; or None and, for the page, why the residuals cannot be drawn. Raises InputError for another one
    that is given."""
    try:
        return model_of(result, model), None
    except (InputError, PluginError):
        if model is not None:
            raise
        why = f"the leg model {result.model.name!r} is not known here"
        return None, f"{why}; install the package that provides it and write the page again with `cpcal report`"


def _leg(campaign: Campaign, result: Result, leg: LegResult, model: LegModel | None) -> dict[str, Any]:
    names = leg.support[:_MOST_NAMES]
    return {
        "number": leg.leg,
        "verdict": verdict_of(result, leg),
        "sentence": leg_sentence(result, leg),
        "center": center_sentence(result, leg),
        "trials": [_trial(leg, trial) for trial in leg.trials],
        "parameters": _parameters(result, leg),
        "bars": _bars(campaign, result, leg),
        "contractors": contractors_sentences(leg),
        "proved_point": leg.point is not None,
        "empty": leg.enclosure.is_empty,
        "support": names,
        "more_support": len(leg.support) - len(names),
        "figure": _figure(campaign, leg, model),
        "pairs": pairs(campaign, result, leg),
    }


def _trial(leg: LegResult, trial: Trial) -> tuple[str, ...]:
    """A row of the table of the solver's calls; its bounds have the digits of the leg's own, which end the table."""
    asked, lo = (bracket_text(value, leg.eps_hi)[0] for value in (trial.eps, trial.lo))
    hi = bracket_text(leg.eps_lo, trial.hi)[1]
    answer = trial.answer.value if trial.checked or trial.answer is not Answer.INFEASIBLE else "infeasible, unchecked"
    return (asked, about(trial.delay), answer, lo, hi, str(trial.nodes))


def _parameters(result: Result, leg: LegResult) -> list[tuple[str, ...]]:
    """Name (with its unit, if that is not mm), center, proved point, enclosure, a row a parameter."""
    rows: list[tuple[str, ...]] = []
    for k, name in enumerate(result.parameters):
        unit = result.model.unit(name)
        point = "—" if leg.point is None else nearest(leg.point[k], _DECIMALS)
        lo, hi = float(leg.enclosure.lo[k]), float(leg.enclosure.hi[k])
        bounds = (rounded_down(lo, _DECIMALS), rounded_up(hi, _DECIMALS))
        rows.append((name if unit == "mm" else f"{name} [{unit}]", nearest(leg.center[k], _DECIMALS), point, *bounds))
    return rows


def _bars(campaign: Campaign, result: Result, leg: LegResult) -> dict[str, Any]:
    """The plot of the enclosure against nominal values and fit, and what its caption says."""
    data = Enclosure(
        PARAMETERS,
        campaign.robot.parameters[leg.leg - 1],
        leg.enclosure.lo[:7],
        leg.enclosure.hi[:7],
        np.array(leg.center[:7]) if result.options.center == "fit" else None,
    )
    label = f"Leg {leg.leg}: enclosure of each parameter, relative to its nominal value"
    return {
        "svg": Markup(enclosure_svg(data, label=label)),  # made by us, as below
        "empty": data.empty,
        "unbounded": data.unbounded,
        "fit": data.fit is not None,
        "fit_beyond": data.fit_beyond,
    }


def _figure(campaign: Campaign, leg: LegResult, model: LegModel | None) -> dict[str, Any] | None:
    """The plot of the proved point's residuals and what its caption says; None without such a point, or model."""
    if leg.point is None or not np.isfinite(leg.eps_hi) or model is None:
        return None
    residual = model_residuals(campaign, leg.leg, leg.point, model)
    room = reading_sensitivity(campaign, leg.leg, leg.point, model)
    chosen = set(leg.support)
    support = np.array([name in chosen for name in campaign.measurement_ids], dtype=bool)
    svg = residual_svg(
        Residuals(residual, room, support, leg.eps_hi),
        label=f"Leg {leg.leg}: residuals of the proved point over the measurements, and the band of eps_hi",
    )
    return {
        "svg": Markup(svg),  # made by us: no text of the campaign is in it
        "eps": bracket_text(leg.eps_hi, leg.eps_hi)[1],
        "room": bool(room.any()),
        "beyond": int(np.sum(np.abs(residual) > leg.eps_hi)) if room.any() else 0,
        "envelope": len(residual) > MOST_POINTS,
        "support": bool(support.any()),
    }
