"""What a search found: boxes that hold single solutions, boxes of solutions, boxes that may hold some."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from cpcal.solver.accounts import RowUse
from cpcal.solver.contract import Clock, Verdict
from cpcal.solver.execution.stopping import asked
from cpcal.solver.existence.unique import Unique, UniquenessProver
from cpcal.solver.interval import Box, Boxes, Interval, IntervalArray
from cpcal.solver.interval.box import Variable
from cpcal.solver.search.search import Search, clusters, difference, volume


@dataclass(frozen=True)
class Solution:
    """A box of a `Paving`: PROVED, it holds exactly one solution; UNKNOWN, it may hold solutions.

    Boxes that touch, and those that touch them, have the same `cluster`.
    """

    verdict: Verdict
    box: Box
    cluster: int = 0

    def __getitem__(self, name: str | Variable) -> Interval | IntervalArray:
        """`solution[x]`: what its box says of a component (by name) or a variable."""
        return self.box[name]


@dataclass(frozen=True)
class Paving:
    """Every solution in the domain lies in one of `solutions` or of `inside`; `complete` is False when a limit came
    first. `status` says it in a sentence.

    `inside` (all points are solutions) and `outside` (none is, but on faces shared with other boxes) are filled by
    `solve(inner=True)`; with the boxes of `solutions` they cover the domain.
    """

    complete: bool
    status: str
    solutions: tuple[Solution, ...]
    nodes: int
    inside: Boxes = ()
    outside: Boxes = ()
    method: str = ""  # contractors and strategy: what was chosen, and why
    width: float = 0.0  # of boxes that are not divided further
    row_use: RowUse | None = None  # of the contractors that came to this answer

    @property
    def boundary(self) -> Boxes:
        """The boxes that may hold solutions."""
        return tuple(s.box for s in self.solutions if s.verdict is Verdict.UNKNOWN)

    @property
    def clusters(self) -> Boxes:
        """The hull of each cluster of `solutions`: neighbours that may be about one and the same solution."""
        members = dict[int, list[Box]]()
        for solution in self.solutions:
            members.setdefault(solution.cluster, []).append(solution.box)
        return tuple(reduce(Box.hull, boxes) for boxes in members.values())

    @property
    def volume(self) -> Interval:
        """Enclosure of the solution set's volume: that of `inside`, up to that with all boxes of `solutions`."""
        surely, perhaps = volume(self.inside), volume([s.box for s in self.solutions])
        return Interval(surely.lo, (surely + perhaps).hi)


# ------------------------------------------------------------------------------------------------------------------
# From a search that has ended to a paving: which of the boxes that it kept hold exactly one solution.

_SEVERAL = 64  # boxes of a cluster that are tried one by one where its hull is not proved to hold one solution


def conclusion(search: Search, prover: UniquenessProver, clock: Clock, nodes: int, *, outside: bool) -> Paving:
    """What is known when a search stops, at its end or at a limit; `outside`: of all boxes that hold no solution, too.

    Ctrl-C ends the proofs, not the conclusion.
    """
    pending = [node.box for node in search.pending]
    kept = [piece.box for piece in search.kept]
    proved, open_boxes = _proved(kept, prover, clock)
    boxes = [(Verdict.PROVED, box) for box in proved]
    boxes += [(Verdict.UNKNOWN, box) for box in open_boxes + pending]
    labels = clusters([box for _, box in boxes])
    solutions = tuple(Solution(verdict, box, int(k)) for (verdict, box), k in zip(boxes, labels, strict=True))
    status = _sentence(len(proved), len(open_boxes), len(pending), len(search.inside))
    if outside and prover.applies:
        pieces = kept
        for part in proved + open_boxes:
            pieces = [rest for piece in pieces for rest in difference(piece, piece.intersect(part))]
        search.outside += pieces
    return Paving(not pending, status, solutions, nodes, tuple(search.inside), tuple(search.outside))


def _proved(kept: Sequence[Box], prover: UniquenessProver, clock: Clock) -> tuple[list[Box], list[Box]]:
    """Boxes that hold exactly one solution, and the boxes that may hold others.

    A zero on a face lies in several boxes, so that clusters are tried as a whole before their boxes one by one. A box
    inside a region of uniqueness holds no solution but that one.
    """
    if not prover.applies:
        return [], list(kept)
    found = list[Unique]()
    left = dict(enumerate(kept))
    labels = clusters(kept)
    try:
        for label in range(int(labels.max(initial=-1)) + 1):
            members = [int(k) for k in np.flatnonzero(labels == label)]
            _try(prover, clock, reduce(Box.hull, [kept[k] for k in members]), found)
            for k in members if len(members) <= _SEVERAL else []:
                if len(members) > 1:
                    _try(prover, clock, kept[k], found)
                if not (clock.over() or asked() or _covered(kept[k], found)):
                    left[k] = prover.narrowed(kept[k])
    except KeyboardInterrupt:
        pass
    # what another one covers is a solution that is known already
    boxes = [proof.box for k, proof in enumerate(found) if not _covered(proof.box, found[:k])]
    return boxes, [box for box in left.values() if not box.is_empty and not _covered(box, found)]


def _try(prover: UniquenessProver, clock: Clock, box: Box, found: list[Unique]) -> None:
    """Add what can be proved about a box to what was found."""
    if not (clock.over() or asked() or _covered(box, found)):
        proof = prover.prove(box)
        if proof is not None:
            found.append(proof)


def _covered(box: Box, found: Sequence[Unique]) -> bool:
    """Whether a box can hold no solutions but those found."""
    return any(box.subset(proof.region) for proof in found)


def _sentence(proved: int, unknown: int, pending: int, inside: int) -> str:
    if pending:
        return f"Stopped with {pending} box{'es' if pending > 1 else ''} undivided; the boxes hold all solutions."
    if not (proved or unknown or inside):
        return "The constraints have no common solution in the domain: proved."
    boxes = "1 box holds" if proved == 1 else f"{proved} boxes hold"
    if proved and not unknown:
        return f"{boxes} exactly one solution{'' if proved == 1 else ' each'}, and there are no others: proved."
    if proved:
        return f"{boxes} exactly one solution{'' if proved == 1 else ' each'}: proved; {unknown} more may hold others."
    if inside:
        return f"{inside} boxes hold nothing but solutions: proved; {unknown} more may hold others."
    return "All solutions lie in the boxes; whether each box holds one is not proved."
