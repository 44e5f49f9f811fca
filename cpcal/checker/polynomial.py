"""Polynomials with exact coefficients, and boxes. Standard library only; part of the checker.

A polynomial is a dict from sorted tuples of unknowns to numbers: {(): 3, (0, 1): 2} is 3 + 2 x0 x1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property
from typing import cast

Polynomial = dict[tuple[int, ...], F]
Vector = Sequence[F]
ZERO = cast(F, 0)  # an int, so that it mixes with every kind of exact number


@dataclass(frozen=True)
class ExactBox:
    """lo <= x <= hi."""

    lo: tuple[F, ...]
    hi: tuple[F, ...]

    @cached_property
    def center(self) -> tuple[F, ...]:
        return tuple((a + b) / 2 for a, b in zip(self.lo, self.hi, strict=True))

    @cached_property
    def radius(self) -> tuple[F, ...]:
        return tuple((b - a) / 2 for a, b in zip(self.lo, self.hi, strict=True))


def add(p: Polynomial, monomial: tuple[int, ...], coefficient: F) -> None:
    key = tuple(sorted(monomial))
    p[key] = p.get(key, ZERO) + coefficient


def combined(*weighted: tuple[F | int, Polynomial]) -> Polynomial:
    """Sum of multiples of polynomials."""
    out: Polynomial = {}
    for factor, p in weighted:
        for monomial, c in p.items():
            add(out, monomial, factor * c)
    return out


def product(p: Polynomial, q: Polynomial) -> Polynomial:
    out: Polynomial = {}
    for m, c in p.items():
        for n, d in q.items():
            add(out, m + n, c * d)
    return out


def square(p: Polynomial) -> Polynomial:
    return product(p, p)


def value(p: Polynomial, x: Vector) -> F:
    """At a point."""
    total = ZERO
    for monomial, c in p.items():
        for i in monomial:
            c = c * x[i]
        total += c
    return total


def shifted(p: Polynomial, box: ExactBox) -> Polynomial:
    """The polynomial in u, where x_i = center_i + radius_i u_i."""
    out: Polynomial = {}
    for monomial, c in p.items():
        terms: Polynomial = {(): c}
        for i in monomial:  # times (center + radius u_i)
            grown: Polynomial = {}
            for m, d in terms.items():
                if box.center[i]:
                    grown[m] = grown.get(m, ZERO) + d * box.center[i]
                if box.radius[i]:
                    add(grown, (*m, i), d * box.radius[i])
            terms = grown
        for m, d in terms.items():
            out[m] = out.get(m, ZERO) + d
    return out


def least(p: Polynomial) -> F:
    """A lower bound over |u| <= 1: a product of squares lies in [0, 1], any other monomial in [-1, 1]."""
    total = ZERO
    for monomial, c in p.items():
        if not monomial:
            total += c
        elif monomial[::2] == monomial[1::2]:
            total += min(c, ZERO)
        else:
            total -= abs(c)
    return total


def span(p: Polynomial) -> tuple[F, F]:
    """Midpoint and radius of an enclosure over |u| <= 1."""
    return p.get((), ZERO), sum((abs(c) for monomial, c in p.items() if monomial), ZERO)
