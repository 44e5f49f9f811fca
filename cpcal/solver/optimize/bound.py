"""method="bound": branch and bound on the objective, a variable of the network like any other.

Below, the contractors raise the objective's lower bound; above, a local fit proposes points that
`WitnessProver` proves. Between the two the bracket is valid at every moment.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.execution.stopping import asked
from cpcal.solver.contract import Contractor, Limits, Strategy
from cpcal.solver.interval import Arithmetic, Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize.bounding import Bounding, Branch, Row
from cpcal.solver.optimize.incumbent import Incumbent
from cpcal.solver.optimize.minimum import Bracket, Found, Minimum, status_of
from cpcal.solver.optimize.saved import Saved
from cpcal.solver.search import (
    Contracting,
    ContractorUse,
    Event,
    EventKind,
    LargestFirst,
    Node,
    Piece,
    Search,
    StepProver,
    total_use,
)

Named = tuple[str, Contractor]

_ROUND = 16  # nodes, at most
_WAITING = 8  # pending nodes for each of a round: few that a better point would spare are looked at


def _abreast(pending: int) -> int:
    """Nodes of a round. It depends on the search alone, never on who does the work, so that all go the same way."""
    return min(_ROUND, 1 + pending // _WAITING)


def minimize(
    network: ConstraintNetwork,
    objective: str,
    contractors: Contractor | Sequence[Named],
    *,
    engine: Arithmetic,
    limits: Limits,
    start: Floats | None = None,
    strategy: Strategy | None = None,
    enclose: bool = True,
    prover: StepProver | None = None,
    observe: Callable[[Event], None] | None = None,
    resume: Saved | None = None,
    keep: Callable[[Callable[[], Saved]], None] | None = None,
    place: tuple[Executor, int] | None = None,
) -> Generator[Bracket | Minimum, None, None]:
    """Brackets of the smallest value of the variable `objective`, then the `Minimum` as the last item.

    THERE EXISTS a reading in its set for every constraint, as in the network. `contractors` are applied one after the
    other; with a `prover` only what it proves again by weights counts for `lo` and `enclosure`, and `found` holds what
    all contractors reach. `start` (n,) is where the first fit begins (default: the middle of the domain). Without
    `enclose` no work is spent on a tight enclosure. `observe` is told of every node's fate, and after it
    `keep` is given a function that tells where the search stands; with that as `resume` another call goes on from
    there, to the same end. `place`: an executor that decides rounds of several nodes, and how many tasks it is given at
    a time; the answer is the same. Close the iterator to stop early.
    """
    began = time.monotonic() - (0.0 if resume is None else resume.seconds)
    index = network.names.index(objective)
    clock = limits.clock()
    domain = network.domain
    if strategy is None:
        strategy = LargestFirst(scale=np.where(domain.rad > 0.0, domain.rad, 1.0), skip=(objective,))
    named = contractors if isinstance(contractors, Sequence) else [("", contractors)]
    incumbent = Incumbent(network, index, limits, engine, clock.deadline)
    process = Bounding(incumbent, Contracting(named, prover), strategy, enclose, place)
    search = Search(
        [Piece(domain, Branch(domain, fresh=True))], process, lambda node: float(node.box.lo[index]), abreast=_abreast
    )
    tally = _Tally(process)
    if resume is not None:
        search.restore(resume.pending, resume.kept, resume.created)
        incumbent.learn(resume.known, incumbent.state)
        tally.restore(resume)

    def bracket() -> Bracket:
        lo = _lowest([node.box for node in search.pending] + [piece.box for piece in search.kept], incumbent)
        return Bracket(lo, incumbent.hi, tally.nodes, tally.programs, time.monotonic() - began)

    interrupted = False
    try:
        if resume is None:
            incumbent.propose(domain.mid if start is None else np.asarray(start, np.float64))
        while search.pending and not clock.over(tally.nodes):
            for event in search:  # of one round: a state between two of them can be gone on from
                tally.add(event)
                if observe is not None:
                    observe(event)
                if not search.within_round:
                    break
            if keep is not None:
                keep(lambda: _saved(search, incumbent, tally, time.monotonic() - began))
            yield bracket()
    except KeyboardInterrupt:
        interrupted = True
    yield _minimum(search, incumbent, bracket(), tally, interrupted)


class _Tally:
    """What the events add up to."""

    def __init__(self, process: Bounding) -> None:
        self._process = process
        self.nodes = self.programs = 0
        self.used: set[Row] = set()
        self.decisive: set[Row] = set()  # rows of the steps that decided the leaves
        self.uses: tuple[ContractorUse, ...] = ()

    def restore(self, saved: Saved) -> None:
        self.nodes, self.programs, self.uses = saved.nodes, saved.programs, saved.uses
        self.used, self.decisive = set(saved.used), set(saved.decisive)

    def add(self, event: Event) -> None:
        step = event.contraction
        self.nodes += event.kind is not EventKind.CONTRACTED
        self.programs += step.programs
        self.uses = total_use(self.uses, event.decision.uses)
        self.used.update(row for s in step.steps for row in s.rows)
        if event.kind in (EventKind.PRUNED, EventKind.KEPT):
            self.decisive |= self._process.raising(step.steps) or event.node.state.rows


def _saved(search: Search, incumbent: Incumbent, tally: _Tally, seconds: float) -> Saved:
    return Saved(
        pending=search.pending,
        kept=tuple(search.kept),
        created=search.created,
        known=incumbent.state,
        nodes=tally.nodes,
        programs=tally.programs,
        used=frozenset(tally.used),
        decisive=frozenset(tally.decisive),
        uses=tally.uses,
        seconds=seconds,
    )


def _lowest(boxes: Sequence[Box], incumbent: Incumbent) -> float:
    lowest = [float(box.lo[incumbent.objective]) for box in boxes if not box.is_empty]
    return min([*lowest, incumbent.hi])


def _minimum(search: Search, incumbent: Incumbent, last: Bracket, tally: _Tally, interrupted: bool) -> Minimum:
    leaves: list[Node | Piece] = [*search.pending, *search.kept]
    boxes = [incumbent.cut(leaf.box) for leaf in leaves]
    found = [incumbent.cut(leaf.state.found) for leaf in leaves]
    pending = boxes[: len(search.pending)]
    undecided = sum(not box.is_empty and not incumbent.settled(box) for box in pending)
    enclosure = _hull(boxes, incumbent)
    reached = Found(_lowest(found, incumbent), _hull(found, incumbent))
    verdict, status = status_of(last, incumbent, undecided)
    more = reached.lo > last.lo or reached.enclosure != enclosure
    return Minimum(
        lo=last.lo,
        hi=last.hi,
        verdict=verdict,
        status=status + (reached.sentence(last.lo) if more else ""),
        witness=incumbent.witness,
        enclosure=enclosure,
        floor=incumbent.floor,
        rows=tuple(sorted(tally.used)),
        decisive_rows=tuple(sorted(tally.decisive)),
        pending=undecided,
        nodes=last.nodes,
        programs=last.programs,
        seconds=last.seconds,
        interrupted=interrupted,
        contractors_used=tally.uses,
        found=reached if more else None,
    )


def _hull(boxes: Sequence[Box], incumbent: Incumbent) -> Box:
    out = Box.empty(incumbent.domain.names)
    for box in boxes:
        out = out.hull(box)
    return out


def run(states: Generator[Bracket | Minimum, None, None], progress: Callable[[Bracket], None] | None) -> Minimum:
    """Run to the end, telling `progress` of every bracket; Ctrl-C, and a process that is asked to stop, end it with
    what is proved."""
    while True:
        try:
            state = next(states)
            if not isinstance(state, Minimum) and progress is not None:
                progress(state)
            if not isinstance(state, Minimum) and asked():
                state = states.throw(KeyboardInterrupt())
        except KeyboardInterrupt as stop:
            state = states.throw(stop)
        if isinstance(state, Minimum):
            return state
