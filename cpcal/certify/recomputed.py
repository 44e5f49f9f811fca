"""What a result states that no certificate holds, but that follows from its campaign at once: computed again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cpcal.certify.undetermined import determination
from cpcal.common.errors import InputError, PluginError
from cpcal.legs import LegModel, Parameter, leg_model
from cpcal.results import LegResult, Result
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


def _units(extra: tuple[Parameter, ...]) -> list[tuple[str, str]]:
    return [(p.name, p.unit) for p in extra]


def _determination(campaign: Campaign, result: Result, leg: LegResult, model: LegModel) -> object:
    at = np.array(leg.center if leg.point is None else leg.point)
    if result.options.delta == 0.0:
        return None
    try:
        with np.errstate(all="ignore"):
            return determination(campaign, leg.leg, at, model)
    except np.linalg.LinAlgError:
        return "of a point that is too far away"
