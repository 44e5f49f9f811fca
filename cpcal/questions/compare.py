"""Leg models compared on a campaign: for each leg and model a proved bracket of the smallest eps."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

from cpcal.common.errors import Problem
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import COMPARED as FOLDER
from cpcal.files.run_folder import answers_into
from cpcal.legs import LegModel
from cpcal.questions import Comparison, Entry, LegResult, ModelNote, Result
from cpcal.questions.ask import LOADS, answered, checked_options, with_certificates
from cpcal.questions.question import HERE, Question, answers, chosen_model
from cpcal.robot import Campaign
from cpcal.solver.execution.executors import Here, Place, executor_for
from cpcal.solver.execution.stopping import heard

COMPARED = ("plain", "gain", "linear")
_CENTERS = ("plain", "nominal")  # the same for all models, whatever their own fits


def compare(
    campaign: Campaign,
    models: Sequence[str | LegModel] = COMPARED,
    *,
    tolerance: float | None = None,
    legs: Sequence[int] | None = None,
    delta: float = 100.0,
    center: str = "plain",
    gap: float = 1e-6,
    time_limit: float | None = None,
    contractors: Sequence[str] = ("lifted",),
    arithmetic: str = "float64",
    half_widths: Mapping[str, Mapping[str, float]] | None = None,
    certificates: str | os.PathLike[str] | None = None,
    progress: Callable[[Entry], None] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | None = None,
) -> Comparison:
    """For each leg and each model the smallest eps (mm), bracketed by proofs; and what is refuted at `tolerance`.

    All models are asked about the same box of (a, b, l), within `delta` mm of the fit of the plain model (or of the
    nominal parameters), their extra parameters within `half_widths[model]` of 0. So a model that contains another one
    never has a larger eps. The other arguments are those of `certify`; `certificates` names a folder for files such as
    `gain-leg1.cert.jsonl`, and `progress` is called with every entry. Each leg with each model is a task of `workers`
    processes, of a Dask `scheduler` or of an `executor`. Ctrl-C ends it with what is proved so far.
    Raises InputError with every problem, PluginError, LostWorkerError.
    """
    question, chosen = comparison_question(
        campaign,
        models,
        half_widths,
        tolerance=tolerance,
        legs=legs,
        delta=delta,
        center=center,
        gap=gap,
        time_limit=time_limit,
        contractors=contractors,
        arithmetic=arithmetic,
    )
    with heard(), executor_for(workers, scheduler, executor, loads=LOADS) as place, ExitStack() as keep:
        if certificates is None:
            return compared(question, chosen, progress, place)
        draft = keep.enter_context(answers_into(certificates, FOLDER, campaign))
        return compared(replace(question, certificates=draft), chosen, progress, place)


def comparison_question(
    campaign: Campaign,
    models: Sequence[str | LegModel],
    half_widths: Mapping[str, Mapping[str, float]] | None = None,
    *,
    center: str = "plain",
    **given: Any,
) -> tuple[Question, list[LegModel]]:
    """What is asked with each of the models, and these. Raises InputError with every problem, PluginError."""
    chosen, wrong = _chosen(campaign, models, half_widths or {})
    if center not in _CENTERS:
        wrong.append(Problem("center", f"{center!r} is not common to all models", f"use {' or '.join(_CENTERS)}"))
    options, _ = checked_options(
        campaign,
        wrong,
        center=center if center in _CENTERS else "plain",
        support="none",
        model="plain",
        **given,
    )
    return Question(campaign=campaign, options=options), chosen


def compared(
    question: Question,
    models: Sequence[LegModel],
    progress: Callable[[Entry], None] | None,
    place: Place = HERE,
) -> Comparison:
    """All models of a leg, then the next leg; `question` is asked with each of them, where `place` says."""
    campaign, options = question.campaign, question.options
    asked = [_Asked(leg, model) for leg in options.legs or range(1, campaign.legs + 1) for model in models]
    found: dict[tuple[int, str], Entry] = {}
    interrupted = False
    try:
        for answer in answers(question, _certified, asked, place):
            leg, model = answer.asked.leg, answer.asked.model
            interrupted = interrupted or answer.found.interrupted
            for one in answer.found.legs:
                found[leg, model.name] = _entry(with_certificates(question, answer.files, one), model)
                if progress is not None:
                    progress(found[leg, model.name])
            if interrupted and isinstance(place[0], Here):
                break
    except KeyboardInterrupt:
        interrupted = True
    entries = [found[key] for one in asked if (key := (one.leg, one.model.name)) in found]
    return Comparison(
        title=campaign.robot.name,
        tolerance=options.tolerance,
        models={model.name: ModelNote(model.name).summary for model in models},
        entries=tuple(entries),
        campaign_sha256=campaign_sha256(campaign),
        options=options,
        interrupted=interrupted or len(entries) < len(asked),
    )


@dataclass(frozen=True)
class _Asked:
    """A leg, and the model that it is asked about."""

    leg: int
    model: LegModel


def _certified(question: Question, asked: _Asked) -> Result:
    options = replace(question.options, legs=(asked.leg,), model=asked.model.name)
    return answered(replace(question, options=options, model=asked.model, prefix=f"{asked.model.name}-"))


def _chosen(
    campaign: Campaign, models: Sequence[str | LegModel], half_widths: Mapping[str, Mapping[str, float]]
) -> tuple[list[LegModel], list[Problem]]:
    """The models, and everything that is wrong with them."""
    chosen, wrong = [], []
    names = [model if isinstance(model, str) else model.name for model in models]
    if not names:
        wrong.append(Problem("models", "none is named", f"name some, such as {', '.join(COMPARED)}"))
    if len(set(names)) < len(names):
        wrong.append(Problem("models", "one is named twice", "name each once"))
    for name in half_widths:
        if name not in names:
            wrong.append(Problem("half_widths", f"{name!r} is not compared", f"models are {', '.join(names)}"))
    for name, asked in zip(names, models, strict=True):
        model, problems = chosen_model(campaign, asked, half_widths.get(name))
        chosen.append(model)
        wrong += problems
    return chosen, wrong


def _entry(found: LegResult, model: LegModel) -> Entry:
    return Entry(
        subject=f"leg {found.leg}",
        model=model.name,
        eps_lo=found.bracket.lo,
        eps_hi=found.bracket.hi,
        enclosure=found.bracket.enclosure,
        certificate=found.bracket.certificate,
        seconds=found.work.seconds,
        determination=found.determination,
        not_certified=found.not_certified,
    )
