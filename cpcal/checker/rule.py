"""The one rule: nonnegative weights that exclude a box or bound an unknown. Standard library only; part of the checker.

See docs/certificate-format.md, "The rule".
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction as F
from typing import Protocol

from cpcal.checker.polynomial import ZERO, ExactBox, Polynomial, least, shifted


class Problem(Protocol):
    """What a certificate speaks of: `count` measurements (or constraints) in some unknowns."""

    @property
    def unknowns(self) -> tuple[str, ...]: ...
    @property
    def objective(self) -> int | None: ...
    @property
    def count(self) -> int: ...
    @property
    def sides(self) -> tuple[str, ...]: ...
    @property
    def chosen(self) -> tuple[int, ...]:
        """The measurements that count, ascending."""
        ...

    def row(self, side: str, k: int, box: ExactBox) -> Polynomial:
        """At most zero at every solution in the box."""
        ...

    def holds(self, k: int, point: tuple[F, ...]) -> bool:
        """Whether it is proved that the point satisfies measurement k (for some reading)."""
        ...

    def fails(self, k: int, point: tuple[F, ...]) -> bool:
        """Whether it is proved that it does not (for any reading)."""
        ...


@dataclass(frozen=True)
class Weights:
    """Multipliers of rows (side, measurement), of products (1 + p u_i)(1 + q u_j) and of squares (u_i - t)^2.

    Each is a whole number, the last of its entry, times 2 to the power that `exponents` gives for its kind.
    """

    rows: tuple[tuple[str, int, int], ...]
    products: tuple[tuple[int, int, int, int, int], ...]
    tangents: tuple[tuple[int, F, int], ...]
    exponents: tuple[int, int, int]


class Rule:
    """Applies weights on one box; each row is formed once."""

    def __init__(self, problem: Problem, box: ExactBox) -> None:
        self._problem, self.box = problem, box
        self._rows: dict[tuple[str, int], Polynomial] = {}

    def row(self, side: str, k: int) -> Polynomial:
        """In u."""
        if (side, k) not in self._rows:
            self._rows[side, k] = shifted(self._problem.row(side, k, self.box), self.box)
        return self._rows[side, k]

    def aggregate(self, weights: Weights) -> tuple[Polynomial, int]:
        """A whole multiple of the sum of weighted rows, less weighted products; and the factor.

        At every solution in the box it is at most zero.
        """
        lowest = min(0, *weights.exponents)
        of_rows, of_products, of_tangents = (1 << (e - lowest) for e in weights.exponents)
        p: Polynomial = {(): ZERO}

        def put(key: tuple[int, ...], value: F | int) -> None:
            p[key] = p.get(key, ZERO) + value

        for side, k, weight in weights.rows:
            for monomial, c in self.row(side, k).items():
                put(monomial, weight * of_rows * c)
        for i, j, a, b, weight in weights.products:
            w = weight * of_products
            put((), -w)
            put((i,), -a * w)
            put((j,), -b * w)
            put((min(i, j), max(i, j)), -a * b * w)
        for i, t, weight in weights.tangents:
            w = weight * of_tangents
            put((), -w * t * t)
            put((i,), 2 * w * t)
            put((i, i), -w)
        return p, 1 << -lowest

    def excludes(self, weights: Weights) -> bool:
        """Whether no solution lies in the box: the aggregate is positive on it."""
        return least(self.aggregate(weights)[0]) > 0

    def bound(self, unknown: int, side: str, weights: Weights) -> F:
        """Every solution in the box has x_i at least ("lo") or at most this."""
        sign = 1 if side == "lo" else -1
        p, factor = self.aggregate(weights)
        p[(unknown,)] = p.get((unknown,), ZERO) + sign * factor
        # factor sign u + aggregate <= factor sign u at a solution
        return self.box.center[unknown] + sign * self.box.radius[unknown] * least(p) / factor
