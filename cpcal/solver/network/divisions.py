"""Divisions by expressions of one sign on the domain, multiplied out: `u / v <= w` is `u <= w v` where v > 0.

What is left is polynomial, if numerators and divisors are, so that linear relaxations and certificates can use it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from cpcal.solver.interval import Box
from cpcal.solver.network.dag import topological
from cpcal.solver.network.expression import Constraint, Expr, as_expr
from cpcal.solver.network.forms import evaluate
from cpcal.solver.network.network import ConstraintNetwork

_MOST = 12  # divisors of one row: beyond, the products get longer than they are worth

Divisors = Counter[Expr]


def multiplied_out(network: ConstraintNetwork) -> list[tuple[int, list[Constraint]]]:
    """The constraints with such divisions, by number, and what each is equivalent to on the domain."""
    out = []
    for number, constraint in enumerate(network.constraints):
        if any(_divides(node) for node in topological((constraint.body, constraint.lower, constraint.upper))):
            found = _without_divisions(network, constraint)
            if found is not None:
                out.append((number, found))
    return out


def with_products(network: ConstraintNetwork, *, instead: bool = False) -> tuple[ConstraintNetwork, list[int]]:
    """The network with those equivalents besides, or instead of the constraints with divisions.

    And for each of its constraints the number of the one that it stands for.
    """
    found = dict(multiplied_out(network))
    if not found:
        return network, list(range(len(network.constraints)))
    out, origin = network.without_constraints(), list[int]()
    for number, constraint in enumerate(network.constraints):
        stated = found.get(number, [])
        stated = stated if number in found and instead else [constraint, *stated]
        out.add(stated)
        origin += [number] * len(stated)
    return out, origin


def _divides(node: Expr) -> bool:
    return (node.op == "div" and not _constant(node.args[1])) or (node.op == "power" and node.parameter < 0)


def _constant(expr: Expr) -> bool:
    return all(node.args or node.op == "constant" for node in topological((expr,)))


def _without_divisions(network: ConstraintNetwork, constraint: Constraint) -> list[Constraint] | None:
    """Equivalent constraints, or None where a divisor's sign is not known."""
    body, lower, upper = constraint.body, constraint.lower, constraint.upper
    if lower.digest == upper.digest:
        found = _product(network, body - lower)
        return None if found is None else [found[0] == 0.0]
    out = []
    for bound, sign in ((upper, 1.0), (lower, -1.0)):
        infinite = bound.op == "constant" and bool(np.all(bound.data.lo == sign * np.inf))  # type: ignore[union-attr]
        if infinite:
            continue
        found = _product(network, body - bound if sign > 0.0 else bound - body)
        if found is None:
            return None
        out.append(found[0] * found[1] <= 0.0)
    return out


def _product(network: ConstraintNetwork, row: Expr) -> tuple[Expr, float] | None:
    """The row times its divisors, and the sign of their product."""
    numerator, divisors = _Ratio().of(row)
    if not divisors or divisors.total() > _MOST:
        return None
    sign = 1.0
    for divisor, count in divisors.items():
        one = _sign(network, divisor, network.domain)
        if not one:
            return None
        sign *= one**count
    return numerator, sign


def _sign(network: ConstraintNetwork, expr: Expr, box: Box) -> float:
    """1 or -1 where the expression has that sign on all of the box, else 0."""
    values = evaluate(network, expr, box)
    return float(np.all(values.lo > 0.0)) - float(np.all(values.hi < 0.0))


class _Ratio:
    """Expressions as a numerator over a product of divisors; each divisor is one node, whatever it is made of."""

    def __init__(self) -> None:
        self._same: dict[bytes, Expr] = {}  # one object for equal expressions, so that counters find them

    def of(self, root: Expr) -> tuple[Expr, Divisors]:
        done: dict[bytes, tuple[Expr, Divisors]] = {}
        for node in topological((root,)):
            done[node.digest] = self._node(node, [done[arg.digest] for arg in node.args])
        return done[root.digest]

    def _node(self, node: Expr, args: list[tuple[Expr, Divisors]]) -> tuple[Expr, Divisors]:
        if not any(divisors for _, divisors in args) and not _divides(node):
            return node, Counter()
        if node.op == "neg":
            return -args[0][0], args[0][1]
        if node.op in ("add", "sub"):
            return self._added(node.op, *args)
        if node.op == "mul":
            return args[0][0] * args[1][0], args[0][1] + args[1][1]
        if node.op == "div":
            (top, below), (divisor, above) = args
            if _constant(divisor):
                return top / divisor, below
            return _times(top, above.elements()), below + self._factors(divisor)
        if node.op == "sqr":
            return args[0][0] * args[0][0], args[0][1] + args[0][1]
        if node.op == "power" and node.parameter < 0 and not args[0][1]:
            factors = self._factors(args[0][0])
            return as_expr(np.ones(node.shape)), Counter({k: -node.parameter * n for k, n in factors.items()})
        return node, Counter()

    def _added(self, op: str, one: tuple[Expr, Divisors], two: tuple[Expr, Divisors]) -> tuple[Expr, Divisors]:
        common = one[1] | two[1]  # the larger count of each
        left = _times(one[0], (common - one[1]).elements())
        right = _times(two[0], (common - two[1]).elements())
        return (left + right if op == "add" else left - right), common

    def _factors(self, divisor: Expr) -> Divisors:
        if divisor.op == "mul":
            parts = [part for part in divisor.args if not _constant(part)]
            if len(parts) == 2:
                return self._factors(parts[0]) + self._factors(parts[1])
        if divisor.op in ("sqr", "power") and (divisor.op == "sqr" or divisor.parameter > 0):
            count = 2 if divisor.op == "sqr" else divisor.parameter
            return Counter({k: count * n for k, n in self._factors(divisor.args[0]).items()})
        return Counter({self._same.setdefault(divisor.digest, divisor): 1})


def _times(expr: Expr, factors: Iterable[Expr]) -> Expr:
    for factor in factors:
        expr = expr * factor
    return expr
