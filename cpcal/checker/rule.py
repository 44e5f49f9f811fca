"""The one rule: weights on rows, bound products and squares exclude a box, or bound an unknown on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F

from .polynomial import FIELD, READINGS, Polynomial, TooLarge, combined, least, signed
from .problem import Box, Problem, Unknowns

_MOST_TERMS = 200_000  # of all rows of a step

Row = tuple[str, int, str]  # side, measurement, signs of the reference reading


@dataclass(frozen=True)
class Weights:
    """Multipliers of rows (its number, weight), of products (1 + p u_i)(1 + q u_j) and of squares (u_i - t)^2.

    Each is a whole number, the last of its entry, times 2 to the power that `exponents` gives for its kind.
    """

    rows: tuple[tuple[int, int], ...]
    products: tuple[tuple[int, int, int, int, int], ...]
    tangents: tuple[tuple[int, F, int], ...]
    exponents: tuple[int, int, int]


class Rule:
    """Applies weights on one box; the rows that they speak of are formed once."""

    def __init__(self, problem: Problem, box: Box, rows: Sequence[Row], spend: Callable[[int], None]) -> None:
        self.x, self._problem, self._rows = Unknowns(box, spend), problem, rows
        self._known: dict[int, Polynomial] = {}
        self._terms = 0

    def row(self, n: int) -> Polynomial:
        if n not in self._known:
            found = self._problem.row(self.x, *self._rows[n])
            self._terms += len(found.terms)
            if self._terms > _MOST_TERMS:
                raise TooLarge(f"the rows of a step have more than {_MOST_TERMS} terms")
            self._known[n] = found
        return self._known[n]

    def aggregate(self, weights: Weights) -> Polynomial:
        """At most zero at every solution in the box: weighted rows, less weighted products and squares."""
        of_rows, of_products, of_tangents = weights.exponents
        parts = [(weight, self.row(n).times(1, of_rows)) for n, weight in weights.rows if weight]
        products: dict[int, int] = {}
        for i, j, p, q, weight in weights.products:
            one, two = _field(i), _field(j)
            for monomial, c in ((0, 1), (one, p), (two, q), (one + two, p * q)):
                products[monomial] = products.get(monomial, 0) - weight * c
        parts.append((1, Polynomial(products, of_products, self.x.spend)))
        for i, t, weight in weights.tangents:
            u = self.x.variable(READINGS + i, -t, F(1))
            parts.append((-weight, (u * u).times(1, of_tangents)))
        return combined(parts, self.x.spend)

    def excludes(self, weights: Weights) -> bool:
        """Whether no solution lies in the box: the aggregate is positive on it."""
        return self._least(self.aggregate(weights)) > 0

    def bound(self, unknown: int, side: str, weights: Weights) -> F:
        """Every solution in the box has x_i at least ("lo") or at most ("hi") this."""
        sign = 1 if side == "lo" else -1
        u = Polynomial({_field(unknown): 1}, 0, self.x.spend)
        least_ = self._least(combined(((1, self.aggregate(weights)), (sign, u)), self.x.spend))
        return self.x.center(unknown) + sign * self.x.radius(unknown) * least_  # as aggregate <= 0 at a solution

    def _least(self, p: Polynomial) -> F:
        return least(p, signed(len(self.x)))


def _field(unknown: int) -> int:
    return 1 << FIELD * (READINGS + unknown)
