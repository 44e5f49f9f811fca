"""The one rule: weights on rows, bound products and squares exclude a box, or bound an unknown on it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction as F
from itertools import chain
from typing import NamedTuple

from .exact_polynomial import (
    MOST_HELD,
    MOST_TERMS,
    READINGS,
    Polynomial,
    Spend,
    combined,
    least,
    signed,
    substituted,
    too_many,
    unknown,
)
from .problem import Box, Problem, Unknowns

Row = tuple[str, int, str]  # side, measurement, signs of the reference reading


class Weights(NamedTuple):
    """Multipliers of rows (its number, weight), of products (1 + p u_i)(1 + q u_j) and of squares (u_i - t)^2.

    Each is a whole number, the last of its entry, times 2 to the power that `exponents` gives for its kind.
    """

    rows: tuple[tuple[int, int], ...]
    products: tuple[tuple[int, int, int, int, int], ...]
    tangents: tuple[tuple[int, F, int], ...]
    exponents: tuple[int, int, int]


class Rule:
    """Applies weights on one box; the rows that they speak of are formed once."""

    def __init__(self, problem: Problem, box: Box, rows: Sequence[Row], spend: Spend) -> None:
        self.x, self._problem, self._table = Unknowns(box, spend), problem, rows
        self.row: dict[int, Polynomial] = {}
        self._held = 0

    def form(self, numbers: Iterable[int]) -> None:
        """Rows, by their numbers, that are not formed yet; others are forgotten where there are many."""
        needed = dict.fromkeys(numbers)
        new = [n for n in needed if n not in self.row]
        if new and self._held > MOST_HELD // 2:
            self.row = {n: row for n, row in self.row.items() if n in needed}
            self._held = sum(row.size for row in self.row.values())
        for place, row in self._problem.rows(self.x, [self._table[n] for n in new]):
            self.row[new[place]] = row
            self._held += row.size
            if self._held > MOST_HELD:
                raise too_many(MOST_HELD, "terms of rows in a step")

    def aggregate(self, weights: Weights) -> Polynomial:
        """At most zero at every solution in the box: weighted rows, less weighted products and squares."""
        of_rows, of_products, of_tangents = weights.exponents
        terms: dict[int, int] = {}
        self.x.spend(len(weights.products) * (20 + len(self.x) // 20) + 100 * len(weights.tangents))
        for i, j, p, q, weight in weights.products:
            one, two = unknown(i), unknown(j)
            for monomial, c in ((0, 1), (one, p), (two, q), (one + two, p * q)):
                terms[monomial] = terms.get(monomial, 0) - weight * c
            if len(terms) > MOST_TERMS:
                raise too_many(MOST_TERMS, "terms of a polynomial")
        products = Polynomial(terms, of_products, self.x.spend)
        self.form(n for n, weight in weights.rows if weight)
        rows: Iterable[tuple[int, Polynomial]] = (
            (weight, self.row[n].times(1, of_rows)) for n, weight in weights.rows if weight
        )
        roots = ((self.x.variable(READINGS + i, -t, F(1)), weight) for i, t, weight in weights.tangents)
        squares = ((-weight, (u * u).times(1, of_tangents)) for u, weight in roots)
        if not self._problem.in_box:
            rows = [(1, substituted(combined(rows, self.x.spend), self.x.images))]
        return combined(chain(rows, ((1, products),), squares), self.x.spend)

    def excludes(self, weights: Weights) -> bool:
        """Whether no solution lies in the box: the aggregate is positive on it."""
        return self._least(self.aggregate(weights)) > 0

    def bound(self, i: int, side: str, weights: Weights) -> F:
        """Every solution in the box has x_i at least ("lo") or at most ("hi") this, as aggregate <= 0 there."""
        sign = 1 if side == "lo" else -1
        u = Polynomial({unknown(i): sign}, 0, self.x.spend)
        return self.x.center(i) + sign * self.x.radius(i) * self._least(self.aggregate(weights) + u)

    def _least(self, p: Polynomial) -> F:
        self.x.spend(100 + 2 * p.size)
        return least(p, signed(len(self.x)))


def meeting(family: Iterable[frozenset[int]], most: int, spend: Spend) -> bool:
    """Whether some `most` numbers meet all sets: one of each set that is not met is tried after the other."""

    def met(left: list[frozenset[int]], budget: int) -> bool:
        if not left:
            return True
        if budget == 0:
            return False
        for k in min(left, key=len):
            spend(20 + len(left))
            if met([one for one in left if k not in one], budget - 1):
                return True
        return False

    return met(sorted(set(family), key=len), most)
