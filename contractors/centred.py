"""Rows of polynomials in a box's own coordinates: exact float64 numbers, and what rounding leaves out as a widening.

On a box with midpoint c and radius r every variable is `x_i = c_i + r_i u_i` with u in [-1, 1]^n, so that
`x^alpha = sum_beta T[alpha, beta] u^beta`. Every `u^beta` lies in [-1, 1]: an error in its coefficient is an error of
that size in the value, and one number for each row covers them all.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from contractors.monomials import divisors
from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.compiled import compiled
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.term_operations import Monomial

_UNIT = 2.0**-53
_UNDERFLOW = 1e-290  # more than all that products lose that are too small
_ETA = 5e-324  # the least number


class Shift:
    """The matrix T for a list of monomials closed under division, by its terms: products of centres and radii."""

    def __init__(self, monomials: tuple[Monomial, ...], variables: int) -> None:
        column = {m: k for k, m in enumerate(monomials)}
        degree = max((len(m) for m in monomials), default=0)
        pairs: dict[tuple[int, int, tuple[int, ...]], int] = {}
        for alpha in monomials:
            for beta, ways in divisors(alpha):
                # positions in the vector (1, c_0 .. c_n-1, r_0 .. r_n-1)
                still = (Counter(alpha) - Counter(beta)).elements()
                factors = sorted(1 + i for i in still) + [1 + i + variables for i in beta]
                pairs[column[beta], column[alpha], tuple(factors) + (0,) * (degree - len(factors))] = ways
        terms = sorted(pairs.items())
        self.size = len(monomials)
        self.beta = np.array([key[0] for key, _ in terms], dtype=np.intp)
        self.alpha = np.array([key[1] for key, _ in terms], dtype=np.intp)
        self._factors = np.array([key[2] for key, _ in terms], dtype=np.intp).reshape(len(terms), degree)
        self._count = np.array([count for _, count in terms], dtype=np.float64)
        self._least = _UNDERFLOW ** (1.0 / max(degree, 1))  # of factors whose product is no number too small

    def values(self, engine: Arithmetic, center: Floats, radius: Floats) -> IntervalArray:
        """Every term, for exact float64 `center` and `radius`."""
        vector = np.concatenate([[1.0], center, radius])
        value = IntervalArray.point(self._count)
        for k in range(self._factors.shape[1]):
            value = engine.mul(value, IntervalArray.point(vector[self._factors[:, k]]))
        return value

    def matrix(self, engine: Arithmetic, center: Floats, radius: Floats) -> IntervalArray:
        """T, shape (M, M)."""
        value = self.values(engine, center, radius)
        lo, hi = np.zeros((2, self.size, self.size))
        lo[self.alpha, self.beta], hi[self.alpha, self.beta] = value.lo, value.hi
        return IntervalArray(lo, hi)

    @property
    def degree(self) -> int:
        return self._factors.shape[1]

    def rounded(self, center: Floats, radius: Floats) -> Floats:
        """Every term, each wrong by at most `degree` roundings."""
        vector = np.concatenate([[1.0], center, radius])
        sizes = [abs(v) for v in vector.tolist() if v]
        if self._least < min(sizes) and max(sizes) < 1.0 / self._least:
            return np.asarray(self._count * vector[self._factors].prod(axis=1))
        mantissa, exponent = np.frexp(vector)  # a product in the middle may be too small, or too large
        product = self._count * mantissa[self._factors].prod(axis=1)
        with np.errstate(all="ignore"):
            return np.asarray(np.ldexp(product, exponent[self._factors].sum(axis=1)))


class CentredRows:
    """K rows of polynomials `coefficients` (1 + J, K, M), in the J readings and the monomials of a `Shift`.

    `matters` (M,): whether the coefficient of a monomial, at the centres of the readings, is not zero in some row.
    """

    def __init__(self, shift: Shift, coefficients: IntervalArray) -> None:
        self._shift, self._coefficients = shift, coefficients
        self._gamma = 4.0 * (len(shift.beta) * coefficients.shape[0] + shift.degree + 8) * _UNIT
        # along the rows in memory, for the loops of `_centred`
        lo = np.ascontiguousarray(coefficients.lo.transpose(0, 2, 1))
        hi = lo if coefficients.lo is coefficients.hi else np.ascontiguousarray(coefficients.hi.transpose(0, 2, 1))
        self._mid, self._errors, self.matters = _split(lo, hi, self._gamma)
        occurs = np.asarray(self._errors.any(axis=1))
        self._terms = np.flatnonzero(occurs[shift.alpha])

    def on(self, engine: Arithmetic, center: Floats, radius: Floats) -> tuple[Floats, Floats]:
        """On a box: coefficients (M, K) of every u^beta, and a widening (K,): for all readings in their sets

        the row's value at u lies within the widening of `coefficients.T @ u^beta`.
        """
        if engine.name == "float64":
            shift, terms = self._shift, self._terms
            term = shift.rounded(center, radius)[terms]
            return _centred(self._mid, self._errors, shift.beta[terms], shift.alpha[terms], term, self._gamma)
        slots, count, size = self._coefficients.shape
        flat = self._coefficients.reshape((slots * count, size))
        found = engine.dot(flat, self._shift.matrix(engine, center, radius)).reshape((slots, count, size))
        spread = found[0].rad.sum(axis=1) + found[1:].mag.sum(axis=(0, 2))
        return np.ascontiguousarray(found[0].mid.T), spread * (1.0 + 4.0 * (slots * size + 8) * _UNIT)


@compiled
def _centred(
    mid: Floats, errors: Floats, beta: Indices, alpha: Indices, term: Floats, gamma: float
) -> tuple[Floats, Floats]:
    """`errors` (M, K): for each coefficient its own radius, and all roundings of its products, per unit of a term.

    A sum of p products errs by at most p u / (1 - p u) times the sum of their sizes; gamma is four times p u for all p
    that occur, which covers the roundings of the widening, too.
    """
    slots, size, count = mid.shape
    rows = np.zeros((size, count))
    widening = np.full(count, _UNDERFLOW)
    extent = np.zeros(size)
    for t in range(term.size):
        extent[alpha[t]] += abs(term[t]) + _UNDERFLOW
    for m in range(size):
        if extent[m] > 0.0:
            for k in range(count):
                widening[k] += errors[m, k] * extent[m]
    for t in range(term.size):
        out, source, factor = rows[beta[t]], mid[0, alpha[t]], term[t]
        for k in range(count):
            out[k] += factor * source[k]
    slope = np.zeros(count)
    for j in range(1, slots):
        for t in range(term.size):
            source, factor = mid[j, alpha[t]], term[t]
            for k in range(count):
                slope[k] += factor * source[k]
            if t + 1 == term.size or beta[t + 1] != beta[t]:
                for k in range(count):
                    widening[k] += abs(slope[k])
                    slope[k] = 0.0
    for k in range(count):
        widening[k] *= 1.0 + gamma
    return rows, widening


@compiled
def _split(lo: Floats, hi: Floats, gamma: float) -> tuple[Floats, Floats, Bools]:
    """Midpoints (slots, M, K); errors (M, K) as `_centred` takes them, of all slots; which monomials matter."""
    slots, size, count = lo.shape
    mid, errors = np.empty((slots, size, count)), np.zeros((size, count))
    matters = np.zeros(size, np.bool_)
    up = 1.0 + 4.0 * (slots + 4) * _UNIT
    for j in range(slots):
        for m in range(size):
            for k in range(count):
                middle = 0.5 * lo[j, m, k] + 0.5 * hi[j, m, k]
                radius = max(hi[j, m, k] - middle, middle - lo[j, m, k]) * up
                mid[j, m, k] = middle
                least = _ETA if middle != 0.0 else 0.0  # where the product with gamma is too small
                errors[m, k] += (gamma * abs(middle) + radius) * up + least
                if j == 0 and abs(middle) > radius:
                    matters[m] = True
    return mid, errors, matters
