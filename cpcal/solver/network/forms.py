"""Evaluation of an expression over a box (paper, eq. 4, 5 and 7): natural, centred and slope form.

With a centre c of the box X, centres m of the readings and their sets M,

    f(x, M)  in  f(c, m) + B (M - m) + A (x - c)    for all x in X                                (eq. 7)

A encloses the derivatives (or slopes from c) with respect to the unknowns over X and M, B those with respect to
the readings at c over M. Both come from one sweep from each element to its leaves.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from functools import reduce
from typing import Literal, get_args

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.values import Bools, Floats
from cpcal.solver.interval import Arithmetic, Box, IntervalArray, get_arithmetic
from cpcal.solver.network.expression import Constraint, Expr, Operand, as_expr, folded, topological
from cpcal.solver.network.network import ConstraintNetwork, component_names
from cpcal.solver.network.polynomial import one_sided
from cpcal.solver.network.tape import ReadingSets, Tape

FormName = Literal["natural", "centred", "slope", "tightest"]


def evaluate(
    network: ConstraintNetwork, expr: Operand, box: Box, form: FormName = "natural", arithmetic: str = "float64"
) -> IntervalArray:
    """An enclosure, of the shape of `expr`, of its values over `box`, for ALL readings in their sets.

    Values count where the expression is defined; an element that is nowhere defined is empty (NaN).
    natural    every operation replaced by that of intervals
    centred    eq. 7 with derivatives (mean value form); abs, min and max with their generalised derivatives
    slope      eq. 7 with slopes from the centre (Krawczyk and Neumaier), about half as wide as derivatives
    tightest   the intersection of all three
    An element for which a form is not valid gets its natural form: undefined somewhere in the box (for slopes: at its
    centre), or unbounded. Raises ModelError for an unknown form and for a box or an expression of other variables.
    """
    if form not in get_args(FormName):
        raise ModelError(f"{form!r} is no form of evaluation: {', '.join(get_args(FormName))}")
    network.check_box(box)
    expr = as_expr(expr)
    network.check_owner(expr)
    plan = CentredForm(network, expr, get_arithmetic(arithmetic))
    natural = plan.natural(box)
    if form == "natural" or box.is_empty or not box.is_bounded:
        return natural.reshape(expr.shape)
    names = ["centred", "slope"] if form == "tightest" else [form]
    found = [_or_else(plan.form(box, name == "slope"), natural) for name in names]
    if form == "tightest":
        found.append(natural)
    return reduce(IntervalArray.intersect, found).reshape(expr.shape)


def _or_else(x: IntervalArray, other: IntervalArray) -> IntervalArray:
    """x, and where it is empty or not bounded the other."""
    known = np.isfinite(x.lo) & np.isfinite(x.hi)
    return IntervalArray(np.where(known, x.lo, other.lo), np.where(known, x.hi, other.hi))


class CentredForm:
    """One expression of a network with the plans of its sweeps; K is its number of elements, in C order."""

    def __init__(self, network: ConstraintNetwork, expr: Expr, engine: Arithmetic) -> None:
        self._engine = engine
        self._tape = Tape(network, [expr])
        self.count = self._tape.count
        self._sets = {leaf.digest: leaf.data for leaf in self._tape.readings}
        self._centers = {digest: IntervalArray.point(data.mid) for digest, data in self._sets.items()}
        self.affine = _degree(expr) <= 1

    def natural(self, box: Box) -> IntervalArray:
        """(K,)"""
        return self._tape.values(self._forward(box.array))[0]

    def at(self, point: Floats, slopes: bool = False) -> IntervalArray:
        """Enclosure (K,) of f(c, M) at a point c (n,): its natural form and f(c, m) + B (M - m)."""
        e, tape = self._engine, self._tape
        slots = self._forward(IntervalArray.point(point))
        natural = tape.values(slots)[0]
        if not self._sets:
            return natural
        center = self._forward(IntervalArray.point(point), self._centers)
        factors = tape.slopes(e, center[0], slots[0]) if slopes else tape.derivatives(e, slots[0])
        value = tape.values(center)[0]
        total = tape.moved(e, factors, value, e.sub(tape.leaves(), tape.leaves(self._centers)))
        known = tape.continuous_rows(e, (center if slopes else slots)[0]) & ~total.empty & ~value.empty
        return natural.intersect(_or_line(total, known))

    def jacobian(self, box: Box) -> IntervalArray:
        """Enclosure (K, n) of the derivatives over the box and all readings; the whole line where there is none."""
        slots = self._forward(box.array)[0]
        known = self._tape.continuous_rows(self._engine, slots)
        return self._gradients(self._tape.derivatives(self._engine, slots), known)

    def slopes(self, box: Box, point: Floats) -> IntervalArray:
        """Enclosure (K, n) of the slopes from a point of the box to all others, for all readings."""
        anywhere, center = self._forward(box.array)[0], self._forward(IntervalArray.point(point))[0]
        known = self._tape.continuous_rows(self._engine, center)
        return self._gradients(self._tape.slopes(self._engine, center, anywhere), known)

    def form(self, box: Box, slopes: bool) -> IntervalArray:
        """f(c, M) + A (X - c) about the midpoint, (K,); empty where f is not defined there."""
        e, center = self._engine, box.mid
        matrix = self.slopes(box, center) if slopes else self.jacobian(box)
        with np.errstate(all="ignore"):
            moves = e.mul(matrix, e.sub(box.array, IntervalArray.point(center)))
            return e.add(self.at(center, slopes), e.sum(moves, 1))

    def _forward(self, flat: IntervalArray, readings: ReadingSets | None = None) -> IntervalArray:
        return self._tape.forward(self._engine, flat[None], readings)

    def _gradients(self, factors: Floats, known: Bools) -> IntervalArray:
        matrix = self._tape.jacobian(self._engine, factors)
        return _or_line(matrix, known[:, None] & ~matrix.empty)


def _or_line(x: IntervalArray, known: Bools) -> IntervalArray:
    """x, and where it is not known the whole line."""
    return IntervalArray(np.where(known, x.lo, -np.inf), np.where(known, x.hi, np.inf))


_DEGREES: dict[str, Callable[[Expr, list[float]], float]] = {
    "mul": lambda node, d: d[0] + d[1],
    "div": lambda node, d: d[0] if d[1] == 0 else np.inf,
    "sqr": lambda node, d: 2 * d[0],
    **dict.fromkeys(("neg", "index", "sum", "add", "sub"), lambda node, d: max(d)),
}


def _degree(expr: Expr) -> float:
    """Degree as a polynomial in the variables alone; infinite for what is none."""

    def degree(node: Expr, below: list[float]) -> float:
        if not any(below):
            return float(node.op == "variable")
        return _DEGREES[node.op](node, below) if node.op in _DEGREES else np.inf

    return folded(expr, degree)


def check_powers(network: ConstraintNetwork, roots: Iterable[Expr]) -> None:
    """Raise ModelError for `x ** n` with x that may be negative and n that may be whole, but is not known to be.

    exp(n log(x)) would cut it to x > 0 without a word. Where n is made of unknowns that take other numbers, too, x > 0
    is what a power means.
    """
    for node in topological(tuple(roots)) if any("pow" in root.ops for root in roots) else ():
        if node.op != "pow" or not _all_whole(network, node.args[1]):
            continue
        base, exponent = (evaluate(network, arg, network.domain) for arg in node.args)
        with np.errstate(all="ignore"):
            wrong = (base.lo < 0.0) & (np.ceil(exponent.lo) <= np.floor(exponent.hi))
        if wrong.any():
            raise ModelError(
                f"{node} may be a whole power of a negative number, but its exponent is no known number: write that, "
                f"or exp(exponent * log(base)), which is defined where the base is positive"
            )


def _all_whole(network: ConstraintNetwork, exponent: Expr) -> bool:
    """Whether the unknowns of an expression are whole numbers, or known to be one number."""
    settled = network.whole | (network.domain.lo == network.domain.hi)
    place = {name: k for k, name in enumerate(network.names)}
    for node in topological((exponent,)):
        for leaf in node.args or (node,):
            if leaf.op != "variable" or (leaf is node and leaf is not exponent):
                continue
            own = np.array([place.get(name, -1) for name in component_names(leaf)])
            own = own[node.places] if node.op == "index" else own
            if not (settled[own] & (own >= 0)).all():
                return False
    return True


# ------------------------------------------------------------------------------------------------------------------
# Divisions by expressions of one sign on the domain, multiplied out: `u / v <= w` is `u <= w v` where v > 0.
#
# What is left is polynomial, if numerators and divisors are, so that linear relaxations and certificates can use it.

_MOST = 12  # divisors of one row: beyond, the products get longer than they are worth

Divisors = Counter[Expr]


def multiplied_out(network: ConstraintNetwork) -> list[tuple[int, list[Constraint]]]:
    """The constraints with such divisions, by number, and what each is equivalent to on the domain."""
    out = []
    for number, constraint in enumerate(network.constraints):
        if any(_divides(node) for node in topological(constraint.parts)):
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
    return (node.op == "div" and not node.args[1].is_constant) or (node.op == "power" and node.parameter < 0)


def _without_divisions(network: ConstraintNetwork, constraint: Constraint) -> list[Constraint] | None:
    """Equivalent constraints, or None where a divisor's sign is not known."""
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
    sign = 1.0
    for divisor, count in divisors.items():
        values = evaluate(network, divisor, network.domain)
        one = float(np.all(values.lo > 0.0)) - float(np.all(values.hi < 0.0))
        if not one:
            return None
        sign *= one**count
    return numerator, sign


class _Ratio:
    """Expressions as a numerator over a product of divisors; each divisor is one node, whatever it is made of."""

    def __init__(self) -> None:
        self._same: dict[bytes, Expr] = {}  # one object for equal expressions, so that counters find them

    def of_node(self, node: Expr, args: list[tuple[Expr, Divisors]]) -> tuple[Expr, Divisors]:
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
            top = _times(top, above.elements())
            return (top / divisor, below) if divisor.is_constant else (top, below + self._factors(divisor))
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
            parts = [part for part in divisor.args if not part.is_constant]
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
