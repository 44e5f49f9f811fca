"""The checker's rule in float64, with every rounding counted: it never says more than the rule itself.

Rows come with a bound of their errors; weights are whole numbers of at most 53 bits times a power of two, so exact.
With unit roundoff u, a sum of p products errs by at most p u / (1 - p u) times the sum of their sizes; the factor taken
below is four times that, for all terms that are added on the way to a bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.checker.exact_polynomial import Polynomial, signed, unknown
from cpcal.checker.leg import LegConstraint
from cpcal.checker.problem import Problem
from cpcal.checker.rule import Row, Rule
from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.certificate.float_rows import FloatRow, float_rows, programs
from cpcal.solver.compiled import compiled

_UNIT = 2.0**-53
_UNDERFLOW = 1e-290  # more than all that numbers lose that are too small
_SMALLEST = 1e-280  # a coefficient below it may have lost digits: such a row is left to exact arithmetic
_LONGEST = 1000  # bits of a whole number that a float64 can hold

Product = tuple[int, int, int, int]  # (1 + p u_i)(1 + q u_j) as i, j, p, q
Square = tuple[int, float]  # (u_i - t)^2 as i, t


@dataclass(frozen=True)
class Parts:
    """Polynomials that weights are put on: coefficients `values` of the monomials with numbers `columns`, those of part
    p from `start[p]` on, and for each part a bound of the sum of their errors."""

    start: Indices
    columns: Indices
    values: Floats
    errors: Floats


class FloatRule:
    """`Rule` for weights on one box, and the rows of a problem that they speak of."""

    def __init__(self, rule: Rule, problem: Problem, rows: Sequence[Row]) -> None:
        self._rule, self._problem, self._table = rule, problem, rows
        self._mask = signed(len(rule.x))
        self._columns: dict[int, int] = {0: 0}
        self._even = [False]  # whether the monomial of a column, not the constant, lies in [0, 1]
        self._evens = np.zeros(1, np.bool_)  # the same as an array
        self._known_beside: dict[Product | Square, tuple[list[int], list[float]]] = {}
        self._rows: dict[int, tuple[Indices, Floats, float]] = {}
        self._sides: dict[int, tuple[float, float]] = {}  # center and radius of an unknown

    def parts(self, rows: Sequence[int], products: Sequence[Product], squares: Sequence[Square]) -> Parts:
        """Rows by their numbers, then what is not negative on the box, with a minus sign."""
        self.form(rows)
        formed = [self._rows[n] for n in rows]
        columns, values = [own for own, _, _ in formed], [own for _, own, _ in formed]
        sizes = [own.size for own in values] + [4] * len(products) + [3] * len(squares)
        places, coefficients = list[int](), list[float]()
        beside: list[Product | Square] = [*products, *squares]
        for one in beside:
            more = self._beside(one)
            places += more[0]
            coefficients += more[1]
        return Parts(
            start=np.cumsum([0, *sizes]),
            columns=np.concatenate([*columns, np.array(places, np.intp)]),
            values=np.concatenate([*values, np.array(coefficients, np.float64)]),
            errors=np.array([own for _, _, own in formed] + [0.0] * (len(products) + len(squares))),
        )

    def bound(self, i: int, side: str, parts: Parts, weights: Floats) -> tuple[float, float]:
        """A proved bound of x_i in the box, and how much of it may be given away to rounding."""
        sign = 1.0 if side == "lo" else -1.0
        lowest, error = self.lowest(parts, weights, i, sign)
        if i not in self._sides:
            self._sides[i] = float(self._rule.x.center(i)), float(self._rule.x.radius(i))
        center, radius = self._sides[i]
        reach = radius * lowest
        doubt = 8.0 * _UNIT * (abs(center) + abs(reach)) + _UNDERFLOW
        return center + sign * reach - sign * doubt, 2.0 * (doubt + radius * error)

    def lowest(self, parts: Parts, weights: Floats, i: int = 0, sign: float = 0.0) -> tuple[float, float]:
        """A lower bound of `sign u_i` and the weighted sum, and the error that it counts; -inf where it overflows."""
        column = self._column(unknown(i))
        if len(self._evens) < len(self._even):
            self._evens = np.array(self._even)
        kept = self._evens
        lowest, error = _lowest(parts.start, parts.columns, parts.values, parts.errors, weights, kept, column, sign)
        return (lowest - error, error) if np.isfinite(lowest - error) else (-np.inf, np.inf)

    def _beside(self, one: Product | Square) -> tuple[list[int], list[float]]:
        """Columns and coefficients of what is added beside rows."""
        known = self._known_beside.get(one)
        if known is None:
            terms = _of_product(*one) if len(one) == 4 else _of_square(*one)
            known = self._known_beside[one] = [self._column(m) for m, _ in terms], [value for _, value in terms]
        return known

    def form(self, numbers: Sequence[int]) -> None:
        """Columns, coefficients, and the error of all of them, of rows that were not formed before."""
        new = [n for n in dict.fromkeys(numbers) if n not in self._rows]
        legs = {n: leg for n in new if (leg := self._leg(n)) is not None}
        for side in dict.fromkeys(self._table[n][0] for n in legs):
            mine = [n for n in legs if self._table[n][0] == side]
            for places in programs([legs[n] for n in mine]):
                own = [mine[place] for place in places]
                for n, row in zip(own, float_rows([legs[n] for n in own], side), strict=True):
                    self._keep(n, row)
        others = [n for n in new if n not in legs]
        self._rule.form(others)
        for n in others:
            self._keep(n, _rounded(self._rule.row[n]))

    def _keep(self, n: int, row: FloatRow) -> None:
        self._rows[n] = np.array([self._column(m) for m in row.monomials], dtype=np.intp), row.values, row.error

    def _leg(self, n: int) -> LegConstraint | None:
        """The constraint of a row that can be swept in float64."""
        side, k, signs = self._table[n]
        if self._problem.model is None:
            return None
        leg = self._problem.constraint(k, self._rule.x, signs, 0)
        return leg if isinstance(leg, LegConstraint) and (side != "lower" or leg.sure) else None

    def _column(self, monomial: int) -> int:
        if monomial not in self._columns:
            self._columns[monomial] = len(self._columns)
            self._even.append(not monomial & self._mask)
        return self._columns[monomial]


def _of_product(k: int, m: int, p: int, q: int) -> list[tuple[int, float]]:
    one, two = unknown(k), unknown(m)
    return [(0, -1.0), (one, -p), (two, -q), (one + two, -p * q)]


def _of_square(k: int, t: float) -> list[tuple[int, float]]:
    one = unknown(k)
    return [(one + one, -1.0), (one, 2.0 * t), (0, -t * t)]


@compiled
def _lowest(
    start: Indices,
    columns: Indices,
    values: Floats,
    errors: Floats,
    weights: Floats,
    even: Bools,
    moved: int,
    sign: float,
) -> tuple[float, float]:
    """The least that `sign` times monomial `moved` and the weighted parts can be, and the error of it."""
    count, used = even.size, 0
    total, size = np.zeros(count), np.zeros(count)
    total[moved], size[moved] = sign, abs(sign)
    beside = 0.0
    for p in range(weights.size):
        weight = weights[p]
        if weight != 0.0:
            used += 1
            beside += weight * errors[p]
            for t in range(start[p], start[p + 1]):
                term = weight * values[t]
                total[columns[t]] += term
                size[columns[t]] += abs(term)
    lowest, sizes = total[0], size[0]
    for c in range(1, count):
        lowest += min(total[c], 0.0) if even[c] else -abs(total[c])
        sizes += size[c]
    error = 4.0 * _UNIT * (3 * used + count + 8) * sizes + _UNDERFLOW
    return lowest, error + beside * (1.0 + 4.0 * used * _UNIT)


def _rounded(row: Polynomial) -> FloatRow:
    """Each coefficient rounded once, which the rule counts anyway."""
    cut = max(0, max(map(int.bit_length, row.terms.values()), default=0) - _LONGEST)
    values = np.ldexp(np.array([float(c >> cut) for c in row.terms.values()]), row.exponent + cut)
    smallest = float(np.min(np.abs(values), where=values != 0.0, initial=1.0))
    exact = smallest >= _SMALLEST and not any(c and not v for c, v in zip(row.terms.values(), values, strict=True))
    return FloatRow(tuple(row.terms), values, 0.0 if exact else np.inf)
