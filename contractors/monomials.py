"""Monomials on a box: the change to the box's own coordinates, and the bound products between columns.

On a box with midpoint c and radius r every variable is `x_i = c_i + r_i u_i` with u in [-1, 1]^n, and
every monomial of u is one column in [-1, 1], or in [0, 1] when it is a square.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.polynomial import Monomial

# Where the parabola of a square is touched from below; its ends and the column bound w >= 0 do the rest.
_TANGENTS = (-1.0, -0.5, 0.5, 1.0)


class Shift:
    """The matrix T of `x^alpha = sum_beta T[alpha, beta] u^beta`, for a list of monomials closed under division."""

    def __init__(self, monomials: tuple[Monomial, ...], variables: int) -> None:
        column = {m: k for k, m in enumerate(monomials)}
        degree = max((len(m) for m in monomials), default=0)
        pairs: Counter[tuple[int, int, tuple[int, ...]]] = Counter()
        for alpha in monomials:
            for chosen in product((False, True), repeat=len(alpha)):
                beta = tuple(i for i, moves in zip(alpha, chosen, strict=True) if moves)
                # positions in the vector (1, c_0 .. c_n-1, r_0 .. r_n-1)
                factors = sorted(1 + i + variables * moves for i, moves in zip(alpha, chosen, strict=True))
                padded = tuple(factors) + (0,) * (degree - len(factors))
                pairs[column[alpha], column[beta], padded] += 1
        self._size = len(monomials)
        self._row = np.array([p[0] for p in pairs], dtype=np.intp)
        self._column = np.array([p[1] for p in pairs], dtype=np.intp)
        self._factors = np.array([p[2] for p in pairs], dtype=np.intp).reshape(len(pairs), degree)
        self._count = np.array(list(pairs.values()), dtype=np.float64)

    def matrix(self, engine: Arithmetic, center: Floats, radius: Floats) -> IntervalArray:
        """T for exact float64 `center` and `radius`, shape (M, M)."""
        vector = np.concatenate([[1.0], center, radius])
        value = IntervalArray.point(self._count)
        for k in range(self._factors.shape[1]):
            value = engine.mul(value, IntervalArray.point(vector[self._factors[:, k]]))
        lo = np.zeros((self._size, self._size))
        hi = np.zeros_like(lo)
        lo[self._row, self._column], hi[self._row, self._column] = value.lo, value.hi
        return IntervalArray(lo, hi)


@dataclass(frozen=True)
class ProductRows:
    """Rows `matrix w <= rhs` that hold for the monomials w (without the constant) of every u in [-1, 1]^n.

    They are expanded products of two bounds that are not negative: exact small dyadic numbers.
    """

    matrix: Floats
    rhs: Floats
    factors: tuple[
        tuple[Monomial, Monomial, float, float, float], ...
    ]  # and the coefficients of both and their product


def column_bounds(monomials: tuple[Monomial, ...]) -> IntervalArray:
    """[-1, 1] for every monomial but the constant; [0, 1] for those with even exponents only."""
    even = np.array([_is_square(m) for m in monomials[1:]], dtype=bool)
    return IntervalArray(np.where(even, 0.0, -1.0), np.ones(len(even)))


def _is_square(monomial: Monomial) -> bool:
    return all(count % 2 == 0 for count in Counter(monomial).values())


def product_rows(monomials: tuple[Monomial, ...], used: npt.NDArray[np.bool_]) -> ProductRows:
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
    return ProductRows(np.array(rows).reshape(len(rows), len(monomials) - 1), np.array(rhs), tuple(factors))


def _factorings(gamma: Monomial) -> list[tuple[Monomial, Monomial]]:
    found = set()
    for chosen in product((False, True), repeat=len(gamma)):
        beta = tuple(i for i, take in zip(gamma, chosen, strict=True) if take)
        delta = tuple(i for i, take in zip(gamma, chosen, strict=True) if not take)
        if beta and delta and beta <= delta:
            found.add((beta, delta))
    return sorted(found)


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
