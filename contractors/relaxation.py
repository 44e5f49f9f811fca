"""The lifted relaxation of a polynomial system on one box: linear rows in the columns of `monomials`.

All numbers of the rows are exact float64 numbers, their right sides large enough for what was rounded on the way: what
holds at every solution in the box is what the linear programs work on, and what their multipliers are proved with.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from contractors.centred import CentredRows, Shift
from contractors.monomials import ProductRows, column_bounds, product_rows
from contractors.packing import packed, reach, scaled
from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.linear import LinearEngine
from cpcal.solver.network import PolynomialSystem
from cpcal.solver.network.term_operations import Monomial

_UNIT = 2.0**-53
_SMALLEST = 1e-290
_COLUMNS = 150  # beyond, linear programs take too long at each node


class Structure:
    """What the relaxations of one system on all boxes have in common.

    `whole`: of which it is a part, and the monomials that occur in rows that it has not.
    """

    def __init__(self, system: PolynomialSystem, whole: tuple[Structure, Bools] | None = None) -> None:
        self.system = system
        shift = _shift(system.monomials, len(system.names))
        self.rows = CentredRows(shift, system.coefficients)
        self.guards = CentredRows(shift, _guards(system)) if system.guarded.any() else None
        # A monomial whose coefficients all contain zero is bounded, not given a column.
        self._divisors = _divisors(system.monomials)
        paying = (
            _paying(self._divisors, self.rows.matters[1:], system.monomials[1:]) if whole is None else whole[0].used
        )
        self.used: Bools = paying
        self._beyond = np.zeros(len(self.used), np.bool_) if whole is None else whole[1]
        self.linear = np.array([len(m) < 2 for m in system.monomials[1:]], dtype=np.bool_)
        self.bounds = column_bounds(system.monomials)
        self.products = _products(system.monomials, self.used.tobytes())
        self.factors = self.products.matrix != 0.0
        self.positions = {m[0]: k - 1 for k, m in enumerate(system.monomials) if len(m) == 1 and self.used[k - 1]}

    def part(self, rows: Indices, occurring: Bools) -> Structure:
        """Of these rows alone, for boxes within one where no point violates the others.

        `occurring`: the monomials of u that have a coefficient there. They keep their columns, so that the programs are
        those of the whole system.
        """
        return Structure(_restricted(self.system, rows), (self, occurring | self._beyond))

    def columns(self, highest: Floats, radius: Floats) -> Bools:
        """The monomials that get a column on a box; `highest`: their largest coefficients in the rows there are."""
        moving = np.array([all(radius[i] > 0.0 for i in m) for m in self.system.monomials[1:]], dtype=np.bool_)
        return self.with_divisors(self.used & (self.linear | (highest > 0.0) | (self._beyond & moving)))

    def names(self, rows: Indices) -> list[tuple[int, int, int]]:
        """Constraint, part and element of some rows."""
        origin, part = self.system.origin[rows].tolist(), self.system.part[rows].tolist()
        return [(c, p, k) for (c, k), p in zip(origin, part, strict=True)]

    def with_divisors(self, monomials: Bools) -> Bools:
        """Those monomials (without the constant), and all that divide one of them."""
        return np.asarray(self._divisors[monomials].any(axis=0))


def _paying(divisors: Bools, monomials: Bools, degrees: tuple[Monomial, ...]) -> Bools:
    """Which monomials get a column: those given and all that divide them; where these are many, the first so-many.

    Low degrees come first: on a box of half-width r the others count for r^degree only. Of one degree those that divide
    most. What has no column is bounded.
    """
    used = np.asarray(divisors[monomials].any(axis=0))
    if np.count_nonzero(used) <= _COLUMNS:
        return used
    shared = divisors[monomials].sum(axis=0)
    order = sorted(np.flatnonzero(used).tolist(), key=lambda m: (len(degrees[m]), -shared[m], m))
    out = np.zeros(len(used), np.bool_)
    out[[m for k, m in enumerate(order) if k < _COLUMNS or len(degrees[m]) < 2]] = True
    return out


def _guards(system: PolynomialSystem) -> IntervalArray:
    """The guards of the guarded rows, in all monomials."""
    own = system.guards[:, system.guarded]
    lo, hi = np.zeros((2, *own.shape[:2], len(system.monomials)))
    lo[..., system.guard_monomials], hi[..., system.guard_monomials] = own.lo, own.hi
    return IntervalArray(lo, hi)


def _restricted(system: PolynomialSystem, rows: Indices) -> PolynomialSystem:
    """Some rows of a system."""
    return replace(
        system,
        coefficients=system.coefficients[:, rows],
        guarded=system.guarded[rows],
        guards=system.guards[:, rows],
        origin=system.origin[rows],
        part=system.part[rows],
    )


# What follows depends on the monomials alone, which the boxes of one system share.


@lru_cache(maxsize=16)
def _shift(monomials: tuple[Monomial, ...], variables: int) -> Shift:
    return Shift(monomials, variables)


@lru_cache(maxsize=16)
def _products(monomials: tuple[Monomial, ...], used: bytes) -> ProductRows:
    return product_rows(monomials, np.frombuffer(used, np.bool_))


@lru_cache(maxsize=16)
def _divisors(monomials: tuple[Monomial, ...]) -> Bools:
    """Which monomials (columns) divide which (rows), each itself included; the constant is left out."""
    variables = sorted({i for m in monomials for i in m})
    count = np.array([[m.count(i) for i in variables] for m in monomials[1:]], np.int16)
    out = np.ones((len(count), len(count)), np.bool_)
    for powers in count.T if len(count) else ():
        out &= powers[None] <= powers[:, None]
    return out


class Relaxation:
    """The rows of a `Structure` on one bounded box: `matrix @ w <= rhs` for some of the monomials w of u in [-1, 1]^n.

    `columns` are those monomials, in `bounds`; the first rows are the bound products `products`, the others the rows
    `kept` of the system, times 2^-exponent, but for those that no point of the box violates (with `whole`: all).
    """

    def __init__(self, structure: Structure, engine: Arithmetic, box: Box, *, whole: bool = False) -> None:
        self._engine = engine
        self.center, self.radius = box.mid, box.rad
        with np.errstate(all="ignore"):
            rows, widening = structure.rows.on(engine, self.center, self.radius)
            widening = self._guarded(structure, widening)
            rhs = widening - rows[0] + 4.0 * _UNIT * (np.abs(widening) + np.abs(rows[0]))
        rows = rows[1:]
        exponents, highest = scaled(rows, rhs)
        self.occurring = highest > 0.0
        has_column = structure.columns(highest, self.radius)
        self.columns = np.flatnonzero(has_column)
        matters = reach(rows, rhs, has_column, structure.bounds.lo, structure.bounds.hi)
        if whole:
            matters = np.isfinite(rhs) & np.isfinite(rows).all(axis=0)
        self.kept = np.flatnonzero(matters)
        self.bounds, self.exponents = structure.bounds[self.columns], exponents[self.kept]
        self.products = np.flatnonzero(~structure.factors[:, ~has_column].any(axis=1))
        products = structure.products.matrix[np.ix_(self.products, self.columns)]
        self.matrix = packed(products, rows, self.columns, self.kept).T
        self.rhs = np.concatenate([structure.products.rhs[self.products], rhs[self.kept]])

    def _guarded(self, structure: Structure, widening: Floats) -> Floats:
        """With the square of what a guard may fall short by: see `Row`."""
        if structure.guards is None:
            return widening
        rows, error = structure.guards.on(self._engine, self.center, self.radius)
        lowest = _down(rows[0] - _up(np.abs(rows[1:]).sum(axis=0) + error, len(rows)))
        lowest = np.where(np.isfinite(lowest), lowest, -np.inf)  # a sum that overflowed on its way may be anything
        out = widening.copy()
        out[structure.system.guarded] += _up(np.minimum(lowest, 0.0) ** 2, 1)
        return out

    def load(self, engine: LinearEngine) -> LinearEngine:
        """The engine, with its rows."""
        engine.load(self.matrix, self.rhs, self.bounds.lo, self.bounds.hi, len(self.products))
        return engine

    def value(self, variable: int, u: float) -> tuple[float, float]:
        """Enclosure of `c + r u` for one variable: four roundings, each of at most a unit of these sizes."""
        center, reach = float(self.center[variable]), float(self.radius[variable]) * u
        value, error = center + reach, 4.0 * _UNIT * (abs(center) + abs(reach)) + _SMALLEST
        return value - error, value + error


def _up(values: Floats, count: int) -> Floats:
    """Upper bounds of sums of so many numbers >= 0, computed in any order."""
    return np.asarray(values * (1.0 + (count + 8) * 2.0 * _UNIT) + _SMALLEST)


def _down(values: Floats) -> Floats:
    return np.asarray(np.nextafter(values, -np.inf))
