"""Legs of which some measurements may be wrong: the question of `robust_leg` asked of each, here or by workers."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

from cpcal.certify.certify import LOADS, checked_options
from cpcal.certify.leg_tasks import answers
from cpcal.certify.question import Question
from cpcal.certify.robust_leg import Told, robust_leg
from cpcal.common.atomic import write_file
from cpcal.common.errors import Problem
from cpcal.common.version import __version__
from cpcal.execution.executors import Here, Place, executor_for
from cpcal.execution.stopping import Reason, Stopped, asked, heard
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import ROBUST, answers_into
from cpcal.legs import LegModel
from cpcal.results import CampaignNote, ModelNote
from cpcal.results.robust import RobustResult, save_robust
from cpcal.robot import Campaign


def certify_robust(
    campaign: Campaign,
    *,
    outliers: int,
    legs: Sequence[int] | None = None,
    delta: float = 100.0,
    center: str = "fit",
    time_limit: float | None = None,
    contractors: Sequence[str] = ("lifted",),
    model: str | LegModel | None = None,
    certificates: str | os.PathLike[str] | None = None,
    tell: Told | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | None = None,
) -> RobustResult:
    """For every leg the smallest eps when at most `outliers` of its measurements may be wrong, bracketed by proofs.

    The other options are those of `certify`. `certificates` names a folder for `robust.json` and what proves it to
    `cpcal verify`. `tell` is called with a line on what is done here. Legs are the tasks of `workers` processes, of a
    Dask `scheduler` or of an `executor`. Raises InputError, PluginError, LostWorkerError, Stopped.
    """
    wrong = []
    if isinstance(outliers, bool) or not isinstance(outliers, int) or not 0 <= outliers < len(campaign):
        remedy = f"give a whole number from 0 to {len(campaign) - 1}, such as 2"
        wrong.append(Problem("outliers", f"{outliers!r} is no number of measurements that may be wrong", remedy))
    options, chosen = checked_options(
        campaign,
        wrong,
        legs=legs,
        delta=delta,
        center=center,
        time_limit=time_limit,
        contractors=contractors,
        model=model,
        half_widths={},
    )
    question = Question(campaign=campaign, options=options, model=chosen)
    with heard(), executor_for(workers, scheduler, executor, loads=LOADS) as place:
        if certificates is None:
            return _answered(question, outliers, tell, place)
        with answers_into(certificates, ROBUST, campaign) as draft:
            found = _answered(replace(question, certificates=draft), outliers, tell, place)
            save_robust(found, draft)
    return found


def _answered(question: Question, outliers: int, tell: Told | None, place: Place) -> RobustResult:
    """Raises Stopped where some leg has no answer yet."""
    campaign, model = question.campaign, question.model
    numbers = sorted(question.options.legs or range(1, campaign.legs + 1))
    work = partial(robust_leg, outliers=outliers, tell=tell if isinstance(place[0], Here) else None)
    legs = {}
    for answer in answers(question, work, numbers, place):
        legs[answer.asked] = answer.found
        for name, content in answer.files.items():
            assert question.certificates is not None
            write_file(question.certificates / name, content)
    if len(legs) < len(numbers):
        raise Stopped(asked() or Reason.INTERRUPTED)
    return RobustResult(
        campaign=CampaignNote(campaign_sha256(campaign), campaign.robot.name, len(campaign)),
        options=question.options,
        model=ModelNote(model.name, model.extra),
        outliers=outliers,
        version=__version__,
        legs=tuple(legs[leg] for leg in numbers),
    )
