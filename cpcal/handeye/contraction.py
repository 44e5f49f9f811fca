"""Linear programs that propose bounds on a box; nothing that they say is believed without its weights.

Every row of `equations` in the coordinates u of the box is linear but for products u_i u_j. A product is either a
column, tied to its factors by the four bound products (McCormick; tangents of a square), or it is bounded by its
coefficient. Without columns a program has 24 columns and takes a millisecond; it contracts boxes of a few degrees. With
them it has some 200, and contracts the box of all rotations.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpcal.common.files import replacing
from cpcal.common.numbers import at_most
from cpcal.common.values import Bools, Floats, Indices
from cpcal.handeye.rows import HandEyeStatement, Layout, Quadratics
from cpcal.solver.certificate.exact_network import limits
from cpcal.solver.certificate.recording import WeightProver, line
from cpcal.solver.contract import Contraction, Step, StepWeights
from cpcal.solver.interval import Box
from cpcal.solver.linear import Dense, LinearSolution, LinearStatus

_MET = 1e-3  # a bound that some vertex meets to this (in [-1, 1]) needs no program
_WORTH = 0.02  # of a half-width: what a bound must gain to be kept
_TANGENTS = (-1.0, -0.5, 0.5, 1.0)


@dataclass(frozen=True)
class _Product:
    """A row that bounds a column: (1 + p u_i)(1 + q u_j) >= 0, or (u_i - t)^2 >= 0."""

    i: int
    j: int
    p: float
    q: float
    t: float | None = None


class FramePrograms:
    """The linear programs of some rows on one box."""

    def __init__(self, rows: Quadratics, places: Indices, box: Box, columns: Bools) -> None:
        """`places` (M, 2): constraint and part of each row; `columns` (P,): which products have one."""
        self.layout = layout = rows.layout
        self.box, self.count = box, 0
        centred = rows.centred(box.mid, box.rad)
        chosen = np.flatnonzero(columns & (np.abs(centred.products).max(axis=0) > 0.0))
        beside = np.where(layout.square, np.maximum(-centred.products, 0.0), np.abs(centred.products))
        beside[:, chosen] = 0.0
        matrix = np.concatenate([centred.linear, centred.products[:, chosen]], axis=1)
        rhs = beside.sum(axis=1) - centred.constant
        scale = np.abs(matrix).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            matters = (scale > 0.0) & (np.abs(matrix).sum(axis=1) > rhs)
        self._kept = np.flatnonzero(matters)
        self._places = places[self._kept].tolist()
        self._scale = scale[self._kept]
        self._products, above, sides = _product_rows(chosen, layout)
        self._columns = layout.size + len(chosen)
        lower = -np.ones(self._columns)
        lower[layout.size :][layout.square[chosen]] = 0.0
        self._engine = Dense()
        self._engine.load(
            np.concatenate([above, matrix[self._kept] / self._scale[:, None]]),
            np.concatenate([sides, rhs[self._kept] / self._scale]),
            lower,
            np.ones(self._columns),
        )

    def minimize(self, unknown: int | None, sign: float) -> LinearSolution:
        objective = np.zeros(self._columns)
        if unknown is not None:
            objective[unknown] = sign
        self.count += 1
        return self._engine.minimize(objective)

    def weights(self, solution: LinearSolution) -> StepWeights:
        """The multipliers of a program, as the rule of certificates takes them."""
        rows, pairs, tangents = [], [], []
        for place, weight in zip(solution.rows.tolist(), solution.multipliers.tolist(), strict=True):
            if place < len(self._products):
                product = self._products[place]
                if product.t is None:
                    pairs.append((product.i, product.j, product.p, product.q, weight))
                else:
                    tangents.append((product.i, product.t, weight))
                continue
            place -= len(self._products)
            number, part = self._places[place]
            rows.append((number, part, 0, weight / float(self._scale[place])))
        return StepWeights(tuple(rows), tuple(pairs), tuple(tangents))


def _product_rows(chosen: Indices, layout: Layout) -> tuple[list[_Product], Floats, Floats]:
    """Rows (K, columns) and right sides that tie the columns of the chosen products to their factors."""
    products: list[_Product] = []
    rows: list[tuple[int, float, int, float, int, float]] = []
    sides: list[float] = []
    for place, pair in enumerate(chosen.tolist()):
        (i, j), column = layout.pairs[pair].tolist(), layout.size + place
        if i == j:
            for t in _TANGENTS:
                products.append(_Product(i, i, 0.0, 0.0, t))
                rows.append((i, 2.0 * t, i, 0.0, column, -1.0))
                sides.append(t * t)
            continue
        for p, q in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
            products.append(_Product(i, j, p, q))
            rows.append((i, -p, j, -q, column, -p * q))
            sides.append(1.0)
    matrix = np.zeros((len(rows), layout.size + len(chosen)))
    for k, (i, a, j, b, column, c) in enumerate(rows):
        matrix[k, i] += a
        matrix[k, j] += b
        matrix[k, column] = c
    return products, matrix, np.array(sides)


def proposed(programs: FramePrograms) -> Contraction:
    """Bounds of all unknowns, by two programs each; those that vertices show to move by next to nothing are left."""
    box, names = programs.box, programs.layout.names
    lo, hi, radius, mid = box.lo.copy(), box.hi.copy(), box.rad, box.mid
    lowest, highest = np.full(len(names), np.inf), np.full(len(names), -np.inf)
    steps: list[Step] = []
    for i in range(len(names)):
        for side, sign in (("lo", 1.0), ("hi", -1.0)):
            met = lowest[i] < -1.0 + _MET if sign > 0.0 else highest[i] > 1.0 - _MET
            if radius[i] == 0.0 or met:
                continue
            solution = programs.minimize(i, sign)
            if solution.status is LinearStatus.INFEASIBLE:
                step = Step("handeye", None, "", np.nan, (), programs.weights(solution))
                return Contraction(Box.empty(box.names), (*steps, step), None, programs.count)
            if solution.status is not LinearStatus.OPTIMAL:
                continue
            u = solution.point[: len(names)]
            np.minimum(lowest, u, out=lowest)
            np.maximum(highest, u, out=highest)
            if sign * u[i] < -1.0 + _WORTH:
                continue
            bound = float(mid[i] + radius[i] * u[i])
            steps.append(Step("handeye", names[i], side, bound, (), programs.weights(solution)))
            (lo if sign > 0.0 else hi)[i] = bound
    crossed = lo > hi
    lo[crossed] = hi[crossed] = mid[crossed]
    return Contraction(box.with_bounds(lo, hi), tuple(steps), None, programs.count)


# ------------------------------------------------------------------------------------------------------------------
# A box contracted by weights that exact arithmetic accepts: what certificates of hand-eye studies are made of.
#
# Linear programs propose, `WeightProver` forms the checker's own polynomials and decides what a step proves; only that
# counts. So what a proof says is what `cpcal verify` will find.

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
