"""Leg models by name: those that come with cpcal, and those that other packages provide by entry point."""

from __future__ import annotations

from cpcal.common.errors import InputError, PluginError, Problem
from cpcal.legs.models import BUILT_IN, LegModel, built_in, model_problems

GROUP = "cpcal.leg_models"


def leg_model(model: str | LegModel) -> LegModel:
    """The model of that name, or the model given.

    Raises InputError with everything that is wrong with the name or the model, PluginError when the package that
    provides it does not load.
    """
    if isinstance(model, str):
        ours = {m.name: m for m in BUILT_IN}
        model = ours[model] if model in ours else _provided(model)
    problems = [] if built_in(model) else model_problems(model)
    if problems:
        raise InputError(problems)
    return model


def _provided(name: str) -> LegModel:
    from cpcal.solver import plugins  # here: models that come with cpcal need none

    known = plugins.found(GROUP)
    if name not in known:
        names = ", ".join(dict.fromkeys([*(m.name for m in BUILT_IN), *known]))
        remedy = f"use one of {names}, pass a LegModel, or install the package that provides it (entry point {GROUP})"
        raise InputError([Problem("model", f"{name!r} is not known", remedy)])
    model = plugins.load_member("leg model", name, GROUP)
    if not isinstance(model, LegModel) or model.name != name:
        raise PluginError(f"leg model {name!r} ({known[name].value}) is no cpcal.LegModel of that name")
    return model
