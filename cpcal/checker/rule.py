"""The one rule: weights on rows, bound products and squares exclude a box, or bound an unknown on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property, lru_cache
from itertools import chain
from typing import Any, NamedTuple

from .polynomial import (
    FIELD,
    MOST_HELD,
    READINGS,
    Form,
    Numbers,
    Polynomial,
    Spend,
    Terms,
    combined,
    constant,
    dyadics,
    least,
    signed,
    substituted,
    too_many,
    unknown,
)
from .readers import Fractions, Names, Places, Refused

# constraints with readings, and what they say in the coordinates of a box --------------------------------------------

SIDES = ("upper", "lower", "sign", "body")
_MOST_KEPT = 100_000  # terms of what is put for monomials


@dataclass(frozen=True)
class Box:
    """lo <= x <= hi."""

    lo: Fractions
    hi: Fractions

    def replaced(self, i: int, *, lo: F | None = None, hi: F | None = None) -> Box:
        """With other bounds on x_i."""
        low = self.lo if lo is None else (*self.lo[:i], lo, *self.lo[i + 1 :])
        return Box(low, self.hi if hi is None else (*self.hi[:i], hi, *self.hi[i + 1 :]))

    def holds(self, lo: Sequence[F], hi: Sequence[F]) -> bool:
        """Whether another box lies in it."""
        return all(a <= b and c <= d for a, b, c, d in zip(self.lo, lo, hi, self.hi, strict=True))


class Unknowns:
    """The unknowns on a box: x_i = center_i + radius_i u_i."""

    def __init__(self, box: Box, spend: Spend) -> None:
        self.box, self.spend = box, spend
        self._parts: dict[int, Unknowns] = {}

    def __len__(self) -> int:
        return len(self.box.lo)

    def center(self, i: int) -> F:
        return (self.box.lo[i] + self.box.hi[i]) / 2

    def radius(self, i: int) -> F:
        return (self.box.hi[i] - self.box.lo[i]) / 2

    @cached_property
    def numbers(self) -> Numbers:
        """Centers and radii, as programs take them: where the unknowns are few."""
        return dyadics([of(i) for of in (self.center, self.radius) for i in range(len(self))])

    @cached_property
    def at(self) -> Numbers:
        """The coordinates of a point."""
        return dyadics(self.box.lo)

    def variable(self, field: int, middle: F, factor: F) -> Polynomial:
        """middle + factor * the variable in that field."""
        number, u = constant(middle, self.spend), Polynomial({1 << FIELD * field: 1}, 0, self.spend)
        return number + u * constant(factor, self.spend)

    def first(self, count: int) -> Unknowns:
        """So many of them alone."""
        if count == len(self):
            return self
        if count not in self._parts:
            self._parts[count] = Unknowns(Box(self.box.lo[:count], self.box.hi[:count]), self.spend)
        return self._parts[count]

    @cached_property
    def images(self) -> Images:
        """What is put for each monomial in x."""
        return Images(self.box, self.spend)


class Images(dict[int, Polynomial]):
    """By monomial in x, the product of the variables of its fields in the coordinates of a box: formed when first used,
    all forgotten when they are too many."""

    def __init__(self, box: Box, spend: Spend) -> None:
        self._box, self._spend, self._size = box, spend, 0

    def __missing__(self, monomial: int) -> Polynomial:
        field = max((monomial & -monomial).bit_length() - 1, 0) // FIELD  # the first
        one, x, i = 1 << FIELD * field, Unknowns(self._box, self._spend), field - READINGS
        if not monomial:
            found = constant(F(1), self._spend)
        elif monomial == one:
            found = x.variable(field, x.center(i), x.radius(i))
        else:
            found = self[monomial - one] * self[one]
        self._size += found.size
        if self._size > _MOST_KEPT:
            self.clear()
            self._size = found.size
        self[monomial] = found
        return found


@dataclass(frozen=True)
class Constraint:
    """`at_least <= sqrt(body / factor) <= at_most` where there is a factor > 0; else `at_least <= body <= at_most`.

    None: no bound. There are no readings, and a factor is a number.
    """

    body: Polynomial
    at_least: Polynomial | None
    at_most: Polynomial | None
    factor: Polynomial | None = None

    def on(self, images: Images) -> Constraint:
        """With what is put for each monomial."""
        low, high = (None if p is None else substituted(p, images) for p in (self.at_least, self.at_most))
        return Constraint(substituted(self.body, images), low, high, self.factor)

    def row(self, side: str, mask: int) -> Polynomial:
        """At most zero at every solution."""
        body, low, high, factor = self.body, self.at_least, self.at_most, self.factor
        if side == "upper" and high is not None:
            return body - (high if factor is None else factor * (high * high))
        if side == "lower" and low is not None:
            if factor is None:
                return low - body
            return factor * (low * low) - body - constant(beyond(low, factor, mask), body.spend)
        if side == "sign" and high is not None and factor is not None:
            return high.times(-1)
        return body.times(-1) if side == "body" and factor is not None else body.times(0)

    @property
    def held(self) -> bool:
        """At a point."""
        return all(self.row(side, 0).constant <= 0 for side in SIDES)


def beyond(at_least: Polynomial, factor: Polynomial, mask: int) -> F:
    """The most that `factor at_least^2` can be where at_least is negative: what a "lower" row must give away."""
    lowest = min(F(0), least(at_least, mask))
    return -least(factor.times(-1), mask) * lowest**2 if lowest else F(0)


# A reading is the first number plus the second times y, in half-widths: |y| <= 1 about 0, or 0 <= y <= 1 from its end.
ENDS = {"-": (-1, 2), "0": (0, 1), "+": (1, -2)}


# The default has a name, so that a problem can go to another process.
def _none(*_: Any) -> tuple[()]:
    return ()


@dataclass(frozen=True)
class Problem:
    """Constraints in some unknowns; `chosen`: the ascending numbers of those that count, of `count`."""

    unknowns: Names
    objective: int | None
    count: int
    chosen: Places
    constraint: Callable[[int, Unknowns, str], Any]  # k on a box, its reading's signs
    radii: Callable[[int], tuple[float | F, ...]] = _none  # of the readings of k: 0 where they are exact
    sides: Names = SIDES
    model: str | None = None  # of a leg; None: the certificate states the constraints
    at: Callable[..., int | None] | None = None  # of a leg: what is asked of `unproved`
    forms: tuple[Any, ...] = ()  # of a leg: polynomials that are the last of its unknowns
    # rows of what is no Constraint; of some that have one formula
    settled: Callable[[Unknowns, Sequence[Any], str], Iterable[Polynomial]] = _none
    in_box: bool = True  # whether rows come in the coordinates u of a box, or in x
    # so many tags of rows may be wrong: a step then has several sets of weights, and these spoil no more than some
    wrong: int = 0
    tag: Callable[[str, int], Any] = _none  # of a row, where some may be wrong; None: nothing spoils it

    def row(self, x: Unknowns, side: str, k: int, signs: str) -> Polynomial:
        """In u, at most zero at every solution in the box: at the reference reading, less the penalties."""
        return next(self.rows(x, [(side, k, signs)]))[1]

    def rows(self, x: Unknowns, table: Sequence[tuple[str, int, str]]) -> Iterator[tuple[int, Polynomial]]:
        """`row` of several, each with its place in the table."""
        groups: dict[tuple[str, bool], list[tuple[int, Any]]] = {}
        for n, (side, k, signs) in enumerate(table):
            item = self.constraint(k, x, signs)
            if isinstance(item, Constraint):
                yield n, item.row(side, signed(len(x)))
            else:
                groups.setdefault((side, any(self.radii(k))), []).append((n, item))
        for (side, _), group in groups.items():
            places, items = zip(*group, strict=True)
            yield from zip(places, self.settled(x, items, side), strict=True)

    def unproved(self, x: Unknowns, points: Sequence[tuple[int, str]], factor: F | None = None) -> int | None:
        """The first of these numbers that it is not proved of that the point, a box of width zero, satisfies it: for
        some reading between the end that its signs name and the opposite one, or with a `factor` for all readings."""
        if self.at is not None:
            return self.at(x, points, factor)
        return next((k for k, signs in points if not self.constraint(k, x, signs).held), None)

    def fails(self, x: Unknowns, side: str, k: int, signs: str) -> bool:
        """Whether it is proved that it does not for any reading."""
        return least(self.row(x, side, k, signs), 0) > 0


class ModelRows(ABC):
    """Rows that a model derives: by side and number, polynomials in x, at most zero at every solution.

    `tags`: all that there are, in order; `size`: of unknowns; `count`: numbers are below it.
    """

    sides: Names
    tags: dict[tuple[str, int], None]
    size: int
    count: int

    @abstractmethod
    def form(self, side: str, k: int) -> Form:
        """One of them, times some number above zero."""

    def work(self, side: str, k: int) -> int:
        """What it costs besides its terms."""
        return 0

    def row(self, side: str, k: int) -> Terms:
        """Of `form`. Raises Refused for a row that there is not."""
        if (side, k) not in self.tags:
            raise Refused(f"there is no row {side} {k}")
        return self.form(side, k).terms

    def problem(self, spend: Spend) -> Problem:
        """For the rule: with a largest coefficient of about one, as a row may be divided by what is above zero."""

        @lru_cache(maxsize=2048)
        def polynomial(side: str, k: int) -> Polynomial:
            spend(self.work(side, k))
            terms = self.row(side, k)
            spend(500 + 20 * len(terms))
            bits = max((c.bit_length() for c in terms.values()), default=0)
            return Polynomial({sum(map(unknown, m)): c for m, c in terms.items()}, -bits, spend)

        return Problem(
            tuple(map(str, range(self.size))), None, self.count, tuple(range(self.count)), lambda k, *_: k,
            sides=self.sides, in_box=False, settled=lambda _, items, side: (polynomial(side, k) for k in items),
        )  # fmt: skip


Row = tuple[str, int, str]  # side, measurement, signs of the reference reading


class Weights(NamedTuple):
    """Multipliers of rows (its number, weight), of products (1 + p u_i)(1 + q u_j) and of squares (u_i - t)^2.

    Each is a whole number, the last of its entry, times 2 to the power that `exponents` gives for its kind.
    """

    rows: tuple[tuple[int, int], ...]
    products: tuple[tuple[int, int, int, int, int], ...]
    tangents: tuple[tuple[int, F, int], ...]
    exponents: tuple[int, int, int]


class Rule:
    """Applies weights on one box; the rows that they speak of are formed once."""

    def __init__(self, problem: Problem, box: Box, rows: Sequence[Row], spend: Spend) -> None:
        self.x, self._problem, self._table = Unknowns(box, spend), problem, rows
        self.row: dict[int, Polynomial] = {}
        self._u, self._held = list(map(unknown, range(len(self.x)))), 0

    def form(self, numbers: Iterable[int]) -> None:
        """Rows, by their numbers, that are not formed yet; others are forgotten where there are many."""
        needed = dict.fromkeys(numbers)
        new = [n for n in needed if n not in self.row]
        if new and self._held > MOST_HELD // 2:
            self.row = {n: row for n, row in self.row.items() if n in needed}
            self._held = sum(row.size for row in self.row.values())
        for place, row in self._problem.rows(self.x, [self._table[n] for n in new]):
            self.row[new[place]] = row
            self._held += row.size
            if self._held > MOST_HELD:
                raise too_many(MOST_HELD, "terms of rows in a step")

    def aggregate(self, weights: Weights, *more: Polynomial) -> Polynomial:
        """At most zero at every solution in the box: weighted rows, less weighted products and squares; and `more`
        times the power of two of the rows' weights."""
        of_rows, of_products, of_tangents = weights.exponents
        spend, u, linear, products = self.x.spend, self._u, [0] * len(self.x), {0: 0}
        spend(len(weights.products) * (20 + len(self.x) // 20) + 100 * len(weights.tangents))
        known = products.get
        for i, j, p, q, weight in weights.products:
            products[0] -= weight
            linear[i] -= p * weight
            linear[j] -= q * weight
            both = u[i] + u[j]
            products[both] = known(both, 0) - p * q * weight
        products |= {m: c for m, c in zip(u, linear, strict=True) if c}
        squares, power = dict[int, int](), dyadics([t for _, t, _ in weights.tangents]).power
        for i, t, weight in weights.tangents:
            top = t.numerator * ((1 << power) // t.denominator)
            for monomial, c in ((u[i] + u[i], 1 << 2 * power), (u[i], -top << power + 1), (0, top * top)):
                squares[monomial] = squares.get(monomial, 0) - weight * c
        self.form(n for n, weight in weights.rows if weight)
        rows = [(weight, self.row[n]) for n, weight in weights.rows if weight]
        if not self._problem.in_box:
            rows = [(1, substituted(combined(rows, spend), self.x.images))]
        beside = (
            Polynomial(products, of_products - of_rows, spend),
            Polynomial(squares, of_tangents - 2 * power - of_rows, spend),
            *more,
        )
        return combined([*rows, *((1, p) for p in beside)], spend).times(1, of_rows)

    def excludes(self, weights: Weights) -> bool:
        """Whether no solution lies in the box: the aggregate is positive on it."""
        return self._least(self.aggregate(weights)) > 0

    def bound(self, i: int, side: str, weights: Weights) -> F:
        """Every solution in the box has x_i at least ("lo") or at most ("hi") this, as aggregate <= 0 there."""
        sign = 1 if side == "lo" else -1
        u = Polynomial({self._u[i]: sign}, -weights.exponents[0], self.x.spend)
        return self.x.center(i) + sign * self.x.radius(i) * self._least(self.aggregate(weights, u))

    def _least(self, p: Polynomial) -> F:
        self.x.spend(100 + 2 * p.size)
        return least(p, signed(len(self.x)))


def hitting_set(
    family: Collection[frozenset[Any]], most: int, spend: Callable[[int], Any] = _none
) -> frozenset[Any] | None:
    """At most `most` numbers of which every set of the family holds one; None where there are none.

    Each number meets no more sets than it is in; of a smallest set one after the other is tried, of many sets first.
    """
    if not family:
        return frozenset()
    counts = Counter(chain.from_iterable(family))
    spend(20 + counts.total())
    if len(family) > most * max(counts.values(), default=0):
        return None
    smallest = min(family, key=len)
    for k in sorted(smallest, key=lambda k: (-counts[k], k)):
        found = hitting_set([one for one in family if k not in one], most - 1, spend)
        if found is not None:
            return found | {k}
    return None
