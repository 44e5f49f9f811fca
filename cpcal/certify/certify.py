"""The main job: a campaign in, for every leg a proved bracket of its smallest model error out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cpcal.certify.asked_model import chosen_model
from cpcal.certify.certify_leg import certify_leg
from cpcal.certify.question import Progress, Question, absent_legs
from cpcal.common.atomic import unwritable
from cpcal.common.errors import InputError, Problem
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import RUN, answers_into
from cpcal.legs import LegModel
from cpcal.results import CampaignNote, LegResult, ModelNote, Options, Result
from cpcal.robot import Campaign
from cpcal.solver import plugins


def certify(
    campaign: Campaign,
    *,
    legs: Sequence[int] | None = None,
    delta: float = 100.0,
    center: str = "fit",
    gap: float = 1e-6,
    time_limit: float | None = None,
    contractors: Sequence[str] = ("lifted",),
    arithmetic: str = "float64",
    eps: float | None = None,
    tolerance: float | None = None,
    support: str = "few",
    method: str = "bound",
    certificates: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    model: str | LegModel | None = None,
    half_widths: Mapping[str, float] | None = None,
) -> Result:
    """For every leg the smallest eps for which some x satisfies all N equations, bracketed by proofs.

    "Satisfies" means: for every measurement THERE EXISTS a reading in its set with `|g(x, M_k)| <= eps`.
    x ranges over all parameters within `delta` mm of the center: "fit" (least squares), "plain" (of the plain model) or
    "nominal". `legs` counts from 1 (default: all). `gap` is relative, `time_limit` in seconds per leg. With `eps` (mm)
    the question is instead whether S(eps) is empty. `progress` is called with (leg, Bracket) as the brackets shrink.
    `tolerance` (mm) is kept with the result: the error that the robot may have.

    `support` "irreducible" leaves out of each leg's support every measurement that the proof can do without; "few" does
    not try; with "none" no support is sought. `certificates` names a folder for `legN.cert.jsonl`, which prove the
    answers to `cpcal verify` (and `legN.support.cert.jsonl`, that an irreducible support alone proves eps_lo): then
    every step of a contractor that gives weights (lifted) is proved once more in exact arithmetic before it counts for
    the answer. All contractors take part; what they prove beyond the certificate is told as found (`found_lo`).
    Certificates replace those of an earlier run, and its answers, when all legs are done.

    `method` "bound" is branch and bound on eps; "timeout" is the method of the paper's section 5.2.1, which asks a
    solver made of the contractors for points at one eps after the other, and needs a `time_limit`.

    `model` is the leg model: "plain", "gain", "linear", "lateral", the name of one that an installed package provides,
    or a `LegModel` (default: the campaign's, else plain). Its extra parameters range within `half_widths` of 0: those
    given by name, else its own.

    Ctrl-C ends it with what is proved so far. Raises InputError, PluginError.
    """
    options, corrected = checked_options(
        campaign,
        legs=legs,
        delta=delta,
        center=center,
        gap=gap,
        time_limit=time_limit,
        contractors=contractors,
        arithmetic=arithmetic,
        eps=eps,
        tolerance=tolerance,
        support=support,
        method=method,
        model=model,
        half_widths=half_widths or {},
    )
    question = Question(campaign=campaign, options=options, model=corrected, progress=progress)
    if certificates is None:
        return answered(question)
    with answers_into(certificates, RUN, campaign) as draft:
        return answered(replace(question, certificates=draft))


def checked_options(campaign: Campaign, others: Sequence[Problem] = (), **given: Any) -> tuple[Options, LegModel]:
    """Options that this campaign can be asked about, and their leg model.

    Raises InputError with every problem at once, `others` among them; PluginError for a contractor that is not there.
    """
    model, wrong = chosen_model(campaign, given.get("model"), given.get("half_widths"))
    problems = [*others, *wrong, *absent_legs(campaign, given.get("legs"))]
    if isinstance(given.get("model"), LegModel):
        given["model"] = model.name
    try:
        options = Options(**given)
    except InputError as error:
        raise InputError([*problems, *error.problems]) from None
    if problems:
        raise InputError(problems)
    plugins.check_names(options.contractors)
    return options, model


def answered(question: Question) -> Result:
    """The legs one after the other. Raises InputError when a certificate cannot be written."""
    campaign, model = question.campaign, question.model
    done: list[LegResult] = []
    interrupted = False
    for leg in question.options.legs or range(1, campaign.legs + 1):
        try:
            found, interrupted = certify_leg(question, leg)
        except KeyboardInterrupt:
            interrupted = True
            break
        except OSError as error:
            raise unwritable(question.certificates or Path(), error) from None
        done.append(found)
        if interrupted:
            break
    return Result(
        campaign=CampaignNote(campaign_sha256(campaign), campaign.robot.name, len(campaign)),
        options=question.options,
        model=ModelNote(model.name, model.summary, model.extra),
        version=__version__,
        interrupted=interrupted,
        legs=tuple(done),
    )
