"""Decisions about many boxes and about what came of them, as a few arrays: they travel in a tenth of the time.

What explains a contraction (steps, a promising point, a polyhedron) stays where it was made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.arrays import Bools, Floats, Ints
from cpcal.solver.accounts import ContractorUse
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box
from cpcal.solver.search.orders import Node
from cpcal.solver.search.search import Decision, EventKind, Piece

NOT_YET, NEVER = -1, -2

_KINDS = tuple(EventKind)


@dataclass(frozen=True)
class Forest:
    """B decisions with P pieces in all, whose state is None or their box.

    A piece's own decision comes after that of its parent.

    kinds     (B,) places in `EventKind`
    boxes     (B, 2, n) what is left of each node's box
    programs  (B,)
    counts    (B, 2) pieces of each, and parts of its box that were removed; -1: nobody asked for these
    pieces    (P, 2, n)
    removed   (R, 2, n)
    stated    (P,) whether there is a state
    depths    (P,)
    links     (P,) the decision about each piece; NOT_YET, or NEVER where it is not divided
    uses      (B, m, 2) calls and steps of each contractor
    seconds   of the processor that all of it took
    """

    names: tuple[str, ...]
    contractors: tuple[str, ...]
    kinds: Ints
    boxes: Floats
    programs: Ints
    counts: Ints
    pieces: Floats
    removed: Floats
    stated: Bools
    depths: Ints
    links: Ints
    uses: Ints
    seconds: float

    @classmethod
    def of(cls, decisions: Sequence[Decision], depths: Sequence[int], links: Sequence[int], seconds: float) -> Forest:
        """At least one decision; depths and links of their pieces."""
        pieces = [piece for decision in decisions for piece in decision.pieces]
        removed = [box for decision in decisions for box in decision.removed or ()]
        n = len(decisions[0].box)
        return cls(
            names=decisions[0].box.names,
            contractors=tuple(use.name for use in decisions[0].uses),
            kinds=np.array([_KINDS.index(decision.kind) for decision in decisions]),
            boxes=_bounds([decision.box for decision in decisions], n),
            programs=np.array([decision.contraction.programs for decision in decisions]),
            counts=np.array([(len(d.pieces), -1 if d.removed is None else len(d.removed)) for d in decisions]),
            stated=np.array([piece.state is not None for piece in pieces], dtype=np.bool_),
            pieces=_bounds([piece.box for piece in pieces], n),
            removed=_bounds(removed, n),
            depths=np.array(depths, dtype=np.intp),
            links=np.array(links, dtype=np.intp),
            uses=np.array([[(use.calls, use.steps) for use in decision.uses] for decision in decisions]),
            seconds=seconds,
        )

    def __len__(self) -> int:
        return len(self.kinds)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_lists", "open")}

    @cached_property
    def open(self) -> dict[int, Node]:
        """The pieces about which nothing is decided here, as nodes, by their place."""
        places = np.flatnonzero(self.links == NOT_YET)
        boxes = Box.rows(self.names, self.pieces[places, 0], self.pieces[places, 1])
        rest = zip(places.tolist(), boxes, self.depths[places].tolist(), self.stated[places].tolist(), strict=True)
        return {p: Node(box, depth, -1, box if stated else None, Ahead()) for p, box, depth, stated in rest}

    def _ahead(self, piece: int, link: int) -> Ahead | None:
        if link == NEVER:
            return None
        if link == NOT_YET:
            return self.open[piece].decided  # type: ignore[no-any-return]
        return Ahead(self, link, given=True)

    @cached_property
    def _lists(self) -> _Lists:
        """Opened when the first of the decisions is wanted: until then they take little memory."""
        starts = np.concatenate([np.zeros((1, 2), np.intp), np.cumsum(np.maximum(self.counts, 0), axis=0)])
        boxes, parts, removed = (
            Box.rows(self.names, a[:, 0], a[:, 1]) for a in (self.boxes, self.pieces, self.removed)
        )
        lists = (a.tolist() for a in (self.kinds, self.programs, starts, self.stated, self.links, self.uses))
        return _Lists(boxes, parts, removed, *lists)

    def decision(self, k: int) -> Decision:
        """That of this place; its pieces know where theirs are, or will be."""
        of = self._lists
        (first, gone), (last, end) = of.starts[k], of.starts[k + 1]
        pieces = tuple(
            Piece(of.parts[p], of.parts[p] if of.stated[p] else None, self._ahead(p, of.links[p]))
            for p in range(first, last)
        )
        uses = tuple(ContractorUse(name, *use) for name, use in zip(self.contractors, of.uses[k], strict=True))
        removed = None if self.counts[k, 1] < 0 else tuple(of.removed[gone:end])
        return Decision(
            _KINDS[of.kinds[k]], Contraction(of.boxes[k], programs=of.programs[k]), pieces, uses, (), removed
        )


@dataclass(eq=False)
class Ahead:
    """Where the decision about a node is that is made ahead of its turn; without a forest it will be. `given`: to
    whoever makes it."""

    forest: Forest | None = None
    place: int = 0
    given: bool = False

    @property
    def decision(self) -> Decision | None:
        return None if self.forest is None else self.forest.decision(self.place)


class _Lists(NamedTuple):
    """A forest's arrays as objects."""

    boxes: list[Box]
    parts: list[Box]
    removed: list[Box]
    kinds: list[int]
    programs: list[int]
    starts: list[list[int]]
    stated: list[bool]
    links: list[int]
    uses: list[list[list[int]]]


def _bounds(boxes: Sequence[Box], n: int) -> Floats:
    """(B, 2, n)"""
    return np.array([(box.lo, box.hi) for box in boxes], np.float64).reshape(len(boxes), 2, n)
