"""method="bound": branch and bound on the objective, a variable of the network like any other.

Below, the contractors raise the objective's lower bound; above, a local fit proposes points that
`WitnessProver` proves. Between the two the bracket is valid at every moment.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from cpcal.common.values import Floats, Indices, Names, Places, floats
from cpcal.solver.accounts import RowUse, bracket_sentence
from cpcal.solver.compiled import TimeUp, compiling_until
from cpcal.solver.contract import Contraction, Limits, Named, Row, Step, Strategy, Verdict, shrunk
from cpcal.solver.execution.checkpoint_file import Line
from cpcal.solver.execution.executors import Place, Shared
from cpcal.solver.execution.stopping import Stopped, asked
from cpcal.solver.interval import Box, Interval
from cpcal.solver.interval.box import Variable
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize.local import Incumbent, Known
from cpcal.solver.optimize.witness import Prepared, Witness
from cpcal.solver.search.passes import Contracting, LargestFirst, StepProver, bisect, light
from cpcal.solver.search.search import (
    Branch,
    Decision,
    Event,
    EventKind,
    Node,
    Observer,
    Piece,
    Search,
    Standing,
    rows_of,
)

# ------------------------------------------------------------------------------------------------------------------
# What is done to one node of the branch and bound: cut with the incumbent, contract, decide what comes next.

_SHRINK = 0.8  # go on with a node while some width falls below this share of what it was
_SETTLE = 0.95  # the same for a node that was closed from the start, where only the enclosure is at stake
_THIN = 1e-12  # a width below this share of the domain's does not count


class Bounding:
    """The process of a branch and bound: every decision is made of the node and of the incumbent.

    Without `enclose` no work is spent on a box that is closed.
    """

    def __init__(
        self, incumbent: Incumbent, contracting: Contracting, strategy: Strategy, enclose: bool, place: Place | None
    ) -> None:
        self._incumbent, self._contracting, self._strategy, self._enclose = incumbent, contracting, strategy, enclose
        self._elsewhere: Shared[Bounding] | None = None  # and none in what travels
        if place is not None:
            self._elsewhere = Shared(self, place)

    def __call__(self, node: Node) -> Decision:
        return self.all([node])[0]

    def all(self, nodes: Sequence[Node]) -> list[Decision]:
        """The decisions of a round, each from the incumbent as it is at its beginning, so that their order, and where
        they are made, change nothing. What they find counts from its end.

        Raises Stopped between two nodes of a round.
        """
        before = self._incumbent.state
        if len(nodes) == 1:
            known = self._incumbent.at(before)
            made = [(self._decision(nodes[0], known), known.state)]
        elif self._elsewhere is None:
            made = self.decided(nodes, before)
        else:
            made = self._elsewhere.in_parts(Bounding.decided, nodes, before)
        for _, state in made:
            self._incumbent.learn(state, before)
        return [decision for decision, _ in made]

    def decided(self, nodes: Sequence[Node], before: Known) -> list[tuple[Decision, Known]]:
        """The decisions about some nodes of a round, each with the one about the most urgent of its pieces, and the
        incumbent after each, if it was `before` when it began."""
        decisions = []
        for node in nodes:
            known = self._incumbent.at(before)
            made = self._decision(node, known)
            if made.kind in (EventKind.SPLIT, EventKind.CONTRACTED):
                reason = asked()  # the whole round begins anew some day
                if reason is not None:
                    raise Stopped(reason)
                pieces = list(made.pieces)
                k = min(range(len(pieces)), key=lambda k: float(pieces[k].box.lo[known.objective]))
                depth = node.depth + (made.kind is EventKind.SPLIT)
                below = self._decision(Node(pieces[k].box, depth, -1, pieces[k].state), known)
                pieces[k] = replace(pieces[k], decided=below)
                made = replace(made, pieces=tuple(pieces))
            decisions.append((light(made), known.state))
        return decisions

    def _decision(self, node: Node, known: Incumbent) -> Decision:
        branch = node.state
        before = known.cut(node.box)
        if before.is_empty:
            return Decision(EventKind.PRUNED, Contraction(before))
        was_closed = known.closed(before)
        done = self._contracting.contract(before)
        step = done.contraction
        branch = branch._replace(rows=self.raising(step.steps) or branch.rows)
        pays = self._pays(before, step.box, was_closed)
        # boxes that contraction closes alone need no other fit than the first
        wanted = branch.fresh and not (step.box.is_empty or known.closed(step.box) or (pays and known.served))
        point = step.point
        if point is None and known.witness is None and not step.box.is_empty:
            point = step.box.mid  # no program says better where the objective has no bounds yet
        if point is not None and wanted:
            pays = known.propose(point) or pays
            branch = branch._replace(fresh=False)
        left = replace(step, box=known.cut(step.box))
        kind, pieces = self._next(left.box, branch, pays, was_closed, known)
        return Decision(kind, left, pieces, done.proof)

    def raising(self, steps: Iterable[Step]) -> frozenset[Row]:
        """The rows of the last step that raised the objective, or proved a box empty."""
        name = self._incumbent.domain.names[self._incumbent.objective]
        raised = [s for s in steps if s.variable is None or (s.variable == name and s.side == "lo")]
        return frozenset(raised[-1].rows) if raised else frozenset()

    def _pays(self, before: Box, after: Box, was_closed: bool) -> bool:
        """Whether another pass is worth while."""
        counts = before.width > _THIN * self._incumbent.domain.width
        return shrunk(before.width[counts], after.width[counts], _SETTLE if was_closed else _SHRINK)

    def _next(
        self, box: Box, branch: Branch, pays: bool, was_closed: bool, known: Incumbent
    ) -> tuple[EventKind, tuple[Piece, ...]]:
        """The box itself for another pass, or to be kept once it is settled, else its pieces by the strategy.

        Where that finds nothing to divide, the objective itself is halved.
        """
        if box.is_empty:
            return EventKind.PRUNED, ()
        closed = known.closed(box)
        if pays and closed == was_closed and (self._enclose or not closed):
            return EventKind.CONTRACTED, (Piece(box, branch),)
        if known.settled(box):
            return EventKind.KEPT, (Piece(box, branch),)
        cuts = self._strategy.split(box) or bisect(box, self._incumbent.objective)
        # a fit may begin in the first piece
        pieces = tuple(Piece(piece, branch._replace(fresh=k == 0)) for k, piece in enumerate(cuts))
        return (EventKind.SPLIT, pieces) if pieces else (EventKind.KEPT, (Piece(box, branch),))


# ------------------------------------------------------------------------------------------------------------------
# What the events add up to, and where a branch and bound stands between two rounds, as lines of JSON.


class Tally(NamedTuple):
    """`used`: rows with a weight in some step; `decisive`: those of the steps that decided the leaves."""

    nodes: int = 0
    programs: int = 0
    used: frozenset[Row] = frozenset()
    decisive: frozenset[Row] = frozenset()

    def with_event(self, event: Event, raising: frozenset[Row]) -> Tally:
        """`raising`: the rows by which the node's objective rose last."""
        step, leaf = event.contraction, event.kind in (EventKind.PRUNED, EventKind.KEPT)
        rows = {row for s in step.steps for row in s.rows}
        return Tally(
            self.nodes + (event.kind is not EventKind.CONTRACTED),
            self.programs + step.programs,
            self.used if rows <= self.used else self.used | rows,
            self.decisive | raising if leaf else self.decisive,
        )


class Saved(NamedTuple):
    """Everything that the rest of a minimisation depends on; `seconds` that it took until then."""

    names: Names
    search: Standing
    known: Known
    tally: Tally
    seconds: float

    def lines(self) -> Iterator[Line]:
        """A head, then a line a box."""
        witness, tally = self.known.witness, self.tally
        yield {
            "names": list(self.names),
            "witness": None if witness is None else {"point": witness.point.tolist(), "value": witness.value},
            "calls": self.known.calls,
            "created": self.search.created,
            **tally._asdict(),
            "used": sorted(tally.used),
            "decisive": sorted(tally.decisive),
            "seconds": self.seconds,
        }
        yield from self.search.lines()

    @classmethod
    def from_lines(cls, lines: Sequence[Line]) -> Saved:
        """What `lines` gave. Raises KeyError, TypeError, ValueError, ModelError."""
        head, *boxes = lines
        names, witness = tuple(head["names"]), head["witness"]
        if witness is not None:
            witness = Witness(np.array(witness["point"], np.float64), witness["value"])
        return cls(
            names,
            Standing.from_lines(head["created"], names, boxes),
            Known(witness, head["calls"]),
            Tally(head["nodes"], head["programs"], rows_of(head["used"]), rows_of(head["decisive"])),
            head["seconds"],
        )


_ROUND = 64  # nodes, at most
_WAITING = 8  # pending nodes for each of a round: few that a better point would spare are looked at


def _abreast(pending: int) -> int:
    """Nodes of a round. It depends on the search alone, never on who does the work, so that all go the same way."""
    return min(_ROUND, 1 + pending // _WAITING)


def minimize(
    network: ConstraintNetwork,
    objective: str,
    contractors: Sequence[Named],
    *,
    limits: Limits,
    domain: Box | None = None,
    start: Floats | None = None,
    best: Known | None = None,
    prepared: Prepared | None = None,
    enclose: bool = True,
    prover: StepProver | None = None,
    observe: Observer | None = None,
    resume: Saved | None = None,
    keep: Callable[[Callable[[], Saved]], None] | None = None,
    place: Place | None = None,
) -> Generator[Bracket | Minimum, None, None]:
    """Brackets of the smallest value of the variable `objective`, then the `Minimum` as the last item.

    THERE EXISTS a reading in its set for every constraint, as in the network. `contractors` are applied one after the
    other; with a `prover` only what it proves again by weights counts. `domain`: a part of the network's (default: all
    of it). `start` (n,) is where the first fit begins (default: the middle of the domain); with `best`, which is known
    already, there is none. `prepared`: what other questions about the network and the objective have set up. Without
    `enclose` no work is spent on a tight enclosure. `observe` is told of every node's fate, and after it `keep` is
    given a function that tells where the search stands; with that as `resume` another call goes on from there, to the
    same end. `place`: an executor that decides rounds of several nodes, and how many tasks it is given at a time; the
    answer is the same. Close the iterator to stop early.
    """
    began = time.monotonic() - (0.0 if resume is None else resume.seconds)
    index = network.names.index(objective)
    clock = limits.clock()
    domain = network.domain if domain is None else domain
    strategy = LargestFirst(scale=np.where(domain.rad > 0.0, domain.rad, 1.0), skip=(objective,))
    prepared = prepared or Prepared(network, objective)
    incumbent = Incumbent(prepared, limits, clock.deadline, domain, best)
    process = Bounding(incumbent, Contracting(contractors, prover, clock.deadline), strategy, enclose, place)
    root = Piece(domain, Branch(fresh=True))
    search = Search([root], process, lambda node: float(node.box.lo[index]), abreast=_abreast)
    tally, kept_from = Tally(), np.inf  # and the objective's lowest bound in what was kept
    if resume is not None:
        search.restore(resume.search)
        incumbent.learn(resume.known, incumbent.state)
        tally, kept_from = resume.tally, min((float(piece.box.lo[index]) for piece in search.kept), default=np.inf)

    def bracket() -> Bracket:
        lo = min(incumbent.hi, kept_from, np.inf if search.lowest is None else search.lowest)
        return Bracket(lo, incumbent.hi, tally.nodes, tally.programs, time.monotonic() - began, search.waiting)

    def saved() -> Saved:
        return Saved(domain.names, search.standing(), incumbent.state, tally, time.monotonic() - began)

    interrupted = False
    try:
        with compiling_until(clock.deadline):
            if resume is None and best is None:
                incumbent.propose(domain.mid if start is None else floats(start))
        while search.waiting and not clock.over(tally.nodes):
            with compiling_until(clock.deadline):
                for event in search:  # of one round: a state between two of them can be gone on from
                    rows = process.raising(event.contraction.steps) or event.node.state.rows
                    tally = tally.with_event(event, rows)
                    if event.kind is EventKind.KEPT:
                        kept_from = min([kept_from, *(float(p.box.lo[index]) for p in event.decision.pieces)])
                    if observe is not None:
                        observe(event)
                    if not search.begun:
                        break
            if keep is not None:
                keep(saved)
            yield bracket()
    except TimeUp:  # inside of a decision: no event is half stored
        pass
    except KeyboardInterrupt:
        interrupted = True
    yield _minimum(search, incumbent, bracket(), tally, interrupted)


def _minimum(search: Search, incumbent: Incumbent, last: Bracket, tally: Tally, interrupted: bool) -> Minimum:
    undecided, floor = 0, incumbent.floor
    enclosure = Box.empty(incumbent.domain.names)
    leaves: Iterator[Node | Piece] = chain(search.pending, search.kept)
    for leaf in leaves:
        box = incumbent.cut(leaf.box)
        undecided += isinstance(leaf, Node) and not box.is_empty and not incumbent.settled(box)
        enclosure = enclosure.hull(box)
    verdict, status = status_of(last, incumbent, undecided, floor)
    return Minimum(
        lo=last.lo,
        hi=last.hi,
        verdict=verdict,
        status=status,
        witness=incumbent.witness,
        enclosure=enclosure,
        floor=floor,
        rows=tuple(sorted(tally.used)),
        decisive_rows=tuple(sorted(tally.decisive)),
        pending=undecided,
        nodes=last.nodes,
        programs=last.programs,
        seconds=last.seconds,
        interrupted=interrupted,
        names=incumbent.domain.names,
    )


def run(states: Generator[Bracket | Minimum, None, None], progress: Progress) -> Minimum:
    """Run to the end, telling `progress` of every bracket; Ctrl-C, and a process that is asked to stop, end it with
    what is proved."""
    while True:
        try:
            state = next(states)
            if not isinstance(state, Minimum):
                if progress is not None:
                    progress(state)
                if asked():
                    raise KeyboardInterrupt
        except KeyboardInterrupt as stop:
            state = states.throw(stop)
        if isinstance(state, Minimum):
            return state


# ------------------------------------------------------------------------------------------------------------------
# What a minimisation says: a bracket at every moment, and the minimum at its end.


@dataclass(frozen=True)
class Bracket:
    """The state of a minimisation: the optimum lies in `[lo, hi]` (hi infinite: no point proved yet).

    `pending` boxes are undecided.
    """

    lo: float
    hi: float
    nodes: int
    programs: int
    seconds: float
    pending: int = 0


Progress = Callable[[Bracket], None] | None  # what is told of it meanwhile


@dataclass(frozen=True)
class Point:
    """A point (n,) whose components have names."""

    names: Names
    values: Floats

    def __getitem__(self, name: str | Variable) -> float | Floats:
        """A component by its name, or the value of a variable, of its shape."""
        found = Box(self.names, self.values, self.values)[name]
        return found.lo if isinstance(found, Interval) else np.array(found.lo)


@dataclass(frozen=True)
class Minimum:
    """The end of a minimisation over a box.

    `lo`: proved, no solution has a smaller objective. `hi` and `witness`: a proved solution. `enclosure`: holds every
    solution with objective <= hi. `verdict` PROVED: the two bounds are no further apart than the gap asked for, or the
    smallest value of the domain is attained; REFUTED: there is no solution. `floor`: the second-order effect of the
    readings at the witness; boxes are not divided to close a smaller gap (though contraction alone often closes it).
    `rows`: the (constraint, element) pairs with a multiplier in some step of the proof of `lo`; `decisive_rows`: those
    of the steps that decided the leaves. With a certificate all this is what it proves.
    """

    lo: float
    hi: float
    verdict: Verdict
    status: str
    enclosure: Box
    witness: Witness | None = None
    floor: float = 0.0
    rows: tuple[Row, ...] = ()
    decisive_rows: tuple[Row, ...] = ()
    pending: int = 0
    nodes: int = 0
    programs: int = 0
    seconds: float = 0.0
    interrupted: bool = False
    names: Names = ()  # of the components of points
    relax: float = 0.0  # by how much equations may be missed
    method: str = ""  # which contractors, and why these
    row_use: RowUse | None = None

    @property
    def solution(self) -> Point | None:
        """The proved point by names and variables: `minimum.solution["x[0]"]`, `minimum.solution[x]`."""
        return None if self.witness is None else Point(self.names, self.witness.point)


def status_of(last: Bracket, incumbent: Incumbent, undecided: int, floor: float) -> tuple[Verdict, str]:
    """The verdict on a bracket and a sentence; `undecided` boxes were left at a limit."""
    verdict = Verdict.UNKNOWN
    if incumbent.witness is None:
        if not undecided and last.lo == np.inf:
            verdict = Verdict.REFUTED
    elif last.hi == incumbent.domain.lo[incumbent.objective]:
        return Verdict.PROVED, "The smallest value that the domain allows is attained: proved."
    elif last.hi - last.lo <= incumbent.gap:
        verdict = Verdict.PROVED
    hi = np.inf if incumbent.witness is None else last.hi
    return verdict, bracket_sentence(verdict, last.lo, hi, floor=floor, undecided=undecided)


# ------------------------------------------------------------------------------------------------------------------
# The support of a lower bound: few measurements that prove it by themselves.
#
# What is proved of a support: by its measurements alone, no point of the domain has an objective below the bound.

_ROUNDS = 4  # times that measurements are added
_ADDED = 3  # at a time, for each side of each constraint


class Alone(NamedTuple):
    """What some measurements prove alone: a lower bound.

    `point`: a better point than that of all measurements, if these alone allow one.
    """

    lo: float
    point: Floats | None
    interrupted: bool


Solve = Callable[[Indices, float], Alone]  # of which it is asked if they prove at least so much


def support(problem: Prepared, found: Minimum, gap: float, solve: Solve) -> Places:
    """Elements (along the constraints' leading axis) that alone prove `found.lo` up to the relative `gap`.

    It begins with those that decided the leaves; while they alone allow a better point, those join that it violates
    most, else those that say most at the best point, and some that are spread over all. Where that does not end soon,
    or is interrupted: all that had a weight in some step. () when there is nothing to prove.
    """
    domain = problem.network.domain
    if not found.lo > domain[problem.name].lo or found.interrupted:
        return ()
    slack = max(gap * abs(found.lo), found.hi - found.lo)
    enough = found.lo if found.lo == np.inf else found.lo - slack
    chosen = np.array(sorted({k for _, k in found.decisive_rows}), np.intp)
    for _ in range(_ROUNDS if chosen.size else 0):
        alone = solve(chosen, enough)
        if alone.interrupted:
            break
        if alone.lo >= enough:
            return tuple(int(k) for k in chosen)
        more = chosen
        if alone.point is not None:
            more = np.unique(np.concatenate([chosen, *problem.rows.violated(alone.point, _ADDED)]))
        if more.size == chosen.size and found.witness is not None:
            more = np.unique(np.concatenate([chosen, *problem.rows.telling(found.witness.point, _ADDED)]))
        if more.size == chosen.size:
            break
        chosen = more
    return tuple(sorted({k for _, k in found.rows}))
