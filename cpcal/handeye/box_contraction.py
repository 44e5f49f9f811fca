"""A box contracted by weights that exact arithmetic accepts: what certificates of hand-eye studies are made of.

Linear programs propose, `WeightProver` forms the checker's own polynomials and decides what a step proves; only that
counts. So what a proof says is what `cpcal verify` will find.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.common.atomic import replacing
from cpcal.common.numbers import at_most
from cpcal.handeye.exact_rows import HandEyeStatement
from cpcal.handeye.frame_programs import FramePrograms, proposed
from cpcal.handeye.quadratic_rows import Quadratics
from cpcal.solver.certificate.statement import limits
from cpcal.solver.certificate.writer import WeightProver, line
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box

_NARROW = 0.15  # half-width of a rotation's entries below which programs without columns of products are tried
_PAYS = 0.7  # median share of the widths that such a program must leave, or less
_ENDED = 0.85  # share that a large one must leave of some width, or the box is as small as it gets
_PASSES = 60

Tell = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class FramesProof:
    """What is proved of the box `domain` at a tolerance.

    left      holds all that satisfies every constraint; empty: there is nothing
    steps     of the certificate
    used      constraints that some step speaks of
    programs  linear programs solved
    """

    statement: HandEyeStatement
    eps: float
    domain: Box
    left: Box
    steps: tuple[dict[str, Any], ...]
    used: tuple[int, ...]
    programs: int

    @property
    def refuted(self) -> bool:
        return self.left.is_empty

    def write(self, path: str | os.PathLike[str]) -> None:
        """The certificate: it states the constraints that its steps speak of, and no others."""
        places = {k: new for new, k in enumerate(self.used)}
        hull = None if self.refuted else limits(self.left)
        claims = {"cap": None, "infeasible": self.refuted, "epsilon": None, "enclosure": hull, "point": None}
        with replacing(path) as out:
            for first in self.statement.lines(self.domain, self.used):
                out.write(line(first).encode())
            out.write(line(claims).encode())
            for step in self.steps:
                out.write(line(step | {"rows": [[side, places[k]] for side, k in step["rows"]]}).encode())


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Constraints as a certificate states them, and as rows of linear programs.

    places      (M, 2): constraint and part of each row
    rotations   unknowns that are entries of rotations
    negligible  whether products matter so little on a box that columns for them gain nothing
    """

    statement: HandEyeStatement
    rows: Quadratics
    places: Indices
    rotations: tuple[int, ...]
    negligible: Callable[[Box], bool]


def contracted(
    asked: ConstraintRows, eps: float, domain: Box, *, time_limit: float = np.inf, tell: Tell
) -> FramesProof:
    """Contract a box until it is empty or gets no smaller."""
    return _Contracting(asked, domain, time_limit, tell).proof(eps)


class _Contracting:
    def __init__(self, asked: ConstraintRows, domain: Box, limit: float, tell: Tell) -> None:
        self.asked, self.domain, self.tell = asked, domain, tell
        self.prover = WeightProver(asked.statement)
        self.end = time.monotonic() + limit
        self.box, self.programs = domain, 0
        self.steps: list[dict[str, Any]] = []

    def proof(self, eps: float) -> FramesProof:
        pairs = len(self.asked.rows.layout.pairs)
        for _ in range(_PASSES):
            if self.box.is_empty or time.monotonic() > self.end:
                break
            before = self.box
            small = None if not self.narrow() else self.propose(np.zeros(pairs, dtype=np.bool_))
            if small is not None and np.median(_shares(before, small.box)) <= _PAYS:
                self.take(small)
                continue
            if small is not None and self.asked.negligible(self.box):
                self.take(small)
                break
            large = self.propose(np.ones(pairs, dtype=np.bool_))
            if not self.take(large) or _shares(before, self.box).min() > _ENDED:
                break
        used = sorted({k for step in self.steps for _, k in step["rows"]})
        return FramesProof(
            self.asked.statement, eps, self.domain, self.box, tuple(self.steps), tuple(used), self.programs
        )

    def narrow(self) -> bool:
        return float(self.box.rad[list(self.asked.rotations)].max()) < _NARROW

    def propose(self, columns: Bools) -> Contraction:
        programs = FramePrograms(self.asked.rows, self.asked.places, self.box, columns)
        found = proposed(programs)
        self.programs += programs.count
        return found

    def take(self, proposal: Contraction) -> bool:
        """Keep what of a proposal is proved; whether anything is."""
        proved = self.prover(self.box, proposal)
        if proved.record is None:
            return False
        self.steps.append(proved.record)
        self.box = proved.box
        size = 0.0 if self.box.is_empty else float(self.box.rad[list(self.asked.rotations)].max())
        self.tell(
            f"step {len(self.steps)}: {'none are left' if self.box.is_empty else f'rotations +-{at_most(size, 2)}'}"
        )
        return True


def _shares(before: Box, after: Box) -> Floats:
    """What is left of the widths; 0 of an empty box."""
    if after.is_empty:
        return np.zeros(1)
    moved = before.width > 0.0
    return np.asarray(after.width[moved] / before.width[moved]) if moved.any() else np.ones(1)
