"""Plain branch and prune on many boxes at a time: what `Divide` decides of single nodes, in arrays.

It serves contractors that take batches and the strategies of `strategies`. Decisions are the same as one by one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpcal.common.arrays import Floats, Ints
from cpcal.solver.accounts import ContractorUse
from cpcal.solver.contract import Contraction, Contractor, Strategy, takes_batches
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.search.orders import Node
from cpcal.solver.search.search import Decision, EventKind, Piece
from cpcal.solver.search.strategies import LargestFirst, RoundRobin, Smear

_STRATEGIES = (LargestFirst, RoundRobin, Smear)


class Batches:
    """Contractors one after the other on the boxes of many nodes, which are then cut in two."""

    def __init__(self, named: Sequence[tuple[str, Contractor]], strategy: Strategy) -> None:
        self._named, self._strategy = named, strategy

    @staticmethod
    def serve(named: Sequence[tuple[str, Contractor]], strategy: Strategy) -> bool:
        """Whether all of them work on arrays."""
        return type(strategy) in _STRATEGIES and all(takes_batches(contractor) for _, contractor in named)

    def __call__(self, nodes: Sequence[Node]) -> list[Decision]:
        names = nodes[0].box.names
        lo, hi = np.stack([node.box.lo for node in nodes]), np.stack([node.box.hi for node in nodes])
        uses: list[list[ContractorUse]] = [[] for _ in nodes]
        for name, contractor in self._named:
            lo, hi = self._contracted(name, contractor, lo, hi, uses)
        boxes = Box.rows(names, lo, hi)
        depths = np.array([node.depth for node in nodes])
        halves = self._halves(names, np.stack([b.lo for b in boxes]), np.stack([b.hi for b in boxes]), depths)
        return [
            Decision(kind, Contraction(box), pieces, tuple(use))
            for box, use, (kind, pieces) in zip(boxes, uses, map(_next, boxes, halves), strict=True)
        ]

    @staticmethod
    def _contracted(
        name: str, contractor: Contractor, lo: Floats, hi: Floats, uses: list[list[ContractorUse]]
    ) -> tuple[Floats, Floats]:
        alive = np.flatnonzero(~np.isnan(lo).any(axis=1))
        if alive.size:
            left = contractor.contract_batch(IntervalArray(lo[alive], hi[alive]))  # type: ignore[attr-defined]
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
