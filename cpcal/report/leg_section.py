"""What the page says of one leg: its figures, the table of its parameters, and what stands behind them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from markupsafe import Markup

from cpcal.common.numbers import about, bracket_text, nearest, plain_gap, rounded_down, rounded_up
from cpcal.legs import PARAMETERS, LegModel, model_residuals
from cpcal.report.advice import FEW, Advice, advise, measurement_names, support_numbers
from cpcal.report.bars import Enclosure, enclosure_svg
from cpcal.report.drawing_frames import DrawingFrames
from cpcal.report.fitted import Fitted, fitted
from cpcal.report.pairs import eps_text, pairs
from cpcal.report.plot import MOST_POINTS, Residuals, residual_svg
from cpcal.report.sensitivity import reading_sensitivity
from cpcal.report.words import center_sentence, fit_sentence, leg_sentence
from cpcal.results import LegResult, Result, contractors_sentences, verdict_of
from cpcal.robot import Campaign
from cpcal.solver.accounts import TimeoutAnswer, Trial
from cpcal.solver.interval import Box

_DECIMALS = {"mm": 4}  # of parameters in this unit
_MORE = 9  # of others, such as shares
_MOST_NAMES = 120  # measurements listed for a leg


def leg_section(
    campaign: Campaign,
    result: Result,
    leg: LegResult,
    model: LegModel | None,
    frames: DrawingFrames | None = None,
) -> dict[str, Any]:
    """`model`: None where it is not known here; then nothing is said of residuals. `frames`: of the drawing."""
    found = None if model is None else fitted(campaign, result, leg, model)
    names = measurement_names(campaign, support_numbers(campaign, leg))
    return {
        "number": leg.leg,
        "verdict": verdict_of(result, leg),
        "fit_sentence": fit_sentence(verdict_of(result, leg)),
        "sentence": leg_sentence(result, leg),
        "center": center_sentence(result, leg),
        "advice": _advice(campaign, advise(campaign, result, leg, model, found)),
        "fit_error": None if found is None or model is None else _fit_error(campaign, leg, model, found),
        "trials": [_trial(leg, trial) for trial in leg.trials],
        "parameters": _parameters(campaign, result, leg, found),
        "ranges": _ranges(result, leg),
        "enclosure": _enclosure(result, leg),
        "moved": None if frames is None else _moved(result, leg, frames),
        "bars": _bars(campaign, leg, found),
        "contractors": contractors_sentences(leg),
        "certified": leg.certified,
        "proved_point": leg.point is not None,
        "empty": leg.enclosure.is_empty,
        "support": names[:_MOST_NAMES],
        "more_support": max(0, len(names) - _MOST_NAMES),
        "figure": _figure(campaign, leg, model, found),
        "pairs": pairs(campaign, result, leg),
    }


def _advice(campaign: Campaign, advice: Advice) -> dict[str, Any]:
    return {"step": advice.step.value, "sentence": advice.sentence, "first": measurement_names(campaign, advice.first)}


def _fit_error(campaign: Campaign, leg: LegResult, model: LegModel, found: Fitted) -> float:
    """The smallest eps at which the fit is a solution, to first order: what readings in their sets cannot explain."""
    room = reading_sensitivity(campaign, leg.leg, found.x, model)
    return max(0.0, float(np.max(np.abs(found.residuals) - np.nan_to_num(room))))


def _trial(leg: LegResult, trial: Trial) -> tuple[str, ...]:
    """A row of the table of the solver's calls; its bounds have the digits of the leg's own, which end the table."""
    asked, lo = (bracket_text(value, leg.eps_hi)[0] for value in (trial.eps, trial.lo))
    hi = bracket_text(leg.eps_lo, trial.hi)[1]
    answer = (
        trial.answer.value if trial.checked or trial.answer is not TimeoutAnswer.INFEASIBLE else "infeasible, unchecked"
    )
    return (asked, about(trial.delay), answer, lo, hi, str(trial.nodes))


def _parameters(campaign: Campaign, result: Result, leg: LegResult, found: Fitted | None) -> list[dict[str, Any]]:
    """Name (with its unit, if that is not mm), nominal value, fit, proved point, range and its width, a row each."""
    nominal = [*campaign.robot.parameters[leg.leg - 1], *(0.0 for _ in result.model.extra)]
    rows = []
    for k, name in enumerate(result.parameters):
        unit = result.model.unit(name)
        decimals = _DECIMALS.get(unit, _MORE)
        fit = None if found is None else float(found.x[k])
        point = None if leg.point is None else leg.point[k]
        plain = ["—" if v is None else nearest(v, decimals) for v in (float(nominal[k]), fit, point)]
        sides = ("—", "—", "—") if leg.ranges is None else _sides(leg.ranges.box, k, decimals)
        exact = None if leg.ranges is None else _hex(leg.ranges.box, k)
        label = name if unit == "mm" else f"{name} [{unit}]"
        rows.append({"name": name, "label": label, "plain": plain, "range": sides, "exact": exact, "point": point})
    return rows


def _sides(box: Box, k: int, decimals: int) -> tuple[str, str, str]:
    """The bounds of one parameter and their distance, rounded outward."""
    lo, hi = float(box.lo[k]), float(box.hi[k])
    return rounded_down(lo, decimals), rounded_up(hi, decimals), plain_gap(lo, hi)


def _hex(box: Box, k: int) -> tuple[str, str]:
    """The bounds exactly, for programs that check the page."""
    return float(box.lo[k]).hex(), float(box.hi[k]).hex()


def _ranges(result: Result, leg: LegResult) -> dict[str, Any] | None:
    """To which eps the ranges belong, and who can check them."""
    if leg.ranges is None:
        return None
    eps = leg.ranges.eps
    return {
        "eps": eps_text(result, eps),
        "exact": eps.hex(),
        "margin": about(eps / leg.eps_hi) if 0.0 < leg.eps_hi < eps else None,
        "certificate": leg.ranges.certificate,
    }


def _enclosure(result: Result, leg: LegResult) -> list[dict[str, Any]]:
    """The rows of the table of all parameters that reach eps_hi."""
    rows = []
    for k, name in enumerate(result.parameters):
        unit = result.model.unit(name)
        decimals = 2 + _DECIMALS.get(unit, _MORE)
        label = name if unit == "mm" else f"{name} [{unit}]"
        sides = _sides(leg.enclosure, k, decimals)
        point = "—" if leg.point is None else nearest(leg.point[k], decimals)
        cells = (label, point, *sides)
        exact_point = None if leg.point is None else leg.point[k].hex()
        rows.append({"name": name, "cells": cells, "exact": _hex(leg.enclosure, k), "point": exact_point})
    return rows


def _moved(result: Result, leg: LegResult, frames: DrawingFrames) -> list[tuple[str, ...]] | None:
    """Certified values and ranges in the drawing's frames; None without them."""
    if leg.point is None or leg.ranges is None:
        return None
    point, (lo, hi) = frames.point(np.array(leg.point)), frames.box(leg.ranges.box.lo, leg.ranges.box.hi)
    box = Box(leg.ranges.box.names, lo, hi)
    decimals = _DECIMALS["mm"]
    return [
        (name, nearest(float(point[k]), decimals), *_sides(box, k, decimals))
        for k, name in enumerate(result.parameters)
    ]


def _bars(campaign: Campaign, leg: LegResult, found: Fitted | None) -> dict[str, Any]:
    """The plot of the ranges, or where there are none of the enclosure, against nominal values and fit."""
    box = leg.enclosure if leg.ranges is None else leg.ranges.box
    data = Enclosure(
        PARAMETERS,
        campaign.robot.parameters[leg.leg - 1],
        box.lo[:7],
        box.hi[:7],
        None if found is None else found.x[:7],
    )
    what = "enclosure" if leg.ranges is None else "range"
    label = f"Leg {leg.leg}: {what} of each parameter, relative to its nominal value"
    return {
        "svg": Markup(enclosure_svg(data, label=label)),  # made by us, as below
        "what": what,
        "empty": data.empty,
        "unbounded": data.unbounded,
        "fit": data.fit is not None,
        "fit_beyond": data.fit_beyond,
    }


def _figure(campaign: Campaign, leg: LegResult, model: LegModel | None, found: Fitted | None) -> dict[str, Any] | None:
    """The plot of the proved point's residuals and what its caption says; None without such a point, or model."""
    if leg.point is None or not math.isfinite(leg.eps_hi) or model is None:
        return None
    residual = model_residuals(campaign, leg.leg, leg.point, model)
    room = reading_sensitivity(campaign, leg.leg, leg.point, model)
    support, small = np.zeros(len(campaign), dtype=bool), len(leg.support) <= FEW
    support[list(support_numbers(campaign, leg))] = small
    names = measurement_names(campaign, tuple(range(len(campaign))))
    drawn = Residuals(residual, room, support, leg.eps_hi, None if found is None else found.residuals, names)
    svg = residual_svg(
        drawn, label=f"Leg {leg.leg}: residuals of the proved point over the measurements, and the band of eps_hi"
    )
    return {
        "svg": Markup(svg),  # made by us: text of the campaign in it is escaped
        "eps": bracket_text(leg.eps_hi, leg.eps_hi)[1],
        "exact": leg.eps_hi.hex(),
        "room": bool(room.any()),
        "beyond": int(np.sum(np.abs(residual) > leg.eps_hi)) if room.any() else 0,
        "envelope": len(residual) > MOST_POINTS,
        "support": bool(support.any()),
        "many": 0 if small else len(leg.support),
        "fit": None if found is None else about(found.largest),
    }
