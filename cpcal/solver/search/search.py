"""Branch and prune: the whole search is one callback, `process(node) -> Decision`.

The search is an iterator that yields one event per node. Progress bars, limits, logs and checkpoints are callers of it:
stop iterating whenever you like, `pending` holds every box that has not been decided. What a decision depends on is in
the node: its box, and the `state` that the decision which made it handed on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from cpcal.solver.accounts import ContractorUse
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box
from cpcal.solver.interval.rounding import check_rounding
from cpcal.solver.search.frontier import Frontier
from cpcal.solver.search.orders import Node, Priority, depth_first
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
    """A box and what later decisions about it depend on besides; `decided`: the next one, where it is made already, as
    the process that made it says it."""

    box: Box
    state: Any = None
    decided: Any = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class Decision:
    """What becomes of a node. `contraction.box` is what is left of its box, and `pieces` cover that.

    PRUNED has no pieces; KEPT and INSIDE have one, which is stored; CONTRACTED has one, which comes back as a node, and
    SPLIT has several. `uses` says who contracted, `proof` how weights prove it, for a certificate. `removed` is what
    the node's box has lost, in boxes, where whoever decided worked that out.
    """

    kind: EventKind
    contraction: Contraction
    pieces: tuple[Piece, ...] = ()
    uses: tuple[ContractorUse, ...] = ()
    proof: tuple[tuple[str, dict[str, Any]], ...] = ()
    removed: tuple[Box, ...] | None = None

    @property
    def box(self) -> Box:
        """What is left of the node's box."""
        return self.contraction.box


Process = Callable[[Node], Decision]


@dataclass(frozen=True)
class Event:
    """One node, what was decided, and the nodes that it became; `pending` nodes of its search are undecided then."""

    node: Node
    decision: Decision
    children: tuple[Node, ...] = ()
    pending: int = 0

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
    A process with `ahead(node, waiting)` is asked for every node that way, and sees which others wait, the most urgent
    ones first, so that it can have them decided meanwhile.
    With `subtrees` pieces that come with their decision belong to the round of their parent; else they wait their turn.

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
        subtrees: bool = False,
    ) -> None:
        self._process, self._priority, self.wants_outside = process, priority, outside
        self._abreast, self._batch, self._subtrees = abreast, batch, subtrees
        self._frontier = Frontier(priority)
        self._round: list[Node] = []  # the next one last
        self._decided: dict[int, Decision] = {}  # by serial, of the round
        self._ahead: Callable[[Node, Callable[[], Iterable[Node]]], Decision] | None = getattr(process, "ahead", None)
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

    @property
    def begun(self) -> tuple[Node, ...]:
        """The nodes of the round at work that are still to come, the next one first."""
        return tuple(reversed(self._round))

    def restore(
        self,
        pending: Iterable[Node],
        kept: Iterable[Piece],
        created: int,
        *,
        begun: Iterable[Node] = (),
        inside: Iterable[Box] = (),
        outside: Iterable[Box] = (),
    ) -> None:
        """Stand where another search of the same process and priority stood between two nodes; `pending` are the nodes
        of no round."""
        self._frontier = Frontier(self._priority)
        self._frontier.extend(pending)
        self._round, self._decided = [*begun][::-1], {}
        self.kept, self.inside, self.outside, self._created = list(kept), list(inside), list(outside), created

    @property
    def pending(self) -> tuple[Node, ...]:
        """The undecided nodes, most urgent first."""
        queued = sorted(self._frontier, key=lambda node: (self._priority(node), node.serial))
        return (*reversed(self._round), *queued)

    @property
    def waiting(self) -> int:
        """How many nodes are undecided."""
        return len(self._round) + len(self._frontier)

    @property
    def lowest(self) -> float | None:
        """The least priority of an undecided node; None where there is none."""
        rest = self._frontier.lowest
        return min([*map(self._priority, self._round), *([] if rest is None else [rest])], default=None)

    def undecided(self) -> Iterator[Node]:
        """The same as `pending`, in no order, and not all in memory at a time. The search stands still meanwhile."""
        yield from reversed(self._round)
        yield from self._frontier

    def __next__(self) -> Event:
        # Ctrl-C may strike between any two lines: a node is listed as undecided (perhaps twice) until all that
        # follows from it is stored.
        if not self._round:
            if not len(self._frontier):
                raise StopIteration
            abreast = self._abreast if isinstance(self._abreast, int) else self._abreast(len(self._frontier))
            for _ in range(min(abreast, len(self._frontier))):
                self._round.insert(0, self._frontier.first())
                self._frontier.drop()
        node = self._round[-1]
        decision = self._decision(node)
        check_rounding()  # a plug-in that changed it makes all contractors after it unsound
        removed = decision.removed if self.wants_outside else ()
        if removed is None:
            removed = difference(node.box, decision.box)
        children = self._stored(node, decision)
        self.outside.extend(removed)
        if self._subtrees:
            self._round = [*self._round[:-1], *(child for child in reversed(children) if child.decided is not None)]
        else:
            self._round.pop()
        self._decided.pop(node.serial, None)
        return Event(node, decision, children, self.waiting)

    def _soon(self) -> Iterator[Node]:
        """Undecided nodes, the most urgent ones first; not all."""
        yield from reversed(self._round)
        yield from self._frontier.soon()

    def _decision(self, node: Node) -> Decision:
        if self._ahead is not None:
            return self._ahead(node, self._soon)
        made: Decision | None = node.decided or self._decided.get(node.serial)
        if made is not None:
            return made
        together = getattr(self._process, "all", None)
        if together is None or len(self._round) == 1 or self._batch == 1:
            return self._process(node)
        nodes = [one for one in self._round[::-1] if one.decided is None][: self._batch]
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
        node = Node(piece.box, depth, self._created, piece.state, piece.decided)
        self._created += 1
        if not (self._subtrees and piece.decided is not None):
            self._frontier.push(node)
        return node
