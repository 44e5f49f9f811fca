"""method="bound": branch and bound on the objective, a variable of the network like any other.

Below, the contractors raise the objective's lower bound; above, a local fit proposes points that
`WitnessProver` proves. Between the two the bracket is valid at every moment.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.interfaces import Contraction, Contractor, Limits, Strategy, Verdict
from cpcal.interval import Arithmetic, Box
from cpcal.linear import Glop
from cpcal.network import ConstraintNetwork
from cpcal.network.rows import Rows
from cpcal.optimize.fit import fit
from cpcal.optimize.witness import Witness, WitnessProver
from cpcal.search import LargestFirst, Node, Search

Floats = npt.NDArray[np.float64]

_PASSES = 50  # contractions of one node at most
_SHRINK = 0.8  # go on with a node while some width falls below this share of what it was
_SETTLE = 0.95  # the same once the bracket is closed, for the enclosure alone


@dataclass(frozen=True)
class Bracket:
    """The state of a minimisation: the optimum lies in `[lo, hi]` (hi infinite: no point proved yet)."""

    lo: float
    hi: float
    nodes: int
    programs: int
    seconds: float


@dataclass(frozen=True)
class Minimum:
    """The end of a minimisation over a box.

    `lo`: proved, no solution has a smaller objective. `hi` and `witness`: a proved solution. `enclosure`: holds every
    solution with objective <= hi. `floor`: the second-order effect of the readings at the witness; boxes are not divided
    to close a smaller gap (though contraction alone often closes it). `rows`: the (constraint, element) pairs with a
    multiplier in some step of the proof of `lo`.
    """

    lo: float
    hi: float
    verdict: Verdict
    status: str
    witness: Witness | None
    enclosure: Box
    floor: float
    rows: tuple[tuple[int, int], ...]
    pending: int
    nodes: int
    programs: int
    seconds: float
    interrupted: bool = False


class _Bounding:
    """A contractor that runs another to the end on a node, cutting with the incumbent it keeps improving."""

    idempotent = False

    def __init__(
        self,
        network: ConstraintNetwork,
        objective: int,
        contractor: Contractor,
        limits: Limits,
        engine: Arithmetic,
    ) -> None:
        self._inner, self.objective, self.limits = contractor, objective, limits
        self._rows = Rows(network)
        self._prover = WitnessProver(network, objective, engine)
        self.domain = network.domain
        self.witness: Witness | None = None
        self.programs = 0
        self.used: set[tuple[int, int]] = set()
        self.kept: list[Box] = []
        self.clock = limits.clock()

    @property
    def hi(self) -> float:
        return np.inf if self.witness is None else self.witness.value

    @property
    def goal(self) -> float:
        """Nodes whose objective is at least this need no more work."""
        return self.hi - max(self.limits.gap * abs(self.hi), self.limits.gap_absolute)

    @property
    def floor(self) -> float:
        """The second-order effect of the readings at the incumbent (0 without one)."""
        return 0.0 if self.witness is None else self._rows.second_order(self.witness.point)

    def propose(self, start: Floats) -> None:
        """Fit from a point and keep what is proved, if it is better."""
        for point in (fit(self._rows, self.objective, self.domain, start, Glop()), start):
            witness = self._prover.prove(point)
            if witness is not None and witness.value < self.hi:
                self.witness = witness
                return

    def cut(self, box: Box) -> Box:
        """Drop what is worse than the incumbent."""
        name = box.names[self.objective]
        return box.replace(name, hi=min(float(box.hi[self.objective]), self.hi))

    def contract(self, box: Box) -> Contraction:
        current, proposed = self.cut(box), False
        for _ in range(_PASSES):
            if current.is_empty or self.clock.over():
                break
            closed = self.closed(current)
            step = self._inner.contract(current)
            self.programs += step.programs
            self.used.update(row for s in step.steps for row in s.rows)
            shrunk = self._shrunk(current, step.box, _SETTLE if closed else _SHRINK)
            current = step.box
            if step.point is not None and not proposed and not self.closed(current):
                self.propose(step.point)
                proposed = True
            current = self.cut(current)
            if current.is_empty or not shrunk or (self.closed(current) and not closed):
                break
        return Contraction(current)

    def closed(self, box: Box) -> bool:
        return not box.is_empty and bool(box.lo[self.objective] >= self.goal)

    @staticmethod
    def _shrunk(before: Box, after: Box, ratio: float) -> bool:
        return after.is_empty or bool((after.width < ratio * before.width).any())

    def settled(self, box: Box) -> bool:
        """Whether dividing the box is pointless: it is closed, or down to the second order of the readings."""
        return self.closed(box) or (not box.is_empty and bool(box.lo[self.objective] >= self.hi - self.floor))

    def split(self, box: Box, strategy: Strategy) -> tuple[Box, ...]:
        """() for a node that is settled; else its pieces by the strategy."""
        pieces = () if self.settled(box) else strategy.split(box)
        if not pieces:
            self.kept.append(box)
        return pieces


@dataclass(frozen=True)
class _Splitting:
    bounding: _Bounding
    strategy: Strategy

    def split(self, box: Box) -> tuple[Box, ...]:
        return self.bounding.split(box, self.strategy)


def minimize(
    network: ConstraintNetwork,
    objective: str,
    contractor: Contractor,
    *,
    engine: Arithmetic,
    limits: Limits,
    start: Floats | None = None,
    strategy: Strategy | None = None,
) -> Generator[Bracket | Minimum, None, None]:
    """Brackets of the smallest value of the variable `objective`, then the `Minimum` as the last item.

    THERE EXISTS a reading in its set for every constraint, as in the network. `start` (n,) is where the
    first fit begins (default: the middle of the domain). Close the iterator to stop early.
    """
    began = time.monotonic()
    index = network.names.index(objective)
    bounding = _Bounding(network, index, contractor, limits, engine)
    domain = bounding.domain
    bounding.propose(domain.mid if start is None else np.asarray(start, np.float64))
    if strategy is None:
        strategy = LargestFirst(scale=np.where(domain.rad > 0.0, domain.rad, 1.0), skip=(objective,))
    search = Search([domain], bounding, _Splitting(bounding, strategy), lambda node: float(node.box.lo[index]))
    nodes = 0

    def bracket() -> Bracket:
        return Bracket(
            _lowest(search.pending, bounding), bounding.hi, nodes, bounding.programs, time.monotonic() - began
        )

    interrupted = False
    try:
        while search.pending and not bounding.clock.over(nodes):
            next(search)
            nodes += 1
            yield bracket()
    except KeyboardInterrupt:
        interrupted = True
    yield _minimum(search, bounding, bracket(), interrupted)


def _lowest(pending: tuple[Node, ...], bounding: _Bounding) -> float:
    boxes = [node.box for node in pending] + bounding.kept
    return min([float(box.lo[bounding.objective]) for box in boxes] + [bounding.hi])


def _minimum(search: Search, bounding: _Bounding, last: Bracket, interrupted: bool) -> Minimum:
    pending = [bounding.cut(node.box) for node in search.pending]
    kept = [bounding.cut(box) for box in bounding.kept]
    enclosure = Box.empty(bounding.domain.names)
    for box in kept + pending:
        enclosure = enclosure.hull(box)
    undecided = [box for box in pending if not box.is_empty and not bounding.settled(box)]
    verdict, status = _status(last, bounding, len(undecided))
    return Minimum(
        last.lo,
        last.hi,
        verdict,
        status,
        bounding.witness,
        enclosure,
        bounding.floor,
        tuple(sorted(bounding.used)),
        len(undecided),
        last.nodes,
        last.programs,
        last.seconds,
        interrupted,
    )


def _status(last: Bracket, bounding: _Bounding, undecided: int) -> tuple[Verdict, str]:
    if bounding.witness is None and not undecided and last.lo == np.inf:
        return Verdict.REFUTED, "No point of the domain satisfies the constraints: proved."
    if bounding.witness is None:
        return Verdict.UNKNOWN, "No point was proved to satisfy the constraints; the lower bound is proved."
    if last.hi == bounding.domain.lo[bounding.objective]:
        return Verdict.PROVED, "The smallest value that the domain allows is attained: proved."
    gap = last.hi - last.lo
    if gap <= max(bounding.limits.gap * abs(last.hi), bounding.limits.gap_absolute):
        return Verdict.PROVED, "Both bounds are proved and the gap is closed."
    if not undecided and gap <= bounding.floor:
        return (
            Verdict.PROVED,
            f"Both bounds are proved; the gap of {gap:.1e} is below the second-order effect of the readings, "
            f"{bounding.floor:.1e}.",
        )
    if not undecided:
        return Verdict.UNKNOWN, f"Both bounds are proved; the contractors cannot close the gap of {gap:.1e}."
    return (
        Verdict.UNKNOWN,
        f"Stopped at a limit with {undecided} undecided boxes; both bounds are proved, the gap is open.",
    )


def run(states: Generator[Bracket | Minimum, None, None], progress: Callable[[Bracket], None] | None) -> Minimum:
    """Run to the end, telling `progress` of every bracket; Ctrl-C ends it with what is proved."""
    for state in states:
        if isinstance(state, Minimum):
            return state
        try:
            if progress is not None:
                progress(state)
        except KeyboardInterrupt as stop:
            last = states.throw(stop)
            assert isinstance(last, Minimum)
            return last
    raise AssertionError("minimize ends with a Minimum")
