"""What is proved of a study at one tolerance: a box of frames contracted by weights that exact arithmetic accepts.

`Relaxation` proposes, `WeightProver` forms the checker's own polynomials and decides what a step proves; only that
counts. So what a proof says is what `cpcal verify` will find.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.common.atomic import replacing
from cpcal.common.numbers import at_most
from cpcal.handeye.exact_rows import ExactRows, HandEyeStatement, row_meaning, row_number
from cpcal.handeye.frame_equations import (
    EQUATIONS,
    PAIRS,
    R_F,
    R_X,
    UNKNOWNS,
    Quadratics,
    pixel_rows,
    rotation_rows,
)
from cpcal.handeye.frame_programs import FramePrograms, proposed
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.pose_slack import point_motion, pose_slack
from cpcal.solver.certificate.statement import limits
from cpcal.solver.certificate.writer import WeightProver, line
from cpcal.solver.contract import Contraction, Step
from cpcal.solver.interval import Box

_NARROW = 0.15  # half-width of a rotation's entries below which the small programs are tried
_PAYS = 0.7  # median share of the widths that a small program must leave, or less
_ENDED = 0.85  # share that a large one must leave of some width, or the box is as small as it gets
_NEGLIGIBLE = 0.01
_PASSES = 60
_TURNS = 4
_NEARER = 0.9  # share of what poses move points by, below which constraints are stated anew

Tell = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class FramesProof:
    """What is proved of the box `domain` at a tolerance.

    left      holds all frames that satisfy every pixel; empty: there are none
    steps     of the certificate, and the proposals that they come from, which may be tried at another tolerance
    used      constraints that some step speaks of
    programs  linear programs solved
    """

    statement: HandEyeStatement
    eps: float
    domain: Box
    left: Box
    steps: tuple[dict[str, Any], ...]
    proposals: tuple[Contraction, ...]
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


def prove(
    study: HandEyeStudy,
    eps: float,
    domain: Box,
    *,
    about: str,
    replayed: FramesProof | None = None,
    time_limit: float = np.inf,
    tell: Tell = lambda text: None,
) -> FramesProof:
    """Contract a box of frames until it is empty or gets no smaller, at a tolerance of `eps` px.

    replayed  a proof at a larger tolerance: its steps are taken first, without linear programs
    """
    statement = HandEyeStatement(ExactRows(study, eps, domain), about)
    proving = _Proving(study, statement, eps, domain, time_limit, tell)
    for proposal in () if replayed is None or eps <= 0.0 else replayed.proposals:
        if proving.box.is_empty or not proving.take(_tighter(proposal, study, replayed.eps, eps)):  # type: ignore[union-attr]
            break
    return proving.proof()


def prove_in_turns(
    study: HandEyeStudy,
    eps: float,
    domain: Box,
    *,
    about: str,
    replayed: FramesProof | None = None,
    time_limit: float = np.inf,
    tell: Tell = lambda text: None,
) -> tuple[FramesProof, ...]:
    """Proofs of which each begins where the one before ended, as long as that says more of uncertain robot poses.

    How far a reading of a pose can move a point depends on where the target is, so the constraints are stated anew for
    the smaller box. With exact poses there is one proof.
    """
    found = [prove(study, eps, domain, about=about, replayed=replayed, time_limit=time_limit, tell=tell)]
    while not found[-1].refuted and len(found) < _TURNS:
        last = found[-1]
        before, after = point_motion(study, last.domain), point_motion(study, last.left)
        if not (after < _NEARER * before).any():
            break
        found.append(prove(study, eps, last.left, about=about, time_limit=time_limit, tell=tell))
    return tuple(found)


class _Proving:
    def __init__(
        self, study: HandEyeStudy, statement: HandEyeStatement, eps: float, domain: Box, limit: float, tell: Tell
    ) -> None:
        self.statement, self.eps, self.domain, self.tell = statement, eps, domain, tell
        self.rows = Quadratics.joined([rotation_rows(), pixel_rows(study, eps, pose_slack(study, eps, domain))])
        self.prover = WeightProver(statement)
        self.end = time.monotonic() + limit
        self.box, self.programs = domain, 0
        self.steps: list[dict[str, Any]] = []
        self.proposals: list[Contraction] = []

    def proof(self) -> FramesProof:
        for _ in range(_PASSES):
            if self.box.is_empty or time.monotonic() > self.end:
                break
            before = self.box
            small = None if not self.narrow() else self.propose(np.zeros(len(PAIRS), dtype=np.bool_))
            if small is not None and np.median(_shares(before, small.box)) <= _PAYS:
                self.take(small)
                continue
            if small is not None and self.negligible():
                self.take(small)
                break
            large = self.propose(np.ones(len(PAIRS), dtype=np.bool_))
            if not self.take(large) or _shares(before, self.box).min() > _ENDED:
                break
        used = sorted({k for step in self.steps for _, k in step["rows"]})
        return FramesProof(
            self.statement, self.eps, self.domain, self.box,
            tuple(self.steps), tuple(self.proposals), tuple(used), self.programs,
        )  # fmt: skip

    def narrow(self) -> bool:
        return float(self.box.rad[[*R_X, *R_F]].max()) < _NARROW

    def negligible(self) -> bool:
        """Whether products change a pixel by next to nothing beside the tolerance, so that columns gain nothing."""
        centred = self.rows.centred(self.box.mid, self.box.rad)
        start, count = 2 * len(EQUATIONS), len(self.rows) - 2 * len(EQUATIONS)
        constant = centred.constant[start:].reshape(2, 2, -1)
        room = -constant.sum(axis=1)  # 2 (eps + half-width) x_3 of each point and axis
        beside = np.abs(centred.products[start:]).sum(axis=1).reshape(2, 2, count // 4).max(axis=1)
        return bool((beside <= _NEGLIGIBLE * room).all())

    def propose(self, columns: Bools) -> Contraction:
        programs = FramePrograms(self.rows, self.box, columns)
        found = proposed(programs)
        self.programs += programs.count
        return found

    def take(self, proposal: Contraction) -> bool:
        """Keep what of a proposal is proved; whether anything is."""
        proved = self.prover(self.box, proposal)
        if proved.record is None:
            return False
        self.steps.append(proved.record)
        self.proposals.append(proposal)
        self.box = proved.box
        wide = (
            "none are left" if self.box.is_empty else f"rotations +-{at_most(float(self.box.rad[list(R_X)].max()), 2)}"
        )
        self.tell(f"step {len(self.steps)}: {wide}")
        return True


def _shares(before: Box, after: Box) -> Floats:
    """What is left of the widths; 0 of an empty box."""
    if after.is_empty:
        return np.zeros(1)
    moved = before.width > 0.0
    return np.asarray(after.width[moved] / before.width[moved]) if moved.any() else np.ones(1)


def _tighter(proposal: Contraction, study: HandEyeStudy, larger: float, smaller: float) -> Contraction:
    """The same bounds from the rows at a smaller tolerance.

    With w the half-width of a pixel, the rows above and below at tolerance e add up to -2 (e + w) x_3 <= 0. So a row
    at e' > e is the one at e plus (e' - e) / (2 (e + w)) times both.
    """
    count = len(study.image)

    def rewritten(step: Step) -> Step:
        weights: dict[tuple[int, int], float] = {}
        assert step.weights is not None
        for constraint, part, _, weight in step.weights.rows:
            weights[constraint, part] = weights.get((constraint, part), 0.0) + weight
            meaning = row_meaning(constraint, count)
            if meaning is None:
                continue
            point, axis, _ = meaning
            more = weight * (larger - smaller) / (2.0 * (smaller + float(study.half_width[point])))
            for below in (False, True):
                key = row_number(point, axis, below, count), 0
                weights[key] = weights.get(key, 0.0) + more
        rows = tuple((k, part, 0, weight) for (k, part), weight in weights.items())
        return replace(step, weights=replace(step.weights, rows=rows))

    return replace(proposal, steps=tuple(map(rewritten, proposal.steps)))


def box_of(lo: Any, hi: Any) -> Box:
    """Of all unknowns."""
    return Box(UNKNOWNS, lo, hi)
