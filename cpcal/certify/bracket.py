"""Brackets of one leg's eps by branch and bound, with certificates where they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from cpcal.certify.prepared_leg import PreparedLeg
from cpcal.certify.question import Question
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError
from cpcal.execution.stopping import asked
from cpcal.results import SupportProof, Uncertified
from cpcal.solver.accounts import Trial
from cpcal.solver.certificate.affordable import UncheckableError
from cpcal.solver.certificate.recording import Recording, claims_of
from cpcal.solver.certificate.statement import Statement
from cpcal.solver.certificate.writer import WeightProver
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box
from cpcal.solver.network.restrict import restricted
from cpcal.solver.optimize import Bracket, Minimum, minimize, run
from cpcal.solver.search import Contracting, Event, Proof, StepProver


class LegProver:
    """Proves steps of a leg as its certificate will say them, wherever the boxes of its search are decided.

    It travels without the statement, whose equations are functions, and forms it again.
    """

    def __init__(self, question: Question, leg: int, domain: Box, statement: Statement | None = None) -> None:
        self._asked = (replace(question, place=None, progress=None, checkpoints=None), leg, domain)
        self._prover: StepProver | None = None if statement is None else WeightProver(statement)

    def __call__(self, box: Box, proposed: Contraction) -> Proof:
        if self._prover is None:
            question, leg, domain = self._asked
            statement = question.statement(leg, domain)
            assert statement is not None
            self._prover = WeightProver(statement)
        return self._prover(box, proposed)

    def __reduce__(self) -> tuple[type[LegProver], tuple[Question, int, Box]]:
        return LegProver, self._asked


@dataclass(frozen=True)
class Answered:
    """A leg's bracket, the name of its certificate, and the calls of the solver that led to it (method timeout).

    `lost`: why there is none, although something was proved that it could claim.
    """

    minimum: Minimum
    certificate: str | None = None
    trials: tuple[Trial, ...] = ()
    lost: Uncertified = Uncertified.NOTHING


def by_bound(
    leg: PreparedLeg,
    start: Floats,
    tell: Callable[[Bracket], None],
    *,
    domain: Box | None = None,
    hull_only: bool = False,
) -> Answered:
    """Branch and bound, by all contractors asked for; with certificates, what weights prove of it is the answer.

    `domain`: a part of the leg's (default: all of it). `hull_only`: the certificate claims the enclosure alone, since
    nothing else is going to be stated.
    """
    question, domain = leg.question, leg.domain if domain is None else domain

    def solved(
        prover: StepProver | None, observe: Callable[[Event], None] | None, recording: Recording | None
    ) -> Minimum:
        keeper = None if question.checkpoints is None else question.checkpoints.search_keeper(leg.leg, recording)
        states = minimize(
            leg.network,
            "eps",
            leg.named,
            engine=question.engine,
            limits=question.limits,
            domain=domain,
            start=start,
            prepared=leg.problem,
            prover=prover,
            observe=observe,
            resume=None if keeper is None else keeper.resumed(),
            keep=keeper,
            place=question.place,
        )
        found = run(states, tell)
        if keeper is not None:
            keeper.end(found)
        return found

    statement = leg.stated(domain)
    if statement is None:
        return Answered(solved(None, None, None))
    with Recording(statement, domain) as recording:
        found = solved(LegProver(question, leg.leg, domain, statement), recording.event, recording)
        if _torn(found) or (found.witness is None and found.lo <= domain["eps"].lo):
            return Answered(found)  # nothing is proved, or the last step may be half written
        claims = claims_of(found, domain, "eps") | ({"point": None} if hull_only else {})
        name, lost = written(question.certificate(leg.leg), partial(recording.write, claims=claims))
        found = replace(found, contractors_used=recording.credited(found.contractors_used))
        return Answered(found, name, lost=lost)


def prove_support(leg: PreparedLeg, start: Floats, few: tuple[int, ...]) -> SupportProof | None:
    """Write a certificate that speaks of a few measurements only, and proves the lower bound that they give.

    None, and no certificate, where they give none, or contractors without weights.
    """
    question, network = leg.question, leg.network
    smaller = restricted(network, [np.array(few, dtype=np.intp)] * len(network.constraints))
    named, engine, limits = question.named(smaller), question.engine, question.limits
    statement = question.statement(leg.leg, network.domain, few)
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
        if _torn(found) or found.lo <= lowest:
            return None
        claims = claims_of(found, network.domain, "eps", lower_only=True)
        name, _ = written(question.certificate(leg.leg, ".support"), partial(recording.write, claims=claims))
        if name is None:
            return None
        return SupportProof(highest if lowest == highest else float(found.lo), name)


def written(path: Path, write: Callable[[Path], object]) -> tuple[str | None, Uncertified]:
    """The name of a certificate that is written there; None where it cannot be, and why."""
    try:
        write(path)
    except UncheckableError:
        return None, Uncertified.UNCHECKABLE
    except InputError:
        return None, Uncertified.UNWRITTEN
    return path.name, Uncertified.NOTHING


def all_or_none(question: Question, names: Sequence[str | None]) -> tuple[str, ...]:
    """Certificates that prove something together; none, and no files, where one is missing: the others prove less."""
    found = tuple(name for name in names if name is not None)
    if len(found) == len(names):
        return found
    for name in found:
        assert question.certificates is not None
        (question.certificates / name).unlink()
    return ()


def _torn(found: Minimum) -> bool:
    """Whether an exception broke the search off between any two lines, and no stop that it was asked for."""
    return found.interrupted and not asked()
