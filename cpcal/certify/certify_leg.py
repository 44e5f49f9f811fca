"""One leg: its bracket, and few measurements that prove it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpcal.certify.bracket import Answered, by_bound, prove_support
from cpcal.certify.point import verified_rows
from cpcal.certify.question import Question
from cpcal.certify.timeout_method import by_timeout
from cpcal.certify.undetermined import determination
from cpcal.common.arrays import Floats
from cpcal.execution.stopping import asked
from cpcal.legs import built_in, exactly_read
from cpcal.results import Determination, LegResult, SupportProof, Uncertified, VerifiedPoint
from cpcal.solver.contract import Verdict
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize import Bracket, Minimum, irreducible, minimize, run
from cpcal.solver.optimize import support as find_support

# at most for each proof that a few measurements suffice: a convenience must not cost more than the answer
_SUPPORT_NODES = 3


def certify_leg(question: Question, leg: int) -> tuple[LegResult, bool]:
    """The result of one leg, and whether the user interrupted it."""
    center = question.center(leg)
    network = question.network(leg, center)
    start = np.append(center, question.options.eps or 0.0)

    def tell(bracket: Bracket) -> None:
        if question.progress is not None:
            question.progress(leg, bracket)

    answer = by_bound if question.options.method == "bound" else by_timeout
    found = answer(question, leg, network, start, tell)
    few, proof = _support(question, leg, network, start, found.minimum)
    result = _leg_result(question, leg, center, found, few)
    return replace(result, support_proof=proof), found.minimum.interrupted or asked() is not None


def _support(
    question: Question, leg: int, network: ConstraintNetwork, start: Floats, found: Minimum
) -> tuple[tuple[int, ...], SupportProof | None]:
    """The measurements, and what is proved of them alone where a certificate of it was asked for."""
    if question.options.support == "none":
        return (), None
    gap, short = question.limits.gap, replace(question.limits, nodes=_SUPPORT_NODES)

    def alone(net: ConstraintNetwork) -> Minimum:
        """The lower bound by a part of the measurements."""
        named, engine = question.named(net), question.engine
        return run(minimize(net, "eps", named, engine=engine, limits=short, start=start, enclose=False), None)

    few = find_support(network, "eps", found, gap, alone)
    if question.options.support == "irreducible" and few:
        few = irreducible(network, found, few, gap, alone)
        if question.certificates is not None and not asked():
            best = start if found.witness is None else found.witness.point
            return few, prove_support(question, leg, network, best, few)
    return few, None


def _leg_result(question: Question, leg: int, center: Floats, answer: Answered, few: tuple[int, ...]) -> LegResult:
    found = answer.minimum
    ids, enclosure = question.campaign.measurement_ids, found.enclosure
    eps = question.options.eps or 0.0
    good, bad = verified_rows(question.campaign, leg, center, eps, question.engine, question.model)
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
        certified=answer.certificate is not None,
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
