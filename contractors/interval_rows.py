"""The constraints on a box as interval-linear inequalities, and polyhedra around their solutions.

On a box X with an expansion point c every one-sided row r(x, m) <= 0 gives (paper, eq. 7 and 8)

    v + A (x - c) <= 0   for some v in r(c, M) and some A in the interval matrix of the row
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats, Indices
from cpcal.solver.contract import Polyhedron
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.network import CentredForm, ConstraintNetwork, one_sided_rows


@dataclass(frozen=True)
class IntervalRows:
    """K rows: point (n,), value (K,), matrix (K, n); origin (K, 2) names constraint and element of each."""

    point: Floats
    value: IntervalArray
    matrix: IntervalArray
    origin: Indices

    @property
    def usable(self) -> npt.NDArray[np.bool_]:
        """Rows that say something: defined, and finite where it matters."""
        finite = np.isfinite(self.matrix.lo).all(axis=1) & np.isfinite(self.matrix.hi).all(axis=1)
        return np.asarray(finite & np.isfinite(self.value.lo))

    def __getitem__(self, rows: npt.NDArray[np.bool_]) -> IntervalRows:
        return IntervalRows(self.point, self.value[rows], self.matrix[rows], self.origin[rows])


class Linearised:
    """The one-sided rows of a network, to be linearised box by box.

    `slopes`: the matrix holds slopes from the expansion point instead of derivatives (paper, eq. 5). They are about
    half as wide, but every expansion point needs its own.
    """

    def __init__(self, network: ConstraintNetwork, engine: Arithmetic, slopes: bool) -> None:
        self._slopes = slopes
        self._forms: list[tuple[CentredForm, Indices]] = []
        for row in one_sided_rows(network):
            form = CentredForm(network, row.expr, engine)
            elements = np.arange(form.count) if row.elements is None else row.elements
            self._forms.append((form, np.stack([np.full(form.count, row.constraint), elements], axis=1)))

    def at(self, box: Box, points: Sequence[Floats], affine: bool | None = None) -> list[IntervalRows]:
        """The rows on a box (all, or only those that are affine in x, or only the others), for each expansion point.

        A point is in the box; for affine rows, whose matrix is the same everywhere, it may lie anywhere.
        """
        chosen = [(form, origin) for form, origin in self._forms if affine is None or form.affine == affine]
        jacobians = [None if self._slopes and not form.affine else form.jacobian(box) for form, _ in chosen]
        out = []
        for point in points:
            blocks = [
                IntervalRows(
                    point, form.at(point, self._slopes), form.slopes(box, point) if matrix is None else matrix, origin
                )
                for (form, origin), matrix in zip(chosen, jacobians, strict=True)
            ]
            rows = _joined(point, blocks)
            out.append(rows[rows.usable])
        return out


def _joined(point: Floats, blocks: list[IntervalRows]) -> IntervalRows:
    n = len(point)

    def stacked(parts: list[IntervalArray], empty: tuple[int, ...]) -> IntervalArray:
        zeros = np.zeros(empty)
        lows, highs = [zeros, *(p.lo for p in parts)], [zeros, *(p.hi for p in parts)]
        return IntervalArray(np.concatenate(lows), np.concatenate(highs))

    return IntervalRows(
        point,
        stacked([b.value for b in blocks], (0,)),
        stacked([b.matrix for b in blocks], (0, n)),
        np.concatenate([np.zeros((0, 2), dtype=np.intp), *(b.origin for b in blocks)]),
    )


# Which real matrix stands for the interval matrix of the rows on a box.
Decomposition = Callable[[IntervalRows, Box], Floats]


def krawczyk(rows: IntervalRows, box: Box) -> Floats:
    """The midpoint (eq. 11)."""
    return rows.matrix.mid


def beaumont(rows: IntervalRows, box: Box) -> Floats:
    """The row that solves `(mid A) z - (rad A) |z| <= -v` (Oettli and Prager) with z = x - c in place of |z|'s chord.

    |z_j| <= alpha_j z_j + beta_j on the box, alpha = (|hi| - |lo|) / (hi - lo). Exact where z_j has one sign;
    where the box is symmetric about c, alpha = 0 and the row is Krawczyk's.
    """
    lo, hi = box.lo - rows.point, box.hi - rows.point
    with np.errstate(all="ignore"):
        alpha = (np.abs(hi) - np.abs(lo)) / (hi - lo)
    alpha = np.where(np.isfinite(alpha), np.clip(alpha, -1.0, 1.0), 0.0)
    return np.asarray(rows.matrix.mid - rows.matrix.rad * alpha)


def inequalities(engine: Arithmetic, rows: IntervalRows, box: Box, decomposition: Decomposition) -> Polyhedron:
    """`U x <= u` around the solutions of the rows in a box (eq. 12); rigorous for every real matrix U:

    U (x - c) <= -v + (U - A)(x - c),     hence     U x <= sup(U c) - inf v + sup((U - A)(X - c))
    """
    matrix = decomposition(rows, box)
    u, c = IntervalArray.point(matrix), IntervalArray.point(rows.point)
    with np.errstate(all="ignore"):
        rest = engine.sum(engine.mul(engine.sub(u, rows.matrix), engine.sub(box.array, c)), 1)
        start = engine.dot(u, c.reshape((-1, 1)))[:, 0]
        rhs = engine.sub(engine.add(start, rest), rows.value)
    return Polyhedron(box.names, matrix, rhs.hi)
