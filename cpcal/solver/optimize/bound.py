"""method="bound": branch and bound on the objective, a variable of the network like any other.

Below, the contractors raise the objective's lower bound; above, a local fit proposes points that
`WitnessProver` proves. Between the two the bracket is valid at every moment.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from itertools import chain

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.execution.executors import Place
from cpcal.execution.stopping import asked
from cpcal.solver.accounts import ContractorUse, Found, total_use
from cpcal.solver.compiled import TimeUp, compiling_until
from cpcal.solver.contract import Contractor, Strategy
from cpcal.solver.interval import Arithmetic, Box
from cpcal.solver.limits import Limits
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize.bounding import Bounding, Branch, Row
from cpcal.solver.optimize.incumbent import Incumbent, Known
from cpcal.solver.optimize.minimum import Bracket, Minimum, status_of
from cpcal.solver.optimize.prepared import Prepared
from cpcal.solver.optimize.saved import Saved
from cpcal.solver.search import (
    Contracting,
    Event,
    EventKind,
    LargestFirst,
    Node,
    Piece,
    Search,
    StepProver,
)

Named = tuple[str, Contractor]

_ROUND = 64  # nodes, at most
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
    domain: Box | None = None,
    start: Floats | None = None,
    best: Known | None = None,
    prepared: Prepared | None = None,
    strategy: Strategy | None = None,
    enclose: bool = True,
    prover: StepProver | None = None,
    observe: Callable[[Event], None] | None = None,
    resume: Saved | None = None,
    keep: Callable[[Callable[[], Saved]], None] | None = None,
    place: Place | None = None,
) -> Generator[Bracket | Minimum, None, None]:
    """Brackets of the smallest value of the variable `objective`, then the `Minimum` as the last item.

    THERE EXISTS a reading in its set for every constraint, as in the network. `contractors` are applied one after the
    other; with a `prover` only what it proves again by weights counts for `lo` and `enclosure`, and `found` holds what
    all contractors reach. `domain`: a part of the network's (default: all of it). `start` (n,) is where the first fit
    begins (default: the middle of the domain); with `best`, which is known already, there is none. `prepared`: what
    other questions about the network and the objective have set up. Without `enclose` no work is spent on a tight
    enclosure. `observe` is told of every node's fate, and after it `keep` is given a function that tells where the
    search stands; with that as `resume` another call goes on from there, to the same end. `place`: an executor that
    decides rounds of several nodes, and how many tasks it is given at a time; the answer is the same. Close the
    iterator to stop early.
    """
    began = time.monotonic() - (0.0 if resume is None else resume.seconds)
    index = network.names.index(objective)
    clock = limits.clock()
    domain = network.domain if domain is None else domain
    strategy = strategy or LargestFirst(scale=np.where(domain.rad > 0.0, domain.rad, 1.0), skip=(objective,))
    named = contractors if isinstance(contractors, Sequence) else [("", contractors)]
    prepared = prepared or Prepared(network, objective, engine)
    incumbent = Incumbent(prepared, limits, clock.deadline, domain=domain, best=best)
    process = Bounding(incumbent, Contracting(named, prover), strategy, enclose, place)
    root = Piece(domain, Branch(domain, fresh=True))
    search = Search([root], process, lambda node: float(node.box.lo[index]), abreast=_abreast, subtrees=True)
    tally = _Tally(process, index)
    if resume is not None:
        search.restore(resume.pending, resume.kept, resume.created)
        incumbent.learn(resume.known, incumbent.state)
        tally.restore(resume)

    def bracket() -> Bracket:
        lo = min(incumbent.hi, tally.kept_from, np.inf if search.lowest is None else search.lowest)
        spent = time.monotonic() - began
        return Bracket(lo, incumbent.hi, tally.nodes, tally.programs, spent, search.waiting)

    interrupted = False
    try:
        with compiling_until(clock.deadline):
            if resume is None and best is None:
                incumbent.propose(domain.mid if start is None else np.asarray(start, np.float64))
        while search.waiting and not clock.over(tally.nodes):
            with compiling_until(clock.deadline):
                for event in search:  # of one round: a state between two of them can be gone on from
                    tally.add(event)
                    if observe is not None:
                        observe(event)
                    if not search.within_round:
                        break
            if keep is not None:
                keep(lambda: _saved(search, incumbent, tally, time.monotonic() - began))
            yield bracket()
    except TimeUp:  # inside of a decision: no event is half stored
        pass
    except KeyboardInterrupt:
        interrupted = True
    yield _minimum(search, incumbent, bracket(), tally, interrupted)


class _Tally:
    """What the events add up to."""

    def __init__(self, process: Bounding, objective: int) -> None:
        self._process, self._objective = process, objective
        self.nodes = self.programs = 0
        self.kept_from = np.inf  # the objective's lowest bound in what was kept
        self.used: set[Row] = set()
        self.decisive: set[Row] = set()  # rows of the steps that decided the leaves
        self.uses: tuple[ContractorUse, ...] = ()

    def restore(self, saved: Saved) -> None:
        self.nodes, self.programs, self.uses = saved.nodes, saved.programs, saved.uses
        self.used, self.decisive = set(saved.used), set(saved.decisive)
        self._keep(piece.box for piece in saved.kept)

    def add(self, event: Event) -> None:
        step = event.contraction
        self.nodes += event.kind is not EventKind.CONTRACTED
        self.programs += step.programs
        self.uses = total_use(self.uses, event.decision.uses)
        self.used.update(row for s in step.steps for row in s.rows)
        if event.kind in (EventKind.PRUNED, EventKind.KEPT):
            self.decisive |= self._process.raising(step.steps) or event.node.state.rows
        if event.kind is EventKind.KEPT:
            self._keep(piece.box for piece in event.decision.pieces)

    def _keep(self, boxes: Iterable[Box]) -> None:
        self.kept_from = min([self.kept_from, *(float(box.lo[self._objective]) for box in boxes)])


def _saved(search: Search, incumbent: Incumbent, tally: _Tally, seconds: float) -> Saved:
    return Saved(
        names=incumbent.domain.names,
        pending=search.undecided(),
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


def _minimum(search: Search, incumbent: Incumbent, last: Bracket, tally: _Tally, interrupted: bool) -> Minimum:
    undecided, least = 0, incumbent.hi
    enclosure = around = Box.empty(incumbent.domain.names)
    leaves: Iterator[Node | Piece] = chain(search.undecided(), search.kept)
    for leaf in leaves:  # one at a time: many of them may be on disk
        box, found = incumbent.cut(leaf.box), incumbent.cut(leaf.state.found)
        undecided += isinstance(leaf, Node) and not box.is_empty and not incumbent.settled(box)
        enclosure, around = enclosure.hull(box), around.hull(found)
        least = least if found.is_empty else min(least, float(found.lo[incumbent.objective]))
    reached = Found(least, around)
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
