"""The range of each parameter of a leg at a tolerance: how well its measurements determine it, each side proved."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from cpcal.certify.bracket import by_bound
from cpcal.certify.leg_tasks import HERE, answers
from cpcal.certify.prepared_leg import PreparedLeg
from cpcal.certify.question import Question
from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError
from cpcal.execution.executors import Place
from cpcal.legs import LegModel
from cpcal.results import LegResult, Options, Ranges, Result, model_of
from cpcal.robot import Campaign
from cpcal.solver.contract import Verdict

MARGIN = 1.1  # times eps_hi: at eps_hi itself hardly more than one point is left
PREFIX = "ranges-"  # of the certificates' names


def with_ranges(
    campaign: Campaign,
    result: Result,
    *,
    certificates: str | os.PathLike[str] | None = None,
    model: LegModel | None = None,
    place: Place = HERE,
) -> Result:
    """The result with `ranges` for every leg that has a tolerance to ask them at (`range_eps`).

    `certificates`: a folder for `ranges-legN.cert.jsonl`, which prove them. `model`: the leg model, where no installed
    package provides it. `place`: where the work is done. Ctrl-C ends it with what is done. Raises InputError without
    the model.
    """
    if result.interrupted:
        return result
    folder = None if certificates is None else Path(certificates)
    question = Question(
        campaign=campaign,
        options=result.options,
        model=model_of(result, model),
        certificates=folder,
    )
    found: dict[int, LegResult] = {leg.leg: leg for leg in result.legs}
    left = set(found)
    interrupted = False
    try:
        for answer in answers(question, _ranges, result.legs, place):
            ranges, stopped = answer.found
            interrupted = interrupted or stopped
            if stopped:
                continue
            leg = answer.asked
            left.discard(leg.leg)
            found[leg.leg] = replace(leg, ranges=_written(folder, answer.files, ranges))
    except KeyboardInterrupt:
        interrupted = True
    legs = tuple(found[leg.leg] for leg in result.legs)
    return replace(result, legs=legs, interrupted=interrupted or bool(left))


def _written(folder: Path | None, files: Mapping[str, bytes], ranges: Ranges | None) -> Ranges | None:
    """The ranges, with their certificate in the folder; without it where it cannot be written."""
    try:
        for name, content in files.items():
            assert folder is not None
            write_file(folder / name, content)
    except InputError:
        return None if ranges is None else replace(ranges, certificate=None)
    return ranges


def range_eps(options: Options, leg: LegResult) -> float | None:
    """The eps asked about; else the tolerance, if the leg reaches it; else eps_hi and a tenth. None where none does."""
    if options.eps is not None:
        return None if leg.verdict is Verdict.REFUTED else options.eps
    if leg.point is None or not math.isfinite(leg.eps_hi):
        return None
    if options.tolerance is not None and leg.eps_hi <= options.tolerance:
        return options.tolerance
    return MARGIN * leg.eps_hi


def _ranges(question: Question, leg: LegResult) -> tuple[Ranges | None, bool]:
    if _asked_at(question.options, leg) is None:
        return _without_search(question.options, leg), False
    return ranges_of(PreparedLeg.of(question, leg.leg, np.array(leg.center)), leg)


def _asked_at(options: Options, leg: LegResult) -> float | None:
    """The eps of a search for the ranges; None where none is needed."""
    return None if options.eps is not None else range_eps(options, leg)


def _without_search(options: Options, leg: LegResult) -> Ranges | None:
    """They are what was asked, where one eps was asked about."""
    eps = range_eps(options, leg)
    return None if eps is None or leg.enclosure.is_empty else Ranges(eps, leg.enclosure, leg.certificate)


def ranges_of(prepared: PreparedLeg, leg: LegResult) -> tuple[Ranges | None, bool]:
    """The ranges of a leg that has its bracket, and whether the user interrupted the search for them."""
    question = prepared.question
    eps = _asked_at(question.options, leg)
    if eps is None:
        return _without_search(question.options, leg), False
    domain = prepared.at(eps)
    if domain.is_empty:
        return None, False
    options = replace(question.options, eps=eps, method="bound")
    asked = replace(question, options=options, prefix=PREFIX, checkpoints=None)
    start = np.append(leg.center if leg.point is None else leg.point, eps)
    answer = by_bound(prepared.asking(asked), start, lambda _: None, domain=domain, hull_only=True)
    box = answer.minimum.enclosure
    if box.is_empty or answer.minimum.interrupted:
        return None, answer.minimum.interrupted
    return Ranges(eps, type(box)(leg.enclosure.names, box.lo[:-1], box.hi[:-1]), answer.certificate), False
