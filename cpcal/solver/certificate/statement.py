"""What a certificate is about, as the writer needs it: the exact problem, its first lines, and where weights go."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from typing import Any, Protocol

from cpcal.checker import FORMAT
from cpcal.checker.exact_polynomial import constant
from cpcal.checker.header import polynomial
from cpcal.checker.problem import Constraint, Problem
from cpcal.solver.interval import Box

_DIGITS = 64  # of a number, on either side of the point, at most
LONGEST = 2 * 4 * _DIGITS  # bits
HIGHEST_POWER = 1100  # of two, in a number of the format


Given = tuple[tuple[tuple[int, ...], F], ...]  # a polynomial as a certificate states it: monomials, coefficients


@dataclass(frozen=True)
class Stated:
    """A constraint that the certificate states itself: `at_least <= body <= at_most`, or of the root of the body."""

    name: str
    root: bool
    body: Given
    at_least: Given | None
    at_most: Given | None

    def constraint(self) -> Constraint:
        """As the checker reads it."""
        low, high = (None if p is None else polynomial(p, free) for p in (self.at_least, self.at_most))
        return Constraint(polynomial(self.body, free), low, high, constant(F(1), free) if self.root else None)


def free(_: int) -> None:
    """Work that nobody limits."""


class Statement(Protocol):
    """A problem, and how it is written."""

    @property
    def problem(self) -> Problem: ...

    def place(self, constraint: int, part: int, element: int) -> tuple[str, int] | None:
        """Side and number, in the problem, of the polynomial row `part` of an element of a network's constraint."""
        ...

    def header(self, domain: Box) -> Iterator[dict[str, Any]]:
        """The first lines, for the box of all unknowns."""
        ...


# parts of the leg network's constraints: -(L + l + t + eps) <= 0, which no proof needs, is taken for the length row
_LEG_SIDES = {(0, 0): "length", (0, 1): "upper", (0, 2): "lower", (1, 0): "length"}


@dataclass(frozen=True)
class LegStatement:
    """One leg of a campaign with that SHA-256; `only`: the measurements of the network, if they are not all."""

    problem: Problem
    sha256: str
    leg: int
    only: tuple[int, ...] | None = None

    def place(self, constraint: int, part: int, element: int) -> tuple[str, int] | None:
        return _LEG_SIDES[constraint, part], element if self.only is None else self.only[element]

    def header(self, domain: Box) -> Iterator[dict[str, Any]]:
        yield {
            "format": FORMAT,
            "campaign": self.sha256,
            "leg": self.leg,
            "model": self.problem.model,
            "measurements": self.problem.count,
            "only": None if self.only is None else list(self.only),
            **limits(domain),
        }


@dataclass(frozen=True)
class NetworkStatement:
    """Constraints that the certificate states itself. `sides`: by constraint of the network the side of each part;
    `start`: the number of its first element."""

    problem: Problem
    items: tuple[Stated, ...]
    about: str
    sides: Mapping[int, Sequence[str]]
    start: Mapping[int, int]

    def place(self, constraint: int, part: int, element: int) -> tuple[str, int] | None:
        return self.sides[constraint][part], self.start[constraint] + element

    def header(self, domain: Box) -> Iterator[dict[str, Any]]:
        yield {
            "format": FORMAT,
            "about": self.about,
            "unknowns": list(self.problem.unknowns),
            "objective": self.problem.objective,
            "constraints": self.problem.count,
            **limits(domain),
        }
        for c in self.items:
            yield _constraint(c)


def _constraint(c: Stated) -> dict[str, Any]:
    parts = {"body": c.body, "at_least": c.at_least, "at_most": c.at_most}
    return {"name": c.name, "root": c.root} | {k: None if p is None else _polynomial(p) for k, p in parts.items()}


def _polynomial(p: Given) -> list[Any]:
    return [[list(monomial), number(c)] for monomial, c in sorted(p) if c]


def limits(box: Box) -> dict[str, list[str]]:
    return {"lo": [number(v) for v in box.lo], "hi": [number(v) for v in box.hi]}


def number(value: F | float) -> str:
    """The hexadecimal text of a dyadic number, an odd mantissa and an exponent."""
    numerator, denominator = F(value).as_integer_ratio()
    exponent = 1 - denominator.bit_length()
    if numerator:
        zeros = (numerator & -numerator).bit_length() - 1
        numerator, exponent = numerator >> zeros, exponent + zeros
    digits, behind = f"{abs(numerator):x}", ""
    if len(digits) > _DIGITS:  # as many again fit behind the point
        digits, behind, exponent = digits[:-_DIGITS], f".{digits[-_DIGITS:]}", exponent + 4 * _DIGITS
    return f"{'-' if numerator < 0 else ''}0x{digits}{behind}p{exponent:+d}"
