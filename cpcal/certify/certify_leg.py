"""One leg: its bracket, few measurements that prove it, ranges and projections of its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpcal.certify.bracket import Answered, by_bound, prove_support
from cpcal.certify.certified_ranges import ranges_of
from cpcal.certify.point import verified_center
from cpcal.certify.prepared_leg import PreparedLeg
from cpcal.certify.projections import projections_of
from cpcal.certify.question import Question
from cpcal.certify.timeout_method import by_timeout
from cpcal.certify.undetermined import determination
from cpcal.common.arrays import Floats, Indices
from cpcal.execution.stopping import asked
from cpcal.legs import built_in, exactly_read
from cpcal.results import Determination, LegResult, SupportProof, Uncertified, VerifiedPoint
from cpcal.solver.contract import Verdict
from cpcal.solver.optimize import Alone, Bracket, Known, Minimum, irreducible, minimize, run
from cpcal.solver.optimize import support as find_support

# at most for each proof that a few measurements suffice: a convenience must not cost more than the answer
_SUPPORT_NODES = 3


def certify_leg(question: Question, leg: int | LegResult) -> tuple[LegResult, bool]:
    """The result of one leg, and whether the user interrupted it.

    With what follows the bracket, where the question asks for that; a result that has its bracket gets the rest.
    """
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
    result = replace(_leg_result(leg, found, few), support_proof=proof)
    return result, found.minimum.interrupted or asked() is not None


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


def _leg_result(prepared: PreparedLeg, answer: Answered, few: tuple[int, ...]) -> LegResult:
    question, leg, center = prepared.question, prepared.leg, prepared.center
    found = answer.minimum
    ids, enclosure = question.campaign.measurement_ids, found.enclosure
    eps = question.options.eps or 0.0
    good, bad = verified_center(prepared)
    names, beyond = question.model.parameters, found.found
    return LegResult(
        leg=leg,
        verdict=found.verdict,
        eps_lo=_lower(question, found),
        eps_hi=float(found.hi),
        point=None if found.witness is None else tuple(float(v) for v in found.witness.point[:-1]),
        center=tuple(float(v) for v in center),
        enclosure=type(enclosure)(names, enclosure.lo[:-1], enclosure.hi[:-1]),
        floor=float(found.floor),
        support=tuple(ids[k] for k in few),
        nodes=found.nodes,
        programs=found.programs,
        seconds=found.seconds,
        certificate=answer.certificate,
        not_certified=_not_certified(question, leg, answer),
        verified=VerifiedPoint(eps, len(good), len(bad), len(question.campaign)),
        determination=_determination(question, leg, center, found),
        trials=answer.trials,
        contractors_used=found.contractors_used,
        found_lo=beyond.lo if beyond is not None and beyond.lo > found.lo else None,
        found_enclosure=None
        if beyond is None
        else type(enclosure)(names, beyond.enclosure.lo[:-1], beyond.enclosure.hi[:-1]),
        pending=found.pending,
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
