"""Decisions about many boxes and about what came of them, as a few arrays: they travel in a tenth of the time.

What explains a contraction (steps, a promising point, a polyhedron) stays where it was made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Bools, Floats, Ints
from cpcal.solver.accounts import ContractorUse
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box
from cpcal.solver.search.search import Decision, EventKind, Piece

_KINDS = tuple(EventKind)


@dataclass(frozen=True)
class Forest:
    """B decisions with P pieces in all, whose state is None or their box.

    A piece's own decision comes after that of its parent.

    kinds     (B,) places in `EventKind`
    boxes     (B, 2, n) what is left of each node's box
    programs  (B,)
    counts    (B,) pieces of each
    pieces    (P, 2, n)
    stated    (P,) whether there is a state
    links     (P,) the decision about each piece; -1: it is not made yet
    uses      (B, m, 2) calls and steps of each contractor
    """

    names: tuple[str, ...]
    contractors: tuple[str, ...]
    kinds: Ints
    boxes: Floats
    programs: Ints
    counts: Ints
    pieces: Floats
    stated: Bools
    links: Ints
    uses: Ints

    @classmethod
    def of(cls, decisions: Sequence[Decision], links: Sequence[int]) -> Forest:
        """At least one decision."""
        pieces = [piece for decision in decisions for piece in decision.pieces]
        return cls(
            names=decisions[0].box.names,
            contractors=tuple(use.name for use in decisions[0].uses),
            kinds=np.array([_KINDS.index(decision.kind) for decision in decisions]),
            boxes=_bounds([decision.box for decision in decisions], len(decisions[0].box)),
            programs=np.array([decision.contraction.programs for decision in decisions]),
            counts=np.array([len(decision.pieces) for decision in decisions]),
            stated=np.array([piece.state is not None for piece in pieces], dtype=np.bool_),
            pieces=_bounds([piece.box for piece in pieces], len(decisions[0].box)),
            links=np.array(links, dtype=np.intp),
            uses=np.array([[(use.calls, use.steps) for use in decision.uses] for decision in decisions]),
        )

    def roots(self, count: int) -> list[Decision]:
        """The first so many decisions; pieces carry those that were made about them."""
        boxes = Box.rows(self.names, self.boxes[:, 0], self.boxes[:, 1])
        parts = Box.rows(self.names, self.pieces[:, 0], self.pieces[:, 1])
        kinds, programs, uses = (a.tolist() for a in (self.kinds, self.programs, self.uses))
        links, stated = self.links.tolist(), self.stated.tolist()
        starts = np.concatenate([[0], np.cumsum(self.counts)]).tolist()
        made: list[Decision | None] = [None] * len(boxes)
        for k in reversed(range(len(boxes))):
            places = range(starts[k], starts[k + 1])
            pieces = tuple(
                Piece(parts[p], parts[p] if stated[p] else None, made[links[p]] if links[p] >= 0 else None)
                for p in places
            )
            used = tuple(ContractorUse(name, *use) for name, use in zip(self.contractors, uses[k], strict=True))
            made[k] = Decision(_KINDS[kinds[k]], Contraction(boxes[k], programs=programs[k]), pieces, used)
        return [decision for decision in made[:count] if decision is not None]


def _bounds(boxes: Sequence[Box], n: int) -> Floats:
    """(B, 2, n)"""
    return np.array([(box.lo, box.hi) for box in boxes]).reshape(len(boxes), 2, n)
