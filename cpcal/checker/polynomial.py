"""Polynomials with whole coefficients over a common power of two: exact, and their work is counted.

A monomial is one integer with a field of FIELD bits for the exponent of each variable, so that a product of monomials
is the sum of their integers. The first READINGS variables are those of a reading, the others the unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import lru_cache, reduce
from operator import add, itemgetter, mul, or_, sub
from typing import Any, NamedTuple, Self

from .readers import Refused, binary

FIELD = 6
READINGS = 7
MOST_TERMS = 100_000  # of one polynomial
MOST_HELD = 500_000  # terms of all polynomials that one sum, or the rows of a step, hold: each for every 512 bits of it
_LONG = 1024  # bits behind the point
_MOST_BITS = 4096  # of a coefficient over the common power of two
Spend = Callable[[int], None]


def unknown(i: int) -> int:
    """The monomial of one unknown."""
    return 1 << FIELD * (READINGS + i)


@dataclass(eq=False)
class Polynomial:
    """`sum c * monomial`, times 2 ** `exponent`; `spend` is told what an operation is going to cost.

    That is what it takes in tenths of a microsecond, about; coefficients of a and b bits are multiplied in a b / 2^16.
    """

    terms: dict[int, int]
    exponent: int
    spend: Spend

    def __post_init__(self) -> None:
        self.bits = max(map(int.bit_length, self.terms.values()), default=0)  # of the longest coefficient
        # what its longest monomial takes besides, of time and memory: one for every 1024 bits, or 170 unknowns
        self.wide = max(self.terms, default=0).bit_length() >> 10
        # what it takes of memory: its terms, each once more for every 512 bits
        self.size = len(self.terms) * (1 + (self.bits >> 9) + 2 * self.wide)

    def __add__(self, other: Polynomial) -> Polynomial:
        return combined(((1, self), (1, other)), self.spend)

    def __sub__(self, other: Polynomial) -> Polynomial:
        return combined(((1, self), (-1, other)), self.spend)

    def __mul__(self, other: Polynomial) -> Polynomial:
        a, b = self.terms, other.terms
        if self.bits + other.bits > _MOST_BITS:
            raise too_many(_MOST_BITS, "bits of a coefficient")
        self.spend(50 + len(a) * len(b) * (3 + (self.bits * other.bits >> 16) + self.wide + other.wide))
        out: dict[int, int] = {}
        known = out.get
        for m, c in a.items():
            for n, d in b.items():
                out[m + n] = known(m + n, 0) + c * d
            if len(out) > MOST_TERMS:
                raise too_many(MOST_TERMS, "terms of a polynomial")
        return Polynomial(out, self.exponent + other.exponent, self.spend)

    def times(self, factor: int, power: int = 0) -> Polynomial:
        """factor * 2 ** power times it."""
        if factor == 1:
            return Polynomial(self.terms, self.exponent + power, self.spend)
        self.spend(len(self.terms))
        return Polynomial({m: factor * c for m, c in self.terms.items()}, self.exponent + power, self.spend)

    @property
    def constant(self) -> F:
        """Its constant term: its value at the centre."""
        return binary(self.terms.get(0, 0), self.exponent)


def combined(parts: Iterable[tuple[int, Polynomial]], spend: Spend) -> Polynomial:
    """The sum of whole multiples."""
    held, size = [], 0
    for factor, p in parts:
        spend(20)
        size += p.size
        if size > MOST_HELD:
            raise too_many(MOST_HELD, "terms in a sum")
        if p.terms:
            held.append((factor, p))
    lowest = min((p.exponent for _, p in held), default=0)
    out: dict[int, int] = {}
    known = out.get
    for factor, p in held:
        shift = p.exponent - lowest
        bits = factor.bit_length() + shift
        if bits + p.bits > _MOST_BITS:
            raise too_many(_MOST_BITS, "bits of a coefficient")
        spend(len(p.terms) * (3 + (bits * p.bits >> 16) + p.wide))
        multiple = factor << shift
        for m, c in p.terms.items():
            out[m] = known(m, 0) + multiple * c
        if len(out) > MOST_TERMS:
            raise too_many(MOST_TERMS, "terms of a polynomial")
    return Polynomial({m: c for m, c in out.items() if c}, lowest, spend)


def substituted(p: Polynomial, images: Mapping[int, Polynomial]) -> Polynomial:
    """With what is put for each monomial."""
    return combined(((c, images[monomial]) for monomial, c in p.terms.items()), p.spend).times(1, p.exponent)


def constant(value: F, spend: Spend) -> Polynomial:
    return Polynomial({0: value.numerator}, 1 - value.denominator.bit_length(), spend)


def shortened(terms: dict[int, int], exponent: int, spend: Spend) -> Polynomial:
    """The polynomial with those coefficients, without the power of two that long ones have in common."""
    common = reduce(or_, terms.values(), 0) if exponent < -_LONG else 0
    zeros = (common & -common).bit_length() - 1 if common else 0
    return Polynomial({m: c >> zeros for m, c in terms.items()} if zeros else terms, exponent + zeros, spend)


class Numbers(NamedTuple):
    """Whole numbers, all divided by two to one power."""

    values: list[int]
    power: int

    def over(self, power: int) -> list[int]:
        """The whole numbers over a power that is not lower."""
        more = power - self.power
        return [value << more for value in self.values] if more else self.values


def dyadics(values: Iterable[float | F]) -> Numbers:
    """Of numbers whose denominators are powers of two."""
    ratios = [value.as_integer_ratio() for value in values]
    bits = max([below for _, below in ratios], default=1).bit_length()
    return Numbers([above << bits - below.bit_length() for above, below in ratios], bits - 1)


def rotation_rows(h: Sequence[Any]) -> list[list[Any]]:
    """|h|^2 R(h) of a quaternion, scalar first, whatever its numbers are."""
    w, x, y, z = h
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    halves = (p * q for p, q in ((w, x), (w, y), (w, z), (x, y), (x, z), (y, z)))
    wx, wy, wz, xy, xz, yz = (half + half for half in halves)
    return [
        [ww + xx - (yy + zz), xy - wz, xz + wy],
        [xy + wz, ww + yy - (xx + zz), yz - wx],
        [xz - wy, yz + wx, ww + zz - (xx + yy)],
    ]


# polynomials that a model makes its rows of --------------------------------------------------------------------------

Terms = dict[tuple[int, ...], Any]  # by its unknowns, ascending; coefficients are whole, or fractions


class Form:
    """A small polynomial, whose work nobody counts."""

    __slots__ = ("terms",)

    def __init__(self, terms: Terms) -> None:
        self.terms = {m: c for m, c in terms.items() if c}

    def __add__(self, other: Form | F | int) -> Self:
        found = dict(self.terms)
        for m, c in (other.terms if isinstance(other, Form) else {(): other}).items():
            found[m] = found.get(m, 0) + c
        return type(self)(found)

    def __sub__(self, other: Form | F | int) -> Self:
        return self + -1 * other

    def __mul__(self, other: Form | F | int) -> Self:
        if not isinstance(other, Form):
            return type(self)({m: c * other for m, c in self.terms.items()})
        found: Terms = {}
        for m, c in self.terms.items():
            for n, d in other.terms.items():
                key = tuple(sorted(m + n))
                found[key] = found.get(key, 0) + c * d
        return type(self)(found)

    __radd__, __rmul__ = __add__, __mul__


def forms(unknowns: Iterable[int]) -> list[Form]:
    return [Form({(i,): 1}) for i in unknowns]


# vectors and matrices over any ring: fractions, whole numbers, intervals, traced polynomials ------------------------

Row = Sequence[Any]


def inner(x: Iterable[Any], y: Iterable[Any]) -> Any:
    return reduce(add, map(mul, x, y))


def plus(x: Row, y: Row) -> list[Any]:
    return list(map(add, x, y))


def minus(x: Row, y: Row) -> list[Any]:
    return list(map(sub, x, y))


def applied(matrix: Iterable[Row], x: Row) -> list[Any]:
    return [inner(row, x) for row in matrix]


def product(left: Iterable[Row], right: Sequence[Row]) -> list[list[Any]]:
    return [applied(transposed(right), row) for row in left]


def transposed(matrix: Sequence[Row]) -> list[Row]:
    return list(zip(*matrix, strict=True))


def cross(x: Row, y: Row) -> list[Any]:
    return [x[k - 2] * y[k - 1] - x[k - 1] * y[k - 2] for k in range(3)]


def too_many(most: int, what: str) -> Refused:
    return Refused(f"the check takes more than {most} {what}", "limit")


@lru_cache(maxsize=512)
def signed(unknowns: int, signs: str = "") -> int:
    """The variables that may be negative, as a mask of the lowest bit of each field: all but readings at an end."""
    every = sum(1 << FIELD * i for i in range(READINGS + unknowns))
    return every - sum(1 << FIELD * j for j, sign in enumerate(signs) if sign != "0")


def least(p: Polynomial, mask: int) -> F:
    """A lower bound: a monomial lies in [0, 1] if its variables under the mask have even exponents, else in [-1, 1]."""
    low = p.terms.get(0, 0)
    for monomial, c in p.terms.items():
        if monomial & mask:
            low -= abs(c)
        elif c < 0 and monomial:
            low += c
    return binary(low, p.exponent)


class Remainder:
    """What is left of polynomials with these monomials without their readings: at their reference, less the penalties.

    The penalty of a reading is of all monomials in which it is the first: divided by it, where it begins at an end.
    """

    def __init__(self, monomials: Sequence[int], signs: str, mask: int) -> None:
        of_readings = (1 << FIELD * READINGS) - 1
        divided = [0 if sign == "0" else 1 << FIELD * j for j, sign in enumerate(signs)]
        kept: list[int] = []
        lists: list[list[list[int]]] = [[[], [], []] for _ in signs]
        for place, monomial in enumerate(monomials):
            reading = monomial & of_readings
            if not reading:
                kept.append(place)
                continue
            j = ((reading & -reading).bit_length() - 1) // FIELD
            rest = monomial - divided[j]
            lists[j][0 if rest & mask else 1 if rest else 2].append(place)
        self._monomials = [monomials[place] for place in kept]
        self._kept = _picked(kept)
        self._readings = [tuple(map(_picked, own)) for own in lists if any(own)]

    def of(self, coefficients: Sequence[int]) -> dict[int, int]:
        """Coefficients of what is left, by monomial, from those of the monomials."""
        left = dict(zip(self._monomials, self._kept(coefficients), strict=True))
        penalty = 0
        for signed, falling, alone in self._readings:
            low = sum(alone(coefficients)) - sum(map(abs, signed(coefficients)))
            low += sum(c for c in falling(coefficients) if c < 0)
            penalty += min(low, 0)
        left[0] = left.get(0, 0) + penalty
        return left


def _picked(places: list[int]) -> Callable[[Sequence[int]], Sequence[int]]:
    """The numbers at these places."""
    if len(places) < 2:  # of one place itemgetter gives no tuple
        return lambda numbers: [numbers[place] for place in places]
    return itemgetter(*places)
