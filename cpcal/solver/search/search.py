"""Branch and prune: the whole search is one callback, `process(node) -> Decision`.

The search is an iterator that yields one event per node. Progress bars, limits, logs and checkpoints are callers of it:
stop iterating whenever you like, `pending` holds every box that has not been decided. What a decision depends on is in
the node: its box, and the `state` that the decision which made it handed on.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.values import Indices, Names
from cpcal.solver.contract import Contraction, Row
from cpcal.solver.execution.checkpoint_file import Line
from cpcal.solver.interval import Box, Boxes, Interval, IntervalArray
from cpcal.solver.interval.kernels import check_rounding

# ------------------------------------------------------------------------------------------------------------------
# The order in which the undecided boxes of a search are taken: lower priority first.


@dataclass(frozen=True)
class Node:
    """An undecided box; `serial` counts nodes in order of creation, `state` is what the parent's decision handed on.

    `decided`: the decision, where whoever made the parent's has made this one, too.
    """

    box: Box
    depth: int
    serial: int
    state: Any = None
    decided: Any = field(default=None, compare=False, repr=False)


Priority = Callable[[Node], float]


ORDERS: dict[str, Priority] = {
    "depth": lambda node: -float(node.serial),  # the latest box first: few boxes wait at any time
    "breadth": lambda node: float(node.depth),  # what is known of the whole domain grows evenly
}


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
    SPLIT has several. `proof`: how weights prove it, the steps of a certificate. `removed` is what
    the node's box has lost, in boxes, where it was asked for.
    """

    kind: EventKind
    contraction: Contraction
    pieces: tuple[Piece, ...] = ()
    proof: tuple[Line, ...] = ()
    removed: Boxes = ()


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


Observer = Callable[[Event], None]


class Search(Iterator[Event]):
    """Process the most urgent node, then the next one. Lower priority goes first, then age.

    With `abreast` the most urgent so many nodes (or as many as it says for a number of pending ones) are taken as one
    round, one after the other, before any that came of them; `process.all(nodes)`, if there is one, decides `batch` of
    them at a time. The size of batches changes nothing else. Of a round that is not over, the rest is pending. Pieces
    that come with their decision belong to the round of their parent.

    `kept` holds the pieces that were fine enough and `inside` the boxes that hold nothing but solutions; `outside`,
    where the process tells it, what was proved to hold none. At every moment these three and `pending` cover the roots.
    """

    def __init__(
        self,
        roots: Iterable[Box | Piece],
        process: Process,
        priority: Priority = ORDERS["depth"],
        *,
        abreast: int | Callable[[int], int] = 1,
        batch: int = 64,
    ) -> None:
        self._process, self._priority = process, priority
        self._abreast, self._batch = abreast, batch
        self._heap = list[tuple[float, int, Node]]()  # priority, serial
        self.begun = list[Node]()  # of the round at work those that are still to come, the next one first
        self._decided = dict[int, Decision]()  # by serial, of the round
        self.created = 0  # nodes that were ever made
        self.kept = list[Piece]()
        self.inside = list[Box]()
        self.outside = list[Box]()
        for root in roots:
            self._push(root if isinstance(root, Piece) else Piece(root), 0)

    @property
    def pending(self) -> tuple[Node, ...]:
        """The undecided nodes, most urgent first."""
        return (*self.begun, *(node for *_, node in sorted(self._heap, key=lambda entry: entry[:2])))

    @property
    def waiting(self) -> int:
        """How many nodes are undecided."""
        return len(self.begun) + len(self._heap)

    @property
    def lowest(self) -> float | None:
        """The least priority of an undecided node; None where there is none."""
        return min([*map(self._priority, self.begun), *(entry[0] for entry in self._heap[:1])], default=None)

    def standing(self) -> Standing:
        """All that the rest of the search depends on, besides its process and priority. It stands still meanwhile."""
        begun = {node.serial for node in self.begun}
        pending = (node for *_, node in self._heap if node.serial not in begun)
        return Standing(self.created, pending, self.begun, self.kept, self.inside, self.outside)

    def restore(self, at: Standing) -> None:
        """Stand where another search of the same process and priority stood."""
        self._heap = [(self._priority(node), node.serial, node) for node in at.pending]
        heapq.heapify(self._heap)
        self.begun, self._decided, self.created = list(at.begun), {}, at.created
        self.kept, self.inside, self.outside = list(at.kept), list(at.inside), list(at.outside)

    def __next__(self) -> Event:
        # Ctrl-C may strike between any two lines: a node is listed as undecided (perhaps twice) until all that
        # follows from it is stored.
        if not self.begun:
            if not self._heap:
                raise StopIteration
            abreast = self._abreast if isinstance(self._abreast, int) else self._abreast(len(self._heap))
            for _ in range(min(abreast, len(self._heap))):
                self.begun.append(self._heap[0][2])
                heapq.heappop(self._heap)
        node = self.begun[0]
        decision = self._decision(node)
        check_rounding()  # a plug-in that changed it makes all contractors after it unsound
        children: tuple[Node, ...] = ()
        if decision.kind is EventKind.INSIDE:
            self.inside.extend(piece.box for piece in decision.pieces)
        elif decision.kind is EventKind.KEPT:
            self.kept.extend(decision.pieces)
        else:
            depth = node.depth + (decision.kind is EventKind.SPLIT)
            children = tuple(self._push(piece, depth) for piece in decision.pieces)
        self.outside.extend(decision.removed)
        self.begun = [*(child for child in children if child.decided is not None), *self.begun[1:]]
        self._decided.pop(node.serial, None)
        return Event(node, decision, children, self.waiting)

    def _decision(self, node: Node) -> Decision:
        made = node.decided or self._decided.get(node.serial)
        if made is not None:
            return made
        together = getattr(self._process, "all", None)
        if together is None or len(self.begun) == 1 or self._batch == 1:
            return self._process(node)
        nodes = [one for one in self.begun if one.decided is None][: self._batch]
        self._decided = {one.serial: decision for one, decision in zip(nodes, together(nodes), strict=True)}
        return self._decided[node.serial]

    def _push(self, piece: Piece, depth: int) -> Node:
        node = Node(piece.box, depth, self.created, piece.state, piece.decided)
        self.created += 1
        if piece.decided is None:
            heapq.heappush(self._heap, (self._priority(node), node.serial, node))
        return node


# ------------------------------------------------------------------------------------------------------------------
# Where a search stands between two nodes, as values, and as lines of JSON: a line a box.


class Branch(NamedTuple):
    """What decisions about a node of a minimisation depend on, besides its box.

    fresh  no fit has begun here since the last division
    rows   of the step on the way here that raised the objective last
    """

    fresh: bool
    rows: frozenset[Row] = frozenset()


class Standing(NamedTuple):
    """How many nodes were ever made, the nodes of no round and those of the round at work, and what was stored.

    The state of a node or a piece is None, or a `Branch`.
    """

    created: int
    pending: Iterable[Node]
    begun: Iterable[Node]
    kept: Iterable[Piece]
    inside: Iterable[Box]
    outside: Iterable[Box]

    def lines(self) -> Iterator[Line]:
        for where in ("begun", "pending"):
            for node in getattr(self, where):
                yield {"in": where, "depth": node.depth, "serial": node.serial} | _line(node.box, node.state)
        yield from ({"in": "kept"} | _line(piece.box, piece.state) for piece in self.kept)
        for where in ("inside", "outside"):
            yield from ({"in": where} | _line(box) for box in getattr(self, where))

    @classmethod
    def from_lines(cls, created: int, names: Names, lines: Iterable[Line]) -> Standing:
        """What `lines` gave. Raises KeyError, TypeError, ValueError, ModelError."""
        found: dict[str, list[Any]] = {where: [] for where in ("pending", "begun", "kept", "inside", "outside")}
        for line in lines:
            where = line["in"]
            box = Box(names, *(np.array(side, np.float64) for side in line["box"]))
            state = Branch(line["fresh"], rows_of(line["rows"])) if "rows" in line else None
            if where in ("pending", "begun"):
                found[where].append(Node(box, line["depth"], line["serial"], state))
            else:
                found[where].append(Piece(box, state) if where == "kept" else box)
        return cls(created, **found)


def _line(box: Box, state: Branch | None = None) -> Line:
    """Numbers to the last bit."""
    said = {} if state is None else {"fresh": state.fresh, "rows": sorted(state.rows)}
    return {"box": [box.lo.tolist(), box.hi.tolist()], **said}


def rows_of(pairs: Any) -> frozenset[Row]:
    return frozenset((int(constraint), int(element)) for constraint, element in pairs)


# ------------------------------------------------------------------------------------------------------------------
# Sets of boxes: what is left of a box without another, which boxes touch, how much room they take.


def difference(box: Box, part: Box) -> Boxes:
    """At most 2n boxes that cover `box` without `part`, a subset of it; they meet only at their faces."""
    if part.is_empty:
        return () if box.is_empty else (box,)
    low, high = part.lo > box.lo, part.hi < box.hi
    if not (low.any() or high.any()):
        return ()
    lo, hi = box.lo.copy(), box.hi.copy()
    lower, upper = [], []
    for k in np.flatnonzero(low | high).tolist():
        for cut, end, other in ((low[k], part.lo[k], hi), (high[k], part.hi[k], lo)):
            if cut:
                before, other[k] = other[k], end
                lower.append(lo.copy())
                upper.append(hi.copy())
                other[k] = before
        lo[k], hi[k] = part.lo[k], part.hi[k]
    return tuple(Box.rows(box.names, np.array(lower), np.array(upper)))


def clusters(boxes: Sequence[Box]) -> Indices:
    """For each box the number of its cluster: boxes that touch, and those that touch them, are one cluster.

    Clusters are numbered in the order of their first box. Sorted by one component (of the most different ends), boxes
    are compared only with those that begin before they end.
    """
    count = len(boxes)
    if count == 0 or len(boxes[0]) == 0:
        return np.zeros(count, np.intp)
    bounds = Box.stacked(boxes)
    by = int(np.argmax([len(np.unique(column)) for column in bounds.lo.T]))
    order = np.argsort(bounds.lo[:, by], kind="stable")
    lo, hi = bounds.lo[order], bounds.hi[order]
    ends = np.searchsorted(lo[:, by], hi[:, by], side="right")
    label = np.arange(count)  # of each cluster its first box
    for i in range(count):
        others = np.arange(i + 1, ends[i])
        touching = others[((lo[others] <= hi[i]) & (hi[others] >= lo[i])).all(axis=1)]
        for other in np.unique(label[order[touching]]):
            mine = label[order[i]]
            if other != mine:
                label[label == max(mine, other)] = min(mine, other)
    return np.unique(label, return_inverse=True)[1].astype(np.intp)


def volume(boxes: Sequence[Box]) -> Interval:
    """Enclosure of the sum of the boxes' volumes."""
    full = [box for box in boxes if not box.is_empty]
    if not full:
        return Interval(0.0)
    bounds = Box.stacked(full)
    widths = IntervalArray.point(bounds.hi) - bounds.lo
    product = IntervalArray.point(np.ones(len(full)))
    for k in range(widths.shape[1]):
        product = product * widths[:, k]
    total = product.sum(0)
    return Interval(max(float(total.lo), 0.0), float(total.hi))
