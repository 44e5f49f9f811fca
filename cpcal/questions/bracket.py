"""Brackets of one leg's eps by branch and bound, with certificates where they are asked for."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats, Indices
from cpcal.files.folders import keep_beside
from cpcal.models import PLAIN, LegModel, beyond_legs, built_in, leg_box, leg_network, leg_statement
from cpcal.questions import SupportProof, Uncertified, VerifiedPoint
from cpcal.questions.question import Question, chosen_model
from cpcal.questions.verdict import calls_sentence
from cpcal.robot import Campaign
from cpcal.solver.accounts import ContractorUse, Found, Trial, total_use
from cpcal.solver.certificate.exact_network import Statement
from cpcal.solver.certificate.float_rows import at_point, failing, holding
from cpcal.solver.certificate.recording import (
    Recording,
    UncheckableError,
    WeightProver,
    claims_at,
    claims_of,
    claims_verified,
)
from cpcal.solver.contract import Contraction, Contractor, Limits, Restrictable, Verdict, gives_weights
from cpcal.solver.execution.stopping import asked
from cpcal.solver.interval import Arithmetic, Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.network import restricted
from cpcal.solver.optimize.bound import minimize, run
from cpcal.solver.optimize.minimum import Bracket, Minimum
from cpcal.solver.optimize.timeout import TimeoutOutcome, ask, timeout
from cpcal.solver.optimize.witness import PointVerdicts, Prepared, Witness, verify_point
from cpcal.solver.search import Contracting, Event, LargestFirst, Proof, StepProver

# ------------------------------------------------------------------------------------------------------------------
# One leg, set up once for all that is asked about it: bracket, support, ranges, projections.
#
# It is passed from one question to the next and goes when the leg is done. What contractors keep of the boxes before
# (expanded rows, for the readings that decide there) serves the next question, which comes by the same boxes.


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedLeg:
    """A leg (from 1) of a question, around `center` (n,): parameters of the model in mm.

    problem    its equations, eps up to what they allow, or the one that is asked about
    named      the contractors asked for, for all of these
    statement  what its certificates say; None where there are none, or where they depend on the values of eps
    """

    question: Question
    leg: int
    center: Floats
    problem: Prepared
    named: list[tuple[str, Contractor]]
    statement: Statement | None

    @classmethod
    def of(cls, question: Question, leg: int, center: Floats | None = None) -> PreparedLeg:
        """`center`: where it is known."""
        center = question.center(leg) if center is None else center
        network = question.network(leg, center)
        named = question.named(network)
        proving = question.certificates is not None and Contracting(named).gives_weights
        return cls(
            question=question,
            leg=leg,
            center=center,
            problem=Prepared(network, "eps", question.engine),
            named=named,
            statement=question.statement(leg, network.domain) if proving and built_in(question.model) else None,
        )

    @property
    def network(self) -> ConstraintNetwork:
        return self.problem.network

    @property
    def domain(self) -> Box:
        """All parameters, and every eps that is asked about."""
        return self.network.domain

    def at(self, eps: float) -> Box:
        """All parameters, and one eps. Empty where the legs are too short for that one."""
        lo, hi = self.domain["eps"].lo, self.domain["eps"].hi
        return self.domain.replace("eps", lo=eps, hi=eps) if lo <= eps <= hi else Box.empty(self.domain.names)

    def alone(self, elements: Indices) -> tuple[Prepared, list[tuple[str, Contractor]]]:
        """Some measurements (numbers from 0) alone, and the contractors that use no others."""
        smaller = restricted(self.network, [elements] * len(self.network.constraints))
        problem = Prepared(smaller, "eps", self.question.engine)
        if self.restrictable:
            return problem, [(name, c.restricted_to(elements)) for name, c in self.named if isinstance(c, Restrictable)]
        return problem, self.question.named(smaller)

    @property
    def restrictable(self) -> bool:
        """Whether each contractor can be restricted, and says by weights which measurements it used."""
        return all(isinstance(c, Restrictable) and gives_weights(c) for _, c in self.named)

    def asking(self, question: Question) -> PreparedLeg:
        """The same leg and box, of another question."""
        return replace(self, question=question)

    def stated(self, domain: Box) -> Statement | None:
        """What a certificate about a part of the domain would say; None where none is wanted, or there can be none."""
        if self.question.certificates is None or not Contracting(self.named).gives_weights:
            return None
        return self.statement or self.question.statement(self.leg, domain)


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


# ------------------------------------------------------------------------------------------------------------------
# Brackets of one leg's eps by the paper's timeout method (section 5.2.1): one call of a solver after the other.

_SMALL = 1e-3  # mm: a box this wide is a point to be tried


def by_timeout(leg: PreparedLeg, start: Floats, tell: Callable[[Bracket], None]) -> Answered:
    """The method, from eps_+ of the least-squares fit (or nominal values) and eps_- = 0. Ctrl-C ends it early."""
    began, question, network = time.monotonic(), leg.question, leg.network
    trials: list[Trial] = []
    with ExitStack() as keep:
        solver = _Solver(leg, keep)
        solver.remember(solver.prover.prove(start))
        interrupted = False
        try:
            for trial in timeout(solver, lo=0.0, hi=solver.highest, limits=question.limits):
                trials.append(trial)
                tell(Bracket(trial.lo, trial.hi, len(trials), _programs(trials), time.monotonic() - began))
                if asked():
                    interrupted = True
                    break
        except KeyboardInterrupt:
            interrupted = True
        found = _minimum(network, solver, trials, question.limits, time.monotonic() - began)
        name, lost = None, Uncertified.NOTHING
        if solver.statement is not None and (solver.proof is not None or solver.best is not None):
            name, lost = written(question.certificate(leg.leg), solver.write)
            found = replace(found, contractors_used=solver.credited(found.contractors_used))
    return Answered(replace(found, interrupted=interrupted), name, tuple(trials), lost)


class _Solver:
    """What the method calls: a search for a valid point at one eps; keeps the proof of the last infeasible answer."""

    def __init__(self, leg: PreparedLeg, keep: ExitStack) -> None:
        self._network, self._keep = leg.network, keep
        self._named, self.statement = leg.named, leg.stated(leg.domain)
        self.prover = leg.problem.prover
        self.best: Witness | None = None
        self.proof: tuple[Recording, Box] | None = None
        self.uses: tuple[ContractorUse, ...] = ()

    @property
    def highest(self) -> float:
        """The smallest eps that is attained, or the largest there is."""
        return float(self._network.domain["eps"].hi) if self.best is None else self.best.value

    def remember(self, witness: Witness | None) -> None:
        if witness is not None and (self.best is None or witness.value < self.best.value):
            self.best = witness

    def __call__(self, eps: float, seconds: float) -> TimeoutOutcome:
        domain = self._network.domain.replace("eps", hi=eps)
        if self.statement is None:
            outcome = self._asked(domain, seconds, None)
        else:
            recording = Recording(self.statement, domain)
            outcome = self._asked(domain, seconds, recording)
            if outcome.checked:
                self._keep.enter_context(recording)
                self.proof = recording, domain
            else:
                recording.close()
        self.uses = total_use(self.uses, outcome.uses)
        self.remember(outcome.witness)
        return outcome

    def _asked(self, domain: Box, seconds: float, recording: Recording | None) -> TimeoutOutcome:
        strategy = LargestFirst(_SMALL, skip=("eps",))
        contracting = Contracting(self._named, None if recording is None else recording.prover)
        observe = None if recording is None else recording.event
        return ask(domain, contracting, strategy, self.prover, seconds, observe)

    def credited(self, uses: tuple[ContractorUse, ...]) -> tuple[ContractorUse, ...]:
        """With the number of steps that the certificate holds of each."""
        return uses if self.proof is None else self.proof[0].credited(uses)

    def write(self, path: Path) -> Path:
        """The certificate of the last infeasible answer and of the best point."""
        assert self.statement is not None
        recording, domain = self.proof or (Recording(self.statement, self._network.domain), None)
        self._keep.enter_context(recording)
        highest = float(self._network.domain["eps"].hi if domain is None else domain["eps"].hi)
        point = None if self.best is None else self.best.point
        return recording.write(path, claims_at(highest, refuted=domain is not None, point=point))


def _minimum(
    network: ConstraintNetwork, solver: _Solver, trials: list[Trial], limits: Limits, seconds: float
) -> Minimum:
    """With a certificate the lower bound is that of the last infeasible answer that weights prove."""
    best, domain = solver.best, network.domain
    hi = np.inf if best is None else best.value
    found_lo = trials[-1].lo if trials else 0.0
    checked = max((t.eps for t in trials if t.checked), default=0.0)
    lo = found_lo if solver.statement is None else checked
    found = Found(found_lo, domain) if found_lo > lo else None
    closed = hi - lo <= max(limits.gap * hi, limits.gap_absolute)
    return Minimum(
        lo=lo,
        hi=hi,
        verdict=Verdict.PROVED if closed else Verdict.UNKNOWN,
        status=calls_sentence(len(trials), lo, hi, limits.gap, closed=closed)
        + ("" if found is None else found.sentence(lo)),
        witness=best,
        enclosure=domain,  # the method encloses nothing
        floor=0.0,
        rows=(),
        decisive_rows=(),
        pending=0,
        nodes=sum(t.nodes for t in trials),
        programs=_programs(trials),
        seconds=seconds,
        contractors_used=solver.uses,
        found=found,
    )


def _programs(trials: list[Trial]) -> int:
    return sum(t.programs for t in trials)


# ------------------------------------------------------------------------------------------------------------------
# Certification of a given point, such as a least-squares fit (section 5.1.2 of the paper).


@dataclass(frozen=True)
class PointResult:
    """What is proved of a point of one leg: `verified` counts, `holds` and `fails` name the measurements (pose/run)."""

    leg: int
    point: tuple[float, ...]
    verified: VerifiedPoint
    holds: tuple[str, ...]
    fails: tuple[str, ...]


def certify_point(
    campaign: Campaign,
    leg: int,
    point: npt.ArrayLike,
    *,
    eps: float = 0.0,
    arithmetic: str = "float64",
    certificate: str | os.PathLike[str] | None = None,
    model: str | LegModel | None = None,
) -> PointResult:
    """For each measurement: does the point (ax, ay, az, bx, by, bz, l) in mm satisfy its equation to within `eps` mm?

    It does when THERE EXISTS a reading in the measurement's set with |g| <= eps; it fails when for no reading it does;
    both are proved. `model` is the leg model, as in `certify` (default: the campaign's, else plain); its extra
    parameters follow l in the point. `certificate` names a file for `cpcal verify`; what the exact check cannot repeat
    is then left out. User-defined models have none.
    Raises InputError.
    """
    x = np.asarray(point, np.float64)
    corrected, wrong = chosen_model(campaign, model, None)
    if not 1 <= leg <= campaign.legs:
        wrong.append(Problem("leg", f"there is no leg {leg}", f"choose from 1 to {campaign.legs}"))
    if not (np.isfinite(eps) and eps >= 0.0):
        wrong.append(Problem("eps", f"{eps} is no tolerance", "give a number of mm, 0 or more"))
    if not wrong and (x.shape != (len(corrected.parameters),) or not np.isfinite(x).all()):
        what = f"a point of the {corrected.name} model is {len(corrected.parameters)} finite numbers"
        wrong.append(Problem("point", what, f"give {', '.join(corrected.parameters)}"))
    if certificate is not None and not built_in(corrected):
        wrong.append(Problem("certificate", f"{corrected.name!r}, a user-defined model, has none", "leave it out"))
    if not wrong:
        wrong += beyond_legs(campaign, leg, float(x[6]), eps, "eps")
    if wrong:
        raise InputError(wrong)
    good, bad = verified_rows(campaign, leg, x, eps, get_arithmetic(arithmetic), corrected)
    if certificate is not None:
        good, bad = _certified(campaign, leg, x, eps, good, bad, certificate, corrected)
    ids = campaign.measurement_ids
    counts = VerifiedPoint(eps, len(good), len(bad), len(campaign))
    return PointResult(leg, tuple(map(float, x)), counts, tuple(ids[k] for k in good), tuple(ids[k] for k in bad))


def verified_rows(
    campaign: Campaign,
    leg: int,
    x: npt.NDArray[np.float64],
    eps: float,
    engine: Arithmetic,
    model: LegModel = PLAIN,
) -> tuple[list[int], list[int]]:
    """Numbers (from 0) of the measurements that the point (n,) of the model is proved to satisfy, and to fail."""
    box = leg_box(x, 0.0, model).with_bounds(x, x)
    network = leg_network(campaign, leg, box, engine=engine, eps=(eps, eps), model=model)
    return _numbers(verify_point(network, np.append(x, eps), engine))


def verified_center(leg: PreparedLeg) -> tuple[list[int], list[int]]:
    """The same of the center of a leg, at the eps that is asked about, or 0."""
    point = np.append(leg.center, leg.question.options.eps or 0.0)
    return _numbers(verify_point(leg.network, point, leg.question.engine, leg.problem.prover.reading))


def _numbers(found: PointVerdicts) -> tuple[list[int], list[int]]:
    return np.flatnonzero(found.holds).tolist(), np.flatnonzero(found.fails).tolist()


def _certified(
    campaign: Campaign,
    leg: int,
    x: npt.NDArray[np.float64],
    eps: float,
    good: list[int],
    bad: list[int],
    path: str | os.PathLike[str],
    model: LegModel,
) -> tuple[list[int], list[int]]:
    """Write the claims that the checker's own arithmetic repeats."""
    at_eps, statement = np.append(x, eps), leg_statement(campaign, leg, model=model.name)
    problem, at = statement.problem, at_point(at_eps.tolist())
    good = [k for k in good if holding(problem, at, k) is not None]
    bad = [k for k in bad if failing(problem, at, k) is not None]
    keep_beside(campaign, path)
    with Recording(statement, Box((*model.parameters, "eps"), at_eps, at_eps)) as recording:
        recording.write(path, claims_verified(at_eps, eps, good, bad))
    return good, bad
