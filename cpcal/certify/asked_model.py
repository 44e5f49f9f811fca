"""The leg model of a question: from the caller, by name or as an object, or from the campaign."""

from __future__ import annotations

from collections.abc import Mapping

from cpcal.common.errors import InputError, Problem
from cpcal.legs import PLAIN, LegModel, half_width_problems, leg_model
from cpcal.robot import Campaign


def chosen_model(
    campaign: Campaign, model: str | LegModel | None, half_widths: Mapping[str, float] | None
) -> tuple[LegModel, list[Problem]]:
    """The model with its half-widths, and what is wrong with the choice; it is the plain one then.

    The campaign's half-widths count where its model is the one that is asked for.
    """
    asked = campaign.model
    if model is None:
        model = PLAIN.name if asked is None else asked.name
    try:
        found = leg_model(model)
    except InputError as error:
        return PLAIN, list(error.problems)
    stated = asked.half_widths if asked is not None and asked.name == found.name else {}
    widths = {**stated, **(half_widths or {})}
    problems = half_width_problems(found, widths)
    return (PLAIN, problems) if problems else (found.within(widths), [])
