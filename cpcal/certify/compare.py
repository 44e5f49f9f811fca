"""Leg models compared on a campaign: for each leg and model a proved bracket of the smallest eps."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from cpcal.certify.asked_model import chosen_model
from cpcal.certify.certify import answered, checked_options
from cpcal.certify.question import Question
from cpcal.common.errors import Problem
from cpcal.execution.stopping import heard
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import COMPARED as FOLDER
from cpcal.files.run_folder import answers_into
from cpcal.legs import LegModel
from cpcal.results import Comparison, Entry, LegResult
from cpcal.robot import Campaign

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
) -> Comparison:
    """For each leg and each model the smallest eps (mm), bracketed by proofs; and what is refuted at `tolerance`.

    All models are asked about the same box of (a, b, l), within `delta` mm of the fit of the plain model (or of the
    nominal parameters), their extra parameters within `half_widths[model]` of 0. So a model that contains another one
    never has a larger eps. The other arguments are those of `certify`; `certificates` names a folder for files such as
    `gain-leg1.cert.jsonl`, and `progress` is called with every entry. Ctrl-C ends it with what is proved so far.
    Raises InputError with every problem, PluginError.
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
    with heard(), ExitStack() as keep:
        if certificates is None:
            return compared(question, chosen, progress)
        draft = keep.enter_context(answers_into(certificates, FOLDER, campaign))
        return compared(replace(question, certificates=draft), chosen, progress)


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


def compared(question: Question, models: Sequence[LegModel], progress: Callable[[Entry], None] | None) -> Comparison:
    """All models of a leg, then the next leg; `question` is asked with one model after the other."""
    campaign, options = question.campaign, question.options
    entries: list[Entry] = []
    interrupted = False
    for leg, model in ((leg, model) for leg in options.legs or range(1, campaign.legs + 1) for model in models):
        asked = replace(options, legs=(leg,), model=model.name)
        result = answered(replace(question, options=asked, model=model, prefix=f"{model.name}-"))
        entries += [_entry(found, model) for found in result.legs]
        if progress is not None and result.legs:
            progress(entries[-1])
        interrupted = result.interrupted
        if interrupted:
            break
    return Comparison(
        title=campaign.robot.name,
        tolerance=options.tolerance,
        models={model.name: model.summary for model in models},
        entries=tuple(entries),
        campaign_sha256=campaign_sha256(campaign),
        options=options,
        interrupted=interrupted,
    )


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
        eps_lo=found.eps_lo,
        eps_hi=found.eps_hi,
        enclosure=found.enclosure,
        certificate=found.certificate,
        seconds=found.seconds,
        determination=found.determination,
        not_certified=found.not_certified,
    )
