"""One leg of a campaign as constraints with readings, in the leg models of the format."""

from __future__ import annotations

from array import array as array_of
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import lru_cache
from hashlib import sha256
from itertools import accumulate, pairwise, repeat
from operator import add, mul
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from .files import content, parsed
from .polynomial import (
    FIELD,
    READINGS,
    Polynomial,
    Remainder,
    applied,
    constant,
    dyadics,
    inner,
    minus,
    plus,
    rotation_rows,
    shortened,
    signed,
    unknown,
)
from .readers import Refused, array, decimals, shown, text
from .rule import ENDS, SIDES, Constraint, Problem, Unknowns, beyond

# a formula, traced once ----------------------------------------------------------------------------------------------
#
# The rows of a leg have the same monomials for every measurement on every box; only their coefficients differ. So the
# formula runs once on `Traced` polynomials, which know places instead of coefficients and note what becomes of these:
# `v[k] += v[i] * v[j]`. Whoever runs the notes gets the coefficients, and looks up no monomial. They are run for many
# measurements side by side: each v is a column, so that the loop over notes costs little.
#
# Each number is whole over one power of two, 2 ** unit. A coefficient that is a product of d of them is whole over
# 2 ** (d unit): d is its degree.

Column = int | list[int]  # of all measurements the same, or one for each
Parts = list[tuple[int, int, int]]
T = TypeVar("T")


class Program:
    """Notes (k, i, j): v[k] += v[i] * v[j]. `shared`: whether the numbers that it is given, which come first, are the
    same for all measurements."""

    def __init__(self, shared: Sequence[bool]) -> None:
        self.shared = tuple(shared)
        self.notes: list[tuple[int, int, int]] = []
        self.whole: dict[int, int] = {}  # fixed numbers by their places
        self.ones: dict[int, int] = {}  # places of the number one in some degree
        self.size = len(self.shared)
        self._known: dict[Hashable, int] = {}
        self.unit = self._number(1)
        self.highest = 0  # degree of what is asked for

    def given(self) -> list[Traced]:
        """The numbers that it is given, as polynomials without variables."""
        return [Traced(self, {0: [(k, self.unit, 1)]}, 1) for k in range(len(self.shared))]

    def one(self) -> Traced:
        return Traced(self, {0: [(self.unit, self.unit, 1)]}, 0)

    def settled(self, sums: dict[tuple[int, int], int]) -> tuple[int, int]:
        """Place and factor of a sum of factor * v[i] * v[j]; it is noted if it is more than a multiple of one place."""
        if len(sums) == 1:
            ((i, j), factor), *_ = sums.items()
            if self.unit in (i, j):
                return (j if i == self.unit else i), factor
        pairs = [(i if factor == 1 else self._times(i, self._number(factor)), j) for (i, j), factor in sums.items()]
        k = self._fresh()
        self.notes += [(k, i, j) for i, j in pairs]
        return k, 1

    def raised(self, i: int, degree: int) -> int:
        """The place of v[i] with a degree raised by that."""
        one = self._place(("one", degree), self.ones, degree)
        return one if i == self.unit else self._times(i, one)

    def _number(self, value: int) -> int:
        return self._place(value, self.whole, value)

    def _place(self, key: Hashable, table: dict[int, T], value: T) -> int:
        if key not in self._known:
            self._known[key] = self._fresh()
            table[self._known[key]] = value
        return self._known[key]

    def _times(self, i: int, j: int) -> int:
        key = ("times", i, j)
        if key not in self._known:
            self._known[key] = self._fresh()
            self.notes.append((self._known[key], i, j))
        return self._known[key]

    def _fresh(self) -> int:
        self.size += 1
        return self.size - 1


class Formula:
    """Numbers of a program, computed for many measurements side by side."""

    def __init__(self, program: Program, places: Sequence[int]) -> None:
        self._program, self._places = program, list(places)
        sums: dict[int, list[tuple[int, int]]] = {}
        for k, i, j in program.notes:
            sums.setdefault(k, []).append((i, j))
        needed = set(places)
        for k in reversed(list(sums)):
            if k in needed:
                needed.update(i for pair in sums[k] for i in pair)
        self.notes = sum(len(pairs) for k, pairs in sums.items() if k in needed)
        degrees = {**dict.fromkeys(range(len(program.shared)), 1), **dict.fromkeys(program.whole, 0), **program.ones}
        self._products = 0  # of degrees, in all multiplications together
        own = {k for k, shared in enumerate(program.shared) if not shared}  # differ from measurement to measurement
        self._shared: list[tuple[int, list[tuple[int, int]]]] = []
        self._columns: list[tuple[int, tuple[int, int], list[tuple[int, int]]]] = []
        for k, pairs in sums.items():
            if k not in needed:
                continue
            for i, j in pairs:
                self._products += degrees[i] * degrees[j]
            degrees[k] = degrees[i] + degrees[j]
            if own.isdisjoint(i for pair in pairs for i in pair):
                self._shared.append((k, pairs))
            else:
                own.add(k)
                pairs.sort(key=own.isdisjoint)  # the first of them is a column
                self._columns.append((k, pairs[0], pairs[1:]))

    def cost(self, given: Sequence[Column], unit: int) -> tuple[int, int]:
        """The work for each measurement, and the bits of the longest number that may come up."""
        each = (
            column.bit_length() if isinstance(column, int) else max(map(int.bit_length, column)) for column in given
        )
        longest = max(unit, *each)
        return self.notes + (self._products * longest * longest >> 17), self._program.highest * longest

    def run(self, given: Sequence[Column], unit: int) -> list[Iterable[int]]:
        """The numbers at the places for what the program is given, in this unit; shared ones without end."""
        program, first = self._program, len(given)
        v = [*(column if isinstance(column, int) else 0 for column in given), *[0] * (program.size - first)]
        for k, value in program.whole.items():
            v[k] = value
        for k, degree in program.ones.items():
            v[k] = 1 << degree * unit
        for k, pairs in self._shared:
            v[k] = sum([v[i] * v[j] for i, j in pairs])
        w: list[Iterable[int]] = list(map(repeat, v))
        for k, column in enumerate(given):
            if not isinstance(column, int):
                w[k] = column
        for k, (i, j), others in self._columns:
            found = map(mul, w[i], w[j])
            for i, j in others:
                found = map(add, found, map(mul, w[i], w[j]))
            w[k] = list(found)
        return [w[k] for k in self._places]


class Traced:
    """A polynomial whose coefficients are sums of products of places: entries (i, j, whole factor)."""

    __slots__ = ("degree", "program", "terms")

    def __init__(self, program: Program, terms: dict[int, Parts], degree: int) -> None:
        self.program, self.terms, self.degree = program, terms, degree

    def __add__(self, other: Traced) -> Traced:
        return self._summed(other, 1)

    def __sub__(self, other: Traced) -> Traced:
        return self._summed(other, -1)

    def _summed(self, other: Traced, sign: int) -> Traced:
        degree = max(self.degree, other.degree)
        terms: dict[int, Parts] = {}
        for p, factor in ((self, 1), (other, sign)):
            for m, parts in p._raised(degree).items():
                terms[m] = terms.get(m, []) + [(i, j, factor * own) for i, j, own in parts]
        return Traced(self.program, terms, degree)

    def _raised(self, degree: int) -> dict[int, Parts]:
        more = degree - self.degree
        if not more:
            return self.terms
        raised = self.program.raised
        return {m: [(raised(i, more), j, factor) for i, j, factor in parts] for m, parts in self.terms.items()}

    def settled(self) -> dict[int, tuple[int, int]]:
        """Place and factor of every coefficient."""
        sums = {m: _collected(parts) for m, parts in self.terms.items()}
        found = {m: self.program.settled(one) for m, one in sums.items() if one}
        self.terms = {m: [(i, self.program.unit, factor)] for m, (i, factor) in found.items()}
        return found

    def __mul__(self, other: Traced) -> Traced:
        terms: dict[int, Parts] = {}
        ours = self.settled()
        if ours == {0: (self.program.unit, 1)}:
            return other
        theirs = other.settled()
        for m, (i, f) in ours.items():
            for n, (j, g) in theirs.items():
                terms.setdefault(m + n, []).append((i, j, f * g))
        return Traced(self.program, terms, self.degree + other.degree)

    def places(self) -> dict[int, int]:
        """The place of every coefficient itself."""
        program = self.program
        found = {m: (i if f == 1 else program._times(i, program._number(f))) for m, (i, f) in self.settled().items()}
        self.terms = {m: [(i, program.unit, 1)] for m, i in found.items()}
        return found

    def times(self, factor: int) -> Traced:
        """A whole multiple."""
        terms = {m: [(i, j, factor * own) for i, j, own in parts] for m, parts in self.terms.items()}
        return Traced(self.program, terms, self.degree)

    def moved(self, monomial: int) -> Traced:
        """Times a monomial."""
        return Traced(self.program, {m + monomial: parts for m, parts in self.terms.items()}, self.degree)


def _collected(parts: Parts) -> dict[tuple[int, int], int]:
    """The factor of every product that does not vanish."""
    sums: dict[tuple[int, int], int] = {}
    for i, j, factor in parts:
        pair = (i, j) if i <= j else (j, i)
        sums[pair] = sums.get(pair, 0) + factor
    return {pair: factor for pair, factor in sums.items() if factor}


PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
EXTRA = {"plain": (), "gain": ("s",), "lateral": ("h",)}
_SURE, AXES = ("plain", "lateral"), range(3)
_KEPT = 4096  # measurements
POINT_WORK, _POINT_BITS = 300, 16  # of a measurement at a point, and of bits times bits of its longest number a part
_BATCH, _HELD = 256, 16 << 20  # measurements at once; bytes, about, that what is formed for them takes meanwhile
Quaternion = list[Traced]


def check_model(name: str) -> None:
    """A model's name is one of those that are known here, or an ASCII identifier that is none of them."""
    if name not in EXTRA and not (name.isascii() and name.isidentifier() and name.lower() not in EXTRA):
        raise Refused(f"names the model {shown(name)}: a name is an ASCII identifier, and none of cpcal's")


class Measurement:
    """One row of a campaign for one leg: quaternion, position, length; the half-widths of its reading (d, 2 s, e)."""

    def __init__(self, given: Sequence[float], widths: Sequence[float | F]):
        self.given, self.radii = given, tuple(widths)
        self.uncertain = any(self.radii)

    @property
    def shortest(self) -> F:
        """Of the lengths that the reading may stand for."""
        return F(self.given[-1]) - F(self.radii[-1])


def leg_problem(
    rows: Callable[[int], Measurement],
    count: int,
    model: str,
    only: tuple[int, ...] | None,
    forms: Sequence[Polynomial] = (),
) -> Problem:
    """`count` measurements of a leg, or `only` those. The `forms`, polynomials in its unknowns, are unknowns too; that
    each is equal to its polynomial is a constraint beyond the measurements."""
    names, known = (*PARAMETERS, *EXTRA[model], "eps"), lru_cache(_KEPT)(rows)
    n, nothing = len(names), [Polynomial({}, 0, form.spend) for form in forms[:1]]
    stated = [
        Constraint(form - Polynomial({unknown(n + m): 1}, 0, form.spend), *nothing, *nothing)
        for m, form in enumerate(forms)
    ]

    def constraint(k: int, x: Unknowns, signs: str) -> LegConstraint | Constraint:
        return LegConstraint(known(k), model, x.first(n), signs) if k < count else stated[k - count].on(x.images)

    def held(x: Unknowns, points: Iterable[tuple[int, str]], factor: F | None) -> Iterator[bool]:
        own = x.first(n)
        for k, signs in points:
            yield held_leg(known(k), model, own, signs, factor) if k < count else stated[k - count].on(x.images).held

    chosen = tuple(range(count)) if only is None else only
    return Problem(
        (*names, *(f"form {m}" for m in range(len(forms)))), n - 1, count + len(forms),
        (*chosen, *range(count, count + len(forms))), constraint, lambda k: known(k).radii if k < count else (),
        (*SIDES, "length"), model, settled=settled_legs, held=held,
    )  # fmt: skip


@dataclass(frozen=True)
class LegConstraint:
    """The constraint of a measurement on a box, its readings in sets from the ends that `signs` name."""

    m: Measurement
    model: str
    x: Unknowns
    signs: str

    @property
    def sure(self) -> bool:
        """Whether at_least is not negative at any solution."""
        return self.model in _SURE


def taken(legs: Sequence[LegConstraint]) -> tuple[list[Column], int]:
    """What the program takes of legs that have one: whole numbers, and the power of two that they are divided by."""
    x, reads = legs[0].x.numbers, legs[0].m.uncertain
    given = dyadics([v for leg in legs for v in leg.m.given])
    reach = dyadics([v for leg in legs for v in leg.m.radii] if reads else [])
    unit = max(given.power, reach.power + 1, x.power)
    own, widths = given.over(unit), reach.over(unit)
    columns: list[Column] = [own[j::8] for j in range(8)]
    columns.append([v - width for v, width in zip(own[7::8], widths[6::7], strict=True)] if reads else own[7::8])
    columns += x.over(unit)
    for part in range(2 * reads):
        for j in range(READINGS):
            signs = [ENDS[leg.signs[j]][part] for leg in legs]
            both = zip(signs, widths[j::7], strict=True)
            columns.append([sign * width >> 1 if 3 <= j < 6 else sign * width for sign, width in both])
    return columns, unit


def formed(legs: Sequence[LegConstraint], names: tuple[str, ...]) -> Iterator[tuple[Sequence[int], int]]:
    """For each of legs that have one program the coefficients of some parts, and the unit that they are in."""
    formula = _formula(legs, names).formula
    for start in range(0, len(legs), _BATCH):
        batch = legs[start : start + _BATCH]
        columns, unit = taken(batch)
        work, bits = formula.cost(columns, unit)
        batch[0].x.spend(3 * formula.notes + len(batch) * (60 + work))
        step = max(1, _HELD // (formula.notes * (64 + bits // 8) + 1))
        for k in range(0, len(batch), step):
            some = [column if isinstance(column, int) else column[k : k + step] for column in columns]
            found = formula.run(some, unit)
            yield from ((values, unit) for _, *values in zip(batch[k : k + step], *found))  # noqa: B905 - endless ones


def settled_legs(x: Unknowns, items: Sequence[LegConstraint | Constraint], side: str) -> Iterator[Polynomial]:
    """Their rows at the reference readings, less the penalties, in order; legs have one program."""
    legs = [item for item in items if isinstance(item, LegConstraint)]
    found = _settled(x, legs, side) if legs else iter(())
    return (next(found) if isinstance(item, LegConstraint) else item.row(side, signed(len(x))) for item in items)


def _settled(x: Unknowns, legs: Sequence[LegConstraint], side: str) -> Iterator[Polynomial]:
    bounded = side == "lower" and not legs[0].sure
    names = (side, "at_least", "factor") if bounded else (side,)
    formula = _formula(legs, names)
    for leg, (values, unit) in zip(legs, formed(legs, names), strict=True):
        x.spend(2 * len(values))
        mask = signed(len(x), leg.signs)
        exponents = [-unit * degree for degree in formula.degrees]
        parts = formula.split(values)
        row = shortened(formula.remainder(0, leg.signs, mask).of(parts[0]), exponents[0], x.spend)
        if bounded:
            low, factor = (
                shortened(dict(zip(formula.places[k], parts[k], strict=True)), exponents[k], x.spend) for k in (1, 2)
            )
            row = row - constant(beyond(low, factor, mask), x.spend)
        yield row


def held_leg(m: Measurement, model: str, x: Unknowns, signs: str, factor: F | None) -> bool:
    """Whether it is proved that a point satisfies a measurement, for some reading between the end M of its set that the
    signs name and -M; with a `factor` for all readings of sets with so many times the half-widths.

    Numbers are whole, over one power of two; a product of k of them is of degree k, and so are sums of these. See
    docs/certificate-format.md, "The claims", for every name here.
    """
    given, radii, (above, below) = dyadics(m.given), dyadics(m.radii), (factor or F(1)).as_integer_ratio()
    p = max(given.power, radii.power + below.bit_length(), x.at.power)
    one, more, point = 1 << p, p - radii.power - below.bit_length() + 1, x.at.over(p)
    q0, q1, q2, q3, *place, read = given.over(p)
    r1, r2, r3, *turns, rl = [0] * READINGS if factor == 0 else [above * width << more for width in radii.values]
    t1, t2, t3 = (width >> 1 for width in turns)
    (a1, a2, a3, b1, b2, b3, offset), extra, eps = point[:7], point[7:-1], point[-1]
    if eps < 0 or read - rl + offset < eps:
        return False
    # n = |q|^2, c = n R(q) b, w = P - a
    n, turn = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3, rotation_rows((q0, q1, q2, q3))
    c1, c2, c3 = (i * b1 + j * b2 + k * b3 for i, j, k in turn)
    w1, w2, w3 = place[0] - a1, place[1] - a2, place[2] - a3
    x1, x2, x3 = c2 * w3 - c3 * w2, c3 * w1 - c1 * w3, c1 * w2 - c2 * w1  # of degree 4
    gain, off, slack = one + extra[0] if model == "gain" else one, eps << p, 0
    if factor is None:
        d1, d2, d3, s1, s2, s3, e = (
            -ENDS[sign][0] * r for sign, r in zip(signs, (r1, r2, r3, t1, t2, t3, rl), strict=True)
        )
    else:
        change, reference = abs(gain) * rl + off, gain * read + (offset << p)
        shift, swing, size = r1 + r2 + r3, t1 + t2 + t3, n * (abs(b1) + abs(b2) + abs(b3))
        bent = swing * size * (5 * swing * (abs(w1) + abs(w2) + abs(w3) + shift) + (3 * shift << p))
        curved, slopes, swings = 3 * swing * swing * size, [], []
        axes = (c1, w1, r1, t1, x1), (c2, w2, r2, t2, x2), (c3, w3, r3, t3, x3)
        for i in AXES:
            (ci, wi, ri, ti, xi), (cj, wj, rj, tj, _), (ck, wk, rk, tk, _) = axes[i], axes[i - 2], axes[i - 1]
            by_c, of_w, of_c = abs(ci), tj * abs(wj) + tk * abs(wk), tj * abs(cj) + tk * abs(ck)
            turning = by_c * of_w + abs(wi) * of_c + 2 * ti * abs(cj * wj + ck * wk)
            moved = (n * ri << 2 * p) + (2 * (tj * abs(ck) + tk * abs(cj)) << p) + curved
            slopes.append((n * wi + ci << 2 * p, moved, ri))
            swings.append((xi << 2 * p, (turning << p) + (rj * abs(ck) + rk * abs(cj) << 2 * p) + bent, ti))
        if reference < change:
            return False
        slack = sum((4 * r * max(far - abs(g), 0) << p for g, far, r in slopes), 0)
        slack = -(-slack - sum(8 * t * max(far - abs(g), 0) for g, far, t in swings) >> p)
        d1, d2, d3, s1, s2, s3 = (r if g > 0 else -r for g, _, r in (*slopes, *swings))
        e = -rl if gain > 0 else rl
    # at this reading and at the opposite one, with (1 + s.s): what is even in the reading, and what is odd
    over = (one << p) + s1 * s1 + s2 * s2 + s3 * s3
    less, kappa, sc = (one << p + 1) - over, n * over, s1 * c1 + s2 * c2 + s3 * c3
    square = w1 * w1 + w2 * w2 + w3 * w3 + d1 * d1 + d2 * d2 + d3 * d3 + b1 * b1 + b2 * b2 + b3 * b3
    if model == "lateral":
        square -= extra[0] << p
    across = s1 * (c2 * d3 - c3 * d2) + s2 * (c3 * d1 - c1 * d3) + s3 * (c1 * d2 - c2 * d1)
    even = kappa * square + 2 * less * (w1 * c1 + w2 * c2 + w3 * c3)
    even += 4 * (sc * (s1 * w1 + s2 * w2 + s3 * w3) + (across << p))
    odd = 2 * (kappa * (w1 * d1 + w2 * d2 + w3 * d3) + less * (c1 * d1 + c2 * d2 + c3 * d3))
    odd += 4 * (sc * (s1 * d1 + s2 * d2 + s3 * d3) + (s1 * x1 + s2 * x2 + s3 * x3 << p))
    slack *= over
    most, least = (even + odd << 2 * p) + slack, (even - odd << 2 * p) - slack  # of degree 8
    x.spend(POINT_WORK + (most.bit_length() ** 2 >> _POINT_BITS))
    high, low = gain * (read + e) + (offset << p), gain * (read - e) + (offset << p)
    if high + off < 0 or most > kappa * (high + off) ** 2 or least < 0:
        return False
    return low <= off or kappa * (low - off) ** 2 <= least


def _formula(legs: Sequence[LegConstraint], names: tuple[str, ...]) -> LegFormula:
    return leg_formula(legs[0].model, legs[0].m.uncertain, names)


class LegFormula(NamedTuple):
    """A program, the places of the coefficients of some parts by monomial, their degrees, and what computes them."""

    program: Program
    places: list[dict[int, int]]
    degrees: list[int]
    formula: Formula
    remainders: dict[tuple[int, str, int], Remainder]

    def split(self, values: Sequence[int]) -> list[Sequence[int]]:
        """The coefficients of each part."""
        ends = [0, *accumulate(map(len, self.places))]
        return [values[a:b] for a, b in pairwise(ends)]

    def remainder(self, part: int, signs: str, mask: int) -> Remainder:
        """Of a part, for readings with these signs."""
        key = part, "".join("0" if sign == "0" else "+" for sign in signs), mask
        if key not in self.remainders:
            self.remainders[key] = Remainder(list(self.places[part]), *key[1:])
        return self.remainders[key]


@lru_cache(maxsize=256)
def leg_formula(model: str, reads: bool, names: tuple[str, ...]) -> LegFormula:
    """Of polynomials in u, and in y if it `reads` sets."""
    n = 8 + len(EXTRA[model])
    program = Program([False] * 9 + [True] * 2 * n + [False] * 2 * READINGS * reads)
    given = iter(program.given())
    quaternion, position, (length, shortest), centers = ([next(given) for _ in range(k)] for k in (4, 3, 2, n))
    x = [c + next(given).moved(unknown(i)) for i, c in enumerate(centers)]
    nothing = Traced(program, {}, 0)
    reading = [nothing] * READINGS
    if reads:
        at = [next(given) for _ in reading]
        reading = [end + next(given).moved(1 << FIELD * j) for j, end in enumerate(at)]
    found = _constraint(model, program.one(), (position, quaternion, length, shortest), x, reading)
    parts = [found.part(name) for name in names]
    program.highest = max(part.degree for part in parts)
    places = [part.places() for part in parts]
    formula = Formula(program, [k for part in places for k in part.values()])
    return LegFormula(program, places, [part.degree for part in parts], formula, {})


class _Constraint(NamedTuple):
    """`at_least <= sqrt(under_root / factor) <= at_most`, and what else is at most zero."""

    under_root: Traced
    factor: Traced
    at_least: Traced
    at_most: Traced
    length: Traced

    def part(self, name: str) -> Traced:
        """A row, or one of the fields."""
        body, factor, low, high = self[:4]
        if name == "upper":
            return body - factor * (high * high)
        if name == "lower":
            return factor * (low * low) - body
        if name == "sign":
            return high.times(-1)
        found: Traced = body.times(-1) if name == "body" else getattr(self, name)
        return found


def _constraint(
    model: str,
    one: Traced,
    m: tuple[Quaternion, Quaternion, Traced, Traced],
    x: Sequence[Traced],
    y: Sequence[Traced],
) -> _Constraint:
    """See docs/certificate-format.md, "A leg as constraints", for every name here."""
    position, quaternion, reading, shortest = m
    a, b, offset, eps = x[:3], x[3:6], x[6], x[-1]
    s, fixed = y[3:6], rotation_rows(quaternion)
    turned, norm = inner(s, s), inner(quaternion, quaternion)
    kappa = norm * (one + turned)
    p = plus(position, y[:3])
    z = minus(p, a)
    along = inner(z, applied(rotation_rows([one, *s]), applied(fixed, b)))
    square = inner((*z, *b), (*z, *b))
    if model == "lateral":
        square = square - x[7]
    body = kappa * square + along.times(2)
    read = reading + y[6]
    length = read + offset
    if model == "gain":
        length = length + x[7] * read
    return _Constraint(body, kappa, length - eps, length + eps, eps - offset - shortest)


# campaign.json: the exact numbers of a campaign ----------------------------------------------------------------------

NAME = "campaign.json"
FORMAT = "cpcal-campaign-exact/1"
_OTHERS = ("files", "robot", "uncertainty", "model", "provenance")
_LARGEST = 32 << 20  # bytes
_DEEPEST = 28  # lists and objects, one in the other


class ExactCampaign:
    """Measurements as rationals: each number is the float64 nearest to its decimal text."""

    def __init__(self, path: Path) -> None:
        """Raises Unusable where the file cannot be read, Refused where it is no campaign."""
        self.robot: Any = None
        self.legs = 0
        self.place: dict[str, int] = {}  # number of each measurement by its name, pose/run
        self._numbers = array_of("d")
        self._shortest: dict[int, F] = {}
        try:
            given = content(path, _LARGEST)
            self.sha256 = sha256(given).hexdigest()
            self._read(parsed(given))
        except Refused as refused:
            raise Refused(f"{NAME}: {refused.reason}", "campaign", 0) from None

    def _read(self, data: dict[str, Any]) -> None:
        if data.keys() != {"format", *_OTHERS, "measurements"}:
            raise Refused("it holds another key than " + ", ".join(["format", *_OTHERS, "measurements"]))
        if data["format"] != FORMAT:
            raise Refused(f"its format is not {FORMAT}")
        if _depth([data[key] for key in _OTHERS]) > _DEEPEST + 1:
            raise Refused("it is nested too deeply")
        if isinstance(data["robot"], dict):
            self.robot = data["robot"].get("name")
        for cells in array(data["measurements"]):
            self._add(array(cells))
        if not self.place:
            raise Refused("it lacks measurements")

    def _add(self, cells: list[Any]) -> None:
        self.legs = self.legs or (len(cells) - 15) // 2
        if self.legs < 1 or len(cells) != 15 + 2 * self.legs:
            raise Refused(f"a list of {15 + 2 * max(self.legs, 1)} is needed here")
        name, numbers = f"{text(cells[0])}/{text(cells[1])}", decimals(cells[2:])
        if not any(numbers[3:7]) or min(numbers[7 + self.legs :]) < 0:
            raise Refused("a measurement has a quaternion that is no rotation, or a negative half-width")
        if self.place.setdefault(name, len(self.place)) * len(numbers) < len(self._numbers):
            raise Refused(f"two measurements have the name {shown(name)}")
        self._numbers.extend(numbers)

    def __len__(self) -> int:
        return len(self.place)

    def measurement(self, k: int, leg: int) -> Measurement:
        """Row k from 0, leg from 1."""
        width, first = 13 + 2 * self.legs, 7 + self.legs
        numbers = self._numbers[k * width : (k + 1) * width]
        given = (*numbers[3:7], *numbers[:3], numbers[6 + leg])
        return Measurement(given, (*numbers[first : first + 6], numbers[first + 5 + leg]))

    def shortest(self, leg: int) -> F:
        """Of all lengths that the readings of a leg may stand for."""
        if leg not in self._shortest:
            self._shortest[leg] = min(self.measurement(k, leg).shortest for k in range(len(self)))
        return self._shortest[leg]


def _depth(value: Any) -> int:
    if not isinstance(value, dict | list):
        return 0
    return 1 + max(map(_depth, value.values() if isinstance(value, dict) else value), default=0)


def beside(certificate: Path, sha256: str) -> ExactCampaign:
    """The campaign beside a certificate: the file that is named after its digest, where there is one."""
    own = certificate.parent / f"{sha256[:12]}.{NAME}"
    return ExactCampaign(own if sha256[:12].isalnum() and own.exists() else certificate.parent / NAME)
