"""Brackets of one leg's eps by branch and bound, with certificates where they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpcal.certify.question import Floats, Question
from cpcal.solver.certificate.recording import Recording, certifying, claims_of
from cpcal.solver.contract import Contractor
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.restrict import restricted
from cpcal.solver.optimize import Bracket, Minimum, Trial, minimize, run
from cpcal.solver.search import Event


@dataclass(frozen=True)
class Answered:
    """A leg's bracket, the name of its certificate, and the calls of the solver that led to it (method timeout)."""

    minimum: Minimum
    certificate: str | None = None
    trials: tuple[Trial, ...] = ()


def by_bound(
    question: Question, leg: int, network: ConstraintNetwork, start: Floats, tell: Callable[[Bracket], None]
) -> Answered:
    """Branch and bound. With certificates the contractors that give weights do it alone, if there is one."""

    def solved(contractor: Contractor, observe: Callable[[Event], None] | None) -> Minimum:
        engine, limits = question.engine, question.limits
        return run(
            minimize(network, "eps", contractor, engine=engine, limits=limits, start=start, observe=observe), tell
        )

    parts = question.parts(network)
    useful = certifying(parts)
    statement = question.statement(leg, network.domain) if question.certificates is not None and useful else None
    if statement is None:
        return Answered(solved(question.composed(parts), None))
    with Recording(statement, network.domain) as recording:
        found = solved(recording.contractor(useful), recording.event)
        if found.interrupted or (found.witness is None and found.lo <= network.domain["eps"].lo):
            return Answered(found)  # nothing is proved, or the last step may be half written
        claims = claims_of(found, network.domain, "eps")
        return Answered(found, recording.write(question.certificate(leg), claims).name)


def prove_support(
    question: Question, leg: int, network: ConstraintNetwork, start: Floats, few: tuple[int, ...]
) -> None:
    """Write a certificate that speaks of a few measurements only, and proves the lower bound that they give."""
    smaller = restricted(network, [np.array(few, dtype=np.intp)] * len(network.constraints))
    useful, engine, limits = certifying(question.parts(smaller)), question.engine, question.limits
    statement = question.statement(leg, network.domain, few)
    if not useful or statement is None:
        return
    with Recording(statement, network.domain) as recording:
        contractor, observe = recording.contractor(useful), recording.event
        found = run(
            minimize(
                smaller,
                "eps",
                contractor,
                engine=engine,
                limits=limits,
                start=start,
                enclose=False,
                observe=observe,
            ),
            None,
        )
        if not found.interrupted:
            claims = claims_of(found, network.domain, "eps", lower_only=True)
            recording.write(question.certificate(leg, ".support"), claims)
