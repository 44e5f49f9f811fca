"""A formula that is applied many times, traced once: its multiplications and additions of whole numbers, in order.

The rows of a leg have the same monomials for every measurement on every box; only their coefficients differ. So the
formula runs once on `Traced` polynomials, which look like `Polynomial` but know places instead of coefficients and note
what becomes of these: `v[k] += v[i] * v[j]`. Whoever runs the notes gets the coefficients, and looks up no monomial. As
Python code with a line for each number they take a third of the time of a loop over them.

Each number is whole over a power of two, 2 ** units[kind] for a number of that kind; a coefficient that is a product of
d_0 numbers of kind 0 and d_1 of kind 1 is whole over 2 ** (d_0 units[0] + d_1 units[1]): d is its degree.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from fractions import Fraction as F
from typing import NamedTuple, TypeVar

from .exact_polynomial import Spend

Degree = tuple[int, int]
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
    """Notes (k, i, j): v[k] += v[i] * v[j]. `kinds`, ascending: of the numbers that it is given, which come first."""

    def __init__(self, kinds: Sequence[int]) -> None:
        self.kinds = tuple(kinds)
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
        return self._times(i, self._place(degree, self.ones, degree)) if any(degree) else i

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

    def formula(self, places: Sequence[int]) -> Formula:
        """What it gives at these places."""
        return Formula(self, places)


class Formula:
    """Numbers of a program, computed by one Python function that is made of its notes.

    The function's source holds names v0, v1, ... and whole numbers of the formula, which is one of cpcal's own models:
    nothing that was read from a file enters it.
    """

    def __init__(self, program: Program, places: Sequence[int]) -> None:
        self._count = len(program.kinds)
        self._highest, self._cost = program.highest, len(program.notes) // 2
        self._ones = list(program.ones.items())
        scope: dict[str, Callable[[list[int]], list[int]]] = {}
        exec(_source(program, places), scope)
        self._numbers = scope["numbers"]

    def run(self, first: Numbers, others: Sequence[Numbers], spend: Spend) -> tuple[list[int], Degree]:
        """The numbers at the places, and the units, for what the program is given of kind 0 and of kind 1."""
        v, a, b = first.values, first.power, max(part.power for part in others)
        w = [value for part in others for value in part.over(b)]
        bits = [max(unit, *map(int.bit_length, part)) for unit, part in ((a, v), (b, w))]
        longest = sum(d * size for d, size in zip(self._highest, bits, strict=True))
        spend(self._count + self._cost * (1 + (longest >> 10) ** 2))
        return self._numbers([*v, *w, *(1 << p * a + q * b for _, (p, q) in self._ones)]), (a, b)


def _source(program: Program, places: Sequence[int]) -> str:
    """A function of the given numbers and of one in each degree, without what the places do not need."""
    sums: dict[int, list[tuple[int, int]]] = {}
    for k, i, j in program.notes:
        sums.setdefault(k, []).append((i, j))
    needed = set(places)
    for k in reversed(list(sums)):
        if k in needed:
            needed.update(i for pair in sums[k] for i in pair)

    def name(i: int) -> str:
        return f"({program.whole[i]})" if i in program.whole else f"v{i}"

    lines = [f" {''.join(f'v{k},' for k in (*range(len(program.kinds)), *program.ones))}=given"]
    for k, pairs in sums.items():
        if k in needed:
            lines.append(f" v{k}={'+'.join(f'{name(i)}*{name(j)}' for i, j in pairs)}")
    return "\n".join(["def numbers(given):", *lines, f" return [{','.join(map(name, places))}]"])


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
        unit, raised = self.program.unit, self.program.raised
        return {m: [(raised(i, more), unit, factor)] for m, (i, factor) in self.settled().items()}

    def settled(self) -> dict[int, tuple[int, int]]:
        """Place and factor of every coefficient."""
        sums = {m: _collected(parts) for m, parts in self.terms.items()}
        found = {m: self.program.settled(one) for m, one in sums.items() if one}
        self.terms = {m: [(i, self.program.unit, factor)] for m, (i, factor) in found.items()}
        return found

    def __mul__(self, other: Traced) -> Traced:
        terms: dict[int, Parts] = {}
        ours, theirs = self.settled(), other.settled()
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
