"""The main job: a campaign in, for every leg a proved bracket of its smallest model error out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.common.files import write_file
from cpcal.common.values import Floats, Indices
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import RUN, answers_into
from cpcal.models import LegModel, built_in, exactly_read
from cpcal.questions import (
    CampaignNote,
    Determination,
    LegBracket,
    LegResult,
    ModelNote,
    Options,
    Result,
    Support,
    SupportProof,
    Uncertified,
    VerifiedPoint,
    Work,
    model_of,
)
from cpcal.questions.bracket import (
    Answered,
    PreparedLeg,
    by_bound,
    by_timeout,
    prove_support,
    verified_center,
)
from cpcal.questions.outliers import robust_leg
from cpcal.questions.question import (
    HERE,
    Checkpoints,
    Progress,
    Question,
    absent_legs,
    answers,
    beyond_all_legs,
    chosen_model,
    placed,
)
from cpcal.questions.ranges import projections_of, range_eps, ranges_of
from cpcal.questions.undetermined import determination
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.accounts import Found
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.executors import Here, Place, executor_for
from cpcal.solver.execution.stopping import asked, heard, within_memory
from cpcal.solver.optimize.bound import minimize, run
from cpcal.solver.optimize.local import Known
from cpcal.solver.optimize.minimum import Alone, Bracket, Minimum, irreducible
from cpcal.solver.optimize.minimum import support as find_support

if TYPE_CHECKING:
    from distributed import Client

# ------------------------------------------------------------------------------------------------------------------
# One leg: its bracket, few measurements that prove it, ranges and projections of its parameters.

# at most for each proof that a few measurements suffice: a convenience must not cost more than the answer
_SUPPORT_NODES = 3


def certify_leg(question: Question, leg: int | LegResult) -> tuple[LegResult, bool]:
    """The result of one leg, and whether the user interrupted it.

    With what follows the bracket, where the question asks for that; a result that has its bracket gets the rest.
    """
    if question.options.outliers:
        return robust_leg(question, leg.leg if isinstance(leg, LegResult) else leg), asked() is not None
    if isinstance(leg, LegResult):
        prepared, result, stopped = PreparedLeg.of(question, leg.leg, np.array(leg.center)), leg, False
    else:
        prepared = PreparedLeg.of(question, leg)
        result, stopped = _bracketed(prepared)
    if not question.whole or stopped:
        return result, stopped
    ranges, stopped = ranges_of(prepared, result)
    result = replace(result, ranges=ranges)
    try:
        drawn = None if stopped else projections_of(prepared, result)
    except KeyboardInterrupt:
        return result, True
    return replace(result, projections=drawn), stopped or asked() is not None


def _bracketed(leg: PreparedLeg) -> tuple[LegResult, bool]:
    question, number = leg.question, leg.leg
    start = np.append(leg.center, question.options.eps or 0.0)

    def tell(bracket: Bracket) -> None:
        if question.progress is not None:
            question.progress(number, bracket)

    answer = by_bound if question.options.method == "bound" else by_timeout
    found = answer(leg, start, tell)
    few, proof = _support(leg, start, found.minimum)
    return _leg_result(leg, found, few, proof), found.minimum.interrupted or asked() is not None


def _support(leg: PreparedLeg, start: Floats, found: Minimum) -> tuple[tuple[int, ...], SupportProof | None]:
    """The measurements, and what is proved of them alone where a certificate of it was asked for."""
    question = leg.question
    if question.options.support == "none":
        return (), None
    gap, short = question.limits.gap, replace(question.limits, nodes=_SUPPORT_NODES)
    best = Known(found.witness, 0)

    def alone(elements: Indices) -> Alone:
        """The lower bound by a part of the measurements; the best point of all is one of theirs."""
        problem, named = leg.alone(elements)
        states = minimize(
            problem.network,
            "eps",
            named,
            engine=question.engine,
            limits=short,
            best=best,
            prepared=problem,
            enclose=False,
        )
        least = run(states, None)
        members = (k for _, k in least.rows) if leg.restrictable else elements.tolist()
        better = least.witness if least.hi < found.hi else None
        return Alone(least.lo, frozenset(members), None if better is None else better.point, least.interrupted)

    few = find_support(leg.problem, found, gap, alone)
    if question.options.support == "irreducible" and few:
        few = irreducible(found, few, gap, alone)
        if question.certificates is not None and not asked():
            return few, prove_support(leg, start if found.witness is None else found.witness.point, few)
    return few, None


def _leg_result(prepared: PreparedLeg, answer: Answered, few: tuple[int, ...], proof: SupportProof | None) -> LegResult:
    question, leg, center = prepared.question, prepared.leg, prepared.center
    found = answer.minimum
    ids, enclosure = question.campaign.measurement_ids, found.enclosure
    eps = question.options.eps or 0.0
    good, bad = verified_center(prepared)
    names, beyond = question.model.parameters, found.found
    lo = _lower(question, found)
    return LegResult(
        leg=leg,
        bracket=LegBracket(
            verdict=found.verdict,
            lo=lo,
            hi=float(found.hi),
            point=None if found.witness is None else tuple(float(v) for v in found.witness.point[:-1]),
            center=tuple(float(v) for v in center[:7]),
            enclosure=type(enclosure)(names, enclosure.lo[:-1], enclosure.hi[:-1]),
            certificate=answer.certificate,
        ),
        support=Support(tuple(ids[k] for k in few), proof),
        not_certified=_not_certified(question, leg, answer),
        verified=VerifiedPoint(eps, len(good), len(bad), len(question.campaign)),
        extra=tuple(float(v) for v in center[7:]),
        determination=_determination(question, leg, center, found),
        found=None
        if beyond is None
        else Found(
            beyond.lo if beyond.lo > found.lo else lo,
            type(enclosure)(names, beyond.enclosure.lo[:-1], beyond.enclosure.hi[:-1]),
        ),
        work=Work(
            nodes=found.nodes,
            programs=found.programs,
            seconds=found.seconds,
            pending=found.pending,
            floor=float(found.floor),
            trials=answer.trials,
            contractors_used=found.contractors_used,
        ),
    )


def _lower(question: Question, found: Minimum) -> float:
    """The proved lower bound of eps: where one eps was asked about, only its refutation says something of it."""
    if question.options.eps is None:
        return float(found.lo)
    return question.options.eps if found.verdict is Verdict.REFUTED else 0.0


def _determination(question: Question, leg: int, center: Floats, found: Minimum) -> Determination | None:
    """At the proved point, or the center of the box; None for a box that is a point."""
    if question.options.delta == 0.0:
        return None
    at = center if found.witness is None else found.witness.point[:-1]
    return determination(question.campaign, leg, at, question.model)


def _not_certified(question: Question, leg: int, answer: Answered) -> Uncertified:
    """Why there is no certificate."""
    if answer.certificate is not None:
        return Uncertified.NOTHING
    if question.certificates is None:
        return Uncertified.NOT_ASKED
    if answer.lost:
        return answer.lost
    if answer.minimum.interrupted:
        return Uncertified.INTERRUPTED
    if not built_in(question.model) and not exactly_read(question.campaign, leg):
        return Uncertified.MODEL
    return Uncertified.NOTHING_PROVED


LOADS = ("cpcal.questions.ask", "cpcal.solver.numba_begun")  # of workers


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
    outliers: int = 0,
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
    With `outliers` the bracket holds whichever so many measurements of a leg are wrong, nobody knows which.

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
    question = question_of(
        campaign,
        progress=progress,
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
        outliers=outliers,
        support=support,
        method=method,
        model=model,
        half_widths=half_widths or {},
    )
    with heard(), within_memory(memory_limit), executor_for(workers, scheduler, executor, loads=LOADS) as place:
        if certificates is None:
            return answered(question, place)
        with answers_into(certificates, RUN, campaign) as draft:
            kept = Checkpoints.for_run(Path(certificates), question, resume=resume)
            kept.begin()
            result = answered(replace(question, certificates=draft, checkpoints=kept), place)
    kept.end_after(result)
    return result


def question_of(
    campaign: Campaign, others: Sequence[Problem] = (), *, progress: Progress | None = None, **given: Any
) -> Question:
    """What is asked with the options that are `given`, if this campaign can be asked it.

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
    if options.outliers >= len(campaign):
        remedy = f"give a whole number below {len(campaign)}, such as 1"
        problems.append(
            Problem("outliers", f"{options.outliers} is no number of measurements that may be wrong", remedy)
        )
    if problems:
        raise InputError(problems)
    plugins.check_names(options.contractors)
    return Question(campaign=campaign, options=options, model=model, progress=progress)


def with_ranges(
    campaign: Campaign,
    result: Result,
    *,
    certificates: str | os.PathLike[str] | None = None,
    model: LegModel | None = None,
) -> Result:
    """The result with `ranges`, and what the page draws, for every leg that has a tolerance to ask them at.

    `certificates`: a folder for `ranges-legN.cert.jsonl`, which prove them. `model`: the leg model, where no installed
    package provides it. Ctrl-C ends it with what is done. Raises InputError without the model.
    """
    if result.interrupted:
        return result
    question = Question(
        campaign=campaign,
        options=replace(result.options, legs=tuple(leg.leg for leg in result.legs)),
        model=model_of(result, model),
        certificates=None if certificates is None else Path(certificates),
        whole=True,
    )
    found = answered(question, known=result.legs)
    return replace(result, legs=found.legs, interrupted=found.interrupted)


def answered(question: Question, place: Place = HERE, known: Sequence[LegResult] = ()) -> Result:
    """All legs; of those that are `known` what is to follow their brackets.

    Raises LostWorkerError, and InputError for a question that cannot travel to where the work is done.
    """
    campaign, model = question.campaign, question.model
    numbers = question.options.legs or tuple(range(1, campaign.legs + 1))
    beyond = beyond_all_legs(question, numbers)
    if beyond:
        raise InputError(beyond)
    kept = question.checkpoints
    done = {leg.leg: leg for leg in known} if kept is None else _resumed(question, kept, numbers)
    left = [done.get(leg, leg) for leg in numbers if leg not in done or _begun(question, done[leg])]
    question, place = placed(question, len(left), place)
    here = isinstance(place[0], Here)
    interrupted = False
    try:
        for answer in answers(question, certify_leg, left, place):
            leg, stopped = answer.found
            interrupted = interrupted or stopped
            done[leg.leg] = with_certificates(question, answer.files, leg)
            if kept is not None and not (stopped or leg.work.pending or leg.not_certified is Uncertified.UNWRITTEN):
                begun = kept.answer(leg.leg) if isinstance(answer.asked, LegResult) else None
                kept.keep_answer(leg, answer.files if begun is None else {**begun[1], **answer.files})
            if question.progress is not None and not here:
                question.progress(
                    leg.leg,
                    Bracket(leg.bracket.lo, leg.bracket.hi, leg.work.nodes, leg.work.programs, leg.work.seconds),
                )
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
    whole = question.whole and not question.options.outliers
    return whole and leg.ranges is None and range_eps(question.options, leg) is not None


def with_certificates(question: Question, files: Mapping[str, bytes], leg: LegResult) -> LegResult:
    """The leg, its certificates in the folder for them; where they cannot be written it stays, without them."""
    for name, content in files.items():
        assert question.certificates is not None
        try:
            write_file(question.certificates / name, content)
        except InputError:
            if leg.ranges is not None and name == leg.ranges.certificate != leg.bracket.certificate:
                leg = replace(leg, ranges=replace(leg.ranges, certificate=None))
            else:
                bracket = replace(leg.bracket, certificate=None)
                leg = replace(leg, bracket=bracket, not_certified=Uncertified.UNWRITTEN)
    return leg
