"""Brackets of one leg's eps by branch and bound, with certificates where they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cpcal.certify.question import Question
from cpcal.common.arrays import Floats
from cpcal.results.support_proof import SupportProof
from cpcal.solver.certificate.recording import Recording, claims_of
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.restrict import restricted
from cpcal.solver.optimize import Bracket, Minimum, Trial, minimize, run
from cpcal.solver.search import Contracting, Event, StepProver


@dataclass(frozen=True)
class Answered:
    """A leg's bracket, the name of its certificate, and the calls of the solver that led to it (method timeout)."""

    minimum: Minimum
    certificate: str | None = None
    trials: tuple[Trial, ...] = ()


def by_bound(
    question: Question,
    leg: int,
    network: ConstraintNetwork,
    start: Floats,
    tell: Callable[[Bracket], None],
    *,
    hull_only: bool = False,
) -> Answered:
    """Branch and bound, by all contractors asked for; with certificates, what weights prove of it is the answer.

    `hull_only`: the certificate claims the enclosure alone, since nothing else is going to be stated.
    """
    named = question.named(network)

    def solved(prover: StepProver | None, observe: Callable[[Event], None] | None) -> Minimum:
        engine, limits = question.engine, question.limits
        states = minimize(
            network, "eps", named, engine=engine, limits=limits, start=start, prover=prover, observe=observe
        )
        return run(states, tell)

    wanted = question.certificates is not None and Contracting(named).gives_weights
    statement = question.statement(leg, network.domain) if wanted else None
    if statement is None:
        return Answered(solved(None, None))
    with Recording(statement, network.domain) as recording:
        found = solved(recording.prover, recording.event)
        if found.interrupted or (found.witness is None and found.lo <= network.domain["eps"].lo):
            return Answered(found)  # nothing is proved, or the last step may be half written
        claims = claims_of(found, network.domain, "eps") | ({"point": None} if hull_only else {})
        path = recording.write(question.certificate(leg), claims)
        found = replace(found, contractors_used=recording.credited(found.contractors_used))
        return Answered(found, path.name)


def prove_support(
    question: Question, leg: int, network: ConstraintNetwork, start: Floats, few: tuple[int, ...]
) -> SupportProof | None:
    """Write a certificate that speaks of a few measurements only, and proves the lower bound that they give.

    None, and no certificate, where they give none, or contractors without weights.
    """
    smaller = restricted(network, [np.array(few, dtype=np.intp)] * len(network.constraints))
    named, engine, limits = question.named(smaller), question.engine, question.limits
    statement = question.statement(leg, network.domain, few)
    if not Contracting(named).gives_weights or statement is None:
        return None
    with Recording(statement, network.domain) as recording:
        found = run(
            minimize(
                smaller,
                "eps",
                named,
                engine=engine,
                limits=limits,
                start=start,
                enclose=False,
                prover=recording.prover,
                observe=recording.event,
            ),
            None,
        )
        lowest, highest = network.domain["eps"].lo, network.domain["eps"].hi
        if found.interrupted or found.lo <= lowest:
            return None
        path = recording.write(
            question.certificate(leg, ".support"), claims_of(found, network.domain, "eps", lower_only=True)
        )
        return SupportProof(highest if lowest == highest else float(found.lo), path.name)
