"""What a certificate is about: constraints with readings, and what they say in the coordinates of a box."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property
from typing import Protocol

from .exact_polynomial import (
    FIELD,
    READINGS,
    Kept,
    Polynomial,
    Spend,
    constant,
    least,
    products,
    signed,
    substituted,
)
from .program import Numbers, dyadics

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

    def holds(self, lo: Sequence[F], hi: Sequence[F]) -> bool:
        """Whether another box lies in it."""
        return all(a <= b and c <= d for a, b, c, d in zip(self.lo, lo, hi, self.hi, strict=True))


class Unknowns:
    """The unknowns on a box: x_i = center_i + radius_i u_i."""

    def __init__(self, box: Box, spend: Spend) -> None:
        self.box, self.spend = box, spend

    def __len__(self) -> int:
        return len(self.box.lo)

    def center(self, i: int) -> F:
        return (self.box.lo[i] + self.box.hi[i]) / 2

    def radius(self, i: int) -> F:
        return (self.box.hi[i] - self.box.lo[i]) / 2

    @cached_property
    def moves(self) -> bool:
        """Whether the box has a width."""
        return self.box.lo != self.box.hi

    @cached_property
    def numbers(self) -> Numbers:
        """Centers, and radii of a box that has a width, as programs take them: where the unknowns are few."""
        each = range(len(self))
        return dyadics([*map(self.center, each), *(map(self.radius, each) if self.moves else ())])

    def variable(self, field: int, middle: F, factor: F) -> Polynomial:
        """middle + factor * the variable in that field."""
        number, u = constant(middle, self.spend), Polynomial({1 << FIELD * field: 1}, 0, self.spend)
        return number + u * constant(factor, self.spend)

    @cached_property
    def images(self) -> Kept:
        """What is put for each monomial in x."""

        def image(field: int) -> Polynomial:
            return self.variable(field, self.center(field - READINGS), self.radius(field - READINGS))

        return products(image, self.spend)


class OnBox(Protocol):
    """A constraint in the coordinates of a box, and of its readings."""

    def holds(self, sides: tuple[str, ...]) -> bool:
        """Whether it is proved of these sides at a point, a box of width zero, and one reading."""
        ...

    def settled(self, side: str, signs: str, mask: int) -> Polynomial:
        """A row at the reference reading, less the penalties."""
        ...


@dataclass(frozen=True)
class Constraint:
    """`at_least <= sqrt(body / factor) <= at_most` where there is a factor > 0; else `at_least <= body <= at_most`.

    None: no bound. There are no readings, and a factor is a number.
    """

    body: Polynomial
    at_least: Polynomial | None
    at_most: Polynomial | None
    factor: Polynomial | None = None

    def on(self, images: Kept) -> Constraint:
        """With what is put for each monomial."""
        low, high = (None if p is None else substituted(p, images) for p in (self.at_least, self.at_most))
        return Constraint(substituted(self.body, images), low, high, self.factor)

    def holds(self, sides: tuple[str, ...]) -> bool:
        return all(self.settled(side, "", 0).constant <= 0 for side in sides)

    def settled(self, side: str, signs: str, mask: int) -> Polynomial:
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


def beyond(at_least: Polynomial, factor: Polynomial, mask: int) -> F:
    """The most that `factor at_least^2` can be where at_least is negative: what a "lower" row must give away."""
    lowest = min(F(0), least(at_least, mask))
    return -least(factor.times(-1), mask) * lowest**2 if lowest else F(0)


# A reading is the first number plus the second times y, in half-widths: |y| <= 1 about 0, or 0 <= y <= 1 from its end.
# With `way` 1 it is the reading that its sign names itself, -1 the opposite one.
ENDS = {"-": (-1, 2), "0": (0, 1), "+": (1, -2)}


def _exact(k: int) -> tuple[int, ...]:
    """Of constraints without readings."""
    return ()


@dataclass(frozen=True)
class Problem:
    """Constraints in some unknowns; `chosen`: the ascending numbers of those that count, of `count`."""

    unknowns: tuple[str, ...]
    objective: int | None
    count: int
    chosen: tuple[int, ...]
    constraint: Callable[[int, Unknowns, str, int], OnBox]  # k on a box with signs of a reading, and its `way`
    radii: Callable[[int], tuple[int, ...]] = _exact  # of the readings of k: 0 where they are exact
    sides: tuple[str, ...] = SIDES
    conditions: tuple[str, ...] = SIDES  # sides that are at most zero at a solution
    model: str | None = None  # of a leg; None: the certificate states the constraints

    def row(self, x: Unknowns, side: str, k: int, signs: str) -> Polynomial:
        """In u, at most zero at every solution in the box: at the reference reading, less the penalties."""
        return self.constraint(k, x, signs, 0).settled(side, signs, signed(len(x), signs))

    def holds(self, x: Unknowns, k: int, signs: str) -> bool:
        """Whether it is proved that the point, a box of width zero, satisfies k for some reading between two ends."""
        ends = ((1, self.below), (-1, self.above)) if any(self.radii(k)) else ((1, self.conditions),)
        return all(self.constraint(k, x, signs, way).holds(sides) for way, sides in ends)

    @cached_property
    def above(self) -> tuple[str, ...]:
        """The conditions that are asked at the far end of a reading set."""
        return tuple(side for side in self.conditions if side in ("upper", "sign"))

    @cached_property
    def below(self) -> tuple[str, ...]:
        return tuple(side for side in self.conditions if side not in self.above)

    def fails(self, x: Unknowns, side: str, k: int, signs: str) -> bool:
        """Whether it is proved that it does not for any reading."""
        return least(self.row(x, side, k, signs), 0) > 0
