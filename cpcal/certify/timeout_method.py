"""Brackets of one leg's eps by the paper's script (section 5.2.1): one call of a solver after the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from cpcal.certify.bracket import Answered
from cpcal.certify.question import Floats, Question
from cpcal.solver.certificate.recording import Recording, certifying, claims_at
from cpcal.solver.contract import Contractor, Limits, Verdict
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize import Answer, Bracket, Minimum, Outcome, Trial, Witness, WitnessProver, ask, timeout
from cpcal.solver.search import Event, LargestFirst

_SMALL = 1e-3  # mm: a box this wide is a point to be tried


def by_timeout(
    question: Question, leg: int, network: ConstraintNetwork, start: Floats, tell: Callable[[Bracket], None]
) -> Answered:
    """The script, from eps_+ of the least-squares fit (or nominal values) and eps_- = 0. Ctrl-C ends it early."""
    began = time.monotonic()
    trials: list[Trial] = []
    with ExitStack() as keep:
        solver = _Solver(question, leg, network, keep)
        solver.remember(solver.prover.prove(start))
        interrupted = False
        try:
            for trial in timeout(solver, lo=0.0, hi=solver.highest, limits=question.limits):
                trials.append(trial)
                tell(Bracket(trial.lo, trial.hi, len(trials), _programs(trials), time.monotonic() - began))
        except KeyboardInterrupt:
            interrupted = True
        lo = trials[-1].lo if trials else 0.0
        found = _minimum(network, lo, solver.best, trials, question.limits, time.monotonic() - began)
        name = None
        if solver.statement is not None and (solver.proof is not None or solver.best is not None):
            name = solver.write(question.certificate(leg)).name
    return Answered(replace(found, interrupted=interrupted), name, tuple(trials))


class _Solver:
    """What the script calls: a search for a valid point at one eps; keeps the proof of the last infeasible answer."""

    def __init__(self, question: Question, leg: int, network: ConstraintNetwork, keep: ExitStack) -> None:
        self._network, self._keep = network, keep
        self.statement = None if question.certificates is None else question.statement(leg, network.domain)
        parts = question.parts(network)
        self._contractor = question.composed(parts)
        self._useful = certifying(parts) if self.statement is not None else []
        self.prover = WitnessProver(network, network.names.index("eps"), question.engine)
        self.best: Witness | None = None
        self.proof: tuple[Recording, Box] | None = None

    @property
    def highest(self) -> float:
        """The smallest eps that is attained, or the largest there is."""
        return float(self._network.domain["eps"].hi) if self.best is None else self.best.value

    def remember(self, witness: Witness | None) -> None:
        if witness is not None and (self.best is None or witness.value < self.best.value):
            self.best = witness

    def __call__(self, eps: float, seconds: float) -> Outcome:
        domain = self._network.domain.replace("eps", hi=eps)
        if not self._useful or self.statement is None:
            outcome = self._asked(self._contractor, domain, seconds, None)
        else:
            recording = Recording(self.statement, domain)
            outcome = self._asked(recording.contractor(self._useful), domain, seconds, recording.event)
            if outcome.answer is Answer.INFEASIBLE:
                outcome = replace(outcome, checked=True)
                self._keep.enter_context(recording)
                self.proof = recording, domain
            else:
                recording.close()
        self.remember(outcome.witness)
        return outcome

    def _asked(
        self, contractor: Contractor, domain: Box, seconds: float, observe: Callable[[Event], None] | None
    ) -> Outcome:
        strategy = LargestFirst(_SMALL, skip=("eps",))
        return ask(domain, contractor, strategy, self.prover, seconds, observe)

    def write(self, path: Path) -> Path:
        """The certificate of the last infeasible answer and of the best point."""
        assert self.statement is not None
        recording, domain = self.proof or (Recording(self.statement, self._network.domain), None)
        self._keep.enter_context(recording)
        highest = float(self._network.domain["eps"].hi if domain is None else domain["eps"].hi)
        point = None if self.best is None else self.best.point
        return recording.write(path, claims_at(highest, refuted=domain is not None, point=point))


def _minimum(
    network: ConstraintNetwork, lo: float, best: Witness | None, trials: list[Trial], limits: Limits, seconds: float
) -> Minimum:
    hi = np.inf if best is None else best.value
    closed = hi - lo <= max(limits.gap * hi, limits.gap_absolute)
    unchecked = sum(t.answer is Answer.INFEASIBLE and not t.checked for t in trials)
    status = f"{len(trials)} calls of the solver; " + (
        "both bounds are proved and the gap is closed."
        if closed
        else "both bounds are proved, the gap is open."
        if best is not None
        else "no point was proved to satisfy the constraints; the lower bound is proved."
    )
    if unchecked:
        status += f" {unchecked} infeasible answers are unchecked: they have no certificate."
    return Minimum(
        lo,
        hi,
        Verdict.PROVED if closed else Verdict.UNKNOWN,
        status,
        best,
        network.domain if best is not None else Box.empty(network.names),
        0.0,
        (),
        (),
        0,
        sum(t.nodes for t in trials),
        _programs(trials),
        seconds,
    )


def _programs(trials: list[Trial]) -> int:
    return sum(t.programs for t in trials)
