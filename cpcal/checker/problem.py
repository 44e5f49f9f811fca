"""What a certificate is about: constraints with readings, and what they say in the coordinates of a box."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction as F
from functools import lru_cache

from .exact_polynomial import (
    FIELD,
    READINGS,
    Kept,
    Polynomial,
    Spend,
    constant,
    least,
    products,
    settled,
    signed,
    substituted,
)

SIDES = ("upper", "lower", "sign", "body")
_MOST_SETS = 8  # of products on one box, by the readings and their signs


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
    """The unknowns on a box: x_i = center_i + radius_i u_i, and readings, as polynomials in u and y."""

    def __init__(self, box: Box, spend: Spend) -> None:
        self.box, self.spend = box, spend
        self.images = lru_cache(_MOST_SETS)(self._images)

    def __len__(self) -> int:
        return len(self.box.lo)

    def center(self, i: int) -> F:
        return (self.box.lo[i] + self.box.hi[i]) / 2

    def radius(self, i: int) -> F:
        return (self.box.hi[i] - self.box.lo[i]) / 2

    def variable(self, field: int, middle: F, factor: F) -> Polynomial:
        """middle + factor * the variable in that field."""
        number, u = constant(middle, self.spend), Polynomial({1 << FIELD * field: 1}, 0, self.spend)
        return number + u * constant(factor, self.spend)

    def _images(self, radii: tuple[F, ...], signs: str, way: int = 0) -> Kept:
        """What is put for each monomial in x and readings.

        A reading is radius y about 0, |y| <= 1, or from its end, 0 <= y <= 1. `way`: 1 for the reading that the signs
        name itself, -1 for the opposite one.
        """

        def image(field: int) -> Polynomial:
            if field >= READINGS:
                return self.variable(field, self.center(field - READINGS), self.radius(field - READINGS))
            end, factor = {"-": (-1, 2), "0": (0, 1), "+": (1, -2)}[signs[field]]
            return self.variable(field, (way or 1) * end * radii[field], F(0) if way else factor * radii[field])

        return products(image, self.spend)


@dataclass(frozen=True)
class Constraint:
    """`at_least <= sqrt(body / factor) <= at_most` where there is a factor > 0; else `at_least <= body <= at_most`.

    None: no bound. `sure`: at_least is not negative at any solution.
    `also`: more polynomials that are at most zero, by their side.
    """

    body: Polynomial
    at_least: Polynomial | None
    at_most: Polynomial | None
    factor: Polynomial | None = None
    sure: bool = False
    also: Mapping[str, Polynomial] = field(default_factory=dict)

    def on(self, images: Kept) -> Constraint:
        """With what is put for each monomial; of one whose factor is a number."""
        low, high = (None if p is None else substituted(p, images) for p in (self.at_least, self.at_most))
        return Constraint(substituted(self.body, images), low, high, self.factor)

    def row(self, side: str, mask: int) -> Polynomial:
        """At most zero at every solution; the zero polynomial where there is no such bound."""
        body, low, high, factor = self.body, self.at_least, self.at_most, self.factor
        if side in self.also:
            return self.also[side]
        if side == "upper" and high is not None:
            return body - (high if factor is None else factor * (high * high))
        if side == "lower" and low is not None:
            if factor is None:
                return low - body
            beyond = F(0) if self.sure else min(F(0), least(low, mask))
            penalty = -least(factor.times(-1), mask) * beyond**2 if beyond else F(0)
            return factor * (low * low) - body - constant(penalty, body.spend)
        if side == "sign" and high is not None and factor is not None:
            return high.times(-1)
        return body.times(-1) if side == "body" and factor is not None else body.times(0)


def _exact(k: int) -> tuple[F, ...]:
    """Of constraints without readings."""
    return ()


@dataclass(frozen=True)
class Problem:
    """Constraints in some unknowns; `chosen`: the ascending numbers of those that count, of `count`."""

    unknowns: tuple[str, ...]
    objective: int | None
    count: int
    chosen: tuple[int, ...]
    constraint: Callable[[int, Kept], Constraint]  # with what is put for each monomial in x and readings
    radii: Callable[[int], tuple[F, ...]] = _exact  # of readings m: |m_j| <= radii_j
    sides: tuple[str, ...] = SIDES
    model: str | None = None  # of a leg; None: the certificate states the constraints

    def row(self, x: Unknowns, side: str, k: int, signs: str) -> Polynomial:
        """In u, at most zero at every solution in the box: at the reference reading, less the penalties."""
        mask = signed(len(x), signs)
        return settled(self.constraint(k, x.images(self.radii(k), signs)).row(side, mask), signs, mask)

    def holds(self, x: Unknowns, k: int, signs: str) -> bool:
        """Whether it is proved that the point, a box of width zero, satisfies k for some reading between two ends."""
        long, short = (self.constraint(k, x.images(self.radii(k), signs, way)) for way in (1, -1))
        sides = {side: short if side in ("upper", "sign") else long for side in (*SIDES, *long.also)}
        return all(at.row(side, 0).constant <= 0 for side, at in sides.items())

    def fails(self, x: Unknowns, side: str, k: int, signs: str) -> bool:
        """Whether it is proved that it does not for any reading."""
        return least(self.row(x, side, k, signs), 0) > 0
