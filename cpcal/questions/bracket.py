"""Brackets of one leg's eps: by branch and bound, or by the paper's timeout method, with certificates."""

import time
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.errors import InputError
from cpcal.common.values import Floats, Places
from cpcal.models import built_in, leg_box, leg_network, model_statement, of_measurements
from cpcal.questions.question import Question
from cpcal.questions.result import Uncertified
from cpcal.solver import plugins
from cpcal.solver.accounts import Trial
from cpcal.solver.certificate.exact_network import Statement
from cpcal.solver.certificate.prover import Claims, WeightProver, claims
from cpcal.solver.certificate.recording import Recording, SearchKeeper, UncheckableError, claims_of
from cpcal.solver.contract import Contraction, Contractor, Limits, Named, Repeat, TakesParts, Verdict, givers
from cpcal.solver.execution.checkpoint_file import Line
from cpcal.solver.execution.stopping import asked
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize.bound import Bracket, Minimum, Progress, minimize, run
from cpcal.solver.optimize.timeout import TimeoutOutcome, ask, timeout
from cpcal.solver.optimize.witness import Prepared, Witness
from cpcal.solver.search.passes import Contracting, LargestFirst, Proof

# ------------------------------------------------------------------------------------------------------------------
# One leg, or some of its measurements, set up for the searches about it.
#
# It is passed from one question to the next: bracket, support, ranges. What contractors keep of the boxes
# before (expanded rows, for the readings that decide there) serves the next question, which comes by the same boxes.


def network_of(question: Question, leg: int, center: Floats, highest: float | None = None) -> ConstraintNetwork:
    """The equations of a leg (from 1), eps up to what they allow, or `highest`, or the one that is asked about."""
    box, eps = leg_box(center, question.options.delta, question.model), question.options.eps
    if highest is None:  # a leg is longer than eps, which bounds eps
        longest = float(np.nextafter(np.min(question.campaign.length[:, leg - 1]) + box.hi[6], np.inf))
        highest = max(longest, 0.0)
    domain = (0.0, highest) if eps is None else (eps, eps)
    return leg_network(question.campaign, leg, box, eps=domain, model=question.model)


_AGAIN = 0.8  # share of a width below which another pass is worth while


class PreparedLeg(NamedTuple):
    """A leg (from 1) of a question, around `center` (n,): parameters of the model in mm.

    problem    its equations
    named      the contractors asked for, for all of these
    only       the measurements, numbers from 0; None: all
    statement  what its certificates say; None where there are none, or where they depend on the values of eps
    """

    question: Question
    leg: int
    center: Floats
    problem: Prepared
    named: list[tuple[str, Contractor]]
    only: Places | None
    statement: Statement | None = None

    @property
    def domain(self) -> Box:
        """All parameters, and every eps that is asked about."""
        return self.problem.network.domain

    def alone(self, only: Places) -> "PreparedLeg":
        """The same for some measurements, without a certificate: no search need look at a box between two passes."""
        network, again = of_measurements(self.problem.network, only), list[Named]()
        for name, whole in self.named:
            if isinstance(whole, TakesParts):
                part = whole.among(network, np.array(only, np.intp))
            else:
                part = plugins.load(name)(network, objective="eps")
            again.append((name, Repeat(part, _AGAIN)))
        return self._replace(problem=Prepared(network, "eps"), named=again, only=only, statement=None)

    def stated(self, domain: Box) -> Statement | None:
        """What a certificate about a part of the domain would say; None where none is wanted, or there can be none."""
        question = self.question
        if question.certificates is None or not any(givers(contractor) for _, contractor in self.named):
            return None
        return self.statement or model_statement(question.campaign, self.leg, question.model, domain, self.only)


def prepared_leg(
    question: Question,
    leg: int,
    *,
    center: Floats | None = None,
    only: Places | None = None,
    highest: float | None = None,
) -> PreparedLeg:
    """`center`: where it is known. `only`: some measurements. `highest`: eps up to that."""
    center = question.center(leg) if center is None else center
    network = of_measurements(network_of(question, leg, center, highest), only)
    found = PreparedLeg(
        question=question,
        leg=leg,
        center=center,
        problem=Prepared(network, "eps"),
        named=plugins.build_each(network, question.options.contractors, objective="eps"),
        only=only,
    )
    return found._replace(statement=found.stated(network.domain)) if built_in(question.model) else found


class LegProver:
    """Proves steps of a leg as its certificate will say them, wherever the boxes of its search are decided.

    It travels without the statement, whose equations are functions, and forms it again.
    """

    def __init__(self, leg: PreparedLeg, domain: Box, statement: Statement) -> None:
        question = leg.question
        self._asked = (question.campaign, leg.leg, question.model, domain, leg.only)
        self._prover = WeightProver(statement)

    def __call__(self, box: Box, proposed: Contraction) -> Proof:
        if self._prover is None:
            statement = model_statement(*self._asked)
            assert statement is not None
            self._prover = WeightProver(statement)
        return self._prover(box, proposed)

    def __getstate__(self) -> dict[str, Any]:
        return {"_asked": self._asked, "_prover": None}


# ------------------------------------------------------------------------------------------------------------------
# Every search about a leg, and what its certificate claims.


class Answered(NamedTuple):
    """What was found, the name of its certificate, and the calls of the solver that led to it (method timeout).

    `lost`: why there is no certificate, although something was proved that it could claim. `steps`: of a search for
    an enclosure, for one that goes on in the box that it left.
    """

    minimum: Minimum
    certificate: str | None = None
    lost: Uncertified = Uncertified.NOTHING
    trials: tuple[Trial, ...] = ()
    steps: tuple[Line, ...] = ()


ToClaim = Callable[[Minimum, Box], Claims | None]


def the_answer(found: Minimum, domain: Box) -> Claims | None:
    """All that a search has proved; None where that is nothing."""
    nothing = found.witness is None and found.lo <= domain["eps"].lo
    return None if nothing else claims_of(found, domain, "eps")


def the_enclosure(found: Minimum, domain: Box) -> Claims | None:
    """That alone, since nothing else is going to be stated."""
    said = the_answer(found, domain)
    return None if said is None else said | {"epsilon": None, "point": None}


def searched(
    leg: PreparedLeg,
    to_claim: ToClaim | None = None,
    *,
    file: str | None = None,
    domain: Box | None = None,
    begun: Answered | None = None,
    limits: Limits | None = None,
    tell: Progress = None,
    **how: Any,
) -> Answered:
    """Branch and bound on eps, by all contractors asked for; with a certificate, what weights prove is the answer.

    `to_claim`: what the certificate claims; `file`: its name, if not the leg's. `domain`: a part of the leg's. `begun`:
    a search that enclosed all solutions in one box, where this one goes on. `how`: what else `minimize` takes.
    """
    question, domain = leg.question, leg.domain if domain is None else domain
    statement = None if to_claim is None else leg.stated(domain)
    with nullcontext() if statement is None else Recording(statement, domain) as recording:
        if recording is not None and begun is not None:
            recording.follow(begun.steps)
        # the one search of a leg that may take long
        place, kept = (question.place, question.checkpoints) if to_claim is the_answer else (None, None)
        keeper = None
        if kept is not None:
            keeper = SearchKeeper(*kept.part(leg.leg, "search"), recording, resume=kept.resume)
        states = minimize(
            leg.problem.network,
            "eps",
            leg.named,
            limits=limits or question.limits,
            domain=domain if begun is None else begun.minimum.enclosure,
            prepared=leg.problem,
            prover=None if statement is None else LegProver(leg, domain, statement),
            observe=None if recording is None else recording.event,
            resume=None if keeper is None else keeper.resumed(),
            keep=keeper,
            place=place,
            **how,
        )
        found = run(states, tell)
        if keeper is not None:
            keeper.end(found)
        if begun is not None:
            first = begun.minimum
            found = replace(
                found,
                programs=first.programs + found.programs,
                seconds=first.seconds + found.seconds,
                rows=tuple(sorted({*first.rows, *found.rows})),
            )
        torn = found.interrupted and not asked()  # by an exception, between any two lines: no stop that was asked for
        if to_claim is None or recording is None or torn or (said := to_claim(found, domain)) is None:
            return Answered(found)
        name, lost = written(question, file or f"leg{leg.leg}", recording, said)
        steps = tuple(recording.saved()) if to_claim is the_enclosure and recording.whole else ()
        return Answered(found, name, lost, steps=steps)


def written(question: Question, file: str, recording: Recording, said: Claims) -> tuple[str | None, Uncertified]:
    """The name of a certificate, once it is among those of the question; None where it cannot be, and why."""
    assert question.certificates is not None
    name = f"{file}.cert.jsonl"
    try:
        question.certificates[name] = recording.content(name, said)
    except UncheckableError:
        return None, Uncertified.UNCHECKABLE
    except InputError:
        return None, Uncertified.UNWRITTEN
    return name, Uncertified.NOTHING


# ------------------------------------------------------------------------------------------------------------------
# The paper's timeout method (section 5.2.1): one call of a solver after the other.

_SMALL = 1e-3  # mm: a box this wide is a point to be tried


def by_timeout(leg: PreparedLeg, start: Floats, tell: Progress) -> Answered:
    """The method, from eps_+ of the least-squares fit (or nominal values) and eps_- = 0. Ctrl-C ends it early.

    The certificate holds the best point and the proof of the last infeasible answer; its lower bound is that one's.
    """
    began, limits, whole = time.monotonic(), leg.question.limits, leg.domain
    statement, prover = leg.stated(whole), leg.problem.prover
    best: Witness | None = prover.prove(start)
    proof: tuple[Recording, float] | None = None
    trials: list[Trial] = []
    interrupted, programs = False, 0
    with ExitStack() as keep:

        def solve(eps: float, seconds: float) -> TimeoutOutcome:
            nonlocal best, proof
            domain = whole.replace("eps", hi=eps)
            with ExitStack() as unless_checked:
                recording = None if statement is None else unless_checked.enter_context(Recording(statement, domain))
                contracting = Contracting(leg.named, None if recording is None else recording.prover)
                observe = None if recording is None else recording.event
                outcome = ask(domain, contracting, LargestFirst(_SMALL, skip=("eps",)), prover, seconds, observe)
                if recording is not None and outcome.checked:
                    proof = recording, eps
                    keep.enter_context(unless_checked.pop_all())
            if outcome.witness is not None and (best is None or outcome.witness.value < best.value):
                best = outcome.witness
            return outcome

        highest = whole["eps"].hi if best is None else best.value
        try:
            for trial in timeout(solve, lo=0.0, hi=highest, limits=limits):
                trials.append(trial)
                programs += trial.programs
                if tell is not None:
                    tell(Bracket(trial.lo, trial.hi, len(trials), programs, time.monotonic() - began))
                if asked():
                    interrupted = True
                    break
        except KeyboardInterrupt:
            interrupted = True
        name, lost = None, Uncertified.NOTHING
        if statement is not None and (proof is not None or best is not None):
            recording, cap = proof or (keep.enter_context(Recording(statement, whole)), whole["eps"].hi)
            point, refuted = None if best is None else best.point, proof is not None
            said = claims(cap, refuted=refuted, lo=cap if refuted else None, point=point)
            name, lost = written(leg.question, f"leg{leg.leg}", recording, said)
    lo, hi = trials[-1].lo if trials else 0.0, np.inf if best is None else best.value
    closed = hi - lo <= max(limits.gap * hi, limits.gap_absolute)
    found = Minimum(
        lo=lo,
        hi=hi,
        verdict=Verdict.PROVED if closed else Verdict.UNKNOWN,
        status="",
        witness=best,
        enclosure=whole,  # the method encloses nothing
        nodes=sum(t.nodes for t in trials),
        programs=programs,
        seconds=time.monotonic() - began,
        interrupted=interrupted,
    )
    return Answered(found, name, lost, tuple(trials))
