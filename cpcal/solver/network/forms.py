"""Evaluation of an expression over a box (paper, eq. 4, 5 and 7): natural, centred and slope form.

With a centre c of the box X, centres m of the readings and their sets M,

    f(x, M)  in  f(c, m) + B (M - m) + A (x - c)    for all x in X                                (eq. 7)

A encloses the derivatives (or slopes from c) with respect to the unknowns over X and M, B those with respect to
the readings at c over M. Both come from one reverse sweep for all rows.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Literal, get_args

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.common.errors import ModelError
from cpcal.solver.interval import Arithmetic, Box, IntervalArray, get_arithmetic
from cpcal.solver.network.expression import Expr, Operand, as_expr
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.operations import TABLE, Values
from cpcal.solver.network.reverse import Partials, Reverse
from cpcal.solver.network.slopes import Pair, slope
from cpcal.solver.network.sweep import Slots, Tape

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
        self._size, self._root = len(network.names), self._tape.slot(expr)
        self.count = int(np.prod(expr.shape))
        self._shape = expr.shape
        self._in_variables = Reverse(self._tape, expr, self._tape.variables)
        self._in_readings = Reverse(self._tape, expr, self._tape.readings)
        sets = {k: self._tape.nodes[k].data for k in self._tape.readings}
        self._sets = {k: data for k, data in sets.items() if isinstance(data, IntervalArray)}
        self._centers = {k: IntervalArray.point(data.mid) for k, data in self._sets.items()}
        self.affine = _degree(self._tape)[self._root] <= 1

    def natural(self, box: Box) -> IntervalArray:
        """(K,)"""
        return self._value(self._forward(box.array))

    def at(self, point: Floats, slopes: bool = False) -> IntervalArray:
        """Enclosure (K,) of f(c, M) at a point c (n,): its natural form and f(c, m) + B (M - m)."""
        slots = self._forward(IntervalArray.point(point))
        natural = self._value(slots)
        if not self._sets:
            return natural
        e, plan = self._engine, self._in_readings
        center = self._forward(IntervalArray.point(point), self._centers)
        partials = self._slopes(center, slots) if slopes else self._derivatives(slots)
        with np.errstate(all="ignore"):
            total = self._value(center).reshape((plan.rows, -1))
            for k, adjoint in plan.sweep(e, partials).items():
                moves = e.mul(adjoint, e.sub(self._sets[k], self._centers[k])[None])
                flat = moves.reshape((plan.lanes, plan.rows, -1))
                total = e.add(total, _transposed(e.sum(flat, 2)))
        known = self._defined(plan, center if slopes else slots)[:, None] & ~total.empty
        total = IntervalArray(np.where(known, total.lo, -np.inf), np.where(known, total.hi, np.inf))
        return natural.intersect(total.reshape((self.count,)))

    def jacobian(self, box: Box) -> IntervalArray:
        """Enclosure (K, n) of the derivatives over the box and all readings; the whole line where there is none."""
        slots = self._forward(box.array)
        return self._gradients(self._derivatives(slots), self._defined(self._in_variables, slots))

    def slopes(self, box: Box, point: Floats) -> IntervalArray:
        """Enclosure (K, n) of the slopes from a point of the box to all others, for all readings."""
        anywhere, center = self._forward(box.array), self._forward(IntervalArray.point(point))
        return self._gradients(self._slopes(center, anywhere), self._defined(self._in_variables, center))

    def form(self, box: Box, slopes: bool) -> IntervalArray:
        """f(c, M) + A (X - c) about the midpoint, (K,); empty where f is not defined there."""
        e, center = self._engine, box.mid
        matrix = self.slopes(box, center) if slopes else self.jacobian(box)
        with np.errstate(all="ignore"):
            moves = e.mul(matrix, e.sub(box.array, IntervalArray.point(center)))
            return e.add(self.at(center, slopes), e.sum(moves, 1))

    def _forward(self, flat: IntervalArray, readings: dict[int, IntervalArray] | None = None) -> Slots:
        with np.errstate(all="ignore"):
            return self._tape.forward(self._engine, flat[None], readings)

    def _value(self, slots: Slots) -> IntervalArray:
        return slots[self._root].broadcast_to((1, *self._shape)).reshape((self.count,))

    def _arguments(self, k: int, slots: Slots) -> Values:
        return tuple(slots[j] for j in self._tape.arguments(k))

    def _derivatives(self, slots: Slots) -> Partials:
        def partials(k: int) -> Values:
            node = self._tape.nodes[k]
            derivative = TABLE[node.op].derivative
            assert derivative is not None
            return derivative(self._engine, node, slots[k], self._arguments(k, slots))

        return partials

    def _slopes(self, center: Slots, anywhere: Slots) -> Partials:
        def partials(k: int) -> Values:
            pairs = [Pair(slots[k], self._arguments(k, slots)) for slots in (center, anywhere)]
            return slope(self._engine, self._tape.nodes[k], *pairs)

        return partials

    def _gradients(self, partials: Partials, known: Bools) -> IntervalArray:
        plan = self._in_variables
        lo, hi = (np.zeros((plan.lanes, plan.rows, self._size)) for _ in range(2))
        with np.errstate(all="ignore"):
            for k, adjoint in plan.sweep(self._engine, partials).items():
                where = self._tape.variables[k]
                if plan.row_wise[k]:
                    adjoint = plan.embedded(adjoint)
                flat = adjoint.reshape((plan.lanes, plan.rows, -1))
                lo[..., where], hi[..., where] = flat.lo, flat.hi
        unknown = np.isnan(lo) | np.isnan(hi) | ~known[:, None]
        lo, hi = np.where(unknown, -np.inf, lo), np.where(unknown, np.inf, hi)
        return _transposed(IntervalArray(lo, hi)).reshape((self.count, self._size))

    def _defined(self, plan: Reverse, slots: Slots) -> Bools:
        """The rows (N,) all of whose roots and quotients between leaves and root are defined, hence continuous."""
        rows = np.ones(plan.rows, dtype=bool)
        for k, row_wise in plan.row_wise.items():
            good = _continuous(self._tape.nodes[k], self._arguments(k, slots))
            if good is not None:
                good = np.broadcast_to(good[0], self._tape.nodes[k].args[-1].shape)
                # the last argument of a row-wise quotient may be one for all rows
                apart = row_wise and good.ndim == self._tape.nodes[k].ndim and len(good) == plan.rows
                rows &= good.reshape((plan.rows, -1)).all(axis=1) if apart else bool(good.all())
        return rows


def _continuous(node: Expr, args: Values) -> Bools | None:
    """Where a node is continuous for all values of its last argument; None for those that always are."""
    x = args[-1] if args else None
    if x is not None and node.op == "sqrt":
        return np.asarray(x.lo >= 0.0)
    if x is not None and (node.op == "div" or (node.op == "power" and node.parameter < 0)):
        return np.asarray((x.lo > 0.0) | (x.hi < 0.0))
    return None


def _transposed(x: IntervalArray) -> IntervalArray:
    """The first two axes, lanes and rows, exchanged."""
    return IntervalArray(np.swapaxes(x.lo, 0, 1), np.swapaxes(x.hi, 0, 1))


_DEGREES: dict[str, Callable[[Expr, list[float]], float]] = {
    "mul": lambda node, d: d[0] + d[1],
    "div": lambda node, d: d[0] if d[1] == 0 else np.inf,
    "sqr": lambda node, d: 2 * d[0],
    **dict.fromkeys(("neg", "index", "sum", "add", "sub"), lambda node, d: max(d)),
}


def _degree(tape: Tape) -> list[float]:
    """Degree of every node as a polynomial in the variables alone; infinite for what is none."""
    out: list[float] = []
    for k, node in enumerate(tape.nodes):
        below = [out[j] for j in tape.arguments(k)]
        if not below:
            out.append(1.0 if node.op == "variable" else 0.0)
        elif not any(below):
            out.append(0.0)
        else:
            out.append(_DEGREES[node.op](node, below) if node.op in _DEGREES else np.inf)
    return out
