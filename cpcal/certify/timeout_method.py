"""Brackets of one leg's eps by the paper's timeout method (section 5.2.1): one call of a solver after the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from cpcal.certify.bracket import Answered, written
from cpcal.certify.prepared_leg import PreparedLeg
from cpcal.common.arrays import Floats
from cpcal.execution.stopping import asked
from cpcal.results import Uncertified
from cpcal.results.leg_sentence import calls_sentence
from cpcal.solver.accounts import ContractorUse, Found, Trial, total_use
from cpcal.solver.certificate.recording import Recording, claims_at
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box
from cpcal.solver.limits import Limits
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize import Bracket, Minimum, TimeoutOutcome, Witness, ask, timeout
from cpcal.solver.search import Contracting, LargestFirst

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
