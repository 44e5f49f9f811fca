"""One pass of all contractors that were asked for, over what they have reached and over what weights have proved.

A certificate knows weights only. So a search that writes one keeps two boxes for each node: the node's own, which
weights have proved, and inside it the box `found` that all contractors together have reached. Contractors that give
weights shrink both: what they propose on the node's box is proved again before it counts. All others shrink `found`
alone. As soon as weights have proved all that was found, the two boxes are one, and so is the work.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from cpcal.solver.accounts import ContractorUse
from cpcal.solver.contract import Contraction, Contractor, Step, Then, contracted, elements, followed, gives_weights
from cpcal.solver.interval import Box

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


class StepProver(Protocol):
    """Proves proposed steps again by their weights."""

    def __call__(self, box: Box, proposed: Contraction) -> Proof: ...


@dataclass(frozen=True)
class Pass:
    """What one pass leaves: `contraction` of the node's box, and `found`, a part of that."""

    contraction: Contraction
    found: Box
    uses: tuple[ContractorUse, ...]
    proof: tuple[Record, ...] = ()


class Contracting:
    """Contractors with their names, one after the other, and the prover of their steps where a certificate is wanted.

    Without a prover the two boxes of a node are one.
    """

    def __init__(self, named: Sequence[tuple[str, Contractor]], prover: StepProver | None = None) -> None:
        self._named = [one for name, contractor in named for one in _taken_apart(name, contractor)]
        self._prover = prover

    @property
    def named(self) -> list[tuple[str, Contractor]]:
        """The contractors, one by one."""
        return self._named

    @property
    def proves(self) -> bool:
        """Whether steps are proved again by weights."""
        return self._prover is not None

    @property
    def gives_weights(self) -> bool:
        """Whether a certificate can come of it."""
        return any(gives_weights(giver) for _, contractor in self._named for giver in elements(contractor))

    def contract(self, box: Box, found: Box) -> Pass:
        """One pass over a node's box and the part of it that was found."""
        if self._prover is None:
            return self._plain(box)
        total, proof = Contraction(box), list[Record]()
        uses = []
        for name, contractor in self._named:
            before, as_one = total.box, found == total.box
            givers = [giver for giver in elements(contractor) if gives_weights(giver)]
            calls = steps = 0
            for giver in givers if not before.is_empty else []:
                proposed = contracted(giver, total.box)
                proved = self._prover(total.box, proposed)
                total = followed(total, replace(proposed, box=proved.box, steps=proved.steps))
                calls, steps = calls + 1, steps + len(proposed.steps)
                proof += [] if proved.record is None else [(name, proved.record)]
                found = found.intersect(proved.box if proved.complete else proposed.box)
                if total.box.is_empty:
                    break
            done = givers == [contractor] and (as_one or found == total.box)  # of both boxes at once, or caught up
            if not (found.is_empty or done):
                further = contracted(contractor, found)
                found, calls, steps = further.box, calls + 1, steps + len(further.steps)
                point = total.point if further.point is None else further.point
                total = replace(total, point=point, programs=total.programs + further.programs)
            uses.append(ContractorUse(name, calls, steps))
        return Pass(total, found.intersect(total.box), tuple(uses), tuple(proof))

    def _plain(self, box: Box) -> Pass:
        total, uses = Contraction(box), []
        for name, contractor in self._named:
            use = ContractorUse(name)
            if not total.box.is_empty:
                step = contracted(contractor, total.box)
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
