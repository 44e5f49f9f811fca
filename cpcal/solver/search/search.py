"""Branch and prune: the whole search is one callback, `process(node) -> Decision`.

The search is an iterator that yields one event per node. Progress bars, limits, logs and checkpoints are callers of it:
stop iterating whenever you like, `pending` holds every box that has not been decided. What a decision depends on is in
the node: its box, and the `state` that the decision which made it handed on.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box
from cpcal.solver.interval.rounding import check_rounding
from cpcal.solver.search.orders import Node, Priority, depth_first
from cpcal.solver.search.passes import ContractorUse
from cpcal.solver.search.regions import difference


class EventKind(Enum):
    """What becomes of a node."""

    PRUNED = "proved to hold no solution"
    SPLIT = "divided"
    CONTRACTED = "contracted, and worth another pass"
    KEPT = "fine enough to keep"
    INSIDE = "proved to hold nothing but solutions"


@dataclass(frozen=True)
class Piece:
    """A box and what later decisions about it depend on besides."""

    box: Box
    state: Any = None


@dataclass(frozen=True)
class Decision:
    """What becomes of a node. `contraction.box` is what is left of its box, and `pieces` cover that.

    PRUNED has no pieces; KEPT and INSIDE have one, which is stored; CONTRACTED has one, which comes back as a node, and
    SPLIT has several. `uses` says who contracted, `proof` how weights prove it, for a certificate.
    """

    kind: EventKind
    contraction: Contraction
    pieces: tuple[Piece, ...] = ()
    uses: tuple[ContractorUse, ...] = ()
    proof: tuple[tuple[str, dict[str, Any]], ...] = ()

    @property
    def box(self) -> Box:
        """What is left of the node's box."""
        return self.contraction.box


Process = Callable[[Node], Decision]


@dataclass(frozen=True)
class Event:
    """One node, what was decided, and the nodes that it became."""

    node: Node
    decision: Decision
    children: tuple[Node, ...] = ()

    @property
    def kind(self) -> EventKind:
        return self.decision.kind

    @property
    def contraction(self) -> Contraction:
        return self.decision.contraction


class Search(Iterator[Event]):
    """Process the most urgent node, then the next one. Lower priority goes first, then age.

    With `abreast` the most urgent so many nodes (or as many as it says for a number of pending ones) are taken as one
    round, one after the other, before any that came of them; `process.all(nodes)`, if there is one, decides `batch` of
    them at a time. The size of batches changes nothing else. Of a round that is not over, the rest is pending.

    `kept` holds the pieces that were fine enough and `inside` the boxes that hold nothing but solutions; `outside`, if
    wanted, what was proved to hold none. At every moment these three and `pending` cover the roots.
    """

    def __init__(
        self,
        roots: Iterable[Box | Piece],
        process: Process,
        priority: Priority = depth_first,
        *,
        outside: bool = False,
        abreast: int | Callable[[int], int] = 1,
        batch: int = 64,
    ) -> None:
        self._process, self._priority, self.wants_outside = process, priority, outside
        self._abreast, self._batch = abreast, batch
        self._heap: list[tuple[float, int, Node]] = []
        self._round: list[Node] = []  # the next one last
        self._decided: dict[int, Decision] = {}  # by serial, of the round
        self._created = 0
        self.kept: list[Piece] = []
        self.inside: list[Box] = []
        self.outside: list[Box] = []
        for root in roots:
            self._push(root if isinstance(root, Piece) else Piece(root), 0)

    @property
    def within_round(self) -> bool:
        """Whether nodes of a round that has begun are still to come."""
        return bool(self._round)

    @property
    def created(self) -> int:
        """How many nodes were ever made."""
        return self._created

    def restore(self, pending: Iterable[Node], kept: Iterable[Piece], created: int) -> None:
        """Stand where another search of the same process and priority stood between two nodes."""
        self._heap = [(self._priority(node), node.serial, node) for node in pending]
        heapq.heapify(self._heap)
        self._round, self._decided = [], {}
        self.kept, self._created = list(kept), created

    @property
    def pending(self) -> tuple[Node, ...]:
        """The undecided nodes, most urgent first."""
        queued = tuple(node for _, _, node in sorted(self._heap, key=lambda entry: entry[:2]))
        return (*reversed(self._round), *queued)

    def __next__(self) -> Event:
        # Ctrl-C may strike between any two lines: a node is listed as undecided (perhaps twice) until all that
        # follows from it is stored.
        if not self._round:
            if not self._heap:
                raise StopIteration
            abreast = self._abreast if isinstance(self._abreast, int) else self._abreast(len(self._heap))
            chosen = heapq.nsmallest(abreast, self._heap) if abreast > 1 else self._heap[:1]
            self._round = [node for _, _, node in reversed(chosen)]
            for _ in chosen:
                heapq.heappop(self._heap)
        node = self._round[-1]
        decision = self._decision(node)
        check_rounding()  # a plug-in that changed it makes all contractors after it unsound
        removed = difference(node.box, decision.box) if self.wants_outside else ()
        children = self._stored(node, decision)
        self.outside.extend(removed)
        self._round.pop()
        self._decided.pop(node.serial, None)
        return Event(node, decision, children)

    def _decision(self, node: Node) -> Decision:
        together = getattr(self._process, "all", None)
        if together is None or len(self._round) == 1 or self._batch == 1:
            return self._decided.get(node.serial) or self._process(node)
        if node.serial not in self._decided:
            nodes = self._round[-self._batch :][::-1]
            decisions = together(nodes)
            self._decided = {one.serial: decision for one, decision in zip(nodes, decisions, strict=True)}
        return self._decided[node.serial]

    def _stored(self, node: Node, decision: Decision) -> tuple[Node, ...]:
        """Keep or queue the pieces; the nodes that they became."""
        if decision.kind is EventKind.INSIDE:
            self.inside.extend(piece.box for piece in decision.pieces)
        elif decision.kind is EventKind.KEPT:
            self.kept.extend(decision.pieces)
        else:
            depth = node.depth + (decision.kind is EventKind.SPLIT)
            return tuple(self._push(piece, depth) for piece in decision.pieces)
        return ()

    def _push(self, piece: Piece, depth: int) -> Node:
        node = Node(piece.box, depth, self._created, piece.state)
        self._created += 1
        heapq.heappush(self._heap, (self._priority(node), node.serial, node))
        return node
