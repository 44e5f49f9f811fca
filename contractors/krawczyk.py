"""krawczyk: the paper's interval Newton method for over-determined systems (section 4.3, eq. 7 to 14)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from cpcal.solver.contract import Composable, Contraction, repeated
from cpcal.solver.interval import Bools, Box, Floats, Indices, IntervalArray
from cpcal.solver.interval.numbers import joined
from cpcal.solver.linear import Dense, LinearSolution, Programs, lower_bound
from cpcal.solver.network import CentredForm, ConstraintNetwork, one_sided_rows

# ------------------------------------------------------------------------------------------------------------------
# The box around a polyhedron, by two linear programs per variable (paper, eq. 13 and 14).


class Polyhedron(NamedTuple):
    """Every solution in a box satisfies `matrix @ x <= rhs`, exactly: (m, n), (m,); `origin` (m, 2) names constraint
    and element of each row."""

    matrix: Floats
    rhs: Floats
    origin: Indices


class PolyhedralPrograms(Programs):
    """The linear programs of one polyhedron in one bounded box.

    They are in u = (x - mid) / rad, each row scaled to a largest coefficient of 1; multipliers are proved in x.
    """

    # a program that overflows proposes nothing; what is proved is NaN-safe
    @np.errstate(over="ignore", invalid="ignore")
    def __init__(self, name: str, polyhedron: Polyhedron, box: Box) -> None:
        n = len(box)
        super().__init__(box, {k: k for k in range(n)}, n)
        self.name, self._polyhedron = name, polyhedron
        inner = polyhedron.matrix * box.rad
        largest = np.abs(inner).max(axis=1, initial=0.0)
        self._scale = np.where(largest > 0.0, largest, 1.0)
        rows, right = inner / self._scale[:, None], (polyhedron.rhs - polyhedron.matrix @ box.mid) / self._scale
        finite = np.isfinite(rows).all(axis=1) & np.isfinite(right)  # a row that overflows proposes nothing
        self.engine = Dense(np.where(finite[:, None], rows, 0.0), np.where(finite, right, 0.0), -np.ones(n), np.ones(n))

    @np.errstate(over="ignore")  # an infinite multiplier counts as none
    def lowest(self, objective: Floats, solution: LinearSolution, unit: float = 1.0) -> float:
        weights = solution.multipliers / self._scale[solution.rows] * unit
        matrix, rhs = self._polyhedron.matrix, self._polyhedron.rhs
        return lower_bound(matrix, rhs, solution.rows, weights, objective, self.box.array)

    def reached(self, variable: int, side: str, solution: LinearSolution) -> float:
        sign = 1.0 if side == "lo" else -1.0
        return sign * self.lowest(sign * np.eye(self.size)[variable], solution, float(self.box.rad[variable]))

    def carriers(self, solution: LinearSolution) -> tuple[tuple[tuple[int, int], ...], None]:
        return tuple(dict.fromkeys((int(c), int(k)) for c, k in self._polyhedron.origin[solution.rows])), None


# ------------------------------------------------------------------------------------------------------------------
# The constraints on a box as interval-linear inequalities, and polyhedra around their solutions.
#
# On a box X with an expansion point c every one-sided row r(x, m) <= 0 gives (paper, eq. 7 and 8)
#
#     v + A (x - c) <= 0   for some v in r(c, M) and some A in the interval matrix of the row


class IntervalRows(NamedTuple):
    """K rows: point (n,), value (K,), matrix (K, n); origin (K, 2) names constraint and element of each."""

    point: Floats
    value: IntervalArray
    matrix: IntervalArray
    origin: Indices

    def only(self, rows: Bools) -> IntervalRows:
        return IntervalRows(self.point, self.value[rows], self.matrix[rows], self.origin[rows])


def beaumont(rows: IntervalRows, box: Box) -> Floats:
    """The row that solves `(mid A) z - (rad A) |z| <= -v` (Oettli and Prager) with z = x - c in place of |z|'s chord.

    |z_j| <= alpha_j z_j + beta_j on the box, alpha = (|hi| - |lo|) / (hi - lo). Exact where z_j has one sign;
    where the box is symmetric about c, alpha = 0 and the row is Krawczyk's.
    """
    lo, hi = box.lo - rows.point, box.hi - rows.point
    with np.errstate(all="ignore"):
        alpha = (np.abs(hi) - np.abs(lo)) / (hi - lo)
    alpha = np.where(np.isfinite(alpha), np.clip(alpha, -1.0, 1.0), 0.0)
    return rows.matrix.mid - rows.matrix.rad * alpha


def inequalities(rows: IntervalRows, box: Box, matrix: Floats) -> Polyhedron:
    """`U x <= u` around the solutions of the rows in a box (eq. 12); rigorous for every real `matrix` U:

    U (x - c) <= -v + (U - A)(x - c),     hence     U x <= sup(U c) - inf v + sup((U - A)(X - c))
    """
    u, c = IntervalArray.point(matrix), IntervalArray.point(rows.point)
    with np.errstate(all="ignore"):
        rest = ((u - rows.matrix) * (box.array - c)).sum(1)
        start = (u @ c.reshape((-1, 1)))[:, 0]
        rhs = start + rest - rows.value
    return Polyhedron(matrix, rhs.hi, rows.origin)


_RATIO = 0.9  # of the sum of the widths, each in units of what it was at first: a round that leaves no less is the last
_ROUNDS = 20


class Krawczyk(Composable):
    """Centred form on the box, the polyhedron of eq. 12, a linear program per bound; again while it pays.

    Boxes that are not bounded come back as they are.
    """

    name = "krawczyk"

    def __init__(self, network: ConstraintNetwork, *, objective: str | None = None) -> None:
        self._forms = list[tuple[CentredForm, Indices]]()
        for row in one_sided_rows(network):
            form = CentredForm(network, row.expr)
            elements = np.arange(form.count) if row.elements is None else row.elements
            self._forms.append((form, np.stack([np.full(form.count, row.constraint), elements], axis=1)))
        self._objective = None if objective is None else network.names.index(objective)

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        if box.is_empty or not box.is_bounded:
            return Contraction(box)
        unit = np.where(box.width > 0.0, box.width, 1.0)

        def pays(before: Floats, after: Floats, ratio: float) -> bool:
            with np.errstate(all="ignore"):  # widths beyond float64 tell nothing
                return bool(np.sum(after / unit) < ratio * np.sum(before / unit))

        return repeated(partial(self._once, deadline), box, ratio=_RATIO, most=_ROUNDS, pays=pays)

    def _once(self, deadline: float, box: Box) -> Contraction:
        """One step of the interval Newton method, eq. 9, by rows that a point of the box violates, up to rounding."""
        parts = self._parts(box)
        if not parts:
            return Contraction(box)
        matrix, rhs, origin = map(np.concatenate, zip(*parts, strict=True))
        with np.errstate(all="ignore"):
            largest = np.maximum(matrix, 0.0) @ box.hi + np.minimum(matrix, 0.0) @ box.lo
        keep = np.isfinite(matrix).all(axis=1) & np.isfinite(rhs) & np.isfinite(largest) & (largest > rhs)
        if not keep.any():
            return Contraction(box)
        polyhedron = Polyhedron(matrix[keep], rhs[keep], origin[keep])
        return PolyhedralPrograms(self.name, polyhedron, box).tightened(self._objective, deadline)

    def _rows(self, box: Box, points: Sequence[Floats], affine: bool | None = None) -> list[IntervalRows]:
        """The rows on a box (all, or only those that are affine in x, or only the others), for each expansion point.

        A point is in the box; for affine rows, whose matrix is the same everywhere, it may lie anywhere.
        """
        chosen = [(form, origin) for form, origin in self._forms if affine is None or form.affine == affine]
        if not chosen:
            return []
        matrix = joined([form.jacobian(box) for form, _ in chosen], 0)
        origin = np.concatenate([origin for _, origin in chosen])
        bounds = np.isfinite(matrix.lo).all(axis=1) & np.isfinite(matrix.hi).all(axis=1)
        out = []
        for point in points:
            rows = IntervalRows(point, joined([form.at(point) for form, _ in chosen], 0), matrix, origin)
            out.append(rows.only(bounds & np.isfinite(rows.value.lo)))  # the others say nothing
        return out

    def _parts(self, box: Box) -> list[Polyhedron]:
        """The interval-linear rows on a box, each block of them made real: here by its midpoint (eq. 11)."""
        return [inequalities(rows, box, rows.matrix.mid) for rows in self._rows(box, [box.mid])]


# ------------------------------------------------------------------------------------------------------------------
# beaumont: the krawczyk contractor with the inequalities of Beaumont's decomposition added (paper, 4.3.2).
#
# Oettli and Prager: the solutions z of `A z <= -v` for some A in an interval matrix are those of the real inequality
# `(mid A) z - (rad A) |z| <= -v`, linear wherever no z_j changes its sign. Beaumont replaces each |z_j| by its chord
# over the box. About the midpoint of the box that is Krawczyk's row again; so the same interval-linear system is
# expanded at other points too, where z has one sign and nothing is lost:
#
# - rows that are not affine in x at two opposite corners of the box;
# - affine rows, `A(M) x <= b(M)`, at x = 0, where no reading counts twice: the interval linear system itself.

_THIN = 1e-9  # of the largest coefficient: rows whose matrix is no wider gain nothing by another expansion


class Beaumont(Krawczyk):
    """As Krawczyk, with three to four times the rows and a tighter polyhedron where boxes are wide."""

    name = "beaumont"

    def _parts(self, box: Box) -> list[Polyhedron]:
        corners = self._rows(box, [box.lo, box.hi], affine=False)
        origin = self._rows(box, [np.zeros(len(box))], affine=True)
        parts = super()._parts(box)
        for rows in corners + origin:
            radius, size = rows.matrix.rad.max(axis=1, initial=0.0), rows.matrix.mag.max(axis=1, initial=0.0)
            thick = rows.only(radius > _THIN * size)
            parts.append(inequalities(thick, box, beaumont(thick, box)))
        return parts
