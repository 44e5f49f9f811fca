"""Branch and prune. The search is an iterator that yields one event per node.

Progress bars, limits, logs and checkpoints are callers of it: stop iterating whenever you like, `pending`
holds every box that has not been decided.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Protocol, runtime_checkable

from cpcal.solver.contract import Contraction, Contractor, Strategy
from cpcal.solver.interval import Box
from cpcal.solver.search.orders import Node, Priority, depth_first
from cpcal.solver.search.regions import difference


class EventKind(Enum):
    """What became of a node."""

    PRUNED = "proved to hold no solution"
    SPLIT = "divided"
    CONTRACTED = "contracted, and worth another pass"
    KEPT = "fine enough to keep"
    INSIDE = "proved to hold nothing but solutions"


@dataclass(frozen=True)
class Event:
    """One node's fate. `contraction.box` is what was left of `node.box`."""

    kind: EventKind
    node: Node
    contraction: Contraction
    children: tuple[Node, ...] = ()


@runtime_checkable
class DepthStrategy(Protocol):
    """A strategy that wants to know how many divisions led to a box."""

    def split_at(self, box: Box, depth: int) -> tuple[Box, ...]: ...


class Search(Iterator[Event]):
    """Contract the most urgent box, then prune, keep or split it. Lower priority goes first, then age.

    A strategy that returns one piece asks for another pass over it. `kept` holds the boxes that were fine enough and
    `inside` those of which the test of that name proved that they hold nothing but solutions; `outside`, if wanted,
    what was proved to hold none. At every moment these three and `pending` cover the roots.
    """

    def __init__(
        self,
        roots: Iterable[Box],
        contractor: Contractor,
        strategy: Strategy,
        priority: Priority = depth_first,
        *,
        inside: Callable[[Box], bool] | None = None,
        outside: bool = False,
    ) -> None:
        self._contractor, self._strategy, self._priority = contractor, strategy, priority
        self._is_inside, self.wants_outside = inside, outside
        self._heap: list[tuple[float, int, Node]] = []
        self._current: Node | None = None
        self._created = 0
        self.kept: list[Box] = []
        self.inside: list[Box] = []
        self.outside: list[Box] = []
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
        box = contraction.box
        is_inside = not box.is_empty and self._is_inside is not None and self._is_inside(box)
        pieces = () if box.is_empty or is_inside else self._pieces(box, node.depth)
        removed = difference(node.box, box) if self.wants_outside else ()
        children = tuple(self._push(piece, node.depth + (len(pieces) > 1)) for piece in pieces)
        if is_inside:
            self.inside.append(box)
        elif not pieces and not box.is_empty:
            self.kept.append(box)
        self.outside.extend(removed)
        self._current = None
        return Event(_kind(box, len(pieces), is_inside), node, contraction, children)

    def _pieces(self, box: Box, depth: int) -> tuple[Box, ...]:
        if isinstance(self._strategy, DepthStrategy):
            return self._strategy.split_at(box, depth)
        return self._strategy.split(box)

    def _push(self, box: Box, depth: int) -> Node:
        node = Node(box, depth, self._created)
        self._created += 1
        heapq.heappush(self._heap, (self._priority(node), node.serial, node))
        return node


def _kind(box: Box, pieces: int, is_inside: bool) -> EventKind:
    if box.is_empty:
        return EventKind.PRUNED
    if is_inside:
        return EventKind.INSIDE
    if pieces == 1:
        return EventKind.CONTRACTED
    return EventKind.SPLIT if pieces else EventKind.KEPT
