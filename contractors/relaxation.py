"""The lifted relaxation of a polynomial system on one box: linear rows in the columns of `monomials`.

All numbers of the rows are exact float64 numbers, their right sides large enough for what was rounded on the way: what
holds at every solution in the box is what the linear programs work on, and what their multipliers are proved with.
"""

import math
from collections import Counter
from functools import cached_property, lru_cache
from math import comb
from typing import Any, NamedTuple

import numpy as np

from cpcal.solver.compiled import compiled
from cpcal.solver.interval import Bools, Box, Floats, Indices, IntervalArray
from cpcal.solver.interval.kernels import Arrays
from cpcal.solver.network import PolynomialSystem
from cpcal.solver.network.polynomial import Monomial, Monomials

# ------------------------------------------------------------------------------------------------------------------
# Monomials on a box: columns of linear programs, and the bound products between them.
#
# On a box with midpoint c and radius r every variable is `x_i = c_i + r_i u_i` with u in [-1, 1]^n, and
# every monomial of u is one column in [-1, 1], or in [0, 1] when it is a square.

# Where the parabola of a square is touched from below; its ends and the column bound w >= 0 do the rest.
_TANGENTS = (-1.0, -0.5, 0.5, 1.0)
_ALL_FACTORINGS = 4  # degree up to which a column is tied to the others by each of its factorings


# (variable i, variable j, p, q) of the product (1 + p u_i)(1 + q u_j); (i, t) of the square (u_i - t)^2; None for
# products of more than two variables
Form = tuple[int, int, float, float] | tuple[int, float] | None


class ProductRows(NamedTuple):
    """Rows `matrix w <= rhs` that hold for the monomials w (without the constant) of every u in [-1, 1]^n.

    They are expanded products of two bounds that are not negative: exact small dyadic numbers.
    """

    matrix: Floats
    rhs: Floats
    forms: tuple[Form, ...]  # as `StepWeights` has them, without the weights


def _form(beta: Monomial, delta: Monomial, on_beta: float, on_delta: float, on_gamma: float) -> Form:
    if len(beta) + len(delta) > 2:
        return None
    if beta != delta:
        return beta[0], delta[0], -on_beta, -on_delta
    return (beta[0], beta[0], 1.0, -1.0) if on_gamma > 0.0 else (beta[0], 0.5 * on_beta)


@lru_cache(maxsize=16)
def column_bounds(monomials: Monomials) -> IntervalArray:
    """[-1, 1] for every monomial but the constant; [0, 1] for those with even exponents only."""
    even = np.array([_is_square(m) for m in monomials[1:]], bool)
    return IntervalArray(np.where(even, 0.0, -1.0), np.ones(len(even)))


def _is_square(monomial: Monomial) -> bool:
    return all(count % 2 == 0 for count in Counter(monomial).values())


@lru_cache(maxsize=16)
def product_rows(monomials: Monomials, used: bytes) -> ProductRows:
    """McCormick, secant and tangent rows of every used column of degree two or more, from all its factorings.

    `used`: a 1 for each column that is, as the bytes of an array.
    """
    column = {m: k - 1 for k, m in enumerate(monomials)}
    rows = []
    rhs = []
    forms = []
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
                forms.append(_form(beta, delta, on_beta, on_delta, on_gamma))
    return ProductRows(np.array(rows).reshape(len(rows), len(monomials) - 1), np.array(rhs), tuple(forms))


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


# ------------------------------------------------------------------------------------------------------------------
# Rows of polynomials in a box's own coordinates: exact float64 numbers, and what rounding leaves out as a widening.
#
# On a box with midpoint c and radius r every variable is `x_i = c_i + r_i u_i` with u in [-1, 1]^n, so that
# `x^alpha = sum_beta T[alpha, beta] u^beta`. Every `u^beta` lies in [-1, 1]: an error in its coefficient is an error of
# that size in the value, and one number for each row covers them all.

_UNIT = 2.0**-53
_UNDERFLOW = 1e-290  # more than all that products lose that are too small
_ETA = 5e-324  # the least number


class Shift:
    """The matrix T for a list of monomials closed under division, by its terms: products of centres and radii."""

    def __init__(self, monomials: Monomials, variables: int) -> None:
        column = {m: k for k, m in enumerate(monomials)}
        degree = max((len(m) for m in monomials), default=0)
        pairs = {}
        for alpha in monomials:
            for beta, ways in divisors(alpha):
                # positions in the vector (1, c_0 .. c_n-1, r_0 .. r_n-1)
                still = (Counter(alpha) - Counter(beta)).elements()
                factors = sorted(1 + i for i in still) + [1 + i + variables for i in beta]
                pairs[column[beta], column[alpha], tuple(factors) + (0,) * (degree - len(factors))] = ways
        terms = sorted(pairs.items())
        self.degree = degree
        self.beta, self.alpha = (np.array([key[k] for key, _ in terms], np.intp) for k in (0, 1))
        self._factors = np.array([key[2] for key, _ in terms], np.intp).reshape(len(terms), degree)
        self._count = np.array([count for _, count in terms], np.float64)
        self._least = _UNDERFLOW ** (1.0 / max(degree, 1))  # of factors whose product is no number too small

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


# `CentredRows` as kernels take them: machine code that is kept must not name a class of this package, which a module
# of the user's may hide.
Held = tuple[Any, ...]


class CentredRows(NamedTuple):
    """K rows of polynomials in the J readings and the monomials of a `Shift`, as `_split` leaves them.

    `matters` (M,): whether the coefficient of a monomial, at the centres of the readings, is not zero in some row.
    """

    mid: Floats  # (1 + J, M, K)
    errors: Floats  # (M, K)
    matters: Bools
    terms: Indices  # of the shift, those that count
    beta: Indices  # of these
    alpha: Indices
    gamma: float

    @classmethod
    def of(cls, shift: Shift, coefficients: IntervalArray) -> "CentredRows":
        """`coefficients` are (1 + J, K, M)."""
        gamma = 4.0 * (len(shift.beta) * coefficients.shape[0] + shift.degree + 8) * _UNIT
        # along the rows in memory, for the loops of `centred`
        lo = np.ascontiguousarray(coefficients.lo.transpose(0, 2, 1))
        hi = lo if coefficients.lo is coefficients.hi else np.ascontiguousarray(coefficients.hi.transpose(0, 2, 1))
        mid, errors, matters = _split(lo, hi, gamma)
        terms = np.flatnonzero(np.any(errors, axis=1)[shift.alpha])
        return cls(mid, errors, matters, terms, shift.beta[terms], shift.alpha[terms], gamma)


@compiled
def centred(held: Held, rounded: Floats) -> tuple[Floats, Floats]:
    """Of `held` rows, on a box with these terms of the shift: coefficients (M, K) of every u^beta, a widening (K,).

    For all readings in their sets the row's value at u lies within the widening of `coefficients.T @ u^beta`.

    `errors` (M, K): for each coefficient its own radius, and all roundings of its products, per unit of a term.
    A sum of p products errs by at most p u / (1 - p u) times the sum of their sizes; gamma is four times p u for all p
    that occur, which covers the roundings of the widening, too.
    """
    mid, errors, _, terms, beta, alpha, gamma = held
    slots, size, count = mid.shape
    term = np.empty(beta.size)
    rows = np.zeros((size, count))
    widening = np.full(count, _UNDERFLOW)
    extent = np.zeros(size)
    for t in range(term.size):
        term[t] = rounded[terms[t]]
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
def _up(value: float, count: int) -> float:
    """An upper bound of a sum of so many numbers >= 0, computed in any order."""
    return value * (1.0 + (count + 8) * 2.0 * _UNIT) + _SMALLEST


@compiled
def _widened(widening: Floats, guards: Floats, error: Floats, guarded: Bools) -> None:
    """The widening of guarded rows with the square of what their guards (M, G) may fall short by: see `Row`."""
    row = 0
    for k in range(guarded.size):
        if guarded[k]:
            beside = error[row]
            for m in range(1, len(guards)):
                beside += abs(guards[m, row])
            lowest = np.nextafter(guards[0, row] - _up(beside, len(guards)), -np.inf)
            short = min(lowest, 0.0) if np.isfinite(lowest) else -np.inf  # what overflowed on its way may be anything
            widening[k] += _up(short * short, 1)
            row += 1


@compiled
def _split(lo: Floats, hi: Floats, gamma: float) -> tuple[Floats, Floats, Bools]:
    """Midpoints (slots, M, K); errors (M, K) as `centred` takes them, of all slots; which monomials matter."""
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


# ------------------------------------------------------------------------------------------------------------------
# From the rows of a relaxation to the matrix of a linear program: scaled, without what cannot matter on the box.

_SMALLEST = 1e-290  # coefficients below it are left out


@compiled
def scaled(rows: Floats, rhs: Floats) -> tuple[Indices, Floats]:
    """Divide rows (M, K) and right sides by powers of two, to a largest coefficient of about 1; the exponents.

    And the largest coefficient of each monomial. Nothing is rounded: coefficients that become too small for that are
    left out, and right sides pay for them.
    """
    size, count = rows.shape
    largest, paid, exponents = np.zeros(count), np.zeros(count), np.zeros(count, np.intp)
    highest = np.zeros(size)
    for m in range(size):
        for k in range(count):
            largest[k] = max(largest[k], abs(rows[m, k]))
    for k in range(count):
        exponent = min(max(math.frexp(largest[k])[1], -900), 900) if np.isfinite(largest[k]) else 0
        exponents[k], largest[k] = exponent, math.ldexp(1.0, -exponent)
    for m in range(size):
        for k in range(count):
            value = rows[m, k] * largest[k]
            small = abs(value) < _SMALLEST
            paid[k] += _SMALLEST if small and rows[m, k] != 0.0 else 0.0
            rows[m, k] = 0.0 if small else value
            highest[m] = max(highest[m], abs(value))
    for k in range(count):
        side = rhs[k] * largest[k]
        if paid[k] > 0.0 or abs(side) < _SMALLEST:
            side += paid[k]
            side += 4.0 * _UNIT * abs(side) + _SMALLEST
        rhs[k] = side
    return exponents, highest


@compiled
def reach(rows: Floats, rhs: Floats, has_column: Bools, lower: Floats, upper: Floats) -> Bools:
    """Which rows some point of the box may violate; right sides pay for the monomials without a column.

    Rows that overflowed say nothing.
    """
    size, count = rows.shape
    highest, beside = np.zeros(count), np.zeros(count)
    for m in range(size):
        for k in range(count):
            value = rows[m, k]
            if has_column[m]:
                highest[k] += max(value * lower[m], value * upper[m])
            else:
                beside[k] += abs(value)
    up = 1.0 + 4.0 * (size + 4) * _UNIT
    matters = np.zeros(count, np.bool_)
    for k in range(count):
        if beside[k] != 0.0:  # NaN goes to the right side, which then says nothing
            more = beside[k] * up
            rhs[k] += more + 4.0 * _UNIT * (abs(rhs[k]) + more)
        matters[k] = np.isfinite(highest[k]) and np.isfinite(rhs[k]) and highest[k] > rhs[k]
    return matters


@compiled
def programmed(
    rounded: Floats,
    own: Held,
    guards: Held,
    guarded: Bools,
    products: Floats,
    beside: Floats,
    dividing: Bools,
    linear: Bools,
    box: Arrays,
) -> tuple[Indices, Indices, Indices, Indices, Floats, Floats]:
    """The linear program of rows, with `guards` of some, on a box with these terms of the shift, and of products (P, M)
    with their right sides `beside`, in the `box` of all columns.

    It gives the columns, those that divide (a row of `dividing` each) a monomial with a coefficient or a linear one;
    the products that lie in them; the rows that some point may violate; the exponents of these; and an array (columns,
    products + rows) with its right sides.
    """
    whole, rhs = centred(own, rounded)
    if guarded.any():
        values, error = centred(guards, rounded)
        _widened(rhs, values, error, guarded)
    for k in range(rhs.size):
        constant = whole[0, k]
        rhs[k] = rhs[k] - constant + 4.0 * _UNIT * (abs(rhs[k]) + abs(constant))
    rows = whole[1:]
    exponents, highest = scaled(rows, rhs)
    has_column = np.zeros(highest.size, np.bool_)
    for m in range(highest.size):
        if linear[m] or highest[m] > 0.0:
            for divisor in range(highest.size):
                has_column[divisor] |= dividing[m, divisor]
    matters = reach(rows, rhs, has_column, box[0], box[1])
    inside = np.ones(len(products), np.bool_)
    for k in range(len(products)):
        for m in range(highest.size):
            if products[k, m] != 0.0 and not has_column[m]:
                inside[k] = False
    columns, chosen, kept = np.flatnonzero(has_column), np.flatnonzero(inside), np.flatnonzero(matters)
    matrix = np.concatenate((products[chosen][:, columns].T, rows[columns][:, kept]), axis=1)
    return columns, chosen, kept, exponents[kept], matrix, np.concatenate((beside[chosen], rhs[kept]))


_COLUMNS = 150  # beyond, linear programs take too long at each node


class Structure:
    """What the relaxations of one system on all boxes have in common. `used`: the monomials that get a column."""

    def __init__(self, system: PolynomialSystem) -> None:
        self.system = system
        self.shift = _shift(system.monomials, len(system.names))
        rows = CentredRows.of(self.shift, system.coefficients)
        guards = CentredRows.of(self.shift, system.guards[:, system.guarded]) if system.guarded.any() else rows
        # A monomial whose coefficients all contain zero is bounded, not given a column.
        divisors = _divisors(system.monomials)
        self.used = used = _paying(divisors, rows.matters[1:], system.monomials[1:])
        linear = np.array([len(m) < 2 for m in system.monomials[1:]], np.bool_)
        self.bounds = column_bounds(system.monomials)
        self.products = product_rows(system.monomials, used.tobytes())
        products, bounds = self.products, self.bounds
        held = tuple(rows), tuple(guards), system.guarded
        self.given = (*held, products.matrix, products.rhs, divisors & used[:, None], linear, (bounds.lo, bounds.hi))
        self.positions = {m[0]: k - 1 for k, m in enumerate(system.monomials) if len(m) == 1 and used[k - 1]}

    @cached_property
    def origins(self) -> list[tuple[int, int]]:
        """Constraint and element of every row."""
        return [(constraint, element) for constraint, element in self.system.origin.tolist()]


def _paying(divisors: Bools, monomials: Bools, degrees: Monomials) -> Bools:
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


# What follows depends on the monomials alone, which the boxes of one system share.


_shift = lru_cache(maxsize=16)(Shift)


@lru_cache(maxsize=16)
def _divisors(monomials: Monomials) -> Bools:
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
    `kept` of the system, times 2^-exponent, but for those that no point of the box violates.
    """

    def __init__(self, structure: Structure, box: Box) -> None:
        self.center: list[float] = box.mid.tolist()
        self.radius: list[float] = box.rad.tolist()
        found = programmed(structure.shift.rounded(box.mid, box.rad), *structure.given)
        self.columns, self.products, self.kept, self.exponents, matrix, self.rhs = found
        self.matrix, self.bounds = matrix.T, structure.bounds[self.columns]
