"""What a result states that no certificate holds, but that follows from its campaign at once: computed again."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from cpcal.certify.undetermined import determination
from cpcal.checker import Accepted
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, PluginError
from cpcal.legs import PARAMETERS, LegModel, Parameter, leg_model
from cpcal.results import Comparison, Entry, LegResult, Result
from cpcal.robot import Campaign


def stated_otherwise(campaign: Campaign, result: Result) -> Iterator[str]:
    """Sentences on what the campaign and the model do not give as the result states it.

    The verdict on a leg depends on it. A model that is not known here cannot be compared.
    """
    try:
        model = leg_model(result.model.name)
    except (InputError, PluginError):
        return
    note = result.model
    if (note.summary, _units(note.extra)) != (model.summary, _units(model.extra)):
        yield "states another leg model than the one of that name"
        return
    for leg in result.legs:
        if leg.leg > campaign.legs:
            yield f"names leg {leg.leg}, which the campaign has not"
        elif leg.determination != _determination(campaign, result, leg, model):
            yield f"states other parameters of leg {leg.leg} as undetermined than the campaign leaves open"
        elif result.options.center == "nominal" and leg.center[:7] != tuple(campaign.robot.parameters[leg.leg - 1]):
            yield f"states another center of the box of leg {leg.leg} than the nominal parameters"


def speaks_of(accepted: Accepted, delta: float) -> bool:
    """Whether a leg's certificate is about (a, b, l) within `delta` mm of some center; its box is rounded outward."""
    sides = zip(accepted.lo[: len(PARAMETERS)], accepted.hi, strict=False)
    slack = Fraction(1, 2**49)
    return all(2 * delta <= hi - lo <= 2 * Fraction(delta) + (abs(lo) + abs(hi)) * slack for lo, hi in sides)


def leg_stated_otherwise(
    comparison: Comparison, entry: Entry, accepted: Accepted, campaign: Campaign, delta: float
) -> str | None:
    """What a comparison states of a leg that its accepted certificate, the campaign or the model does not bear."""
    about = f"leg {accepted.leg}, model {accepted.model}, campaign {accepted.campaign}"
    said = accepted.about if accepted.leg is None else about  # a user-defined model says it in words
    number = int(entry.subject[4:]) if re.fullmatch("leg [1-9][0-9]{0,3}", entry.subject) else 0
    if (
        not 1 <= number <= campaign.legs
        or said != f"{entry.subject}, model {entry.model}, campaign {comparison.campaign_sha256}"
    ):
        return "by the certificate of another"
    if not speaks_of(accepted, delta):
        return "of another box"
    try:
        model = leg_model(entry.model)
    except (InputError, PluginError):
        return None
    if model.summary != comparison.models[entry.model]:
        return "of another text of the model"
    point = accepted.claims.point
    middle = [(lo + hi) / 2 for lo, hi in zip(accepted.lo, accepted.hi, strict=True)]
    at = np.array([float(v) for v in (middle if point is None else point.at)[:-1]])
    if entry.determination != _determined(campaign, number, at, model, delta):
        return "with other parameters undetermined"
    return None


def _units(extra: tuple[Parameter, ...]) -> list[tuple[str, str]]:
    return [(p.name, p.unit) for p in extra]


def _determination(campaign: Campaign, result: Result, leg: LegResult, model: LegModel) -> object:
    at = np.array(leg.center if leg.point is None else leg.point)
    return _determined(campaign, leg.leg, at, model, result.options.delta)


def _determined(campaign: Campaign, leg: int, at: Floats, model: LegModel, delta: float) -> object:
    if delta == 0.0:
        return None
    try:
        with np.errstate(all="ignore"):
            return determination(campaign, leg, at, model)
    except np.linalg.LinAlgError:
        return "of a point that is too far away"
