"""A network's constraints in exact polynomials, for the problem section of a certificate.

Only what has such a form: sums and products of exact numbers and unknowns, and in each constraint at most one square
root with a constant factor. Readings, enclosures of constants and other operations have none: NotStated says where.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction as F
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.checker import Refused
from cpcal.checker.problem import Constraint, Problem, Unknowns
from cpcal.common.errors import ModelError
from cpcal.common.names import listed
from cpcal.solver.certificate.statement import HIGHEST_POWER, LONGEST, Given, NetworkStatement, Stated
from cpcal.solver.interval import IntervalArray
from cpcal.solver.network.dag import topological
from cpcal.solver.network.expression import Constraint as NetworkConstraint
from cpcal.solver.network.expression import Expr, as_expr
from cpcal.solver.network.mathematics import sqr
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.rewrite import terms

Objects = npt.NDArray[Any]
Terms = dict[tuple[int, ...], F]  # sorted unknowns of a monomial -> coefficient


class NotStated(ModelError):
    """The constraints have no form that a certificate can hold."""


def network_statement(network: ConstraintNetwork, objective: str | None, about: str = "") -> NetworkStatement:
    """The network's constraints, element by element, exactly. Raises NotStated."""
    items: list[Stated] = []
    constraints: list[Constraint] = []
    sides: dict[int, list[str]] = {}
    start: dict[int, int] = {}
    exact = ExactPolynomials(network)
    for number_, constraint in enumerate(network.constraints):
        try:
            found, sides[number_] = _stated(f"c{number_}", constraint, exact)
            constraints += [item.constraint() for item in found]
        except (NotStated, Refused) as reason:
            raise NotStated(f"constraint {number_} cannot be certified: {reason}") from None
        start[number_] = len(items)
        items += found
    endless = [name for name in network.names if not network.domain[name].is_bounded]
    if endless:
        raise NotStated(f"a certificate is about a bounded box: give {listed(endless)} a finite domain")
    goal = None if objective is None else network.names.index(objective)
    chosen = tuple(range(len(items)))
    problem = Problem(network.names, goal, len(items), chosen, partial(_on, constraints))
    return NetworkStatement(problem, tuple(items), about, sides, start)


def _on(constraints: Sequence[Constraint], k: int, x: Unknowns, *_: object) -> Constraint:
    """On a box; there are no readings. Of the module, so that a statement travels."""
    return constraints[k].on(x.images)


def _stated(name: str, constraint: NetworkConstraint, exact: ExactPolynomials) -> tuple[list[Stated], list[str]]:
    """The elements of one constraint, and the sides of its polynomial rows in the order of `network.rewrite`."""
    factor, node, rest = _root(constraint.body)
    shape = constraint.body.shape
    low, high = _bound(constraint.lower, exact, shape), _bound(constraint.upper, exact, shape)
    upper = ["sign", "upper"] if node is not None else ["upper"]
    lower = ["lower"]
    if node is None:
        body = exact.of(constraint.body)
    else:
        body, others = exact.of(sqr(factor) * node.args[0]), exact.of(rest)
        signs = {c.constant > 0 for c in exact.of(factor).ravel()}
        if signs == {True}:
            low, high = _less(low, others), _less(high, others)
        elif signs == {False}:  # rest - sqrt(u) between low and high
            low, high = (None if b is None else _taken(others, b) for b in (high, low))
            upper, lower = lower, upper
        else:
            raise NotStated("the factor of the square root changes its sign")
    rows = [
        *(upper if _somewhere(constraint.upper, 1.0) else []),
        *(lower if _somewhere(constraint.lower, -1.0) else []),
    ]
    elements = [np.broadcast_to(np.asarray(p, dtype=object), shape).ravel() for p in (body, low, high)]
    items = [
        Stated(f"{name}[{k}]", node is not None, *(p if p is None else _checked(p) for p in parts))  # type: ignore[arg-type]
        for k, parts in enumerate(zip(*elements, strict=True))
    ]
    return items, rows


def _root(body: Expr) -> tuple[Expr, Expr | None, Expr]:
    """The factor and node of the only square root in a sum, and the other terms."""
    factor, node, rest = as_expr(1.0), None, as_expr(np.zeros(body.shape))
    for c, term in terms(body):
        if term.op == "sqrt" and node is None:
            factor, node = c, term
        else:
            rest = rest + c * term
    return factor, node, rest


def _somewhere(bound: Expr, sign: float) -> bool:
    """Whether the bound says something of some element."""
    return not (isinstance(bound.data, IntervalArray) and bool(np.all(bound.data.lo == sign * np.inf)))


def _bound(bound: Expr, exact: ExactPolynomials, shape: tuple[int, ...]) -> Objects | None:
    """Element by element, None where it is infinite."""
    if bound.op == "constant" and isinstance(bound.data, IntervalArray) and np.isinf(bound.data.lo).any():
        if not bool(np.all(bound.data.lo == bound.data.hi)):
            raise NotStated("a bound is known to an interval only")
        out = np.full(shape, None, dtype=object)
        values = np.broadcast_to(bound.data.lo, shape)
        for index in map(tuple, np.argwhere(np.isfinite(values))):
            out[index] = _Poly({(): F(float(values[index]))})
        return out
    return exact.of(bound)


def _less(bound: Objects | None, others: Objects) -> Objects | None:
    return None if bound is None else np.frompyfunc(lambda b, o: None if b is None else b - o, 2, 1)(bound, others)


def _taken(others: Objects, bound: Objects) -> Objects:
    return np.asarray(np.frompyfunc(lambda o, b: None if b is None else o - b, 2, 1)(others, bound), dtype=object)


def _checked(p: _Poly) -> Given:
    for c in p.terms.values():
        power = 4 * HIGHEST_POWER if c.denominator & (c.denominator - 1) else c.denominator.bit_length()
        if power > HIGHEST_POWER or abs(c) >= F(2) ** HIGHEST_POWER or _bits(c) > LONGEST:
            raise NotStated("a coefficient has no short exact form in binary: multiply the divisor out")
    return tuple(p.terms.items())


def _bits(c: F) -> int:
    """Of the odd mantissa of a dyadic number."""
    n = abs(c.numerator)
    return n.bit_length() - (n & -n).bit_length() + 1


class _Poly:
    """A polynomial from sorted monomials to coefficients, with operators so that numpy's object arrays take it."""

    __slots__ = ("terms",)

    def __init__(self, terms: Terms) -> None:
        self.terms = {m: c for m, c in terms.items() if c}

    @property
    def constant(self) -> F:
        return self.terms.get((), F(0))

    def __add__(self, other: _Poly) -> _Poly:
        out = dict(self.terms)
        for m, c in other.terms.items():
            out[m] = out.get(m, F(0)) + c
        return _Poly(out)

    def __sub__(self, other: _Poly) -> _Poly:
        return self + -other

    def __neg__(self) -> _Poly:
        return _Poly({m: -c for m, c in self.terms.items()})

    def __mul__(self, other: _Poly) -> _Poly:
        out: Terms = {}
        for m, c in self.terms.items():
            for n, d in other.terms.items():
                key = tuple(sorted(m + n))
                out[key] = out.get(key, F(0)) + c * d
        return _Poly(out)

    def __truediv__(self, other: _Poly) -> _Poly:
        if set(other.terms) != {()}:
            raise NotStated("it divides by an expression with unknowns, or by zero")
        return _Poly({m: c / other.constant for m, c in self.terms.items()})


class ExactPolynomials:
    """Evaluates expressions to arrays of polynomials; every node once."""

    def __init__(self, network: ConstraintNetwork) -> None:
        self._known: dict[bytes, Objects] = {}
        start = 0
        for leaf in network.variables:
            size = int(np.prod(leaf.shape))
            values = [_Poly({(start + k,): F(1)}) for k in range(size)]
            self._known[leaf.digest] = _array(values, leaf.shape)
            start += size

    def of(self, root: Expr) -> Objects:
        for node in topological((root,)):
            if node.digest not in self._known:
                self._known[node.digest] = self._node(node, [self._known[arg.digest] for arg in node.args])
        return self._known[root.digest]

    def _node(self, node: Expr, args: list[Objects]) -> Objects:
        if node.op == "constant":
            return _constant(node)
        if node.op == "index" and isinstance(node.data, np.ndarray):
            return np.asarray(args[0].ravel()[node.data], dtype=object)
        if node.op == "sum":
            return np.asarray(args[0].sum(axis=node.parameter), dtype=object)
        if node.op == "sqr":
            return np.asarray(args[0] * args[0], dtype=object)
        if node.op == "power" and node.parameter >= 0:
            return _power(args[0], node.parameter)
        if node.op in _BINARY:
            return np.asarray(_BINARY[node.op](*args), dtype=object)
        raise NotStated(f"{node.op!r} has no exact polynomial form")


_BINARY: dict[str, Any] = {
    "neg": np.negative,
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.true_divide,
}


def _power(x: Objects, n: int) -> Objects:
    out = _array([_Poly({(): F(1)})] * x.size, x.shape)
    for _ in range(n):
        out = np.asarray(out * x, dtype=object)
    return out


def _constant(node: Expr) -> Objects:
    data = node.data
    assert isinstance(data, IntervalArray)
    if not bool(np.all(np.isfinite(data.lo) & (data.lo == data.hi))):
        raise NotStated("a constant is known to an interval only")
    return _array([_Poly({(): F(float(v))}) for v in data.lo.ravel()], data.shape)


def _array(values: list[_Poly], shape: tuple[int, ...]) -> Objects:
    out = np.empty(len(values), dtype=object)
    out[:] = values
    return out.reshape(shape)
