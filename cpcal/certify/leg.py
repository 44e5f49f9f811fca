"""One leg: bracket, support, and both in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpcal.certify.bracket import Answered, by_bound, prove_support
from cpcal.certify.determination import determination
from cpcal.certify.point import verified_rows
from cpcal.certify.question import Floats, Question
from cpcal.certify.timeout_method import by_timeout
from cpcal.common.numbers import stated
from cpcal.legs import built_in, exactly_read, leg_statement
from cpcal.results import Determination, LegResult, VerifiedPoint
from cpcal.solver.certificate.readings import at_point, holding
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
    few = _support(question, leg, network, start, found.minimum)
    return _leg_result(question, leg, center, found, few), found.minimum.interrupted


def _support(
    question: Question, leg: int, network: ConstraintNetwork, start: Floats, found: Minimum
) -> tuple[int, ...]:
    if question.options.support == "none":
        return ()
    gap, short = question.limits.gap, replace(question.limits, nodes=_SUPPORT_NODES)

    def alone(net: ConstraintNetwork) -> Minimum:
        """The lower bound by a part of the measurements."""
        named, engine = question.named(net), question.engine
        return run(minimize(net, "eps", named, engine=engine, limits=short, start=start, enclose=False), None)

    few = find_support(network, "eps", found, gap, alone)
    if question.options.support == "irreducible" and few:
        few = irreducible(network, found, few, gap, alone)
        if question.certificates is not None:
            best = start if found.witness is None else found.witness.point
            prove_support(question, leg, network, best, few)
    return few


def _leg_result(question: Question, leg: int, center: Floats, answer: Answered, few: tuple[int, ...]) -> LegResult:
    found = answer.minimum
    ids, enclosure = question.campaign.measurement_ids, found.enclosure
    eps = question.options.eps or 0.0
    good, bad = verified_rows(question.campaign, leg, center, eps, question.engine, question.model)
    names = question.model.parameters
    return LegResult(
        leg=leg,
        verdict=found.verdict,
        status=_sentence(question, leg, found),
        eps_lo=float(found.lo),
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
        found_lo=found.found.lo if found.found is not None and found.found.lo > found.lo else None,
    )


def _determination(question: Question, leg: int, center: Floats, found: Minimum) -> Determination | None:
    """At the proved point, or the center of the box; None for a box that is a point."""
    if question.options.delta == 0.0:
        return None
    at = center if found.witness is None else found.witness.point[:-1]
    return determination(question.campaign, leg, at, question.model)


def _not_certified(question: Question, leg: int, answer: Answered) -> str:
    """Why there is no certificate; empty where there is one."""
    if answer.certificate is not None:
        return ""
    if question.certificates is None:
        return "no certificate was asked for"
    if answer.minimum.interrupted:
        return "the search was interrupted"
    if not built_in(question.model) and not exactly_read(question.campaign, leg):
        return f"with uncertain readings {question.model.name!r}, a user-defined model, has no certificate"
    return "nothing was proved that a certificate could claim"


def _sentence(question: Question, leg: int, found: Minimum) -> str:
    if question.options.eps is not None:
        eps = stated(question.options.eps)
        return {
            Verdict.PROVED: f"Some x in the box satisfies all equations to within {eps} mm for some readings: proved.",
            Verdict.REFUTED: f"No x in the box, with legs longer than {eps} mm, satisfies all equations "
            f"to within {eps} mm for any readings: proved.",
            Verdict.UNKNOWN: f"Stopped before it was known if any x satisfies the equations to within {eps} mm.",
        }[found.verdict] + found.beyond
    if found.witness is not None and found.hi == 0.0:
        how = "proved in exact arithmetic" if _solves_exactly(question, leg, found.witness.point) else "proved"
        return f"Some x in the box satisfies every equation exactly for some readings: {how}.{found.beyond}"
    return found.status


def _solves_exactly(question: Question, leg: int, point: Floats) -> bool:
    """Whether the checker's own arithmetic proves that the point (n + 1,), eps included, satisfies every equation."""
    if not built_in(question.model):
        return False
    problem, x = leg_statement(question.campaign, leg, model=question.model.name).problem, at_point(point.tolist())
    return all(holding(problem, x, k) is not None for k in problem.chosen)
