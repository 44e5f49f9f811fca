"""An expression over a box: its values, and its expansion about a point (paper, eq. 7).

With a centre c of the box X, centres m of the readings and their sets M,

    f(x, M)  in  f(c, m) + B (M - m) + A (x - c)    for all x in X                                (eq. 7)

A encloses the derivatives with respect to the unknowns over X and M, B those with respect to the readings at c over M.
Both come from one sweep from each element to its leaves.
"""

import math
import operator
from collections import Counter
from collections.abc import Callable, Iterable
from fractions import Fraction
from functools import reduce
from typing import Any

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.values import Bools, Floats
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network.expression import Constraint, Expr, Operand, as_expr, folded, topological
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.polynomial import one_sided, sign_of
from cpcal.solver.network.tape import Tape


def evaluate(network: ConstraintNetwork, expr: Operand, box: Box) -> IntervalArray:
    """An enclosure, of the shape of `expr`, of its values over `box`, for ALL readings in their sets.

    Values count where the expression is defined; an element that is nowhere defined is empty (NaN). Raises ModelError
    for a box or an expression of other variables.
    """
    network.check_box(box)
    expr = as_expr(expr)
    network.check_owner(expr)
    tape = Tape(network, [expr])
    return tape.values(tape.forward(box.array[None]))[0].reshape(expr.shape)


class NotExact(ModelError):
    """An expression has no value in exact numbers: it holds other operations, or constants known to an interval."""


_EXACT: dict[str, Callable[..., Any]] = {
    "neg": operator.neg,
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "sqr": lambda x: x * x,
}


def exactly(root: Expr, known: dict[bytes, Any], number: Callable[[float], Any]) -> Any:
    """The elements of an expression, an array of objects of any ring: `known` holds those of its variables, and of what
    was evaluated before; `number` makes one of a float. Raises NotExact."""

    def one(node: Expr, args: list[Any]) -> Any:
        if node.op == "constant":
            if not np.all(np.isfinite(node.data.lo) & (node.data.lo == node.data.hi)):
                raise NotExact("a constant is known to an interval only")
            found = np.frompyfunc(number, 1, 1)(node.data.lo)
        elif node.op == "index":
            found = args[0].ravel()[node.places]
        elif node.op == "sum":
            found = args[0].sum(axis=node.parameter)
        elif node.op == "power":
            ones = np.frompyfunc(number, 1, 1)(np.ones(node.shape))
            found = reduce(np.multiply, [args[0]] * abs(node.parameter), ones)
            found = ones / found if node.parameter < 0 else found
        elif node.op in _EXACT:
            found = _EXACT[node.op](*args)
        else:
            raise NotExact(f"{node.op!r} has no exact polynomial form")
        return np.asarray(found, object)

    return folded(root, one, known)


def exactly_zero(network: ConstraintNetwork, roots: Iterable[Expr], point: Floats) -> bool:
    """Whether expressions are 0 at a point (n,), in fractions; False also where they hold roots or functions."""
    fractions = np.array([Fraction(v) for v in point.tolist()], object)
    known = {digest: np.asarray(fractions[where]) for digest, where in network.places.items()}
    try:
        return all(bool((exactly(root, known, Fraction) == 0).all()) for root in roots)
    except (NotExact, ZeroDivisionError):
        return False


class CentredForm:
    """One expression of a network with the plans of its sweeps; K is its number of elements, in C order."""

    def __init__(self, network: ConstraintNetwork, expr: Expr) -> None:
        self._tape = Tape(network, [expr])
        self.count = self._tape.count
        self._centers = {leaf.digest: IntervalArray.point(leaf.data.mid) for leaf in self._tape.readings}
        self.affine = folded(expr, _degree) <= 1

    def at(self, point: Floats) -> IntervalArray:
        """Enclosure (K,) of f(c, M) at a point c (n,): its natural form and f(c, m) + B (M - m)."""
        tape, boxes = self._tape, IntervalArray.point(point)[None]
        slots = tape.forward(boxes)
        natural = tape.values(slots)[0]
        if not tape.readings:
            return natural
        value = tape.values(tape.forward(boxes, self._centers))[0]
        total = tape.moved(slots[0], value, tape.leaves() - tape.leaves(self._centers))
        return natural.intersect(_or_line(total, tape.continuous_rows(slots[0]) & ~total.empty & ~value.empty))

    def jacobian(self, box: Box) -> IntervalArray:
        """Enclosure (K, n) of the derivatives over the box and all readings; the whole line where there is none."""
        slots = self._tape.forward(box.array[None])[0]
        matrix = self._tape.jacobian(slots)
        return _or_line(matrix, self._tape.continuous_rows(slots)[:, None] & ~matrix.empty)


def _or_line(x: IntervalArray, known: Bools) -> IntervalArray:
    """x, and where it is not known the whole line."""
    return IntervalArray(np.where(known, x.lo, -np.inf), np.where(known, x.hi, np.inf))


_DEGREES: dict[str, Callable[[Expr, list[float]], float]] = {
    "mul": lambda node, d: d[0] + d[1],
    "div": lambda node, d: d[0] if d[1] == 0 else np.inf,
    "sqr": lambda node, d: 2 * d[0],
    **dict.fromkeys(("neg", "index", "sum", "add", "sub"), lambda node, d: max(d)),
}


def _degree(node: Expr, below: list[float]) -> float:
    """Degree as a polynomial in the variables alone, from those of the arguments; infinite for what is none."""
    if not any(below):
        return float(node.op == "variable")
    return _DEGREES[node.op](node, below) if node.op in _DEGREES else np.inf


# ------------------------------------------------------------------------------------------------------------------
# Divisions by expressions of one sign on the domain, multiplied out: `u / v <= w` is `u <= w v` where v > 0.
#
# What is left is polynomial, if numerators and divisors are, so that linear relaxations and certificates can use it.

_MOST = 12  # divisors of one row: beyond, the products get longer than they are worth

Divisors = Counter[Expr]
Ratio = tuple[Expr, Divisors]


def with_products(network: ConstraintNetwork, *, instead: bool = False) -> tuple[ConstraintNetwork, list[int]]:
    """The network with what constraints with such divisions are equivalent to on the domain, besides or instead of
    them; and for each of its constraints the number of the one that it stands for."""
    found = [_without_divisions(network, constraint) for constraint in network.constraints]
    pairs = zip(network.constraints, found, strict=True)
    stated = [[c] if products is None else products if instead else [c, *products] for c, products in pairs]
    origin = [number for number, constraints in enumerate(stated) for _ in constraints]
    if not any(found):
        return network, origin
    out = network.without_constraints()
    out.add(constraint for constraints in stated for constraint in constraints)
    return out, origin


def _divides(node: Expr) -> bool:
    return (node.op == "div" and not node.args[1].is_constant) or (node.op == "power" and node.parameter < 0)


def _without_divisions(network: ConstraintNetwork, constraint: Constraint) -> list[Constraint] | None:
    """Equivalent constraints, or None where there are no divisions, or a divisor's sign is not known."""
    if not any(_divides(node) for node in topological(constraint.parts)):
        return None
    if constraint.is_equation:
        found = _product(network, constraint.body - constraint.lower)
        return None if found is None else [found[0] == 0.0]
    products = [_product(network, row.expr) for row in one_sided(0, constraint)]
    if None in products:
        return None
    return [product[0] * product[1] <= 0.0 for product in products if product is not None]


def _product(network: ConstraintNetwork, row: Expr) -> tuple[Expr, float] | None:
    """The row times its divisors, and the sign of their product."""
    numerator, divisors = folded(row, _Ratio().of_node)
    if not divisors or divisors.total() > _MOST:
        return None
    sign = math.prod(sign_of(network, divisor) ** count for divisor, count in divisors.items())
    return (numerator, float(sign)) if sign else None


class _Ratio:
    """Expressions as a numerator over a product of divisors; each divisor is one node, whatever it is made of."""

    def __init__(self) -> None:
        self._same = dict[bytes, Expr]()  # one object for equal expressions, so that counters find them

    def of_node(self, node: Expr, args: list[Ratio]) -> Ratio:
        if not any(divisors for _, divisors in args) and not _divides(node):
            return node, Counter()
        if node.op == "neg":
            return -args[0][0], args[0][1]
        if node.op in ("add", "sub"):
            (top, below), (other, beside) = args
            common = below | beside  # the larger count of each
            left = reduce(operator.mul, (common - below).elements(), top)
            right = reduce(operator.mul, (common - beside).elements(), other)
            return (left + right if node.op == "add" else left - right), common
        if node.op == "mul":
            return args[0][0] * args[1][0], args[0][1] + args[1][1]
        if node.op == "div":
            (top, below), (divisor, above) = args
            top = reduce(operator.mul, above.elements(), top)
            return (top / divisor, below) if divisor.is_constant else (top, below + self._factors(divisor))
        if node.op == "sqr":
            return args[0][0] * args[0][0], args[0][1] + args[0][1]
        if node.op == "power" and node.parameter < 0 and not args[0][1]:
            factors = self._factors(args[0][0])
            return as_expr(np.ones(node.shape)), Counter({k: -node.parameter * n for k, n in factors.items()})
        return node, Counter()

    def _factors(self, divisor: Expr) -> Divisors:
        if divisor.op == "mul":
            parts = [part for part in divisor.args if not part.is_constant]
            if len(parts) == 2:
                return self._factors(parts[0]) + self._factors(parts[1])
        if divisor.op in ("sqr", "power") and (divisor.op == "sqr" or divisor.parameter > 0):
            count = 2 if divisor.op == "sqr" else divisor.parameter
            return Counter({k: count * n for k, n in self._factors(divisor.args[0]).items()})
        return Counter({self._same.setdefault(divisor.digest, divisor): 1})
