"""Branch and prune. The search is an iterator that yields one event per node.

Progress bars, limits, logs and checkpoints are callers of it: stop iterating whenever you like, `pending`
holds every box that has not been decided.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum

from cpcal.interfaces import Contraction, Contractor, Strategy
from cpcal.interval import Box


class EventKind(Enum):
    """What became of a node."""

    PRUNED = "proved to hold no solution"
    SPLIT = "divided"
    CONTRACTED = "contracted, and worth another pass"
    KEPT = "fine enough to keep"


@dataclass(frozen=True)
class Node:
    """An undecided box; `serial` counts nodes in order of creation."""

    box: Box
    depth: int
    serial: int


@dataclass(frozen=True)
class Event:
    """One node's fate. `contraction.box` is what was left of `node.box`."""

    kind: EventKind
    node: Node
    contraction: Contraction
    children: tuple[Node, ...] = ()


Priority = Callable[[Node], float]


def depth_first(node: Node) -> float:
    return -float(node.serial)


def breadth_first(node: Node) -> float:
    return float(node.depth)


class Search(Iterator[Event]):
    """Contract the most urgent box, then prune, keep or split it. Lower priority goes first, then age.

    A strategy that returns one piece asks for another pass over it. `kept` holds the boxes that were fine enough.
    """

    def __init__(
        self,
        roots: Iterable[Box],
        contractor: Contractor,
        strategy: Strategy,
        priority: Priority = depth_first,
    ) -> None:
        self._contractor, self._strategy, self._priority = contractor, strategy, priority
        self._heap: list[tuple[float, int, Node]] = []
        self._current: Node | None = None
        self._created = 0
        self.kept: list[Box] = []
        for box in roots:
            self._push(box, 0)

    @property
    def pending(self) -> tuple[Node, ...]:
        """The undecided nodes, most urgent first."""
        queued = tuple(node for _, _, node in sorted(self._heap, key=lambda entry: entry[:2]))
        return queued if self._current is None else (self._current, *queued)

    def __next__(self) -> Event:
        # Ctrl-C may strike between any two lines: a node is listed as undecided (perhaps twice) until all that
        # follows from it is stored.
        if self._current is None:
            if not self._heap:
                raise StopIteration
            self._current = self._heap[0][2]
            heapq.heappop(self._heap)
        node = self._current
        contraction = self._contractor.contract(node.box)
        pieces = () if contraction.box.is_empty else self._strategy.split(contraction.box)
        children = tuple(self._push(piece, node.depth + (len(pieces) > 1)) for piece in pieces)
        if not pieces and not contraction.box.is_empty:
            self.kept.append(contraction.box)
        self._current = None
        return Event(_kind(contraction.box, len(pieces)), node, contraction, children)

    def _push(self, box: Box, depth: int) -> Node:
        node = Node(box, depth, self._created)
        self._created += 1
        heapq.heappush(self._heap, (self._priority(node), node.serial, node))
        return node


def _kind(box: Box, pieces: int) -> EventKind:
    if box.is_empty:
        return EventKind.PRUNED
    if pieces == 1:
        return EventKind.CONTRACTED
    return EventKind.SPLIT if pieces else EventKind.KEPT
