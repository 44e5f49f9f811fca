"""Monomials on a box: columns of linear programs, and the bound products between them.

On a box with midpoint c and radius r every variable is `x_i = c_i + r_i u_i` with u in [-1, 1]^n, and
every monomial of u is one column in [-1, 1], or in [0, 1] when it is a square.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.solver.interval import IntervalArray
from cpcal.solver.network.term_operations import Monomial

# Where the parabola of a square is touched from below; its ends and the column bound w >= 0 do the rest.
_TANGENTS = (-1.0, -0.5, 0.5, 1.0)
_ALL_FACTORINGS = 4  # degree up to which a column is tied to the others by each of its factorings


# (variable i, variable j, p, q) of the product (1 + p u_i)(1 + q u_j); (i, t) of the square (u_i - t)^2; None for
# products of more than two variables
Form = tuple[int, int, float, float] | tuple[int, float] | None


@dataclass(frozen=True)
class ProductRows:
    """Rows `matrix w <= rhs` that hold for the monomials w (without the constant) of every u in [-1, 1]^n.

    They are expanded products of two bounds that are not negative: exact small dyadic numbers.
    """

    matrix: Floats
    rhs: Floats
    # and the coefficients of both and their product
    factors: tuple[tuple[Monomial, Monomial, float, float, float], ...]

    @cached_property
    def forms(self) -> list[Form]:
        """As `StepWeights` has them, without the weights."""
        return [_form(*factor) for factor in self.factors]


def _form(beta: Monomial, delta: Monomial, on_beta: float, on_delta: float, on_gamma: float) -> Form:
    if len(beta) + len(delta) > 2:
        return None
    if beta != delta:
        return beta[0], delta[0], -on_beta, -on_delta
    return (beta[0], beta[0], 1.0, -1.0) if on_gamma > 0.0 else (beta[0], 0.5 * on_beta)


def column_bounds(monomials: tuple[Monomial, ...]) -> IntervalArray:
    """[-1, 1] for every monomial but the constant; [0, 1] for those with even exponents only."""
    even = np.array([_is_square(m) for m in monomials[1:]], dtype=bool)
    return IntervalArray(np.where(even, 0.0, -1.0), np.ones(len(even)))


def _is_square(monomial: Monomial) -> bool:
    return all(count % 2 == 0 for count in Counter(monomial).values())


def product_rows(monomials: tuple[Monomial, ...], used: Bools) -> ProductRows:
    """McCormick, secant and tangent rows of every used column of degree two or more, from all its factorings."""
    column = {m: k - 1 for k, m in enumerate(monomials)}
    rows: list[Floats] = []
    rhs: list[float] = []
    factors: list[tuple[Monomial, Monomial, float, float, float]] = []
    for gamma in monomials[1:]:
        if len(gamma) < 2 or not used[column[gamma]]:
            continue
        for beta, delta in _factorings(gamma):
            for on_beta, on_delta, on_gamma, bound in _bound_products(beta, delta):
                row = np.zeros(len(monomials) - 1)
                row[column[gamma]] = on_gamma
                row[column[beta]] += on_beta
                row[column[delta]] += on_delta
                rows.append(row)
                rhs.append(bound)
                factors.append((beta, delta, on_beta, on_delta, on_gamma))
    matrix = np.array(rows).reshape(len(rows), len(monomials) - 1)
    return ProductRows(matrix, np.array(rhs), tuple(factors))


def _factorings(gamma: Monomial) -> list[tuple[Monomial, Monomial]]:
    """Both ways round are one. Beyond degree 4 one factor is a single variable: the others pay little."""
    found = set()
    for beta, _ in divisors(gamma):
        delta = tuple((Counter(gamma) - Counter(beta)).elements())
        if beta and delta and beta <= delta and (len(gamma) <= _ALL_FACTORINGS or 1 in (len(beta), len(delta))):
            found.add((beta, delta))
    return sorted(found)


def divisors(monomial: Monomial) -> list[tuple[Monomial, int]]:
    """All of them, 1 and itself included, and in how many ways the factors of each can be chosen."""
    powers = sorted(Counter(monomial).items())
    out: list[tuple[Monomial, int]] = [((), 1)]
    for variable, power in powers:
        out = [(m + (variable,) * k, ways * comb(power, k)) for m, ways in out for k in range(power + 1)]
    return out


def _bound_products(beta: Monomial, delta: Monomial) -> list[tuple[float, float, float, float]]:
    """Products of two bounds as `(coefficient of beta, of delta, of their product, right side)`, row <= side."""
    lo_b, lo_d = (0.0 if _is_square(m) else -1.0 for m in (beta, delta))
    if beta == delta:
        secant = (-(1.0 + lo_b), 0.0, 1.0, -lo_b)  # (w - lo)(1 - w) >= 0
        return [secant] + [(2.0 * t, 0.0, -1.0, t * t) for t in _TANGENTS]  # (w - t)^2 >= 0
    return [
        (lo_d, lo_b, -1.0, lo_b * lo_d),  # (b - lo)(d - lo) >= 0
        (1.0, 1.0, -1.0, 1.0),  # (1 - b)(1 - d) >= 0
        (-lo_d, -1.0, 1.0, -lo_d),  # (1 - b)(d - lo) >= 0
        (-1.0, -lo_b, 1.0, -lo_b),  # (b - lo)(1 - d) >= 0
    ]
