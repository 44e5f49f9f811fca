"""One pass of all contractors that were asked for, over what they have reached and over what weights have proved.

A certificate knows weights only. So a search that writes one keeps two boxes for each node: the node's own, which
weights have proved, and inside it the box `found` that all contractors together have reached. Contractors that give
weights shrink both: what they propose on the node's box is proved again before it counts. All others shrink `found`
alone. As soon as weights have proved all that was found, the two boxes are one, and so is the work.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from cpcal.common.values import Floats, Ints
from cpcal.solver.accounts import ContractorUse
from cpcal.solver.contract import (
    Contraction,
    Contractor,
    Step,
    Strategy,
    Then,
    answered,
    contracted,
    elements,
    followed,
    gives_weights,
    shrunk,
    takes_batches,
)
from cpcal.solver.execution.executors import Place
from cpcal.solver.execution.outcomes import Shared
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.search.search import Decision, EventKind, Node, Piece, difference
from cpcal.solver.search.strategies import LargestFirst, RoundRobin, Smear

Record = tuple[str, dict[str, Any]]  # a contractor's name, and a step as a certificate says it


@dataclass(frozen=True)
class Proof:
    """What weights prove of a proposed contraction: the box that they leave, the steps, and the certificate's record.

    `complete`: each proposed step was proved, but for what shorter numbers give away.
    """

    box: Box
    steps: tuple[Step, ...]
    record: dict[str, Any] | None
    complete: bool


StepProver = Callable[[Box, Contraction], Proof]  # proves proposed steps again by their weights


@dataclass(frozen=True)
class Pass:
    """What one pass leaves: `contraction` of the node's box, and `found`, a part of that."""

    contraction: Contraction
    found: Box
    uses: tuple[ContractorUse, ...]
    proof: tuple[Record, ...] = ()


class Contracting:
    """Contractors with their names, one after the other, and the prover of their steps where a certificate is wanted.

    Without a prover the two boxes of a node are one. At the `deadline` long contractions end.
    """

    def __init__(
        self, named: Sequence[tuple[str, Contractor]], prover: StepProver | None = None, deadline: float = math.inf
    ) -> None:
        self.named = [one for name, contractor in named for one in _taken_apart(name, contractor)]  # one by one
        self._prover, self.deadline = prover, deadline
        self.proves = prover is not None

    @property
    def gives_weights(self) -> bool:
        """Whether a certificate can come of it."""
        return any(gives_weights(giver) for _, contractor in self.named for giver in elements(contractor))

    def contract(self, box: Box, found: Box) -> Pass:
        """One pass over a node's box and the part of it that was found."""
        if self._prover is None:
            return self._plain(box)
        total, proof = Contraction(box), list[Record]()
        uses = []
        for name, contractor in self.named:
            before, as_one = total.box, found == total.box
            givers = [giver for giver in elements(contractor) if gives_weights(giver)]
            calls = steps = 0
            for giver in givers if not before.is_empty else []:
                proposed = contracted(giver, total.box, self.deadline)
                proved = self._prover(total.box, proposed)
                total = followed(total, replace(proposed, box=proved.box, steps=proved.steps))
                calls, steps = calls + 1, steps + len(proposed.steps)
                proof += [] if proved.record is None else [(name, proved.record)]
                found = found.intersect(proved.box if proved.complete else proposed.box)
                if total.box.is_empty:
                    break
            done = givers == [contractor] and (as_one or found == total.box)  # of both boxes at once, or caught up
            if not (found.is_empty or done):
                further = contracted(contractor, found, self.deadline)
                found, calls, steps = further.box, calls + 1, steps + len(further.steps)
                point = total.point if further.point is None else further.point
                total = replace(total, point=point, programs=total.programs + further.programs)
            uses.append(ContractorUse(name, calls, steps))
        return Pass(total, found.intersect(total.box), tuple(uses), tuple(proof))

    def _plain(self, box: Box) -> Pass:
        total, uses = Contraction(box), []
        for name, contractor in self.named:
            use = ContractorUse(name)
            if not total.box.is_empty:
                step = contracted(contractor, total.box, self.deadline)
                total, use = followed(total, step), ContractorUse(name, 1, len(step.steps))
            uses.append(use)
        return Pass(total, total.box, tuple(uses))


def divided(box: Box, found: Box, split: Callable[[Box], tuple[Box, ...]]) -> tuple[Box, ...]:
    """Pieces of a node's box, cut where `split` cuts what was found in it, or else the box itself; () if nowhere."""
    pieces = () if found.is_empty or found == box else split(found)
    return tuple(_widened(piece, found, box) for piece in pieces) or split(box)


def _widened(piece: Box, part: Box, whole: Box) -> Box:
    """A piece of a part of a box, with the faces that it shares with the part moved out to the whole."""
    lo = np.where(piece.lo == part.lo, whole.lo, piece.lo)
    hi = np.where(piece.hi == part.hi, whole.hi, piece.hi)
    return whole.with_bounds(lo, hi)


def _taken_apart(name: str, contractor: Contractor) -> list[tuple[str, Contractor]]:
    """The parts of a sequence, each by itself, so that those that give weights can be proved."""
    if not isinstance(contractor, Then):
        return [(name, contractor)]
    return [one for part in contractor.parts for one in _taken_apart(type(part).__name__.lower(), part)]


# ------------------------------------------------------------------------------------------------------------------
# Plain branch and prune on many boxes at a time: what `Divide` decides of single nodes, in arrays.
#
# It serves contractors that take batches and the strategies of `strategies`. Decisions are the same as one by one.

_STRATEGIES = (LargestFirst, RoundRobin, Smear)


class Batches:
    """Contractors one after the other on the boxes of many nodes, which are then cut in two."""

    def __init__(self, contracting: Contracting, strategy: Strategy) -> None:
        self._contracting, self._strategy = contracting, strategy

    def __call__(self, nodes: Sequence[Node]) -> list[Decision]:
        names = nodes[0].box.names
        lo, hi = np.stack([node.box.lo for node in nodes]), np.stack([node.box.hi for node in nodes])
        uses: list[list[ContractorUse]] = [[] for _ in nodes]
        for name, contractor in self._contracting.named:
            lo, hi = self._contracted(name, contractor, lo, hi, uses)
        boxes = Box.rows(names, lo, hi)
        depths = np.array([node.depth for node in nodes])
        halves = self._halves(names, np.stack([b.lo for b in boxes]), np.stack([b.hi for b in boxes]), depths)
        return [
            Decision(kind, Contraction(box), pieces, tuple(use))
            for box, use, (kind, pieces) in zip(boxes, uses, map(_next, boxes, halves), strict=True)
        ]

    def _contracted(
        self, name: str, contractor: Contractor, lo: Floats, hi: Floats, uses: list[list[ContractorUse]]
    ) -> tuple[Floats, Floats]:
        alive = np.flatnonzero(~np.isnan(lo).any(axis=1))
        if alive.size:
            some = IntervalArray(lo[alive], hi[alive])
            left = answered(contractor, "contract_batch", some, self._contracting.deadline)
            after_lo, after_hi = lo.copy(), hi.copy()
            after_lo[alive], after_hi[alive] = np.maximum(lo[alive], left.lo), np.minimum(hi[alive], left.hi)
            dead = ~(after_lo <= after_hi).all(axis=1)
            moved = np.where(dead, 1, (after_lo > lo).sum(axis=1) + (after_hi < hi).sum(axis=1))
            after_lo[dead], after_hi[dead] = np.nan, np.nan
            lo, hi = after_lo, after_hi
            counts = dict(zip(alive.tolist(), moved[alive].tolist(), strict=True))
        else:
            counts = {}
        for k, use in enumerate(uses):
            use.append(ContractorUse(name, 1, counts[k]) if k in counts else ContractorUse(name))
        return lo, hi

    def _halves(self, names: tuple[str, ...], lo: Floats, hi: Floats, depths: Ints) -> list[tuple[Piece, ...]]:
        """The two pieces of every box, () where it is empty or fine enough."""
        assert isinstance(self._strategy, LargestFirst)
        component, cut = self._strategy.cuts(names, lo, hi, depths)
        rows = np.flatnonzero(component >= 0)
        upper, lower = hi[rows], lo[rows]
        upper[np.arange(len(rows)), component[rows]] = cut[rows]
        lower[np.arange(len(rows)), component[rows]] = cut[rows]
        pieces: list[tuple[Piece, ...]] = [()] * len(lo)
        first, second = Box.rows(names, lo[rows], upper), Box.rows(names, lower, hi[rows])
        for k, one, two in zip(rows.tolist(), first, second, strict=True):
            pieces[k] = (Piece(one), Piece(two))
        return pieces


def _next(box: Box, halves: tuple[Piece, ...]) -> tuple[EventKind, tuple[Piece, ...]]:
    if box.is_empty:
        return EventKind.PRUNED, ()
    return (EventKind.SPLIT, halves) if halves else (EventKind.KEPT, (Piece(box),))


# ------------------------------------------------------------------------------------------------------------------
# The process of plain branch and prune: contract a box, keep it if it is fine enough, else divide it.

_BATCH = 64  # nodes


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
        plain = inside is None and again is None and not (outside or contracting.proves)
        arrays = type(strategy) in _STRATEGIES and all(takes_batches(contractor) for _, contractor in contracting.named)
        self._batches = Batches(contracting, strategy) if plain and arrays else None

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
        by = self._strategy
        turn = partial(by.split_at, depth=node.depth) if isinstance(by, RoundRobin) else by.split
        pieces = divided(box, found, turn)
        return (EventKind.SPLIT, pieces) if pieces else (EventKind.KEPT, (box,))


class Rounds:
    """A process whose rounds are decided by the workers of a place, each a part of them. Decisions are as here."""

    def __init__(self, process: Divide, place: Place) -> None:
        self._process, self._place, self._travels = process, place, Shared(process)

    def __call__(self, node: Node) -> Decision:
        return self._process(node)

    def all(self, nodes: Sequence[Node]) -> list[Decision]:
        """Raises Stopped when the process is asked to stop."""
        return self._travels.in_parts(self._place, _decided, nodes)


def _decided(process: Divide, nodes: Sequence[Node]) -> list[Decision]:
    return [light(decision) for decision in process.all(nodes)]


def light(decision: Decision) -> Decision:
    """Without what only the contractors needed."""
    steps = tuple(replace(step, weights=None) for step in decision.contraction.steps)
    pieces = tuple(p if p.decided is None else replace(p, decided=light(p.decided)) for p in decision.pieces)
    contraction = replace(decision.contraction, steps=steps, point=None, polyhedron=None)
    return replace(decision, contraction=contraction, pieces=pieces)
