"""A network's constraints in exact polynomials, for the problem section of a certificate.

Only what has such a form: sums and products of exact numbers and unknowns, and in each constraint at most one square
root with a constant factor. Readings, enclosures of constants and other operations have none: NotStated says where.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction as F
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cpcal.checker import FORMAT, Refused
from cpcal.checker.certificate import Given, polynomial
from cpcal.checker.polynomial import Form, constant
from cpcal.checker.rule import SIDES, Constraint, Problem, Unknowns
from cpcal.checker.rule import Box as ExactBox
from cpcal.common.errors import ModelError
from cpcal.common.files import listed
from cpcal.common.values import AnyArray, Json, Places
from cpcal.solver.interval import Box
from cpcal.solver.network.expression import Constraint as NetworkConstraint
from cpcal.solver.network.expression import Expr, sqr
from cpcal.solver.network.forms import NotExact, exactly
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.polynomial import isolated

# ------------------------------------------------------------------------------------------------------------------
# What a certificate is about, as the writer needs it: the exact problem, its first lines, and where weights go.

_DIGITS = 64  # of a number, on either side of the point, at most
LONGEST = 2 * 4 * _DIGITS  # bits
HIGHEST_POWER = 1100  # of two, in a number of the format


class Stated(NamedTuple):
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


Sides = dict[tuple[int, int], tuple[str, Sequence[int]]]


class Statement(NamedTuple):
    """A problem, and how a certificate states it.

    head   the first line, but for the box of all unknowns; `items`: constraints that the certificate states itself
    sides  by constraint of a network and part (its polynomial rows, in order): the side of the problem's rows, and
           their numbers, element by element
    """

    problem: Problem
    head: Json
    sides: Sides
    items: tuple[Stated, ...] = ()

    def place(self, constraint: int, part: int, element: int) -> tuple[str, int]:
        """Side and number, in the problem, of one polynomial row of a network's constraint."""
        side, numbers = self.sides[constraint, part]
        return side, numbers[element]

    def header(self, domain: Box) -> Iterator[Json]:
        """The first lines, for the box of all unknowns."""
        yield {**self.head, **limits(domain)}
        for c in self.items:
            parts = {"body": c.body, "at_least": c.at_least, "at_most": c.at_most}
            yield {"name": c.name, "root": c.root, **{k: p and _polynomial(p) for k, p in parts.items()}}


def stated_leg(problem: Problem, sha256: str, leg: int, only: Places | None, forms: Sequence[Given]) -> Statement:
    """One leg of a campaign with that SHA-256, with all measurements or `only` some."""
    head = {
        "format": FORMAT,
        "campaign": sha256,
        "leg": leg,
        "model": problem.model,
        "measurements": problem.count - len(forms),
        "only": None if only is None else list(only),
        **({"forms": [_polynomial(form) for form in forms]} if forms else {}),
    }
    return Statement(problem, head, leg_sides(problem, problem.count - len(forms), only))


def leg_sides(problem: Problem, count: int, only: Places | None, first: int = 0) -> Sides:
    """Where the rows of a leg's network of `count` measurements stand; its third constraint is of the leg's forms,
    from number `first` on.

    -(L + l + t + eps) <= 0, which no proof needs, is taken for the length row.
    """
    numbers: Sequence[int] = range(count) if only is None else only
    forms: Sequence[int] = range(count + first, problem.count)
    places = {(0, 0): "length", (0, 1): "upper", (0, 2): "lower", (1, 0): "length"}
    sides = {place: (side, numbers) for place, side in places.items()}
    return sides | {(2, part): (side, forms) for part, side in enumerate(SIDES)}


def exact_box(box: Box) -> ExactBox:
    """As the checker has it."""
    return ExactBox(*(tuple(map(F, side.tolist())) for side in (box.lo, box.hi)))


def _polynomial(p: Given) -> list[Any]:
    return [[list(monomial), number(c)] for monomial, c in sorted(p) if c]


def limits(box: Box | ExactBox) -> dict[str, list[str]]:
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


Objects = AnyArray


class NotStated(ModelError):
    """The constraints have no form that a certificate can hold."""


def network_statement(network: ConstraintNetwork, objective: str | None, about: str = "") -> Statement:
    """The network's constraints, element by element, exactly. Raises NotStated."""
    items = list[Stated]()
    constraints = list[Constraint]()
    sides: Sides = {}
    exact = ExactPolynomials(network)
    for c, constraint in enumerate(network.constraints):
        try:
            found, own = _stated(f"c{c}", constraint, exact)
            constraints += [item.constraint() for item in found]
        except (NotStated, Refused) as reason:
            raise NotStated(f"constraint {c} cannot be certified: {reason}") from None
        sides |= {(c, part): (side, range(len(items), len(constraints))) for part, side in enumerate(own)}
        items += found
    endless = [name for name in network.names if not network.domain[name].is_bounded]
    if endless:
        raise NotStated(f"a certificate is about a bounded box: give {listed(endless)} a finite domain")
    goal = None if objective is None else network.names.index(objective)
    problem = Problem(network.names, goal, len(items), tuple(range(len(items))), partial(_on, constraints))
    head = {
        "format": FORMAT,
        "about": about,
        "unknowns": list(network.names),
        "objective": goal,
        "constraints": len(items),
    }
    return Statement(problem, head, sides, tuple(items))


def _on(constraints: Sequence[Constraint], k: int, x: Unknowns, *_: object) -> Constraint:
    """On a box; there are no readings. Of the module, so that a statement travels."""
    return constraints[k].on(x.images)


def _stated(name: str, constraint: NetworkConstraint, exact: ExactPolynomials) -> tuple[list[Stated], list[str]]:
    """The elements of one constraint, and the sides of its polynomial rows in the order of `network.polynomial`."""
    shape, root = constraint.body.shape, isolated(constraint.body, "sqrt")
    low, high = _bound(constraint.lower, exact, shape), _bound(constraint.upper, exact, shape)
    upper, lower = ["upper"], ["lower"]
    if root is None:
        body = exact.of(constraint.body)
    else:
        (factor, node, rest), upper = root, ["sign", "upper"]
        body, others = exact.of(sqr(factor) * node.args[0]), exact.of(rest)
        signs = {c.terms.get((), 0) > 0 for c in exact.of(factor).ravel()}
        if signs == {True}:
            low, high = _minus(low, others), _minus(high, others)
        elif signs == {False}:  # rest - sqrt(u) between low and high
            low, high = _minus(others, high), _minus(others, low)
            upper, lower = lower, upper
        else:
            raise NotStated("the factor of the square root changes its sign")
    bounds = ((upper, constraint.upper, np.inf), (lower, constraint.lower, -np.inf))
    rows = [r for own, bound, none in bounds if bound.op != "constant" or (bound.data.lo != none).any() for r in own]
    elements = [np.broadcast_to(np.asarray(p, object), shape).ravel() for p in (body, low, high)]
    checked = [[None if p is None else _checked(p) for p in part] for part in elements]
    items = [Stated(f"{name}[{k}]", root is not None, *parts) for k, parts in enumerate(zip(*checked, strict=True))]
    return items, rows


def _bound(bound: Expr, exact: ExactPolynomials, shape: tuple[int, ...]) -> Objects | None:
    """Element by element, None where it is infinite."""
    if np.isinf(bound.data.lo).any():
        if not np.all(bound.data.lo == bound.data.hi):
            raise NotStated("a bound is known to an interval only")
        return np.asarray(_numbers(np.broadcast_to(bound.data.lo, shape)), object)
    return exact.of(bound)


def _checked(p: _Poly) -> Given:
    for c in p.terms.values():
        power = 4 * HIGHEST_POWER if c.denominator & (c.denominator - 1) else c.denominator.bit_length()
        n = abs(c.numerator)
        bits = n.bit_length() - (n & -n).bit_length() + 1  # of the odd mantissa
        if power > HIGHEST_POWER or abs(c) >= F(2) ** HIGHEST_POWER or bits > LONGEST:
            raise NotStated("a coefficient has no short exact form in binary: multiply the divisor out")
    return tuple(p.terms.items())


_minus: Any = np.frompyfunc(lambda a, b: None if a is None or b is None else a - b, 2, 1)


class _Poly(Form):
    """That numpy's object arrays take for a number."""

    __slots__ = ()

    def __neg__(self) -> _Poly:
        return self * -1

    def __truediv__(self, other: _Poly) -> _Poly:
        if set(other.terms) != {()}:
            raise NotStated("it divides by an expression with unknowns, or by zero")
        return self * F(1, other.terms[()])


class ExactPolynomials:
    """Evaluates expressions to arrays of polynomials; every node once."""

    def __init__(self, network: ConstraintNetwork) -> None:
        places = network.places.items()
        self._known = {leaf: np.asarray(_unknowns(k), object) for leaf, k in places}

    def of(self, root: Expr) -> Objects:
        """Raises NotStated."""
        try:
            return np.asarray(exactly(root, self._known, _number))
        except NotExact as reason:
            raise NotStated(str(reason)) from None


def _number(value: float) -> _Poly:
    return _Poly({(): F(value)})


_unknowns: Any = np.frompyfunc(lambda k: _Poly({(int(k),): F(1)}), 1, 1)
_numbers: Any = np.frompyfunc(lambda v: _number(v) if math.isfinite(v) else None, 1, 1)
