"""The smallest model error of a leg when up to q of its measurements may be wrong, nobody knows which.

A proof that no eps below some target will do rests on the few measurements that have a weight in it, its *support*. It
holds whatever is left out elsewhere. So leaving out q measurements can allow a smaller eps only if every support known
loses one of its own: if the q measurements meet all of them. The search therefore goes in turns:

- a set of at most q measurements that meets all supports known is left out, and the others are searched up to the
  target: either that is refuted, which gives one more support, or a point is found, which lowers the target;
- when no set of q measurements meets all supports (found out exactly), the target is proved whichever are left out.

This is the exchange on supports, without trying the members of each one after the other: every turn settles all sets
of q measurements that miss the new support. The proof is the family of refutations: see `checker.robust`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from cpcal.common.values import Floats, Indices
from cpcal.models import leg_box, leg_network
from cpcal.questions import LegBracket, LegResult, Uncertified, Work
from cpcal.questions.bracket import all_or_none, written
from cpcal.questions.question import Question
from cpcal.solver.certificate.exact_network import Statement
from cpcal.solver.certificate.recording import Recording, claims_of
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.execution.stopping import Reason, Stopped, asked
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.network import restricted
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.bound import minimize, run
from cpcal.solver.optimize.local import fit
from cpcal.solver.optimize.minimum import Bracket, Minimum, hitting_set
from cpcal.solver.search import Contracting

MARGIN = 1e-5  # relative, below eps_hi: what is proved of every choice of outliers
SMALLEST = 1e-9  # mm, likewise
_ACTIVE = 1e-6  # mm: rows this near to the largest decide a fit


@dataclass(frozen=True)
class _Support:
    """Measurements that alone prove eps >= lo, and the certificate of that."""

    members: frozenset[int]
    lo: float
    certificate: str | None


@dataclass
class _Progress:
    """The best point so far, the proofs so far, and what they cost."""

    best: Minimum | None = None
    without: frozenset[int] = frozenset()
    supports: list[_Support] = field(default_factory=list)
    searches: int = 0

    @property
    def hi(self) -> float:
        return np.inf if self.best is None else self.best.hi


def robust_leg(question: Question, leg: int) -> LegResult:
    """The bracket of leg `leg` when some of its measurements may be wrong; with certificates where they are asked for.

    A search that ends at `question.limits` leaves the bracket open, as does one that cannot refute the target.
    """
    began, outliers = time.monotonic(), question.options.outliers
    search = _Search(question, leg)
    state = _Progress()
    search.begin(state, search.guessed(outliers))
    target = state.hi
    while np.isfinite(state.hi) and time.monotonic() - began < (question.options.time_limit or np.inf):
        target = min(target, state.hi - max(MARGIN * state.hi, SMALLEST))
        if target <= 0.0:  # no error is smaller
            break
        without = hitting_set([one.members for one in state.supports], outliers)
        if without is None:
            break
        if question.progress is not None:
            question.progress(leg, Bracket(0.0, state.hi, state.searches, 0, time.monotonic() - began))
        target = search.turn(state, without, target)
    return _result(search, state, outliers, time.monotonic() - began)


def _result(search: _Search, state: _Progress, outliers: int, seconds: float) -> LegResult:
    question, ids = search.question, search.question.campaign.measurement_ids
    settled = hitting_set([one.members for one in state.supports], outliers) is None
    lo = min((one.lo for one in state.supports), default=0.0) if settled else 0.0
    witness = None if state.best is None else state.best.witness
    at_point = None if witness is None else search.point_certificate(state)
    # a family that some choice meets proves nothing, and leaves no files
    proofs = all_or_none(question, [*(one.certificate for one in state.supports), *(() if settled else (None,))])
    closed = witness is not None and state.hi - lo <= 2.0 * max(MARGIN * state.hi, SMALLEST)
    lost = Uncertified.NOT_ASKED if question.certificates is None else Uncertified.NOTHING_PROVED
    return LegResult(
        leg=search.leg,
        bracket=LegBracket(
            verdict=Verdict.PROVED if closed else Verdict.UNKNOWN,
            lo=float(lo),
            hi=float(state.hi),
            point=None if witness is None else tuple(map(float, witness.point[:-1])),
            center=tuple(map(float, search.center[:7])),
            enclosure=leg_box(search.center, question.options.delta, question.model),
            proofs=proofs,
            point_certificate=at_point,
            left_out=tuple(ids[k] for k in sorted(state.without)),
        ),
        not_certified=Uncertified.NOTHING if proofs or at_point else lost,
        extra=tuple(map(float, search.center[7:])),
        work=Work(nodes=state.searches, seconds=seconds),
    )


class _Search:
    """Searches of one leg without some of its measurements."""

    def __init__(self, question: Question, leg: int) -> None:
        self.question, self.leg = question, leg
        self.center = question.center(leg)
        self._whole = question.network(leg, self.center)
        self._start = np.append(self.center, 0.0)
        self._all = frozenset(range(len(question.campaign)))
        self._count = 0

    def guessed(self, outliers: int) -> frozenset[int]:
        """Measurements to leave out first: one after the other that whose loss lowers a local fit most."""
        without: frozenset[int] = frozenset()
        start = self._start
        for _ in range(outliers):
            start, active = self._fitted(without, start)
            trials = [(float(self._fitted(without | {k}, start)[0][-1]), k) for k in active]
            if not trials:
                break
            without |= {min(trials)[1]}
        return without

    def begin(self, state: _Progress, without: frozenset[int]) -> None:
        """The least eps of the others: the first point."""
        found = self._minimum(self._kept(self._whole, without), None)
        state.searches += 1
        if found.witness is not None:
            state.best, state.without = found, without

    def turn(self, state: _Progress, without: frozenset[int], target: float) -> float:
        """Search the others up to the target; the target that is proved or left after it."""
        state.searches += 1
        box = leg_box(self.center, self.question.options.delta, self.question.model)
        network = leg_network(
            self.question.campaign,
            self.leg,
            box,
            engine=self.question.engine,
            eps=(0.0, target),
            model=self.question.model,
        )
        found, support = self._proved(self._kept(network, without), without)
        if found.witness is not None:  # it lies below the target, and so below the best
            state.best, state.without = found, without
            return target
        state.supports.append(support)
        return min(target, support.lo)

    def point_certificate(self, state: _Progress) -> str | None:
        """The file that proves the best point, at all measurements but those left out."""
        if self.question.certificates is None or state.best is None:
            return None
        network = self._kept(self._whole, state.without)
        statement = self._statement(network.domain, state.without)
        if statement is None:
            return None
        path = self.question.certificate(self.leg, ".point")
        with Recording(statement, network.domain) as recording:
            claims = claims_of(replace(state.best, lo=0.0), network.domain, "eps") | {"enclosure": None}
            return written(path, partial(recording.write, claims=claims))[0]

    def _proved(self, network: ConstraintNetwork, without: frozenset[int]) -> tuple[Minimum, _Support]:
        question, top = self.question, float(network.domain["eps"].hi)
        named = question.named(network)
        wanted = question.certificates is not None and Contracting(named).gives_weights
        statement = self._statement(network.domain, without) if wanted else None
        kept = self._rows(without)
        if statement is None:
            found = self._minimum(network, None)
            return found, _Support(_members(found, kept), min(found.lo, top), None)
        with Recording(statement, network.domain) as recording:
            found = self._minimum(network, recording)
            lo = min(found.lo, top)
            name = None
            if found.witness is None:
                self._count += 1
                write = partial(recording.write, claims=claims_of(found, network.domain, "eps", lower_only=True))
                name, _ = written(question.certificate(self.leg, f".{self._count:03d}"), write)
            return found, _Support(_members(found, kept), lo, name)

    def _minimum(self, network: ConstraintNetwork, recording: Recording | None) -> Minimum:
        question = self.question
        limits = Limits(seconds=question.options.time_limit, gap=0.1 * MARGIN, gap_absolute=0.1 * SMALLEST)
        states = minimize(
            network,
            "eps",
            question.named(network),
            engine=question.engine,
            limits=limits,
            start=self._start,
            enclose=False,
            prover=None if recording is None else recording.prover,
            observe=None if recording is None else recording.event,
        )
        found = run(states, None)
        if found.interrupted:  # its bracket is of no use to the next search
            raise Stopped(asked() or Reason.INTERRUPTED)
        return found

    def _fitted(self, without: frozenset[int], start: Floats) -> tuple[Floats, list[int]]:
        """A local minimiser of the others' eps, and the measurements that decide it."""
        network, kept = self._kept(self._whole, without), self._rows(without)
        rows = Rows(network)
        point = fit(rows, network.names.index("eps"), network.domain, start)
        # each one-sided row of a leg has an element for every measurement
        excess = rows.linearize(point).values.reshape(-1, len(kept)).max(axis=0)
        return point, [int(kept[k]) for k in np.flatnonzero(excess >= -_ACTIVE)]

    def _statement(self, domain: Box, without: frozenset[int]) -> Statement | None:
        return self.question.statement(self.leg, domain, tuple(sorted(self._all - without)) if without else None)

    def _rows(self, without: frozenset[int]) -> Indices:
        return np.array(sorted(self._all - without), dtype=np.intp)

    def _kept(self, network: ConstraintNetwork, without: frozenset[int]) -> ConstraintNetwork:
        return restricted(network, [self._rows(without)] * len(network.constraints)) if without else network


def _members(found: Minimum, kept: Indices) -> frozenset[int]:
    """The measurements with a weight in some step."""
    return frozenset(int(kept[k]) for _, k in found.rows)
