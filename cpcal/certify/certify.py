"""The main job: a campaign in, for every leg a proved bracket of its smallest model error out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpcal.certify.asked_model import chosen_model
from cpcal.certify.certified_ranges import range_eps
from cpcal.certify.certify_leg import certify_leg
from cpcal.certify.checkpoints import Checkpoints
from cpcal.certify.leg_tasks import HERE, answers, placed
from cpcal.certify.question import Progress, Question, absent_legs, beyond_all_legs
from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, Problem
from cpcal.common.version import __version__
from cpcal.execution.executors import Here, Place, executor_for
from cpcal.execution.stopping import heard, within_memory
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import RUN, answers_into
from cpcal.legs import LegModel
from cpcal.results import CampaignNote, LegResult, ModelNote, Options, Result, Uncertified
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.optimize import Bracket

if TYPE_CHECKING:
    from distributed import Client

LOADS = ("cpcal.certify.certify", "cpcal.solver.numba_begun")  # of workers


def certify(
    campaign: Campaign,
    *,
    legs: Sequence[int] | None = None,
    delta: float = 100.0,
    center: str = "fit",
    gap: float = 1e-6,
    time_limit: float | None = None,
    node_limit: int | None = None,
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
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | Client | None = None,
    memory_limit: int | None = None,
    resume: bool = False,
) -> Result:
    """For every leg the smallest eps for which some x satisfies all N equations, bracketed by proofs.

    "Satisfies" means: for every measurement THERE EXISTS a reading in its set with `|g(x, M_k)| <= eps`.
    x ranges over all parameters within `delta` mm of the center: "fit" (least squares), "plain" (of the plain model) or
    "nominal". `legs` counts from 1 (default: all). `gap` is relative; `time_limit` (seconds) and `node_limit` (boxes)
    are of each leg. With `eps` (mm) the question is instead whether S(eps) is empty. `progress` is called with
    (leg, Bracket) as the brackets shrink. `tolerance` (mm) is kept with the result: the error that the robot may have.

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

    `workers` processes of this machine, the Dask cluster whose `scheduler` has that address, or an `executor` (any of
    `concurrent.futures`, or a `distributed.Client`) do the legs; left out: this process does, one after the other. The
    certificates are the same, byte for byte.

    Ctrl-C ends it with what is proved so far, and certificates of that; so does a process (without its workers) that
    takes more than `memory_limit` bytes. Until all is answered the folder keeps what is done in `checkpoint`; with
    `resume` another call goes on from there, whatever its limits, to the same certificates.

    Raises InputError, PluginError, LostWorkerError.
    """
    options, corrected = checked_options(
        campaign,
        legs=legs,
        delta=delta,
        center=center,
        gap=gap,
        time_limit=time_limit,
        node_limit=node_limit,
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
    with heard(), within_memory(memory_limit), executor_for(workers, scheduler, executor, loads=LOADS) as place:
        if certificates is None:
            return answered(question, place)
        with answers_into(certificates, RUN, campaign) as draft:
            kept = Checkpoints.for_run(Path(certificates), campaign, options, corrected, resume=resume)
            kept.begin()
            result = answered(replace(question, certificates=draft, checkpoints=kept), place)
    kept.end_after(result)
    return result


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


def answered(question: Question, place: Place = HERE) -> Result:
    """All legs. Raises LostWorkerError, and InputError for a question that cannot travel to where the work is done."""
    campaign, model = question.campaign, question.model
    numbers = question.options.legs or tuple(range(1, campaign.legs + 1))
    beyond = beyond_all_legs(question, numbers)
    if beyond:
        raise InputError(beyond)
    kept = question.checkpoints
    done = {} if kept is None else _resumed(question, kept, numbers)
    left = [done.get(leg, leg) for leg in numbers if leg not in done or _begun(question, done[leg])]
    question, place = placed(question, len(left), place)
    here = isinstance(place[0], Here)
    interrupted = False
    try:
        for answer in answers(question, certify_leg, left, place):
            leg, stopped = answer.found
            interrupted = interrupted or stopped
            done[leg.leg] = with_certificates(question, answer.files, leg)
            if kept is not None and not (stopped or leg.pending or leg.not_certified is Uncertified.UNWRITTEN):
                begun = kept.answer(leg.leg) if isinstance(answer.asked, LegResult) else None
                kept.keep_answer(leg, answer.files if begun is None else {**begun[1], **answer.files})
            if question.progress is not None and not here:
                question.progress(leg.leg, Bracket(leg.eps_lo, leg.eps_hi, leg.nodes, leg.programs, leg.seconds))
            if stopped and here:
                break
    except KeyboardInterrupt:
        interrupted = True
    return Result(
        campaign=CampaignNote(campaign_sha256(campaign), campaign.robot.name, len(campaign)),
        options=question.options,
        model=ModelNote(model.name, model.extra),
        version=__version__,
        interrupted=interrupted or len(done) < len(numbers),
        legs=tuple(done[leg] for leg in numbers if leg in done),
    )


def _resumed(question: Question, kept: Checkpoints, numbers: Sequence[int]) -> dict[int, LegResult]:
    """The legs that an earlier run has answered, their certificates in the folder for them."""
    done = {}
    for number in numbers:
        found = kept.answer(number)
        if found is not None:
            done[number] = with_certificates(question, found[1], found[0])
    return done


def _begun(question: Question, leg: LegResult) -> bool:
    """Whether a leg with its bracket lacks what is to follow."""
    return question.whole and leg.ranges is None and range_eps(question.options, leg) is not None


def with_certificates(question: Question, files: Mapping[str, bytes], leg: LegResult) -> LegResult:
    """The leg, its certificates in the folder for them; where they cannot be written it stays, without them."""
    for name, content in files.items():
        assert question.certificates is not None
        try:
            write_file(question.certificates / name, content)
        except InputError:
            if leg.ranges is not None and name == leg.ranges.certificate != leg.certificate:
                leg = replace(leg, ranges=replace(leg.ranges, certificate=None))
            else:
                leg = replace(leg, certificate=None, not_certified=Uncertified.UNWRITTEN)
    return leg
