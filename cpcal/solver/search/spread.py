"""The boxes of a search, decided by the workers of an executor ahead of their turn. Decisions are the same as here.

A decision depends on the box alone. So while the search takes in one decision after the other, in its order, workers
decide boxes that wait, and what comes of these, the subtrees below: whoever has decided a box goes on with its pieces
while its time lasts. How far workers look ahead, which depends on their speed, changes nothing but the time.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import Any, NamedTuple, Protocol

import numpy as np

from cpcal.common.values import Bools, Floats, Ints
from cpcal.solver.accounts import ContractorUse
from cpcal.solver.contract import Contraction
from cpcal.solver.execution.executors import Here, Place
from cpcal.solver.execution.outcomes import Shared
from cpcal.solver.execution.stopping import Reason, Stopped, asked
from cpcal.solver.interval import Box
from cpcal.solver.search.passes import Divide
from cpcal.solver.search.search import Decision, EventKind, Node, Piece, Process

# ------------------------------------------------------------------------------------------------------------------
# Decisions about many boxes and about what came of them, as a few arrays: they travel in a tenth of the time.
#
# What explains a contraction (steps, a promising point, a polyhedron) stays where it was made.

NOT_YET, NEVER = -1, -2

_KINDS = tuple(EventKind)


@dataclass(frozen=True)
class Forest:
    """B decisions with P pieces in all, whose state is None or their box.

    A piece's own decision comes after that of its parent.

    kinds     (B,) places in `EventKind`
    boxes     (B, 2, n) what is left of each node's box
    programs  (B,)
    counts    (B, 2) pieces of each, and parts of its box that were removed; -1: nobody asked for these
    pieces    (P, 2, n)
    removed   (R, 2, n)
    stated    (P,) whether there is a state
    depths    (P,)
    links     (P,) the decision about each piece; NOT_YET, or NEVER where it is not divided
    uses      (B, m, 2) calls and steps of each contractor
    seconds   of the processor that all of it took
    """

    names: tuple[str, ...]
    contractors: tuple[str, ...]
    kinds: Ints
    boxes: Floats
    programs: Ints
    counts: Ints
    pieces: Floats
    removed: Floats
    stated: Bools
    depths: Ints
    links: Ints
    uses: Ints
    seconds: float

    @classmethod
    def of(cls, decisions: Sequence[Decision], depths: Sequence[int], links: Sequence[int], seconds: float) -> Forest:
        """At least one decision; depths and links of their pieces."""
        pieces = [piece for decision in decisions for piece in decision.pieces]
        removed = [box for decision in decisions for box in decision.removed or ()]
        n = len(decisions[0].box)
        return cls(
            names=decisions[0].box.names,
            contractors=tuple(use.name for use in decisions[0].uses),
            kinds=np.array([_KINDS.index(decision.kind) for decision in decisions]),
            boxes=_bounds([decision.box for decision in decisions], n),
            programs=np.array([decision.contraction.programs for decision in decisions]),
            counts=np.array([(len(d.pieces), -1 if d.removed is None else len(d.removed)) for d in decisions]),
            stated=np.array([piece.state is not None for piece in pieces], dtype=np.bool_),
            pieces=_bounds([piece.box for piece in pieces], n),
            removed=_bounds(removed, n),
            depths=np.array(depths, dtype=np.intp),
            links=np.array(links, dtype=np.intp),
            uses=np.array([[(use.calls, use.steps) for use in decision.uses] for decision in decisions]),
            seconds=seconds,
        )

    def __len__(self) -> int:
        return len(self.kinds)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_lists", "open")}

    @cached_property
    def open(self) -> dict[int, Node]:
        """The pieces about which nothing is decided here, as nodes, by their place."""
        places = np.flatnonzero(self.links == NOT_YET)
        boxes = Box.rows(self.names, self.pieces[places, 0], self.pieces[places, 1])
        rest = zip(places.tolist(), boxes, self.depths[places].tolist(), self.stated[places].tolist(), strict=True)
        return {p: Node(box, depth, -1, box if stated else None, Ahead()) for p, box, depth, stated in rest}

    def _ahead(self, piece: int, link: int) -> Ahead | None:
        if link == NEVER:
            return None
        if link == NOT_YET:
            return self.open[piece].decided  # type: ignore[no-any-return]
        return Ahead(self, link, given=True)

    @cached_property
    def _lists(self) -> _Lists:
        """Opened when the first of the decisions is wanted: until then they take little memory."""
        starts = np.concatenate([np.zeros((1, 2), np.intp), np.cumsum(np.maximum(self.counts, 0), axis=0)])
        boxes, parts, removed = (
            Box.rows(self.names, a[:, 0], a[:, 1]) for a in (self.boxes, self.pieces, self.removed)
        )
        lists = (a.tolist() for a in (self.kinds, self.programs, starts, self.stated, self.links, self.uses))
        return _Lists(boxes, parts, removed, *lists)

    def decision(self, k: int) -> Decision:
        """That of this place; its pieces know where theirs are, or will be."""
        of = self._lists
        (first, gone), (last, end) = of.starts[k], of.starts[k + 1]
        pieces = tuple(
            Piece(of.parts[p], of.parts[p] if of.stated[p] else None, self._ahead(p, of.links[p]))
            for p in range(first, last)
        )
        uses = tuple(ContractorUse(name, *use) for name, use in zip(self.contractors, of.uses[k], strict=True))
        removed = None if self.counts[k, 1] < 0 else tuple(of.removed[gone:end])
        return Decision(
            _KINDS[of.kinds[k]], Contraction(of.boxes[k], programs=of.programs[k]), pieces, uses, (), removed
        )


@dataclass(eq=False)
class Ahead:
    """Where the decision about a node is that is made ahead of its turn; without a forest it will be. `given`: to
    whoever makes it."""

    forest: Forest | None = None
    place: int = 0
    given: bool = False

    @property
    def decision(self) -> Decision | None:
        return None if self.forest is None else self.forest.decision(self.place)


class _Lists(NamedTuple):
    """A forest's arrays as objects."""

    boxes: list[Box]
    parts: list[Box]
    removed: list[Box]
    kinds: list[int]
    programs: list[int]
    starts: list[list[int]]
    stated: list[bool]
    links: list[int]
    uses: list[list[list[int]]]


def _bounds(boxes: Sequence[Box], n: int) -> Floats:
    """(B, 2, n)"""
    return np.array([(box.lo, box.hi) for box in boxes], np.float64).reshape(len(boxes), 2, n)


_SPAN = 0.1  # seconds of the processor for a task, if its own boxes do not take longer
_MOST = 4096  # boxes of a task
_FEW, _MANY = 16, 64  # nodes that a task begins with, until it is known how long they take, and at most
_STOCK = 200_000  # decisions made ahead, at most: some 50 MB
_LOOK = 64  # decisions between two looks for work to give out
_DIVIDED = (EventKind.SPLIT, EventKind.CONTRACTED)


class DecidesAlone(Protocol):
    """A process that decides each node by itself and by nothing but its box and depth, so many best at a time."""

    @property
    def batch(self) -> int: ...

    def __call__(self, node: Node) -> Decision: ...

    def all(self, nodes: Sequence[Node]) -> list[Decision]: ...


Undecided = Callable[[], Iterable[Node]]  # of a search, the most urgent first


@dataclass(frozen=True)
class DecideTask:
    """Nodes to decide, and for how many seconds to go on with what comes of them."""

    nodes: list[Node]
    span: float
    number: int = 0


class Spread:
    """A process whose nodes are decided by workers. Until the first of them is there, it decides here."""

    def __init__(self, process: DecidesAlone, place: Place) -> None:
        self._process = process
        self._tasks = Shared(process).given_out(place, grown)
        self._workers = (place[1] + 1) // 2
        self._begun = self._there = False  # the workers
        self._here: dict[int, Decision] = {}  # made by this process, by serial
        self._roots: dict[int, Ahead] = {}  # of nodes that come of no forest, by serial
        self._open: deque[Node] = deque()  # of forests; some are given out by now
        self._out: dict[int, list[Ahead]] = {}  # with workers, by number of task
        self._given = 0  # tasks
        self._each = _SPAN / _FEW  # seconds that a node of a task takes, with what comes of it
        self._stock = 0
        self._calls = 0

    def __call__(self, node: Node) -> Decision:
        return self._process(node)

    def ahead(self, node: Node, undecided: Undecided) -> Decision:
        """The decision about the most urgent node. Others are given out, and taken back as they are done."""
        if not self._begun and self._tasks.ready:
            self._begin(node)
        self._calls += 1
        if self._tasks.some_done:
            self._take_back()
            self._give(node, undecided)
        elif self._there and self._calls % _LOOK == 0:
            self._give(node, undecided)
        while (made := self._made(node)) is None:
            if not self._there:
                self._decide_here(undecided)
                continue
            if asked():
                raise Stopped(asked() or Reason.INTERRUPTED)
            self._give(node, undecided)
            self._take_back()
        return made

    def close(self) -> None:
        """Give up what is with workers."""
        self._tasks.cancel()

    def _made(self, node: Node) -> Decision | None:
        if node.serial in self._here:
            return self._here.pop(node.serial)
        found = self._place_of(node)
        if found.forest is None:
            return None
        self._roots.pop(node.serial, None)
        self._stock -= 1
        return found.decision

    def _place_of(self, node: Node) -> Ahead:
        """Where its decision is, or will be."""
        if isinstance(node.decided, Ahead):
            return node.decided
        return self._roots.get(node.serial) or Ahead()

    def _begin(self, node: Node) -> None:
        """Have each worker begin, with a task that makes it load what it needs."""
        self._begun = True
        for _ in range(self._workers):
            self._send([node], [], 0.0, first=True)

    def _decide_here(self, undecided: Undecided) -> None:
        nodes = list(islice((one for one in undecided() if one.serial not in self._here), self._process.batch))
        self._here.update((node.serial, made) for node, made in zip(nodes, self._process.all(nodes), strict=True))

    def _give(self, node: Node, undecided: Undecided) -> None:
        """Give out nodes that nobody has decided; where enough is decided ahead, no other than this one."""
        free = self._tasks.free
        if not free:
            return
        most = min(max(int(_SPAN / self._each), 1), _MANY)
        nodes = list(islice(self._chosen(node, undecided), free * most))
        size = -(-len(nodes) // free)
        for k in range(0, len(nodes), size or 1):
            some = nodes[k : k + size]
            self._send(some, list(map(self._place_of, some)), _SPAN)

    def _chosen(self, node: Node, undecided: Undecided) -> Iterator[Node]:
        """Nodes to give out: those that the search will soon come to, then those that it has not even seen.

        The latter are what forests left open. Without them workers stand still while the search waits for one box.
        """
        for one in [node] if self._stock > _STOCK else undecided():
            if one.serial not in self._here and self._is_chosen(one):
                yield one
        while self._open and self._stock <= _STOCK:
            one = self._open.popleft()
            if self._is_chosen(one):
                yield one

    def _is_chosen(self, node: Node) -> bool:
        """Whether nobody has decided it, or is to decide it until now."""
        place = self._place_of(node)
        if place.given:
            return False
        place.given = True
        if node.decided is None:
            self._roots[node.serial] = place
        return True

    def _send(self, nodes: Sequence[Node], places: list[Ahead], span: float, *, first: bool = False) -> None:
        self._given += 1
        self._out[self._given] = places
        task = DecideTask([replace(node, decided=None) for node in nodes], span, self._given)
        self._tasks.give(task, first=first)

    def _take_back(self) -> None:
        """What is done, or wait for some of it for a moment. Raises what was raised there."""
        for outcome in self._tasks.taken_back():
            self._there = True
            forest, places = outcome.value, self._out.pop(outcome.task.number)
            if not places:
                continue
            self._stock += len(forest)
            self._each = (self._each + max(forest.seconds / len(places), _SPAN / _MANY)) / 2
            for k, place in enumerate(places):
                place.forest, place.place = forest, k
            self._open.extend(forest.open.values())


@contextmanager
def spread_over(there: AbstractContextManager[Place]) -> Iterator[Callable[[Divide], Process]]:
    """What has a process decide by the workers of a place, if there are any; in the end nothing is left with them."""
    made: list[Spread] = []

    def spread(process: Divide) -> Process:
        if isinstance(place[0], Here):
            return process
        made.append(Spread(process, place))
        return made[-1]

    with there as place:
        try:
            yield spread
        finally:
            for one in made:
                one.close()


def grown(process: DecidesAlone, task: DecideTask) -> Forest:
    """Decide the nodes, then what came of them, the oldest first, for about so many seconds."""
    began = time.thread_time()
    decisions: list[Decision] = []
    depths: list[int] = []  # of their pieces
    links: list[int] = []
    waiting = deque[tuple[int, Node]]()  # and the place of their link

    def decide(some: Sequence[Node]) -> None:
        for node, decision in zip(some, process.all(some), strict=True):
            depth = node.depth + (decision.kind is EventKind.SPLIT)
            decisions.append(decision)
            for piece in decision.pieces:
                if decision.kind in _DIVIDED:
                    waiting.append((len(links), Node(piece.box, depth, -1, piece.state)))
                depths.append(depth)
                links.append(NOT_YET if decision.kind in _DIVIDED else NEVER)

    decide(task.nodes)
    while waiting and len(decisions) < _MOST and not asked():
        spent = time.thread_time() - began
        count = min(int((task.span - spent) / spent * len(decisions)), len(waiting), _MOST) if spent else 1
        if count < 1:
            break
        some = [waiting.popleft() for _ in range(count)]
        for k, (place, _) in enumerate(some):
            links[place] = len(decisions) + k
        decide([node for _, node in some])
    return Forest.of(decisions, depths, links, time.thread_time() - began)
