"""What to do about a leg: which measurements to look at first, and the next step.

Estimates from the least-squares fit and the linearised equations, in floating point: help for a person, no proof.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from cpcal.common.errors import CpcalError
from cpcal.common.numbers import about
from cpcal.common.values import Floats
from cpcal.models import PLAIN, LegModel, ModelResiduals, fit_model, leg_model, model_jacobian, model_residuals
from cpcal.questions import (
    LegResult,
    Result,
    verdict_of,
)
from cpcal.robot import Campaign, rotation_matrix, small_rotation

# ------------------------------------------------------------------------------------------------------------------
# The least-squares fit of a leg, which stands beside what was proved. Plain floating point.


@dataclass(frozen=True, eq=False)
class Fitted:
    """Its parameters (n,), residuals (N,) in mm at the centres of the reading sets, and their Jacobian (N, n)."""

    x: Floats
    residuals: Floats
    jacobian: Floats

    @property
    def largest(self) -> float:
        return float(np.max(np.abs(self.residuals)))


def fitted(campaign: Campaign, result: Result, leg: LegResult, model: LegModel) -> Fitted:
    """The fit that was the center of the box, or else one made now."""
    known = result.options.center == "fit"
    x = np.array(leg.center) if known else fit_model(campaign, leg.leg, model)
    with np.errstate(all="ignore"):  # the center of a damaged result may be anywhere
        values, slopes = model_residuals(campaign, leg.leg, x, model), model_jacobian(campaign, leg.leg, x, model)
        return Fitted(x, np.nan_to_num(values), np.nan_to_num(slopes))


FIRST = 3  # measurements to look at
FEW = 20  # a larger support points at nothing
_OTHER_MODELS = ("gain", "lateral", "linear")  # the simplest first
_HELPS = 0.6  # another model is named when its largest residual is below this share of the model's own
_FORCED = 0.5  # measurements are to be taken again when without them the largest residual is below this share
_STEPS_OF_A_FIT = 3
_SURELY = 1.5  # times that share: a fit is not gone on with when its linearised equations leave more
_NEARLY = 1.3  # times the best: a simpler model is as good
_STEPS = {  # by the kind of a verdict
    "explained": ("accept", "Accept the parameters."),
    "undetermined": ("add poses", "Add poses with other positions and rotations."),
    "undecided": (
        "more time",
        "Certify again with a longer --time-limit, or with a --tolerance clearly above or below these bounds.",
    ),
    "bounded": ("state a tolerance", "State with --tolerance which error you can accept."),
    "unexplained": ("state a tolerance", "State with --tolerance which error you can accept."),
}
_MECHANICS = (
    "look at the leg",
    "Neither another leg model nor leaving out these measurements helps: look for play, sag, or joints off their axes "
    "in this leg, or allow the error.",
)


@dataclass(frozen=True)
class Advice:
    """The next step, `short` for a line and as a `sentence`. `first`: measurements from 0, the most telling first."""

    short: str
    sentence: str
    first: tuple[int, ...]


def advise(campaign: Campaign, result: Result, leg: LegResult, model: LegModel | None, found: Fitted | None) -> Advice:
    """`model`: the result's, and its fit, None where it is not known here: then no residuals can be looked at."""
    verdict, support = verdict_of(result, leg), support_numbers(campaign, leg)
    few = support if len(support) <= FIRST else ()
    if verdict.kind == "uncompared":
        what = "Compare the constraints that the certificates state with the model: no program has."
        return Advice("compare the constraints", what, few)
    step = _STEPS[verdict.kind]
    if verdict.kind == "explained":
        return Advice(*step, ())
    if model is None or found is None:
        return Advice(*step, few)
    # of a small support, or of all where it is large, the measurements with the largest residuals
    among = np.array((support if len(support) <= FEW else ()) or range(len(found.residuals)))
    order = np.argsort(-np.abs(found.residuals[among]), kind="stable")
    first = tuple(int(k) for k in among[order[:FIRST]])
    if verdict.kind == "undetermined":
        return Advice(step[0], _where(campaign, verdict.names, found), first)
    if verdict.kind not in ("bounded", "unexplained"):
        return Advice(*step, first)
    better = _another_model(campaign, leg, model, found) or _without(campaign, found, first)
    if verdict.kind == "unexplained":
        return Advice(*(better or _MECHANICS), first)
    if better is None:
        return Advice(*step, first)
    return Advice(better[0], f"{step[1]} If this one is too large: {better[1][0].lower()}{better[1][1:]}", first)


def measurement_names(campaign: Campaign, numbers: Iterable[int]) -> list[str]:
    """Measurements counted from 1, each with its id."""
    ids = campaign.measurement_ids
    return [f"{k + 1} ({ids[k]})" for k in numbers]


def support_numbers(campaign: Campaign, leg: LegResult) -> tuple[int, ...]:
    """The support, counted from 0, in the order of the campaign."""
    chosen = set(leg.support.ids)
    return tuple(k for k, name in enumerate(campaign.measurement_ids) if name in chosen)


def _linear_fit(rows: Floats, values: Floats) -> tuple[Floats, float]:
    """The step of least squares from linearised equations, and the largest residual that it leaves."""
    if len(rows) <= rows.shape[1]:
        return np.zeros(rows.shape[1]), math.inf
    step = np.asarray(np.linalg.lstsq(rows, -values, rcond=1e-12)[0], np.float64)
    return step, float(np.max(np.abs(values + rows @ step)))


def _another_model(campaign: Campaign, leg: LegResult, model: LegModel, own: Fitted) -> tuple[str, str] | None:
    """The simplest model whose fit, a few steps from the plain one's, is much better, if there is one."""
    if model.name != PLAIN.name or len(campaign) < 2 * len(PLAIN.parameters):
        return None
    largest: dict[str, float] = {}
    for name in _OTHER_MODELS:
        other = leg_model(name)
        x = np.append(own.x, np.zeros(len(other.extra)))
        try:
            residuals = ModelResiduals(campaign, leg.leg, other)
            for _ in range(_STEPS_OF_A_FIT):
                with np.errstate(all="ignore"):  # a damaged result may be anywhere
                    step, largest[name] = _linear_fit(residuals.jacobian(x), residuals.values(x))
                if largest[name] > _SURELY * _HELPS * own.largest:
                    break
                x += step
        except (CpcalError, ValueError, np.linalg.LinAlgError):  # a fit that does not exist helps nobody
            largest.pop(name, None)
    best = min(largest.values(), default=math.inf)
    if not best < _HELPS * own.largest:
        return None
    name = next(name for name in largest if largest[name] <= _NEARLY * best)
    sentence = (
        f"Use model “{name}”: its least-squares fit leaves {about(largest[name])} mm at most, this one's "
        f"{about(own.largest)} mm. `cpcal certify --model A,B` proves which models hold."
    )
    return f"model “{name}”", sentence


def _without(campaign: Campaign, own: Fitted, first: tuple[int, ...]) -> tuple[str, str] | None:
    """To measure again what alone makes the error large."""
    for count in range(1, len(first) + 1):
        again = first[:count]
        _, left = _linear_fit(np.delete(own.jacobian, again, axis=0), np.delete(own.residuals, again))
        if left < _FORCED * own.largest:
            sentence = (
                f"Re-measure {', '.join(measurement_names(campaign, again))}: without "
                f"{'it' if count == 1 else 'them'} the least-squares fit leaves {about(left)} mm at most, "
                f"not {about(own.largest)} mm."
            )
            return f"re-measure {', '.join(str(k + 1) for k in again)}", sentence
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
        rotation = rotation_matrix(small_rotation(turn[None]))[0]
        vector = position + rotation @ found.x[3:6] - found.x[:3]
        along = vector / max(float(np.linalg.norm(vector)), 1e-300)
        row = np.concatenate([-along, rotation.T @ along, [-1.0]]) / scale[:7]  # of the plain equation's derivative
        if abs(float(row @ weakest)) > share:
            best, share = (position, turn), abs(float(row @ weakest))
    what = f"Add poses that show {', '.join(names)}" if names else "Add poses"
    at, turned_by = (", ".join(about(v) for v in values) for values in (best[0], np.degrees(best[1])))
    return f"{what}, such as one near ({at}) mm, turned by ({turned_by}) degrees."
