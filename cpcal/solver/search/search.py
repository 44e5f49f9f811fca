"""Branch and prune: the whole search is one callback, `process(node) -> Decision`.

The search is an iterator that yields one event per node. Progress bars, limits, logs and checkpoints are callers of it:
stop iterating whenever you like, `pending` holds every box that has not been decided. What a decision depends on is in
the node: its box, and the `state` that the decision which made it handed on.
"""

from __future__ import annotations

import heapq
import math
import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import chain
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from cpcal.solver.accounts import ContractorUse
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box, Interval, IntervalArray, get_arithmetic
from cpcal.solver.interval.arithmetic import check_rounding
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows

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


def depth_first(node: Node) -> float:
    """The latest box first: few boxes wait at any time."""
    return -float(node.serial)


def breadth_first(node: Node) -> float:
    """The least divided box first: what is known of the whole domain grows evenly."""
    return float(node.depth)


class BestFirst:
    """The box first whose midpoint violates the constraints least (to first order nothing: by its worst row)."""

    def __init__(self, network: ConstraintNetwork) -> None:
        self._rows = Rows(network)

    def __call__(self, node: Node) -> float:
        values = self._rows.linearize(node.box.mid).values
        worst = float(np.max(np.maximum(values, 0.0), initial=0.0))
        return worst if np.isfinite(worst) else np.inf


ORDERS: dict[str, Callable[[ConstraintNetwork], Priority]] = {
    "depth": lambda network: depth_first,
    "breadth": lambda network: breadth_first,
    "best": BestFirst,
}


# ------------------------------------------------------------------------------------------------------------------
# The undecided nodes of a search, the most urgent first. Many of them wait on disk, in the same order as in memory.

IN_MEMORY = 100_000  # nodes, at most, if there is room on the disk: some 100 MB
_CHUNK = 4096  # nodes that go to the disk, and come back, together
_WASTE = 2**26  # bytes of the file that nobody needs any more

Entry = tuple[float, int, Node]  # priority, serial


@dataclass(frozen=True, order=True)
class _Chunk:
    """Nodes on disk, from the most urgent one on, whose priority and serial these are."""

    priority: float
    serial: int
    offset: int
    size: int
    count: int


class Frontier:
    """A queue of nodes by priority, then age. The file is without a name and goes with the process."""

    def __init__(self, priority: Priority, in_memory: int | None = None) -> None:
        self._priority, self._limit = priority, in_memory or IN_MEMORY
        self._heap: list[Entry] = []
        self._chunks: list[_Chunk] = []  # a heap, too
        self._file: IO[bytes] | None = None

    def __del__(self) -> None:
        if self._file is not None:
            self._file.close()

    def __len__(self) -> int:
        return len(self._heap) + sum(chunk.count for chunk in self._chunks)

    @property
    def lowest(self) -> float | None:
        """The priority of the most urgent node; None where there is none."""
        firsts = [self._heap[0][0]] if self._heap else []
        return min([*firsts, *(chunk.priority for chunk in self._chunks[:1])], default=None)

    def __iter__(self) -> Iterator[Node]:
        """All nodes, in no order; those on disk come and go."""
        for entries in chain(map(self._read, tuple(self._chunks)), [tuple(self._heap)]):
            yield from (node for *_, node in entries)

    def push(self, node: Node) -> None:
        heapq.heappush(self._heap, (self._priority(node), node.serial, node))
        if len(self._heap) > self._limit:
            self._spill()

    def move_first(self, to: list[Node]) -> None:
        """The most urgent node to the front of a list."""
        chunks = self._chunks
        while chunks and not (self._heap and self._heap[0][:2] < (chunks[0].priority, chunks[0].serial)):
            for entry in self._read(chunks[0]):
                heapq.heappush(self._heap, entry)
            heapq.heappop(chunks)
        to.insert(0, self._heap[0][2])
        heapq.heappop(self._heap)

    # Ctrl-C may strike between any two lines: what moves is in both places for a moment, never in none.

    def _spill(self) -> None:
        """The less urgent half goes to the disk; where there is no room, all stay."""
        entries = sorted(self._heap, key=lambda entry: entry[:2])
        half = self._limit // 2
        try:
            file = self._with_room()
            chunks = [self._written(file, entries[k : k + _CHUNK]) for k in range(half, len(entries), _CHUNK)]
        except OSError:
            self._limit *= 2
            return
        for chunk in chunks:
            heapq.heappush(self._chunks, chunk)
        self._heap = entries[:half]  # sorted, so that it is a heap

    @staticmethod
    def _written(file: IO[bytes], entries: list[Entry]) -> _Chunk:
        content = pickle.dumps(entries, pickle.HIGHEST_PROTOCOL)
        offset = file.seek(0, 2)
        file.write(content)
        file.flush()
        return _Chunk(*entries[0][:2], offset, len(content), len(entries))

    def _with_room(self) -> IO[bytes]:
        """The file; a new one that holds what is still waiting, where much of it is not."""
        used, file = sum(chunk.size for chunk in self._chunks), self._file
        if file is not None and file.seek(0, 2) - used <= max(_WASTE, used):
            return file
        fresh, moved = tempfile.TemporaryFile(prefix="cpcal-"), []  # noqa: SIM115 - it goes with this object
        for chunk in self._chunks:
            moved.append(replace(chunk, offset=fresh.tell()))
            fresh.write(self._bytes(chunk))
        fresh.flush()
        self._file, self._chunks = fresh, moved
        if file is not None:
            file.close()
        return fresh

    def _read(self, chunk: _Chunk) -> list[Entry]:
        entries: list[Entry] = pickle.loads(self._bytes(chunk))
        return entries

    def _bytes(self, chunk: _Chunk) -> bytes:
        assert self._file is not None
        self._file.seek(chunk.offset)
        return self._file.read(chunk.size)


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
    them at a time. The size of batches changes nothing else. Of a round that is not over, the rest is pending. Pieces
    that come with their decision belong to the round of their parent.

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
        self._frontier = Frontier(priority)
        self._round: list[Node] = []  # the next one last
        self._decided: dict[int, Decision] = {}  # by serial, of the round
        self.created = 0  # nodes that were ever made
        self.kept: list[Piece] = []
        self.inside: list[Box] = []
        self.outside: list[Box] = []
        for root in roots:
            self._push(root if isinstance(root, Piece) else Piece(root), 0)

    @property
    def begun(self) -> tuple[Node, ...]:
        """The nodes of the round at work that are still to come, the next one first."""
        return tuple(reversed(self._round))

    @property
    def pending(self) -> tuple[Node, ...]:
        """The undecided nodes, most urgent first."""
        queued = sorted(self._frontier, key=lambda node: (self._priority(node), node.serial))
        return (*self.begun, *queued)

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
        return chain(self.begun, self._frontier)

    def standing(self) -> Standing:
        """All that the rest of the search depends on, besides its process and priority. It stands still meanwhile."""
        begun = {node.serial for node in self.begun}
        pending = (node for node in self._frontier if node.serial not in begun)
        return Standing(self.created, pending, self.begun, self.kept, self.inside, self.outside)

    def restore(self, at: Standing) -> None:
        """Stand where another search of the same process and priority stood."""
        self._frontier = Frontier(self._priority)
        for node in at.pending:
            self._frontier.push(node)
        self._round, self._decided, self.created = [*at.begun][::-1], {}, at.created
        self.kept, self.inside, self.outside = list(at.kept), list(at.inside), list(at.outside)

    def __next__(self) -> Event:
        # Ctrl-C may strike between any two lines: a node is listed as undecided (perhaps twice) until all that
        # follows from it is stored.
        if not self._round:
            if not len(self._frontier):
                raise StopIteration
            abreast = self._abreast if isinstance(self._abreast, int) else self._abreast(len(self._frontier))
            for _ in range(min(abreast, len(self._frontier))):
                self._frontier.move_first(self._round)
        node = self._round[-1]
        decision = self._decision(node)
        check_rounding()  # a plug-in that changed it makes all contractors after it unsound
        removed = decision.removed if self.wants_outside else ()
        if removed is None:
            removed = difference(node.box, decision.box)
        children = self._stored(node, decision)
        self.outside.extend(removed)
        self._round = [*self._round[:-1], *(child for child in reversed(children) if child.decided is not None)]
        self._decided.pop(node.serial, None)
        return Event(node, decision, children, self.waiting)

    def _decision(self, node: Node) -> Decision:
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
        node = Node(piece.box, depth, self.created, piece.state, piece.decided)
        self.created += 1
        if piece.decided is None:
            self._frontier.push(node)
        return node


# ------------------------------------------------------------------------------------------------------------------
# Where a search stands between two nodes, as values, and as lines of JSON: a line a box.

Line = dict[str, Any]


def bounds_of(box: Box) -> list[list[float | str]] | None:
    """Lower and upper bounds, to the last bit; infinite ones are texts, an empty box is null."""
    if box.is_empty:
        return None
    return [[v if math.isfinite(v) else str(v) for v in side.tolist()] for side in (box.lo, box.hi)]


def box_of(names: tuple[str, ...], bounds: Any) -> Box:
    """The box of `bounds_of`. Raises TypeError, ValueError."""
    if bounds is None:
        return Box.empty(names)
    lo, hi = (np.array([float(v) for v in side], np.float64) for side in bounds)
    if not len(lo) == len(hi) == len(names) or not (lo <= hi).all():
        raise ValueError("a box is none")
    return Box(names, lo, hi)


@dataclass(frozen=True)
class Standing:
    """How many nodes were ever made, the nodes of no round and those of the round at work, and what was stored."""

    created: int
    pending: Iterable[Node]
    begun: Iterable[Node]
    kept: Iterable[Piece]
    inside: Iterable[Box]
    outside: Iterable[Box]

    def lines(self, said: Callable[[Box, Any], Line]) -> Iterator[Line]:
        """`said`: the state of a node or a piece with that box."""
        for where in ("begun", "pending"):
            for node in getattr(self, where):
                line = {"in": where, "depth": node.depth, "serial": node.serial, "box": bounds_of(node.box)}
                yield line | said(node.box, node.state)
        yield from ({"in": "kept", "box": bounds_of(p.box), **said(p.box, p.state)} for p in self.kept)
        for where in ("inside", "outside"):
            yield from ({"in": where, "box": bounds_of(box)} for box in getattr(self, where))

    @classmethod
    def from_lines(
        cls, created: int, names: tuple[str, ...], lines: Iterable[Mapping[str, Any]], read: Callable[[Box, Any], Any]
    ) -> Standing:
        """What `lines` gave; `read`: the state from a line. Raises KeyError, TypeError, ValueError."""
        found: dict[str, list[Any]] = {where: [] for where in ("pending", "begun", "kept", "inside", "outside")}
        for line in lines:
            box, part = box_of(names, line["box"]), found[line["in"]]
            if "serial" in line:
                part.append(Node(box, int(line["depth"]), int(line["serial"]), read(box, line)))
            else:
                part.append(Piece(box, read(box, line)) if line["in"] == "kept" else box)
        return cls(created, **found)


# ------------------------------------------------------------------------------------------------------------------
# Sets of boxes: what is left of a box without another, which boxes touch, how much room they take.


def difference(box: Box, part: Box) -> tuple[Box, ...]:
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


def clusters(boxes: Sequence[Box]) -> npt.NDArray[np.intp]:
    """For each box the number of its cluster: boxes that touch, and those that touch them, are one cluster.

    Clusters are numbered in the order of their first box. Sorted by one component (of the most different ends), boxes
    are compared only with those that begin before they end.
    """
    from scipy.sparse import coo_array  # here: it takes a third of a second to load
    from scipy.sparse.csgraph import connected_components

    count = len(boxes)
    if count == 0 or len(boxes[0]) == 0:
        return np.zeros(count, dtype=np.intp)
    lo, hi = np.stack([box.lo for box in boxes]), np.stack([box.hi for box in boxes])
    by = int(np.argmax([len(np.unique(column)) for column in lo.T]))
    order = np.argsort(lo[:, by], kind="stable")
    lo, hi = lo[order], hi[order]
    ends = np.searchsorted(lo[:, by], hi[:, by], side="right")
    first, second = [], []
    for i in range(count):
        others = np.arange(i + 1, ends[i])
        touching = others[((lo[others] <= hi[i]) & (hi[others] >= lo[i])).all(axis=1)]
        first.append(np.full(len(touching), order[i]))
        second.append(order[touching])
    pairs = (np.concatenate(first), np.concatenate(second))
    graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(count, count))
    label = np.asarray(connected_components(graph, directed=False)[1])
    seen: dict[int, int] = {}
    return np.array([seen.setdefault(int(k), len(seen)) for k in label], dtype=np.intp)


def volume(boxes: Sequence[Box]) -> Interval:
    """Enclosure of the sum of the boxes' volumes."""
    full = [box for box in boxes if not box.is_empty]
    if not full:
        return Interval(0.0)
    lo, hi = np.stack([box.lo for box in full]), np.stack([box.hi for box in full])
    engine = get_arithmetic("float64")
    widths = engine.sub(IntervalArray.point(hi), IntervalArray.point(lo))
    product = IntervalArray.point(np.ones(len(full)))
    for k in range(lo.shape[1]):
        product = engine.mul(product, widths[:, k])
    total = engine.sum(product, 0)
    return Interval(max(float(total.lo), 0.0), float(total.hi))


def hull(boxes: Sequence[Box]) -> Box:
    """The smallest box around some boxes (at least one)."""
    out = boxes[0]
    for box in boxes[1:]:
        out = out.hull(box)
    return out
