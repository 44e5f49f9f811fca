"""Leg models compared on a campaign: for each leg and model a proved bracket of the smallest eps."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from cpcal.certify.certify import answered, emptied
from cpcal.certify.model import chosen_model
from cpcal.certify.question import Question, check
from cpcal.errors import Problem
from cpcal.legs import LegModel
from cpcal.results import Comparison, Entry, LegResult
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.contract import Limits
from cpcal.solver.interval import get_arithmetic

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
    chosen, wrong = _chosen(campaign, models, half_widths or {})
    if tolerance is not None and not (np.isfinite(tolerance) and tolerance >= 0.0):
        wrong.append(Problem("tolerance", f"{tolerance} is no tolerance", "give a number of mm, 0 or more"))
    if center not in _CENTERS:
        wrong.append(Problem("center", f"{center!r} is not common to all models", f"use {' or '.join(_CENTERS)}"))
    check(campaign, legs, delta, "plain", gap, time_limit, None, "few", "bound", wrong)
    plugins.check_names(contractors)
    engine, limits = get_arithmetic(arithmetic), Limits(seconds=time_limit, gap=gap)
    folder = None if certificates is None else emptied(Path(certificates), "*.cert.jsonl")
    entries: list[Entry] = []
    interrupted = False
    pairs = [(leg, model) for leg in legs or range(1, campaign.legs + 1) for model in chosen]
    for leg, model in pairs:
        names, prefix = tuple(contractors), f"{model.name}-"
        asked = (campaign, delta, center, names, engine, None, limits, "none", "bound", folder, None, model, prefix)
        result = answered(Question(*asked), [leg])
        entries += [_entry(found, model) for found in result.legs]
        if progress is not None and result.legs:
            progress(entries[-1])
        interrupted = result.interrupted
        if interrupted:
            break
    summaries = {model.name: model.summary for model in chosen}
    return Comparison(campaign.robot.name, tolerance, summaries, tuple(entries), campaign.sha256, interrupted)


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
    numbers = (found.eps_lo, found.eps_hi, found.enclosure, found.certificate, found.status, found.seconds)
    return Entry(f"leg {found.leg}", model.name, *numbers)
