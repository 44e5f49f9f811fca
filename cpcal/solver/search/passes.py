"""One pass of all contractors that were asked for. A certificate knows weights only: where one is wanted, what a
contractor proposes is proved again by its weights before it counts, and those that give none take no part.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import replace
from itertools import chain
from typing import NamedTuple, Self

import numpy as np

from cpcal.common.values import TINY, ArrayLike, Floats, Ints, Json, floats
from cpcal.solver.contract import (
    Contraction,
    Contractor,
    Named,
    Step,
    Strategy,
    TakesBatches,
    contracted,
    followed,
    givers,
    shrunk,
)
from cpcal.solver.execution.executors import Place, Shared
from cpcal.solver.interval import Box, Boxes, IntervalArray
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows
from cpcal.solver.search.search import Decision, EventKind, Node, Piece, difference


class Proof(NamedTuple):
    """What weights prove of a proposed contraction: the box that they leave, the steps, the certificate's record."""

    box: Box
    steps: tuple[Step, ...]
    record: Json | None


StepProver = Callable[[Box, Contraction], Proof]  # proves proposed steps again by their weights


class Pass(NamedTuple):
    """What one pass leaves, and the records of what weights proved."""

    contraction: Contraction
    proof: tuple[Json, ...]


class Contracting:
    """Contractors with their names, one after the other, and the prover of their steps where a certificate is wanted.

    At the `deadline` long contractions end.
    """

    def __init__(self, named: Sequence[Named], prover: StepProver | None = None, deadline: float = math.inf) -> None:
        self.contractors = [contractor for _, contractor in named]
        self._prover, self.deadline = prover, deadline
        self.proves = prover is not None

    def contract(self, box: Box) -> Pass:
        """One pass over a box."""
        total, proof = Contraction(box), list[Json]()
        for part in self.contractors if self._prover is None else chain.from_iterable(map(givers, self.contractors)):
            if total.box.is_empty:
                break
            step = contracted(part, total.box, self.deadline)
            if self._prover is not None:
                proved = self._prover(total.box, step)
                step = replace(step, box=proved.box, steps=proved.steps)
                proof += [] if proved.record is None else [proved.record]
            total = followed(total, step)
        return Pass(total, tuple(proof))


# ------------------------------------------------------------------------------------------------------------------
# The process of plain branch and prune: contract a box, keep it if it is fine enough, else divide it.

_BATCH = 64  # nodes


class Divide:
    """The contractors on every box; `strategy` divides what they leave.

    A box that `inside` proves to hold nothing but solutions is not divided. With `again` a box of which some width
    shrank below that share is contracted once more before it is divided. `outside`: decisions say what was removed.
    The workers of a `place` decide the nodes of a round. Decisions are the same, one by one, in arrays, or elsewhere.
    """

    def __init__(
        self,
        contracting: Contracting | Contractor,
        strategy: Strategy,
        *,
        inside: Callable[[Box], bool] | None = None,
        again: float | None = None,
        outside: bool = False,
        place: Place | None = None,
    ) -> None:
        if not isinstance(contracting, Contracting):
            contracting = Contracting([("", contracting)])
        self._contracting = contracting
        self._strategy, self._inside, self._again, self._outside = strategy, inside, again, outside
        plain = inside is None and again is None and not (outside or contracting.proves)
        ours = type(strategy) in (LargestFirst, Smear)
        batches = [contractor for contractor in contracting.contractors if isinstance(contractor, TakesBatches)]
        self._arrays = batches if plain and ours and len(batches) == len(contracting.contractors) else []
        self._elsewhere: Shared[Divide] | None = None  # and none in what travels
        if place is not None:
            self._elsewhere = Shared(self, place)
        self.batch = _BATCH if self._arrays or place is not None else 1  # so many nodes are best decided together

    def all(self, nodes: Sequence[Node]) -> list[Decision]:
        """The decisions about several nodes. Raises Stopped when the process is asked to stop."""
        if self._elsewhere is not None:
            return self._elsewhere.in_parts(_decided, nodes)
        return self._in_arrays(nodes) if self._arrays else [self(node) for node in nodes]

    def _in_arrays(self, nodes: Sequence[Node]) -> list[Decision]:
        """For contractors that take batches and the strategies of `strategies`; who contracted is not told."""
        names = nodes[0].box.names
        lo, hi = Box.stacked(node.box for node in nodes).copied()
        for contractor in self._arrays:
            alive = np.flatnonzero(~np.isnan(lo).any(axis=1))
            if alive.size:
                some = IntervalArray(lo[alive], hi[alive])
                left = contractor.contract_batch(some, self._contracting.deadline)
                lo[alive], hi[alive] = np.maximum(some.lo, left.lo), np.minimum(some.hi, left.hi)
                dead = ~(lo <= hi).all(axis=1)
                lo[dead], hi[dead] = np.nan, np.nan
        boxes = Box.rows(names, lo, hi)
        lo, hi = Box.stacked(boxes).copied()
        assert isinstance(self._strategy, LargestFirst)
        component, cut = self._strategy.cuts(names, lo, hi)
        rows = np.flatnonzero(component >= 0)
        upper, lower = hi[rows], lo[rows]
        upper[np.arange(len(rows)), component[rows]] = cut[rows]
        lower[np.arange(len(rows)), component[rows]] = cut[rows]
        pairs = zip(Box.rows(names, lo[rows], upper), Box.rows(names, lower, hi[rows]), strict=True)
        halves = dict(zip(rows.tolist(), pairs, strict=True))
        decisions = []
        for k, box in enumerate(boxes):
            kind = EventKind.PRUNED if box.is_empty else EventKind.SPLIT if k in halves else EventKind.KEPT
            pieces = () if box.is_empty else halves.get(k, (box,))
            decisions.append(Decision(kind, Contraction(box), tuple(map(Piece, pieces))))
        return decisions

    def __call__(self, node: Node) -> Decision:
        done = self._contracting.contract(node.box)
        kind, pieces = self._next(node.box, done.contraction.box)
        removed = difference(node.box, done.contraction.box) if self._outside else ()
        return Decision(kind, done.contraction, tuple(map(Piece, pieces)), done.proof, removed)

    def _next(self, before: Box, box: Box) -> tuple[EventKind, Boxes]:
        if box.is_empty:
            return EventKind.PRUNED, ()
        if self._inside is not None and self._inside(box):
            return EventKind.INSIDE, (box,)
        if self._again is not None and shrunk(before.width, box.width, self._again):
            return EventKind.CONTRACTED, (box,)
        pieces = self._strategy.split(box)
        return (EventKind.SPLIT, pieces) if pieces else (EventKind.KEPT, (box,))


def _decided(process: Divide, nodes: Sequence[Node]) -> list[Decision]:
    return [light(decision) for decision in process.all(nodes)]


def light(decision: Decision) -> Decision:
    """Without what only the contractors needed."""
    steps = tuple(replace(step, weights=None) for step in decision.contraction.steps)
    pieces = tuple(p if p.decided is None else replace(p, decided=light(p.decided)) for p in decision.pieces)
    contraction = replace(decision.contraction, steps=steps, point=None)
    return replace(decision, contraction=contraction, pieces=pieces)


# ------------------------------------------------------------------------------------------------------------------
# Where to cut a box in two.

_MAX = float(np.finfo(np.float64).max)


def bisect(box: Box, component: int) -> Boxes:
    """The two halves of a box, or () where float64 has no number between its bounds."""
    lo, hi = box.lo[component], box.hi[component]
    cut = float(_middle(lo[None], hi[None])[0])
    if not lo < cut < hi:
        return ()
    return box.replace(component, hi=cut), box.replace(component, lo=cut)


@np.errstate(over="ignore")  # what doubles beyond all floats is cut at the largest
def _middle(lo: Floats, hi: Floats) -> Floats:
    """Half way; of an unbounded interval a number that doubles its distance from zero, so that halves get finite."""
    low, high = np.isinf(lo), np.isinf(hi)
    if not (low.any() or high.any()):
        return 0.5 * lo + 0.5 * hi
    cut = 0.5 * np.where(low, 0.0, lo) + 0.5 * np.where(high, 0.0, hi)
    above = np.minimum(np.maximum(1.0, 2.0 * lo), _MAX)
    below = np.maximum(np.minimum(-1.0, 2.0 * hi), -_MAX)
    return np.where(low & high, 0.0, np.where(high, above, np.where(low, below, cut)))


class LargestFirst:
    """Bisect the component that is widest in units of `scale` (default 1); stop when all are below `width`.

    Other strategies of this kind derive from it and give another score.
    """

    _reach: Floats | float = np.inf

    def __init__(self, width: float = 0.0, scale: ArrayLike = 1.0, skip: Iterable[str] = ()) -> None:
        self._width, self._scale, self._skip = width, floats(scale), frozenset(skip)

    def within(self, reach: Floats, unit: Floats | float = 1.0) -> Self:
        """The same, but no component (n,) is divided further than its `reach` from 0; widths are in `unit` (n,)."""
        out = copy(self)
        out._reach, out._scale = reach, self._scale * unit
        return out

    def split(self, box: Box) -> Boxes:
        (component,), _ = self.cuts(box.names, box.lo[None], box.hi[None])
        return bisect(box, int(component)) if component >= 0 else ()

    def cuts(self, names: Sequence[str], lo: Floats, hi: Floats) -> tuple[Ints, Floats]:
        """Which component of boxes (B, n) to cut, -1 for none, and where: (B,) each."""
        with np.errstate(all="ignore"):
            score, cut = self._scores(lo, hi), _middle(lo, hi)
            able = (IntervalArray(lo, hi).width / self._scale > self._width) & (lo < cut) & (cut < hi)
        able &= (lo < self._reach) & (hi > -self._reach)
        if self._skip:
            able &= np.array([name not in self._skip for name in names])
        component = np.argmax(np.where(able, score, -np.inf), axis=1)
        rows = np.arange(len(lo))
        component = np.where(able[rows, component], component, np.where(able.any(axis=1), able.argmax(axis=1), -1))
        return component, cut[rows, component]

    def _scores(self, lo: Floats, hi: Floats) -> Floats:
        """The component with the highest one is cut: (B, n)."""
        return IntervalArray(lo, hi).width / self._scale


_SIZE = 1_000_000  # derivatives that are held at a time


class Smear(LargestFirst):
    """Bisect where the constraints vary most, by |derivative| times width at the midpoint of a box.

    It is summed over the rows, relative to each row's total, so that no row counts more than another. Where nothing
    varies, and on unbounded boxes, the widest component.
    """

    def __init__(self, network: ConstraintNetwork, width: float = 0.0) -> None:
        super().__init__(width)
        self._rows = network.once("rows at points", lambda: Rows(network))

    def _scores(self, lo: Floats, hi: Floats) -> Floats:
        widths, mids = IntervalArray(lo, hi).width, IntervalArray(lo, hi).mid
        scores = widths / self._scale
        bounded = np.flatnonzero(np.isfinite(lo).all(axis=1) & np.isfinite(hi).all(axis=1))
        most = max(1, _SIZE // max(self._rows.count * lo.shape[1], 1))
        for some in (bounded[k : k + most] for k in range(0, len(bounded), most)):
            smear = np.abs(self._rows.jacobians(mids[some])) * widths[some][:, None]
            total = np.maximum(smear.sum(axis=2, keepdims=True), TINY)
            found = np.nan_to_num((smear / total).sum(axis=1))
            varies = found.any(axis=1)
            scores[some[varies]] = found[varies]
        return scores


STRATEGIES: dict[str, Callable[[ConstraintNetwork, float], LargestFirst]] = {
    "largest": lambda network, width: LargestFirst(width),
    "smear-relative": Smear,
}
