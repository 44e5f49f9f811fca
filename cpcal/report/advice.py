"""What to do about a leg: which measurements to look at first, and the next step.

Estimates from the least-squares fit and the linearised equations, in floating point: help for a person, no proof.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from itertools import product

import numpy as np

from cpcal.calibration.statistics import kept
from cpcal.common.arrays import Floats
from cpcal.common.errors import CpcalError
from cpcal.common.numbers import about
from cpcal.legs import PLAIN, LegModel, ModelResiduals, fit_model, leg_model
from cpcal.report.fitted import Fitted
from cpcal.results import (
    Bounded,
    Explained,
    LegResult,
    LegVerdict,
    Result,
    Uncompared,
    Undecided,
    Undetermined,
    verdict_of,
)
from cpcal.robot import Campaign, rotation_matrix, small_rotation

FIRST = 3  # measurements to look at
FEW = 20  # a larger support points at nothing
_OTHER_MODELS = ("gain", "lateral", "linear")  # the simplest first
_HELPS = 0.6  # another model is named when its largest residual is below this share of the model's own
_FORCED = 0.5  # measurements are to be taken again when without them the largest residual is below this share
_ENOUGH = 500  # measurements, for the fits of other models
_SURELY = 1.5  # times that share: another model is not even fitted when its linearised equations leave more
_NEARLY = 1.3  # times the best: a simpler model is as good


class NextStep(StrEnum):
    """The next step, as a title and in the terminal."""

    ACCEPT = "accept"
    MODEL = "use another model"
    REMEASURE = "re-measure"
    ADD = "add poses"
    TOLERANCE = "state a tolerance"
    WAIT = "give it more time"
    MECHANICS = "look at the leg"
    COMPARE = "compare the constraints"


@dataclass(frozen=True)
class Advice:
    """`first`: measurements counted from 0, the most telling first. `short` is for one line, `sentence` for a page."""

    step: NextStep
    short: str
    sentence: str
    first: tuple[int, ...]


def advise(campaign: Campaign, result: Result, leg: LegResult, model: LegModel | None, found: Fitted | None) -> Advice:
    """`model`: the result's, and its fit, None where it is not known here: then no residuals can be looked at."""
    verdict = verdict_of(result, leg)
    if isinstance(verdict, Uncompared) and verdict.fits:
        return Advice(*_by_verdict(verdict), first=_of_support(campaign, leg))
    verdict = verdict.found if isinstance(verdict, Uncompared) else verdict
    if model is None or found is None:
        return Advice(*_by_verdict(verdict), first=_of_support(campaign, leg))
    first = _first(found, _of_support(campaign, leg, FEW))
    if isinstance(verdict, Explained):
        return Advice(*_by_verdict(verdict), first=first)
    if isinstance(verdict, Undetermined):
        return Advice(NextStep.ADD, "add poses", _where(campaign, verdict.names, found), first)
    if isinstance(verdict, Undecided):
        return Advice(*_by_verdict(verdict), first=first)
    better = _another_model(campaign, leg, model, found) or _without(campaign, found, first)
    if better is None:
        better = (
            NextStep.MECHANICS,
            "look at the leg",
            (
                "Neither another leg model nor leaving out these measurements helps: look for play, sag, or joints off "
                "their axes in this leg, or allow the error."
            ),
        )
    if isinstance(verdict, Bounded):
        step, short, sentence = better
        ask = "State with --tolerance which error you can accept."
        if step is NextStep.MECHANICS:
            return Advice(NextStep.TOLERANCE, "state a tolerance", ask, first)
        return Advice(step, short, f"{ask} If this one is too large: {sentence[0].lower()}{sentence[1:]}", first)
    return Advice(*better, first=first)


def measurement_names(campaign: Campaign, numbers: tuple[int, ...]) -> list[str]:
    """Measurements counted from 1, each with its id."""
    ids = campaign.measurement_ids
    return [f"{k + 1} ({ids[k]})" for k in numbers]


def support_numbers(campaign: Campaign, leg: LegResult) -> tuple[int, ...]:
    """The support, counted from 0, in the order of the campaign."""
    chosen = set(leg.support)
    return tuple(k for k, name in enumerate(campaign.measurement_ids) if name in chosen)


def _first(found: Fitted, support: tuple[int, ...]) -> tuple[int, ...]:
    """Of the support, or of all where that is empty, those with the largest residuals."""
    among = np.array(support or range(len(found.residuals)))
    order = np.argsort(-np.abs(found.residuals[among]), kind="stable")
    return tuple(int(k) for k in among[order[:FIRST]])


def _largest_without(found: Fitted, dropped: tuple[int, ...]) -> float:
    """The largest residual of a fit of the other measurements, from the linearised equations."""
    kept = np.delete(np.arange(len(found.residuals)), dropped)
    if len(kept) <= found.jacobian.shape[1]:
        return math.inf
    rows, values = found.jacobian[kept], found.residuals[kept]
    step = np.linalg.lstsq(rows, -values, rcond=1e-12)[0]
    return float(np.max(np.abs(values + rows @ step)))


def _of_support(campaign: Campaign, leg: LegResult, most: int = FIRST) -> tuple[int, ...]:
    """A small support; nothing of a large one."""
    return support_numbers(campaign, leg) if len(leg.support) <= most else ()


def _by_verdict(verdict: LegVerdict) -> tuple[NextStep, str, str]:
    if isinstance(verdict, Uncompared):
        what = "Compare the constraints that the certificates state with the model: no program has."
        return NextStep.COMPARE, "compare the constraints", what
    if isinstance(verdict, Explained):
        return NextStep.ACCEPT, "accept", "Accept the parameters."
    if isinstance(verdict, Undetermined):
        return NextStep.ADD, "add poses", "Add poses with other positions and rotations."
    if isinstance(verdict, Undecided):
        return (
            NextStep.WAIT,
            "more time",
            ("Certify again with a longer --time-limit, or with a --tolerance clearly above or below these bounds."),
        )
    return NextStep.TOLERANCE, "state a tolerance", "State with --tolerance which error you can accept."


def _another_model(
    campaign: Campaign, leg: LegResult, model: LegModel, own: Fitted
) -> tuple[NextStep, str, str] | None:
    """The simplest model whose fit is much better, if there is one."""
    if model.name != PLAIN.name or len(campaign) < 2 * len(PLAIN.parameters):
        return None
    largest: dict[str, float] = {}
    some = _some(campaign)
    for name in _OTHER_MODELS:
        other = leg_model(name)
        try:
            residuals = ModelResiduals(campaign, leg.leg, other)
            if _at_least(residuals, own, other) > _SURELY * _HELPS * own.largest:
                continue
            x = fit_model(some, leg.leg, other, residuals if some is campaign else None)
            largest[name] = float(np.max(np.abs(residuals.values(x))))
        except (CpcalError, ValueError, np.linalg.LinAlgError):  # a fit that does not exist helps nobody
            continue
    best = min(largest.values(), default=math.inf)
    if not best < _HELPS * own.largest:
        return None
    name = next(name for name in largest if largest[name] <= max(_NEARLY * best, 0.0))
    sentence = (
        f"Use model “{name}”: its least-squares fit leaves {about(largest[name])} mm at most, this one's "
        f"{about(own.largest)} mm. cpcal compare proves which models hold."
    )
    return NextStep.MODEL, f"model “{name}”", sentence


def _at_least(residuals: ModelResiduals, own: Fitted, other: LegModel) -> float:
    """About the largest residual of a fit of another model, from its equations linearised at the fit of the plain one.

    What is linear in the extra parameters, which are small, needs no fit to be ruled out.
    """
    at = np.append(own.x, np.zeros(len(other.extra)))
    with np.errstate(all="ignore"):  # a damaged result may be anywhere
        values, rows = residuals.values(at), residuals.jacobian(at)
    step = np.linalg.lstsq(rows, -values, rcond=1e-12)[0]
    return float(np.max(np.abs(values + rows @ step)))


def _some(campaign: Campaign) -> Campaign:
    """Of a large campaign some measurements, evenly spread: enough for the fit of an estimate."""
    step = -(-len(campaign) // _ENOUGH)
    return campaign if step == 1 else kept(campaign, np.arange(len(campaign)) % step == 0)


def _without(campaign: Campaign, own: Fitted, first: tuple[int, ...]) -> tuple[NextStep, str, str] | None:
    """To measure again what alone makes the error large."""
    for count in range(1, len(first) + 1):
        again, left = first[:count], _largest_without(own, first[:count])
        if left < _FORCED * own.largest:
            sentence = (
                f"Re-measure {', '.join(measurement_names(campaign, again))}: without "
                f"{'it' if count == 1 else 'them'} the least-squares fit leaves {about(left)} mm at most, "
                f"not {about(own.largest)} mm."
            )
            return NextStep.REMEASURE, f"re-measure {', '.join(str(k + 1) for k in again)}", sentence
    return None


def _where(campaign: Campaign, names: tuple[str, ...], found: Fitted) -> str:
    """A pose, of the corners of the workspace and a little beyond, that the undetermined parameters would show in."""
    scale = np.sqrt(np.mean(found.jacobian**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    weakest = np.linalg.svd(found.jacobian / scale, full_matrices=len(found.jacobian) < len(scale))[2][-1][:7]
    reach = np.maximum(0.5 * np.ptp(campaign.position, axis=0), 0.1 * float(np.mean(campaign.length)))
    middle = 0.5 * (campaign.position.min(axis=0) + campaign.position.max(axis=0))
    best, share = (middle, np.zeros(3)), -1.0
    for moved, turned in product(product((-1.0, 1.0), repeat=3), product((-0.2, 0.0, 0.2), repeat=3)):
        position, turn = middle + reach * np.array(moved), np.array(turned)
        row = _row(position, turn, found.x) / scale[:7]
        if abs(float(row @ weakest)) > share:
            best, share = (position, turn), abs(float(row @ weakest))
    what = f"Add poses that show {', '.join(names)}" if names else "Add poses"
    at, turned_by = (", ".join(about(v) for v in values) for values in (best[0], np.degrees(best[1])))
    return f"{what}, such as one near ({at}) mm, turned by ({turned_by}) degrees."


def _row(position: Floats, turn: Floats, x: Floats) -> Floats:
    """The derivative (7,) of the plain equation at a pose; `turn` is a rotation vector, rad."""
    rotation = rotation_matrix(small_rotation(turn[None]))[0]
    vector = position + rotation @ x[3:6] - x[:3]
    along = vector / max(float(np.linalg.norm(vector)), 1e-300)
    return np.concatenate([-along, rotation.T @ along, [-1.0]])
