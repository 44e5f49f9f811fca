"""The process of plain branch and prune: contract a box, keep it if it is fine enough, else divide it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

from cpcal.solver.contract import Contractor, Strategy, shrunk
from cpcal.solver.interval import Box
from cpcal.solver.search.batches import Batches
from cpcal.solver.search.orders import Node
from cpcal.solver.search.passes import Contracting, divided
from cpcal.solver.search.regions import difference
from cpcal.solver.search.search import Decision, EventKind, Piece

_BATCH = 64  # nodes


@runtime_checkable
class DepthStrategy(Protocol):
    """A strategy that wants to know how many divisions led to a box."""

    def split_at(self, box: Box, depth: int) -> tuple[Box, ...]: ...


class Divide:
    """The contractors on every box; `strategy` divides what they leave. A node's state is what was found of its box.

    A box that `inside` proves to hold nothing but solutions is not divided. With `again` a box of which some width
    shrank below that share is contracted once more before it is divided. `outside`: decisions say what was removed.
    """

    def __init__(
        self,
        contracting: Contracting | Contractor,
        strategy: Strategy,
        *,
        inside: Callable[[Box], bool] | None = None,
        again: float | None = None,
        outside: bool = False,
    ) -> None:
        if not isinstance(contracting, Contracting):
            contracting = Contracting([("", contracting)])
        self._contracting = contracting
        self._strategy, self._inside, self._again, self._outside = strategy, inside, again, outside
        alone = inside is None and again is None and not (outside or contracting.proves)
        self._batches = (
            Batches(contracting.named, strategy) if alone and Batches.serve(contracting.named, strategy) else None
        )

    @property
    def batch(self) -> int:
        """How many nodes are best decided together: 1 where they are decided one by one."""
        return 1 if self._batches is None else _BATCH

    def all(self, nodes: Sequence[Node]) -> list[Decision]:
        """The decisions about several nodes, at once where contractors and strategy take batches."""
        if self._batches is None:
            return [self(node) for node in nodes]
        return self._batches(nodes)

    def __call__(self, node: Node) -> Decision:
        before = node.box if node.state is None else node.state
        done = self._contracting.contract(node.box, before)
        kind, pieces = self._next(node, before, done.contraction.box, done.found)
        proves = self._contracting.proves  # else the two boxes of a node are one
        children = tuple(Piece(piece, done.found.intersect(piece) if proves else piece) for piece in pieces)
        removed = difference(node.box, done.contraction.box) if self._outside else None
        return Decision(kind, done.contraction, children, done.uses, done.proof, removed)

    def _next(self, node: Node, before: Box, box: Box, found: Box) -> tuple[EventKind, tuple[Box, ...]]:
        if box.is_empty:
            return EventKind.PRUNED, ()
        if self._inside is not None and self._inside(box):
            return EventKind.INSIDE, (box,)
        if self._again is not None:
            pairs = ((node.box, box), (before, found))
            if any(shrunk(one.width, two.width, self._again) for one, two in pairs):
                return EventKind.CONTRACTED, (box,)
        pieces = divided(box, found, lambda part: split(self._strategy, part, node.depth))
        return (EventKind.SPLIT, pieces) if pieces else (EventKind.KEPT, (box,))


def split(strategy: Strategy, box: Box, depth: int) -> tuple[Box, ...]:
    """The pieces of a box that `depth` divisions led to."""
    return strategy.split_at(box, depth) if isinstance(strategy, DepthStrategy) else strategy.split(box)
