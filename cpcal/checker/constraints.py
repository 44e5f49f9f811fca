"""A problem whose constraints stand in the certificate itself. Standard library only; part of the checker."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction as F
from typing import Any

from cpcal.checker.lines import Lines
from cpcal.checker.polynomial import ZERO, ExactBox, Polynomial, combined, least, shifted, square, value

MOST_UNKNOWNS = 1000
_MOST = 100_000  # constraints
_HIGHEST = 8  # degree
_MOST_TERMS = 5_000_000  # of all constraints, so that memory stays bounded


@dataclass(frozen=True)
class Constraint:
    """`at_least <= body <= at_most`, or the same of sqrt(body); None: no bound on that side."""

    name: str
    root: bool
    body: Polynomial
    at_least: Polynomial | None
    at_most: Polynomial | None


@dataclass(frozen=True)
class Constraints:
    """Polynomial constraints in named unknowns."""

    unknowns: tuple[str, ...]
    objective: int | None
    items: tuple[Constraint, ...]
    sides: tuple[str, ...] = ("upper", "lower", "sign")

    @property
    def count(self) -> int:
        return len(self.items)

    @property
    def chosen(self) -> tuple[int, ...]:
        return tuple(range(len(self.items)))

    def row(self, side: str, k: int, box: ExactBox) -> Polynomial:
        c = self.items[k]
        bound = c.at_least if side == "lower" else c.at_most
        if bound is None or (side == "sign" and not c.root):
            return {}
        if side == "sign":
            return combined((-1, bound))
        if not c.root:
            return combined((1, c.body), (-1, bound)) if side == "upper" else combined((1, bound), (-1, c.body))
        if side == "upper":
            return combined((1, c.body), (-1, square(bound)))
        slack = max(ZERO, -least(shifted(bound, box)))  # where the bound is negative, its square is at most slack^2
        return combined((1, square(bound)), (-1, c.body), (-1, {(): slack * slack}))

    def holds(self, k: int, point: tuple[F, ...]) -> bool:
        c = self.items[k]
        body = value(c.body, point)
        low, high = (None if p is None else value(p, point) for p in (c.at_least, c.at_most))
        if not c.root:
            return (low is None or low <= body) and (high is None or body <= high)
        if body < 0 or (high is not None and (high < 0 or body > high * high)):
            return False
        return low is None or low <= 0 or low * low <= body

    def fails(self, k: int, point: tuple[F, ...]) -> bool:
        return not self.holds(k, point)


def read_unknowns(lines: Lines, unknowns: Any) -> tuple[str, ...]:
    names = tuple(lines.list(unknowns))
    if not 0 < len(names) <= MOST_UNKNOWNS:
        raise lines.refused(f"there must be from 1 to {MOST_UNKNOWNS} unknowns")
    if any(not isinstance(n, str) for n in names) or len(set(names)) < len(names):
        raise lines.refused("the unknowns need a name each, and one of their own")
    return names


def read_constraints(lines: Lines, names: tuple[str, ...], objective: int | None, number: int) -> Constraints:
    """The constraints, one on each of the following lines."""
    if number > _MOST:
        raise lines.refused(f"there are more than {_MOST} constraints")
    items: list[Constraint] = []
    room = _MOST_TERMS
    for _ in range(number):
        given = lines.keys(lines.following("all constraints"), "name", "root", "body", "at_least", "at_most")
        name, root, body, low, high = given
        if not isinstance(name, str) or type(root) is not bool:
            raise lines.refused("a constraint has a name, and root is true or false")
        room -= sum(len(p) for p in (body, low, high) if isinstance(p, list))
        if room < 0:
            raise lines.refused(f"the constraints have more than {_MOST_TERMS} terms")
        parts = (_polynomial(lines, p, len(names)) for p in (body, low, high))
        body, low, high = parts
        if body is None:
            raise lines.refused("a constraint has a body")
        items.append(Constraint(name, root, body, low, high))
    return Constraints(names, objective, tuple(items))


def _polynomial(lines: Lines, value: Any, unknowns: int) -> Polynomial | None:
    if value is None:
        return None
    out: Polynomial = {}
    for entry in lines.list(value):
        monomial, coefficient = lines.list(entry, 2)
        key = tuple(lines.integer(i, unknowns) for i in lines.list(monomial))
        if len(key) > _HIGHEST or key != tuple(sorted(key)) or key in out:
            raise lines.refused(f"monomials are sorted, of degree at most {_HIGHEST}, and stand once each")
        out[key] = lines.number(coefficient)
    return out
