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
from itertools import islice
from typing import Protocol

from cpcal.execution.executors import Here, Place
from cpcal.execution.outcomes import Shared
from cpcal.execution.stopping import Reason, Stopped, asked
from cpcal.solver.search.divide import Divide
from cpcal.solver.search.forest import NEVER, NOT_YET, Ahead, Forest
from cpcal.solver.search.orders import Node
from cpcal.solver.search.search import Decision, EventKind, Process

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
