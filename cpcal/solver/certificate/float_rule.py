"""The checker's rule in float64, with every rounding counted: it never says more than the rule itself.

Rows come with a bound of their errors; weights are whole numbers of at most 53 bits, so exact. With unit roundoff u, a
sum of p products errs by at most p u / (1 - p u) times the sum of their sizes; the factor taken below is four times
that, for all terms that are added on the way to a bound.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpcal.checker.exact_polynomial import Polynomial, signed, unknown
from cpcal.checker.leg import LegConstraint
from cpcal.checker.problem import Problem
from cpcal.checker.rule import Row, Rule, Weights
from cpcal.common.arrays import Floats, Indices
from cpcal.solver.certificate.float_rows import FloatRow, float_row

_UNIT = 2.0**-53
_UNDERFLOW = 1e-290  # more than all that numbers lose that are too small
_SMALLEST = 1e-280  # a coefficient below it may have lost digits: such a row is left to exact arithmetic
_LONGEST = 1000  # bits of a whole number that a float64 can hold


class FloatRule:
    """`Rule` for weights on one box, and the rows of a problem that they speak of."""

    def __init__(self, rule: Rule, problem: Problem, rows: Sequence[Row]) -> None:
        self._rule, self._problem, self._table = rule, problem, rows
        self._mask = signed(len(rule.x))
        self._columns: dict[int, int] = {0: 0}
        self._even = [False]  # whether the monomial of a column, not the constant, lies in [0, 1]
        self._rows: dict[int, tuple[Indices, Floats, float]] = {}

    def bound(self, i: int, side: str, weights: Weights) -> tuple[float, float]:
        """A proved bound of x_i in the box, and how much of it may be given away to rounding."""
        sign = 1.0 if side == "lo" else -1.0
        lowest, error = self.lowest(weights, i, sign)
        center, radius = float(self._rule.x.center(i)), float(self._rule.x.radius(i))
        reach = radius * lowest
        doubt = 8.0 * _UNIT * (abs(center) + abs(reach)) + _UNDERFLOW
        return center + sign * reach - sign * doubt, 2.0 * (doubt + radius * error)

    def lowest(self, weights: Weights, i: int = 0, sign: float = 0.0) -> tuple[float, float]:
        """A lower bound of `sign u_i` and the aggregate, and the error that it counts; -inf where it overflows."""
        rows, of_rows = [(self._row(n), float(weight)) for n, weight in weights.rows], weights.exponents[0]
        columns, values = self._beside(weights, i, sign)
        count = len(self._columns)
        total, size = np.zeros(count), np.zeros(count)
        with np.errstate(all="ignore"):
            beside = 0.0
            for (places, row, own), weight in rows:
                w = np.ldexp(weight, of_rows)
                total[places] += w * row
                size[places] += np.abs(w * row)
                beside += w * own
            np.add.at(total, columns, values)
            np.add.at(size, columns, np.abs(values))
            lowest = float(total[0] + np.where(self._even, np.minimum(total, 0.0), -np.abs(total))[1:].sum())
            error = 4.0 * _UNIT * (len(rows) + len(values) + count + 8) * float(size.sum()) + _UNDERFLOW
            error += float(beside) * (1.0 + 4.0 * len(rows) * _UNIT)
        return (lowest - error, error) if np.isfinite(lowest - error) else (-np.inf, np.inf)

    def _beside(self, weights: Weights, i: int, sign: float) -> tuple[Indices, Floats]:
        """Columns and values of `sign u_i` and of all that is added beside rows."""
        _, of_products, of_tangents = weights.exponents
        parts = [(unknown(i), sign)]
        for k, m, p, q, weight in weights.products:
            w, one, two = _scaled(weight, of_products), unknown(k), unknown(m)
            parts += [(0, -w), (one, -w * p), (two, -w * q), (one + two, -w * p * q)]
        for k, touch, weight in weights.tangents:
            w, t, one = _scaled(weight, of_tangents), float(touch), unknown(k)
            parts += [(one + one, -w), (one, 2.0 * w * t), (0, -w * t * t)]
        return np.array([self._column(m) for m, _ in parts], dtype=np.intp), np.array([value for _, value in parts])

    def _row(self, n: int) -> tuple[Indices, Floats, float]:
        """Columns, coefficients, and the error of all of them."""
        if n not in self._rows:
            monomials, values, error = self._formed(n)
            self._rows[n] = np.array([self._column(m) for m in monomials], dtype=np.intp), values, error
        return self._rows[n]

    def _formed(self, n: int) -> FloatRow:
        side, k, signs = self._table[n]
        if self._problem.model is not None:
            leg = self._problem.constraint(k, self._rule.x, signs, 0)
            if isinstance(leg, LegConstraint) and (side != "lower" or leg.sure):
                return float_row(leg, side)
        return _rounded(self._rule.row[n])

    def _column(self, monomial: int) -> int:
        if monomial not in self._columns:
            self._columns[monomial] = len(self._columns)
            self._even.append(not monomial & self._mask)
        return self._columns[monomial]


def _scaled(weight: int, exponent: int) -> float:
    return float(np.ldexp(float(weight), exponent))


def _rounded(row: Polynomial) -> FloatRow:
    """Each coefficient rounded once, which the rule counts anyway."""
    cut = max(0, max(map(int.bit_length, row.terms.values()), default=0) - _LONGEST)
    values = np.ldexp(np.array([float(c >> cut) for c in row.terms.values()]), row.exponent + cut)
    smallest = float(np.min(np.abs(values), where=values != 0.0, initial=1.0))
    exact = smallest >= _SMALLEST and not any(c and not v for c, v in zip(row.terms.values(), values, strict=True))
    return FloatRow(tuple(row.terms), values, 0.0 if exact else np.inf)
