"""A formula that is applied many times, traced once: its multiplications and additions of whole numbers, in order.

The rows of a leg have the same monomials for every measurement on every box; only their coefficients differ. So the
formula runs once on `Traced` polynomials, which look like `Polynomial` but know places instead of coefficients and note
what becomes of these: `v[k] += v[i] * v[j]`. Whoever runs the notes gets the coefficients, and looks up no monomial.
They are run for many measurements side by side: each v is a column, so that the loop over notes costs little.

Each number is whole over a power of two, 2 ** units[kind] for a number of that kind; a coefficient that is a product of
d_0 numbers of kind 0 and d_1 of kind 1 is whole over 2 ** (d_0 units[0] + d_1 units[1]): d is its degree.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from fractions import Fraction as F
from itertools import repeat
from operator import add, mul
from typing import NamedTuple, TypeVar

Degree = tuple[int, int]
Column = int | list[int]  # of all measurements the same, or one for each
Parts = list[tuple[int, int, int]]
T = TypeVar("T")


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
    power = max([below for _, below in ratios], default=1).bit_length() - 1
    return Numbers([(above << power) // below for above, below in ratios], power)


class Program:
    """Notes (k, i, j): v[k] += v[i] * v[j]. `kinds`, ascending: of the numbers that it is given, which come first.
    `shared`: whether these are the same for all measurements."""

    def __init__(self, kinds: Sequence[int], shared: Sequence[bool]) -> None:
        self.kinds, self.shared = tuple(kinds), tuple(shared)
        self.notes: list[tuple[int, int, int]] = []
        self.whole: dict[int, int] = {}  # fixed numbers by their places
        self.ones: dict[int, Degree] = {}  # places of the number one in some degree
        self.size = len(self.kinds)
        self._known: dict[Hashable, int] = {}
        self.unit = self._number(1)
        self.highest: Degree = (0, 0)  # degree of what is asked for

    def given(self) -> list[Traced]:
        """The numbers that it is given, as polynomials without variables."""
        return [Traced(self, {0: [(k, self.unit, 1)]}, (1 - kind, kind)) for k, kind in enumerate(self.kinds)]

    def one(self) -> Traced:
        return Traced(self, {0: [(self.unit, self.unit, 1)]}, (0, 0))

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

    def raised(self, i: int, degree: Degree) -> int:
        """The place of v[i] with a degree raised by that."""
        one = self._place(degree, self.ones, degree)
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
        degrees: dict[int, Degree] = {k: (1 - kind, kind) for k, kind in enumerate(program.kinds)}
        degrees |= {**dict.fromkeys(program.whole, (0, 0)), **program.ones}
        products = [0, 0, 0]  # of the bits of numbers of the kinds 0 0, 0 1, 1 1: in all multiplications together
        own = {k for k, shared in enumerate(program.shared) if not shared}  # differ from measurement to measurement
        self._shared: list[tuple[int, list[tuple[int, int]]]] = []
        self._columns: list[tuple[int, tuple[int, int], list[tuple[int, int]]]] = []
        for k, pairs in sums.items():
            if k not in needed:
                continue
            for i, j in pairs:
                (p, q), (r, t) = degrees[i], degrees[j]
                products = [products[0] + p * r, products[1] + p * t + q * r, products[2] + q * t]
            degrees[k] = p + r, q + t
            if own.isdisjoint(i for pair in pairs for i in pair):
                self._shared.append((k, pairs))
            else:
                own.add(k)
                pairs.sort(key=own.isdisjoint)  # the first of them is a column
                self._columns.append((k, pairs[0], pairs[1:]))
        self._products = tuple(products)

    def cost(self, given: Sequence[Column], units: Degree) -> tuple[int, int]:
        """The work for each measurement, and the bits of the longest number that may come up."""
        longest = list(units)
        for kind, column in zip(self._program.kinds, given, strict=True):
            one = column.bit_length() if isinstance(column, int) else max(map(int.bit_length, column))
            longest[kind] = max(longest[kind], one)
        a, b = longest
        one, other, last = self._products
        bits = self._program.highest[0] * a + self._program.highest[1] * b
        return self.notes + (one * a * a + other * a * b + last * b * b >> 17), bits

    def run(self, given: Sequence[Column], units: Degree) -> list[Iterable[int]]:
        """The numbers at the places for what the program is given, in these units; shared ones without end."""
        program, first = self._program, len(given)
        v = [*(column if isinstance(column, int) else 0 for column in given), *[0] * (program.size - first)]
        for k, value in program.whole.items():
            v[k] = value
        for k, (p, q) in program.ones.items():
            v[k] = 1 << p * units[0] + q * units[1]
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

    def __init__(self, program: Program, terms: dict[int, Parts], degree: Degree) -> None:
        self.program, self.terms, self.degree = program, terms, degree

    def __add__(self, other: Traced) -> Traced:
        return self._summed(other, 1)

    def __sub__(self, other: Traced) -> Traced:
        return self._summed(other, -1)

    def _summed(self, other: Traced, sign: int) -> Traced:
        (a, b), (c, d) = self.degree, other.degree
        degree = max(a, c), max(b, d)
        terms: dict[int, Parts] = {}
        for p, factor in ((self, 1), (other, sign)):
            for m, parts in p._raised(degree).items():
                terms[m] = terms.get(m, []) + [(i, j, factor * own) for i, j, own in parts]
        return Traced(self.program, terms, degree)

    def _raised(self, degree: Degree) -> dict[int, Parts]:
        more = degree[0] - self.degree[0], degree[1] - self.degree[1]
        if not any(more):
            return self.terms
        raised = self.program.raised
        return {m: [(raised(i, more), j, factor) for i, j, factor in parts] for m, parts in self.terms.items()}

    @property
    def unit(self) -> Traced:
        """The number one in its degree."""
        one = self.program.one()
        return Traced(self.program, one._raised(self.degree), self.degree)

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
        degree = self.degree[0] + other.degree[0], self.degree[1] + other.degree[1]
        return Traced(self.program, terms, degree)

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
