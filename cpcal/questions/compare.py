"""Leg models compared on a campaign: the question of `certify` with each of them, about the same box."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from cpcal.common.errors import Problem
from cpcal.files.run_folder import RUN, answers_into
from cpcal.models import LegModel
from cpcal.questions.ask import LOADS, answered
from cpcal.questions.question import Question, chosen_model, question_of
from cpcal.questions.result import Result
from cpcal.robot import Campaign
from cpcal.solver.execution.executors import executor_for
from cpcal.solver.execution.stopping import heard

COMPARED = ("plain", "gain", "linear")
_CENTERS = ("plain", "nominal")  # the same for all models, whatever their own fits


def compare(
    campaign: Campaign,
    models: Sequence[str | LegModel] = COMPARED,
    *,
    half_widths: Mapping[str, Mapping[str, float]] | None = None,
    certificates: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | None = None,
    **given: Any,
) -> dict[str, Result]:
    """What `certify` answers with each model, by the model's name; `given`: other arguments of `certify`.

    All models are asked about the same box of (a, b, l), within `delta` mm of the fit of the plain model (or of the
    nominal parameters, with `center="nominal"`), their extra parameters within `half_widths[model]` of 0. So a model
    that contains another one never has a larger eps. `certificates` names a folder, in which each model has one.
    Ctrl-C ends it with what is proved so far. Raises InputError with every problem, PluginError, LostWorkerError.
    """
    questions, found = comparison(campaign, models, half_widths, **given), {}
    with heard(), executor_for(workers, scheduler, executor, loads=LOADS) as place:
        for question in questions:
            name = question.model.name
            with ExitStack() as keep:
                if certificates is not None:
                    draft = keep.enter_context(answers_into(Path(certificates) / name, RUN, campaign))
                    question = replace(question, certificates=draft)
                found[name] = answered(question, place)
            if found[name].interrupted:
                break
    return found


def comparison(
    campaign: Campaign,
    models: Sequence[str | LegModel],
    half_widths: Mapping[str, Mapping[str, float]] | None = None,
    *,
    center: str = "plain",
    **given: Any,
) -> list[Question]:
    """What is asked with each of the models. Raises InputError with every problem, PluginError."""
    names = [model if isinstance(model, str) else model.name for model in models]
    widths, wrong = dict(half_widths or {}), []
    if not names:
        wrong.append(Problem("models", "none is named", f"name some, such as {', '.join(COMPARED)}"))
    if len(set(names)) < len(names):
        wrong.append(Problem("models", "one is named twice", "name each once"))
    for name in widths:
        if name not in names:
            wrong.append(Problem("half_widths", f"{name!r} is not compared", f"models are {', '.join(names)}"))
    for name, model in zip(names, models, strict=True):
        wrong += chosen_model(campaign, model, widths.get(name))[1]
    if center not in _CENTERS:
        wrong.append(Problem("center", f"{center!r} is not common to all models", f"use {' or '.join(_CENTERS)}"))
    given = {"center": center if center in _CENTERS else "plain", "support": "none"} | given
    question_of(campaign, wrong, model="plain", **given)
    return [
        question_of(campaign, model=model, half_widths=widths.get(name, {}), **given)
        for name, model in zip(names, models, strict=True)
    ]
