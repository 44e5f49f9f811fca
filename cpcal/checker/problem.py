"""What a certificate is about: constraints with readings, as polynomials in the coordinates of a box."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from typing import Protocol

from .polynomial import FIELD, READINGS, Polynomial, combined, constant, least, settled, signed

_MOST_KEPT = 100_000  # terms of products of unknowns that are remembered
SIDES = ("upper", "lower", "sign", "body")


@dataclass(frozen=True)
class Box:
    """lo <= x <= hi."""

    lo: tuple[F, ...]
    hi: tuple[F, ...]

    def replaced(self, i: int, *, lo: F | None = None, hi: F | None = None) -> Box:
        """With other bounds on x_i."""
        low = self.lo if lo is None else (*self.lo[:i], lo, *self.lo[i + 1 :])
        return Box(low, self.hi if hi is None else (*self.hi[:i], hi, *self.hi[i + 1 :]))


class Unknowns:
    """The unknowns on a box as polynomials in u: x_i = center_i + radius_i u_i. Products are formed once."""

    def __init__(self, box: Box, spend: Callable[[int], None]) -> None:
        self.box, self.spend = box, spend
        self._known: dict[tuple[int, ...], Polynomial] = {}
        self._kept = 0

    def __len__(self) -> int:
        return len(self.box.lo)

    def __getitem__(self, i: int) -> Polynomial:
        return self.product((i,))

    def center(self, i: int) -> F:
        return (self.box.lo[i] + self.box.hi[i]) / 2

    def radius(self, i: int) -> F:
        return (self.box.hi[i] - self.box.lo[i]) / 2

    def number(self, value: F) -> Polynomial:
        return constant(value, self.spend)

    def variable(self, field: int, middle: F, factor: F) -> Polynomial:
        """middle + factor * the variable in that field."""
        u = Polynomial({1 << FIELD * field: 1}, 0, self.spend)
        return self.number(middle) + u * self.number(factor)

    def product(self, monomial: tuple[int, ...]) -> Polynomial:
        if monomial not in self._known:
            *others, i = monomial or (None,)
            if i is None:
                found = self.number(F(1))
            elif others:
                found = self.product(tuple(others)) * self[i]
            else:
                found = self.variable(READINGS + i, self.center(i), self.radius(i))
            self._kept += len(found.terms)
            if self._kept > _MOST_KEPT:
                self._known.clear()
                self._kept = len(found.terms)
            self._known[monomial] = found
        return self._known[monomial]

    def readings(self, radii: Sequence[F], signs: str) -> list[Polynomial]:
        """Each reading as a polynomial in y: radius y about 0, |y| <= 1, or from its end, 0 <= y <= 1."""
        ends = {"-": (-1, 2), "0": (0, 1), "+": (1, -2)}
        pairs = zip(radii, (ends[sign] for sign in signs), strict=True)
        return [self.variable(j, end * r, way * r) for j, (r, (end, way)) in enumerate(pairs)]

    def at_readings(self, radii: Sequence[F], signs: str, way: int) -> list[Polynomial]:
        """The reading itself (way 1), or the opposite one (-1), as numbers."""
        return [self.number(way * r * {"-": -1, "0": 0, "+": 1}[sign]) for r, sign in zip(radii, signs, strict=True)]


@dataclass(frozen=True)
class Constraint:
    """`at_least <= sqrt(body / factor) <= at_most` where there is a factor > 0; else `at_least <= body <= at_most`.

    None: no bound. `sure`: at_least is not negative at any solution. `also`: more polynomials that are at most zero.
    """

    body: Polynomial
    at_least: Polynomial | None
    at_most: Polynomial | None
    factor: Polynomial | None = None
    sure: bool = False
    also: tuple[Polynomial, ...] = ()

    def row(self, side: str, mask: int) -> Polynomial:
        """At most zero at every solution; the zero polynomial where there is no such bound."""
        body, low, high, factor = self.body, self.at_least, self.at_most, self.factor
        if side == "length":
            return self.also[0]
        if side == "upper" and high is not None:
            return body - (high if factor is None else factor * high.squared())
        if side == "lower" and low is not None:
            if factor is None:
                return low - body
            row = factor * low.squared() - body
            beyond = F(0) if self.sure else max(F(0), -least(low, mask))
            return row - constant(-least(factor.times(-1), mask) * beyond**2, body.spend) if beyond else row
        if side == "sign" and high is not None and factor is not None:
            return high.times(-1)
        return body.times(-1) if side == "body" and factor is not None else body.times(0)

    def below(self) -> bool:
        """Whether the upper bounds hold, all polynomials being numbers."""
        if self.at_most is None:
            return True
        body, high = self.body.constant, self.at_most.constant
        return body <= high if self.factor is None else high >= 0 and body <= self.factor.constant * high**2

    def above(self) -> bool:
        """Whether the others hold."""
        body, low = self.body.constant, None if self.at_least is None else self.at_least.constant
        if any(p.constant > 0 for p in self.also) or (self.factor is not None and body < 0):
            return False
        return low is None or (
            low <= body if self.factor is None else low <= 0 or self.factor.constant * low**2 <= body
        )


class Item(Protocol):
    """One measurement, or one constraint of a certificate's own."""

    @property
    def radii(self) -> tuple[F, ...]:
        """Half-widths of its readings, READINGS of them or none."""
        ...

    def at(self, x: Unknowns, readings: Sequence[Polynomial]) -> Constraint: ...


@dataclass(frozen=True)
class Problem:
    """Constraints in some unknowns; `chosen`: the ascending numbers of those that count, of `count`."""

    unknowns: tuple[str, ...]
    objective: int | None
    count: int
    chosen: tuple[int, ...]
    sides: tuple[str, ...]
    item: Callable[[int], Item]
    model: str | None = None  # of a leg; None: the certificate states the constraints

    def row(self, x: Unknowns, side: str, k: int, signs: str) -> Polynomial:
        """In u, at most zero at every solution in the box: at the reference reading, less the penalties."""
        item, mask = self.item(k), signed(len(x), signs)
        return settled(item.at(x, x.readings(item.radii, signs)).row(side, mask), signs, mask)

    def holds(self, x: Unknowns, k: int, signs: str) -> bool:
        """Whether it is proved that the point, a box of width zero, satisfies k for some reading between two ends."""
        item = self.item(k)
        long, short = (item.at(x, x.at_readings(item.radii, signs, way)) for way in (1, -1))
        return long.above() and short.below()

    def fails(self, x: Unknowns, side: str, k: int, signs: str) -> bool:
        """Whether it is proved that it does not for any reading."""
        return least(self.row(x, side, k, signs), 0) > 0


Given = tuple[tuple[tuple[int, ...], F], ...]  # a polynomial of a certificate: monomials and coefficients


@dataclass(frozen=True)
class Stated:
    """A constraint that the certificate states itself."""

    name: str
    root: bool
    body: Given
    at_least: Given | None
    at_most: Given | None
    radii: tuple[F, ...] = ()

    def at(self, x: Unknowns, readings: Sequence[Polynomial] = ()) -> Constraint:
        body, low, high = (None if p is None else substituted(p, x) for p in (self.body, self.at_least, self.at_most))
        assert body is not None
        return Constraint(body, low, high, x.number(F(1)) if self.root else None)


def substituted(given: Given, x: Unknowns) -> Polynomial:
    """The polynomial in u."""
    powers = ((c.numerator, 1 - c.denominator.bit_length(), monomial) for monomial, c in given)
    return combined(((c, x.product(monomial).times(1, power)) for c, power, monomial in powers), x.spend)
