"""From a search that has ended to a paving: which of the boxes that it kept hold exactly one solution."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from cpcal.execution.stopping import asked
from cpcal.solver.contract import Verdict
from cpcal.solver.existence import Unique, UniquenessProver
from cpcal.solver.interval import Box
from cpcal.solver.limits import Clock
from cpcal.solver.search.paving import Paving, Solution
from cpcal.solver.search.regions import clusters, difference, hull
from cpcal.solver.search.search import Search

_SEVERAL = 64  # boxes of a cluster that are tried one by one where its hull is not proved to hold one solution


def conclusion(search: Search, prover: UniquenessProver, clock: Clock, nodes: int) -> Paving:
    """What is known when a search stops, at its end or at a limit. Ctrl-C ends the proofs, not the conclusion."""
    pending = [node.box for node in search.pending]
    kept = [piece.box for piece in search.kept]
    proved, open_boxes = _proved(kept, prover, clock)
    boxes = [(Verdict.PROVED, box) for box in proved]
    boxes += [(Verdict.UNKNOWN, box) for box in open_boxes + pending]
    labels = clusters([box for _, box in boxes])
    solutions = tuple(Solution(verdict, box, int(k)) for (verdict, box), k in zip(boxes, labels, strict=True))
    status = _sentence(len(proved), len(open_boxes), len(pending), len(search.inside))
    outside = list(search.outside)
    if search.wants_outside and prover.applies:
        outside += _without(kept, proved + open_boxes)
    return Paving(not pending, status, solutions, nodes, tuple(search.inside), tuple(outside))


def _proved(kept: Sequence[Box], prover: UniquenessProver, clock: Clock) -> tuple[list[Box], list[Box]]:
    """Boxes that hold exactly one solution, and the boxes that may hold others.

    A zero on a face lies in several boxes, so that clusters are tried as a whole before their boxes one by one. A box
    inside a region of uniqueness holds no solution but that one.
    """
    points = list[Box]()
    with suppress(KeyboardInterrupt):
        points = list({box.lo.tobytes(): box for box in kept if prover.holds_at(box)}.values())
    kept = [box for box in kept if not any(box == point for point in points)]
    if not prover.applies:
        return points, list(kept)
    found: list[Unique] = []
    left = dict(enumerate(kept))
    labels = clusters(kept)
    try:
        for label in range(int(labels.max(initial=-1)) + 1):
            members = [int(k) for k in np.flatnonzero(labels == label)]
            _try(prover, clock, hull([kept[k] for k in members]), found)
            for k in members if len(members) <= _SEVERAL else []:
                if len(members) > 1:
                    _try(prover, clock, kept[k], found)
                if not (clock.over() or asked() or _covered(kept[k], found)):
                    left[k] = prover.narrowed(kept[k])
    except KeyboardInterrupt:
        pass
    boxes = points
    for k, proof in enumerate(found):
        if not _covered(proof.box, found[:k]):  # else it is a solution that is known already
            boxes.append(proof.box)
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


def _without(boxes: Sequence[Box], parts: Sequence[Box]) -> list[Box]:
    """What is left of some boxes without others."""
    pieces = list(boxes)
    for part in parts:
        pieces = [rest for piece in pieces for rest in difference(piece, piece.intersect(part))]
    return pieces


def _sentence(proved: int, unknown: int, pending: int, inside: int) -> str:
    if pending:
        return f"Stopped with {pending} boxes undivided; the boxes hold all solutions."
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
