"""Rows of a leg in float64: the checker's own formula, with a bound of all that is rounded on the way.

The checker traces the formula once (`cpcal.checker.leg`); its notes, `v[k] += v[i] * v[j]`, are swept here in float64,
each v with a bound of its error. With unit roundoff u the product of two such numbers is wrong by at most
|v_i| e_j + |v_j| e_i + e_i e_j + u |v_i v_j|, the sum by u of its size more. What is rounded in the bound itself is
covered by a factor.
"""

import math
from collections.abc import Sequence
from fractions import Fraction as F
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cpcal.checker.leg import LegConstraint, leg_formula
from cpcal.checker.polynomial import FIELD, READINGS, Polynomial, rotation_rows, signed, unknown
from cpcal.checker.rule import ENDS, Box, Problem, Row, Rule, Unknowns
from cpcal.common.values import ArrayPair, Bools, Floats, Indices, Places, crossed
from cpcal.solver.certificate.exact_network import free
from cpcal.solver.compiled import compiled

_UNIT = 2.0**-53
_MORE = 1.0 + 2.0**-20  # covers the roundings of error bounds, of which there are some thousands at most
_SMALLEST = 1e-280  # more than all that numbers lose that are too small


class FloatRow(NamedTuple):
    """Coefficients of monomials in u, the constant first, and a bound of the sum of their errors."""

    monomials: Places
    values: Floats
    error: float


def float_rows(legs: Sequence[LegConstraint], side: str) -> list[FloatRow]:
    """`Problem.row`, nearly, of constraints that have one formula; of `sure` sides, whose rows are all that it says."""
    plan = _plan(legs[0].model, legs[0].m.uncertain, side)
    ends = np.array([[leg.m.uncertain and sign != "0" for sign in leg.signs or "0" * READINGS] for leg in legs])
    found, errors = _settled(*plan.swept(legs), plan.first, plan.odd, plan.alone, plan.kept, ends)
    return [FloatRow(plan.monomials, *row) for row in zip(found, errors.tolist(), strict=True)]


def best_signs(legs: Sequence[LegConstraint], side: str) -> list[str]:
    """The reference readings that cost least, by the range over the box of the derivative by each reading: `legs` are
    at the centres of the sets, and have one formula.

    At an end a reading costs what the row may fall from there, at the centre half of it.
    """
    plan = _plan(legs[0].model, legs[0].m.uncertain, side)
    chosen = np.flatnonzero(plan.linear >= 0)
    values, alone = plan.swept(legs)[0].T[chosen], plan.alone[chosen, None]
    low, high = np.zeros((2, READINGS, len(legs)))
    np.add.at(low, plan.linear[chosen], np.where(alone, values, -np.abs(values)))
    np.add.at(high, plan.linear[chosen], np.where(alone, values, np.abs(values)))
    costs = np.maximum(-low, high), 2.0 * np.maximum(-low, 0.0), 2.0 * np.maximum(high, 0.0)
    return ["".join(["0-+"[k] for k in row]) for row in np.argmin(costs, axis=0).T.tolist()]


class _Plan(NamedTuple):
    """A trace and its output as arrays. Of each coefficient (T,): its place, the first reading in its monomial (-1:
    none), the odd exponents as bits, whether its monomial is that reading `alone`, the one reading that it is `linear`
    in (-1: none), its number among `monomials` (-1: it has a reading)."""

    notes: Indices
    places: Indices
    fixed: Indices
    numbers: Floats
    size: int
    monomials: Places
    first: Indices
    odd: Indices
    alone: Bools
    linear: Indices
    kept: Indices

    def swept(self, legs: Sequence[LegConstraint]) -> ArrayPair:
        """The coefficients (B, T) of constraints on one box, and their errors. The trace takes (B, G): one,
        measurements, unknowns, and where readings begin and how far they go."""
        x, uncertain = legs[0].x.numbers, legs[0].m.uncertain
        m = np.array([leg.m.given for leg in legs], np.float64)
        widths = np.array([leg.m.radii for leg in legs], np.float64)
        floats = np.broadcast_to([value / (1 << x.power) for value in x.values], (len(legs), len(x.values)))
        parts = [np.ones((len(legs), 1)), m, m[:, 7:] - widths[:, 6:], floats]
        if uncertain:
            widths[:, 3:6] *= 0.5
            ends = np.array([[ENDS[sign] for sign in leg.signs] for leg in legs])
            parts += [ends[:, :, 0] * widths, ends[:, :, 1] * widths]
        return _swept(self.notes, np.concatenate(parts, axis=1), self.fixed, self.numbers, self.size, self.places)


@lru_cache(maxsize=64)
def _plan(model: str, reads: bool, side: str) -> _Plan:
    trace, ((places, _),) = leg_formula(model, reads, (side,))
    fixed, sums = {0: 1}, list[tuple[int, int, int]]()
    for k, note in enumerate(trace.notes, start=trace.count):
        if isinstance(note, int):
            fixed[k] = note
        else:
            sums += ((k, i, j) for i, j in note)
    of_readings = (1 << FIELD * READINGS) - 1
    kept = [0, *(m for m in places if m and not m & of_readings)]
    number = {m: k for k, m in enumerate(kept)}
    powers = [_exponents(m) for m in places]
    readings = [_exponents(m & of_readings) for m in places]
    return _Plan(
        notes=np.array(sums, np.intp).reshape(-1, 3),
        places=np.array(list(places.values()), np.intp),
        fixed=np.array(list(fixed), np.intp),
        numbers=np.array(list(fixed.values()), np.float64),
        size=trace.count + len(trace.notes),
        monomials=tuple(kept),
        first=np.array([found[0][0] if found else -1 for found in readings], np.intp),
        odd=np.array([sum(1 << f for f, power in found if power % 2) for found in powers], np.intp),
        alone=np.array([[power for _, power in found] == [1] for found in powers], np.bool_),
        linear=np.array([f[0][0] if [power for _, power in f] == [1] else -1 for f in readings], np.intp),
        kept=np.array([number.get(m, -1) for m in places], np.intp),
    )


def _exponents(monomial: int) -> list[tuple[int, int]]:
    """The fields of a monomial that are not zero, and their exponents."""
    fields = range(monomial.bit_length() // FIELD + 1)
    powers = ((field, monomial >> FIELD * field & (1 << FIELD) - 1) for field in fields)
    return [(field, power) for field, power in powers if power]


@compiled
def _swept(notes: Indices, given: Floats, fixed: Indices, numbers: Floats, size: int, places: Indices) -> ArrayPair:
    """The numbers at `places` of a trace for each of (B, G) given, which were rounded once; and their errors."""
    found, errors = np.empty((len(given), places.size)), np.empty((len(given), places.size))
    for leg in range(len(given)):
        v, e = np.zeros(size), np.zeros(size)
        for k in range(given.shape[1]):
            v[k], e[k] = given[leg, k], _UNIT * abs(given[leg, k]) + _SMALLEST
        for k in range(fixed.size):
            v[fixed[k]], e[fixed[k]] = numbers[k], 0.0
        for n in range(notes.shape[0]):
            k, i, j = notes[n, 0], notes[n, 1], notes[n, 2]
            a, b = v[i], v[j]
            product = a * b
            v[k] += product
            more = abs(a) * e[j] + abs(b) * e[i] + e[i] * e[j] + _UNIT * (abs(product) + abs(v[k])) + _SMALLEST
            e[k] += more * _MORE
        for t in range(places.size):
            found[leg, t], errors[leg, t] = v[places[t]], e[places[t]]
    return found, errors


@compiled
def _settled(
    values: Floats, errors: Floats, first: Indices, odd: Indices, alone: Bools, kept: Indices, ends: Bools
) -> ArrayPair:
    """What is left of (B, T) coefficients at the readings' reference, less the penalties, and the error of all of it.

    `ends` (B, 7): the readings that begin at an end.
    """
    out, total = np.zeros((len(values), max(kept.max() + 1, 1))), np.zeros(len(values))
    for leg in range(len(values)):
        found = out[leg]
        centered = (1 << 62) - 1  # bits of the variables that may be negative
        for j in range(ends.shape[1]):
            if ends[leg, j]:
                centered -= 1 << j
        lowest = np.zeros(ends.shape[1])
        error, size = 0.0, 0.0
        for t in range(values.shape[1]):
            value = values[leg, t]
            error += errors[leg, t]
            if kept[t] >= 0:
                found[kept[t]] += value
                continue
            j = first[t]
            size += abs(value)
            bits = odd[t] ^ (1 << j) if ends[leg, j] else odd[t]
            if bits & centered != 0:
                lowest[j] -= abs(value)
            elif value < 0.0 or (ends[leg, j] and alone[t]):
                lowest[j] += value
        for j in range(ends.shape[1]):
            if lowest[j] < 0.0:
                found[0] += lowest[j]
        error += 2.0 * _UNIT * (values.shape[1] + 16) * (size + abs(found[0]))
        total[leg] = error * _MORE
    return out, total


# ------------------------------------------------------------------------------------------------------------------
# The checker's rule in float64, with every rounding counted: it never says more than the rule itself.
#
# Rows come with a bound of their errors; weights are whole numbers of at most 53 bits times a power of two, so exact.
# With unit roundoff u, a sum of p products errs by at most p u / (1 - p u) times the sum of their sizes; the factor
# taken below is four times that, for all terms that are added on the way to a bound.

_UNDERFLOW = 1e-290  # more than all that numbers lose that are too small
_LONGEST = 1000  # bits of a whole number that a float64 can hold

Product = tuple[int, int, int, int]  # (1 + p u_i)(1 + q u_j) as i, j, p, q
Square = tuple[int, float]  # (u_i - t)^2 as i, t


class Parts(NamedTuple):
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
        self._known_beside = dict[Product | Square, tuple[list[int], list[float]]]()
        self._rows = dict[int, tuple[Indices, Floats, float]]()

    def parts(self, rows: Sequence[int], products: Sequence[Product], squares: Sequence[Square]) -> Parts:
        """Rows by their numbers, then what is not negative on the box, with a minus sign."""
        self.form(rows)
        formed = [self._rows[n] for n in rows]
        columns, values = [own for own, _, _ in formed], [own for _, own, _ in formed]
        sizes = [own.size for own in values] + [4] * len(products) + [3] * len(squares)
        places, coefficients = [], []
        beside: list[Product | Square] = [*products, *squares]
        for one in beside:
            known = self._known_beside.get(one)
            if known is None:
                terms = _terms(one)
                known = self._known_beside[one] = [self._column(m) for m, _ in terms], [value for _, value in terms]
            places += known[0]
            coefficients += known[1]
        return Parts(
            start=np.cumsum([0, *sizes]),
            columns=np.concatenate([*columns, np.array(places, np.intp)]),
            values=np.concatenate([*values, np.array(coefficients, np.float64)]),
            errors=np.array([own for _, _, own in formed] + [0.0] * (len(products) + len(squares))),
        )

    def bounds(self, i: int, side: str, parts: Parts, weights: Floats) -> ArrayPair:
        """By each row of weights (B, P) a proved bound of x_i in the box, and how much of it may be given away to
        rounding."""
        sign = 1.0 if side == "lo" else -1.0
        lowest, error = self.lowest(parts, weights, i, sign)
        x = self._rule.x.numbers
        center, radius = (x.values[k] / (1 << x.power) for k in (i, len(self._rule.x) + i))
        reach = radius * lowest
        doubt = 8.0 * _UNIT * (abs(center) + np.abs(reach)) + _UNDERFLOW
        return center + sign * reach - sign * doubt, 2.0 * (doubt + radius * error)

    def lowest(self, parts: Parts, weights: Floats, i: int = 0, sign: float = 0.0) -> ArrayPair:
        """A lower bound of `sign u_i` and the weighted sum, for each row of weights, and the error that it counts; -inf
        where it overflows."""
        column = self._column(unknown(i))
        if len(self._evens) < len(self._even):
            self._evens = np.array(self._even)
        kept = self._evens
        return _lowest(parts.start, parts.columns, parts.values, parts.errors, weights, kept, column, sign)

    def form(self, numbers: Sequence[int]) -> None:
        """Columns, coefficients, and the error of all of them, of rows that were not formed before."""
        new = [n for n in dict.fromkeys(numbers) if n not in self._rows]
        legs = {n: leg for n in new if (leg := self._leg(n)) is not None}
        swept = list[tuple[int, FloatRow]]()
        for side in dict.fromkeys(self._table[n][0] for n in legs):
            for reads in (True, False):  # which have one formula each
                own = [n for n, leg in legs.items() if self._table[n][0] == side and leg.m.uncertain is reads]
                if own:
                    swept += zip(own, float_rows([legs[n] for n in own], side), strict=True)
        others, columns = [n for n in new if n not in legs], dict[Places, Indices]()
        self._rule.form(others)
        for n, row in [*swept, *((n, _rounded(self._rule.row[n])) for n in others)]:
            if row.monomials not in columns:
                columns[row.monomials] = np.array([self._column(m) for m in row.monomials], np.intp)
            self._rows[n] = columns[row.monomials], row.values, row.error

    def _leg(self, n: int) -> LegConstraint | None:
        """The constraint of a row that can be swept in float64."""
        side, k, signs = self._table[n]
        if self._problem.model is None:
            return None
        leg = self._problem.constraint(k, self._rule.x, signs)
        return leg if isinstance(leg, LegConstraint) and (side != "lower" or leg.sure) else None

    def _column(self, monomial: int) -> int:
        if monomial not in self._columns:
            self._columns[monomial] = len(self._columns)
            self._even.append(not monomial & self._mask)
        return self._columns[monomial]


def _terms(beside: Product | Square) -> list[tuple[int, float]]:
    """Monomials and coefficients, with a minus sign."""
    one = unknown(beside[0])
    if len(beside) == 2:
        t = beside[1]
        return [(one + one, -1.0), (one, 2.0 * t), (0, -t * t)]
    _, j, p, q = beside
    two = unknown(j)
    return [(0, -1.0), (one, -p), (two, -q), (one + two, -p * q)]


@compiled
def _lowest(
    start: Indices,
    columns: Indices,
    values: Floats,
    errors_of: Floats,
    weights: Floats,
    even: Bools,
    moved: int,
    sign: float,
) -> ArrayPair:
    """The least that `sign` times monomial `moved` and the parts, weighted by each row, can be, less its error; and
    this."""
    count, found, errors = even.size, np.empty(len(weights)), np.empty(len(weights))
    for b in range(len(weights)):
        used, beside = 0, 0.0
        total, size = np.zeros(count), np.zeros(count)
        total[moved], size[moved] = sign, abs(sign)
        for p in range(weights.shape[1]):
            weight = weights[b, p]
            if weight != 0.0:
                used += 1
                beside += weight * errors_of[p]
                for t in range(start[p], start[p + 1]):
                    term = weight * values[t]
                    total[columns[t]] += term
                    size[columns[t]] += abs(term)
        lowest, sizes = total[0], size[0]
        for c in range(1, count):
            lowest += min(total[c], 0.0) if even[c] else -abs(total[c])
            sizes += size[c]
        error = 4.0 * _UNIT * (3 * used + count + 8) * sizes + _UNDERFLOW
        error += beside * (1.0 + 4.0 * used * _UNIT)
        finite = np.isfinite(lowest - error)
        found[b], errors[b] = (lowest - error, error) if finite else (-np.inf, np.inf)
    return found, errors


def _rounded(row: Polynomial) -> FloatRow:
    """Each coefficient rounded once, which the rule counts anyway."""
    cut = max(0, max(map(int.bit_length, row.terms.values()), default=0) - _LONGEST)
    values = np.ldexp(np.array([float(c >> cut) for c in row.terms.values()]), row.exponent + cut)
    smallest = float(np.min(np.abs(values), where=values != 0.0, initial=1.0))
    exact = smallest >= _SMALLEST and not any(c and not v for c, v in zip(row.terms.values(), values, strict=True))
    return FloatRow(tuple(row.terms), values, 0.0 if exact else np.inf)


# ------------------------------------------------------------------------------------------------------------------
# Proposes readings for the checker: where a row is used, and where a point is a solution. Nothing of it is trusted.


def rows_of(problem: Problem, x: Unknowns, places: Sequence[tuple[str, int]]) -> list[Row]:
    """Rows with the reference readings that cost least, component by component, on the box of x."""
    rows = [(side, k, "0" * len(problem.radii(k))) for side, k in places]
    for side in dict.fromkeys(side for side, _ in places if side != "length"):
        mine = [n for n, row in enumerate(rows) if row[0] == side and any(problem.radii(row[1]))]
        if mine:
            legs = [_leg(problem, x, rows[n][1]) for n in mine]
            for n, signs in zip(mine, best_signs(legs, side), strict=True):
                rows[n] = (*rows[n][:2], signs)
    return rows


def _leg(problem: Problem, x: Unknowns, k: int) -> LegConstraint:
    """The constraint at the centres of its reading sets."""
    leg = problem.constraint(k, x, "0" * len(problem.radii(k)))
    assert isinstance(leg, LegConstraint)
    return leg


def at_point(point: Sequence[float]) -> Unknowns:
    """The unknowns on a box of width zero."""
    x = tuple(F(float(v)) for v in point)
    return Unknowns(Box(x, x), free)


def failing(problem: Problem, x: Unknowns, k: int) -> Row | None:
    """The row that proves that the point fails at k."""
    rows = rows_of(problem, x, [(side, k) for side in problem.sides])
    return next((row for row in rows if problem.fails(x, *row)), None)


def holding(problem: Problem, x: Unknowns, k: int) -> str | None:
    """The signs of the readings that prove that it satisfies k."""
    signs = stretchings(problem, x, [k])[0]
    return signs if problem.unproved(x, [(k, signs)]) is None else None


def stretchings(problem: Problem, x: Unknowns, numbers: Sequence[int]) -> list[str]:
    """The ends of the reading sets, in signs, at which ||v|| is largest compared to its bounds, at a point."""
    radii = [problem.radii(k) for k in numbers]
    found = ["0" * len(one) for one in radii]
    mine = [n for n, one in enumerate(radii) if any(one)]
    if mine:
        readings = measured(problem, [numbers[n] for n in mine], x)
        of = AllReadings(problem.model, [float(v) for v in x.box.lo[:-1]], *readings)
        root = np.sqrt(np.maximum(of.square(of.w, of.c), 0.0))
        slopes = np.column_stack([*of.slopes(), -of.gain * root]) * of.radii
        for n, row in zip(mine, np.sign(slopes).astype(int).tolist(), strict=True):
            found[n] = "".join("0+-"[sign] for sign in row)
    return found


def measured(problem: Problem, numbers: Sequence[int], x: Unknowns) -> ArrayPair:
    """The readings of measurements of a leg (N, 8), and their half-widths (N, 7), as `cpcal.models.leg` has them."""
    of = [_leg(problem, x, k).m for k in numbers]
    return np.array([m.given for m in of], np.float64), np.array([m.radii for m in of], np.float64)


class AllReadings:
    """A point of a leg (n,), without eps: where it is proved to satisfy measurements for all readings of their sets.

    `model`: one that the checker knows; `given` (N, 8) and `radii` (N, 7): see `measured`.

    The checker's rule in float64, for all measurements at once, in its names (`held_leg`); what may be rounded is on
    the safe side.
    """

    def __init__(self, model: str | None, point: Sequence[float], given: Floats, radii: Floats) -> None:
        self.radii = radii
        q, place, self.read = given[:, :4].T, given[:, 4:7], given[:, 7]
        turn = np.moveaxis(np.array(rotation_rows([*q])) / (q * q).sum(axis=0), 2, 0)
        a, b, (self.offset, *extra) = np.array(point[:3]), np.array(point[3:6]), point[6:]
        self.c, self.w = turn @ b, place - a
        self.gain = 1.0 + (extra[0] if model == "gain" else 0.0)
        self.height = extra[0] if model == "lateral" else 0.0
        self.size = np.abs(b).sum()
        own = np.abs(place).sum(axis=1) + np.abs(self.read) + np.abs(point).sum() + self.radii.sum(axis=1)
        self.rounding = _ROUNDINGS * _UNIT * own

    def square(self, w: Floats, c: Floats) -> Floats:
        """(N,) ||v||^2 - h"""
        return np.asarray(((w + c) ** 2).sum(axis=1) - self.height)

    def slopes(self) -> ArrayPair:
        """Half the slopes (N, 3) of the square by d and s."""
        return self.w + self.c, np.cross(self.c, self.w)

    def least_eps(self, factor: float = 1.0) -> float:
        """The least eps, about, at which the point is proved to hold for all readings of sets `factor` times as wide;
        infinite where there is none."""
        rl = factor * self.radii[:, 6]
        most, least = self._squares(factor) if self.radii[:, :6].any() else (self.square(self.w, self.c),) * 2
        end = -rl if self.gain > 0.0 else rl
        high, low = (self.gain * (self.read + e) + self.offset for e in (end, -end))
        if not (least > 0.0).all():
            return math.inf
        roots = np.sqrt(most), np.sqrt(least)
        doubt = (
            self.rounding * (1.0 + np.sqrt(most + abs(self.height)) / roots[1])
            + _UNIT * (most + abs(self.height)) / roots[1]
        )
        eps = float((np.maximum(roots[0] - high, low - roots[1]) + doubt).max(initial=0.0)) * (1.0 + 2.0**-50)
        good = self.gain * self.read + self.offset > abs(self.gain) * rl + eps + self.rounding
        good &= self.read - rl + self.offset > eps + self.rounding
        return eps if good.all() else math.inf

    def _squares(self, factor: float) -> ArrayPair:
        """Above and below the square for all readings of positions and rotations."""
        r, t = factor * self.radii[:, :3], 0.5 * factor * self.radii[:, 3:6]
        shift, swing = r.sum(axis=1), t.sum(axis=1)
        d, s = self.slopes()
        c, w = np.abs(self.c), np.abs(self.w)
        moved = r + 2.0 * crossed(t, c) + (3.0 * swing * swing * self.size)[:, None]
        bent = swing * self.size * (5.0 * swing * (w.sum(axis=1) + shift) + 3.0 * shift)
        both = self.c * self.w
        turning = c * ((t * w).sum(axis=1)[:, None] - t * w) + w * ((t * c).sum(axis=1)[:, None] - t * c)
        turning += 2.0 * t * np.abs(both.sum(axis=1)[:, None] - both) + crossed(r, c) + bent[:, None]
        slack = 4.0 * (r * np.maximum(moved - np.abs(d), 0.0)).sum(axis=1)
        slack += 8.0 * (t * np.maximum(turning - np.abs(s), 0.0)).sum(axis=1)
        ends = np.where(d > 0.0, r, -r), np.where(s > 0.0, t, -t)
        return (
            self.square(self.w + ends[0], _rotated(ends[1], self.c)) + slack,
            self.square(self.w - ends[0], _rotated(-ends[1], self.c)) - slack,
        )


def _rotated(s: Floats, z: Floats) -> Floats:
    """(N, 3) R(1, s) z"""
    across = np.cross(s, z)
    return np.asarray(z + 2.0 * (across + np.cross(s, across)) / (1.0 + (s * s).sum(axis=1))[:, None])


_ROUNDINGS = 64.0  # of sums and products, in units of their sizes
