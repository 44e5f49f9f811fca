"""The lifted relaxation of a polynomial system on one box: linear rows in the columns of `monomials`.

Every row has two versions: approximate (all rows at once, for the linear programs) and rigorous (the few
rows with a multiplier, for the proof).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from contractors.monomials import Shift, column_bounds, product_rows
from cpcal.common.arrays import Floats, Indices
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.linear import LazyRows, LinearEngine
from cpcal.solver.network import PolynomialSystem


def _up(count: int) -> float:
    """Factor that covers the rounding of a sum of so many positive numbers."""
    return 1.0 + (count + 8) * float(np.finfo(np.float64).eps)


class Structure:
    """What the relaxations of one system on all boxes have in common."""

    def __init__(self, system: PolynomialSystem) -> None:
        self.system = system
        self.shift = Shift(system.monomials, len(system.names))
        self.center = system.coefficients.mid
        self.slack = system.coefficients.rad[0]
        self.guard_center = system.guards.mid
        self.columns = column_bounds(system.monomials)
        # A monomial whose coefficients all contain zero is bounded, not given a column.
        matters = (np.abs(self.center[0]) > self.slack).any(axis=0)
        self.used = _with_divisors(system.monomials, matters)[1:]
        self.products = product_rows(system.monomials, self.used)
        self.positions = {m[0]: k - 1 for k, m in enumerate(system.monomials) if len(m) == 1 and self.used[k - 1]}


def _with_divisors(monomials: tuple[tuple[int, ...], ...], matters: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    column = {m: k for k, m in enumerate(monomials)}
    marked = matters.copy()
    for k in reversed(range(len(monomials))):
        if marked[k]:
            for j in range(len(monomials[k])):
                marked[column[monomials[k][:j] + monomials[k][j + 1 :]]] = True
    return marked


class Relaxation:
    """The rows of a `Structure` on one bounded box: `row . w <= rhs` with w the monomials of u in [-1, 1]^n."""

    def __init__(self, structure: Structure, engine: Arithmetic, box: Box) -> None:
        self._structure, self._engine = structure, engine
        self.center, self.radius = box.mid, box.rad
        self._shift = structure.shift.matrix(engine, self.center, self.radius)
        with np.errstate(all="ignore"):
            self._approximate()

    def _approximate(self) -> None:
        """All rows in plain float64, each scaled to a largest coefficient of 1: `matrix`, `rhs`, `scale`."""
        s, shift = self._structure, self._shift.mid
        rows = s.center @ shift
        widening = np.abs(rows[1:]).sum(axis=(0, 2)) + s.slack @ np.abs(shift).sum(axis=1)
        guards = s.guard_center @ shift[s.system.guard_monomials]
        lowest = guards[0, :, 0] - np.abs(guards[0, :, 1:]).sum(axis=1) - np.abs(guards[1:]).sum(axis=(0, 2))
        widening += np.where(s.system.guarded, np.minimum(lowest, 0.0) ** 2, 0.0)
        matrix = rows[0, :, 1:]
        largest = np.abs(matrix).max(axis=1, initial=0.0)
        self.scale = np.where(largest > 0.0, largest, 1.0)
        self.matrix = matrix / self.scale[:, None]
        self.rhs = (widening - rows[0, :, 0]) / self.scale
        lost = ~(np.isfinite(self.matrix).all(axis=1) & np.isfinite(self.rhs))  # overflow: these say nothing
        self.matrix[lost], self.rhs[lost], self.scale[lost] = 0.0, 1.0, 1.0

    def program(self, engine: LinearEngine) -> LazyRows:
        """Its rows as a linear program in the used columns."""
        columns, products = np.flatnonzero(self._structure.used), self._structure.products
        bounds = self._structure.columns[columns]
        return LazyRows(
            engine,
            (products.matrix[:, columns], products.rhs),
            (self.matrix[:, columns], self.rhs),
            (bounds.lo, bounds.hi),
        )

    def rigorous(self, rows: Indices) -> tuple[IntervalArray, Floats]:
        """Enclosures of the given rows and upper bounds of their right sides (not scaled)."""
        e, system = self._engine, self._structure.system
        values = self._in_box(system.coefficients[:, rows], self._shift)
        widening = _spread(values[1:])
        guards = self._in_box(system.guards[:, rows], self._shift[system.guard_monomials])
        inner = _spread(guards[1:]) + guards[0, :, 1:].mag.sum(axis=1) * _up(guards.shape[2])
        lowest = e.sub(IntervalArray.point(guards.lo[0, :, 0]), IntervalArray.point(inner * _up(1))).lo
        shortfall = np.where(system.guarded[rows], np.minimum(lowest, 0.0), 0.0)
        extra = e.add(e.sqr(IntervalArray.point(shortfall)), IntervalArray.point(widening))
        rhs = e.sub(extra, IntervalArray.point(values.lo[0, :, 0])).hi
        return values[0, :, 1:], rhs

    def _in_box(self, coefficients: IntervalArray, shift: IntervalArray) -> IntervalArray:
        slots, count, size = coefficients.shape
        flat = self._engine.dot(coefficients.reshape((slots * count, size)), shift)
        return flat.reshape((slots, count, shift.shape[1]))

    def value(self, variable: int, u: float) -> IntervalArray:
        """Enclosure of `c + r u` for one variable."""
        e = self._engine
        scaled = e.mul(IntervalArray.point(self.radius[variable]), IntervalArray.point(u))
        return e.add(IntervalArray.point(self.center[variable]), scaled)


def _spread(slopes: IntervalArray) -> Floats:
    """Upper bound of what the readings add to each row: the sum of |derivative| over readings and monomials."""
    total: Floats = slopes.mag.sum(axis=(0, 2)) * _up(slopes.shape[0] * slopes.shape[2])
    return total
