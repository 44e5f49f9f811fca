"""The rounds of a search, decided by the workers of an executor. Decisions and their order are the same as here.

A task is some boxes of a round and what comes of them, the subtrees below: whoever has decided a box goes on with its
pieces while its time lasts. That is no other work than the search would give out later, because a decision depends on
the box alone. So how far a worker looks ahead, which depends on its speed, changes nothing but the time.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from typing import Protocol

from cpcal.execution.executors import Place
from cpcal.execution.shared import Shared
from cpcal.execution.stopping import asked
from cpcal.solver.search.forest import Forest
from cpcal.solver.search.orders import Node
from cpcal.solver.search.search import Decision, EventKind

_SPAN = 0.1  # seconds of a task, if its own boxes do not take longer
_MOST = 4096  # boxes of a task
_DIVIDED = (EventKind.SPLIT, EventKind.CONTRACTED)


class Rounds(Protocol):
    """A process that decides rounds, each node by itself and by nothing but its box and depth."""

    def __call__(self, node: Node) -> Decision: ...

    def all(self, nodes: Sequence[Node]) -> list[Decision]: ...


class Spread:
    """A process whose rounds are divided among as many tasks as the executor takes at a time."""

    def __init__(self, process: Rounds, place: Place) -> None:
        self._process, self._shared, self._place = process, Shared(process), place

    def __call__(self, node: Node) -> Decision:
        return self._process(node)

    def all(self, nodes: Sequence[Node]) -> list[Decision]:
        """Their pieces carry the decisions that were made about them, too."""
        size = -(-len(nodes) // self._place[1])
        parts = [nodes[k : k + size] for k in range(0, len(nodes), size)]
        forests = self._shared.mapped(self._place, grown, parts)
        return [one for part, forest in zip(parts, forests, strict=True) for one in forest.roots(len(part))]


def grown(process: Rounds, nodes: Sequence[Node], span: float = _SPAN) -> Forest:
    """Decide the nodes, then what came of them, the oldest first, for about so many seconds."""
    began = time.monotonic()
    decisions: list[Decision] = []
    links: list[int] = []
    waiting = deque[tuple[int, Node]]()  # and the place of their link

    def decide(some: Sequence[Node]) -> None:
        for node, decision in zip(some, process.all(some), strict=True):
            depth = node.depth + (decision.kind is EventKind.SPLIT)
            decisions.append(decision)
            for piece in decision.pieces:
                if decision.kind in _DIVIDED:
                    waiting.append((len(links), Node(piece.box, depth, -1, piece.state)))
                links.append(-1)

    decide(nodes)
    while waiting and len(decisions) < _MOST and not asked():
        spent = time.monotonic() - began
        count = min(int((span - spent) / spent * len(decisions)), len(waiting), _MOST) if spent else 1
        if count < 1:
            break
        some = [waiting.popleft() for _ in range(count)]
        for k, (place, _) in enumerate(some):
            links[place] = len(decisions) + k
        decide([node for _, node in some])
    return Forest.of(decisions, links)
