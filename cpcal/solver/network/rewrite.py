"""From constraints to polynomial inequalities `q <= 0`, by small passes.

Every pass takes a row `expr <= 0` and returns rows whose conjunction it implies (for some reading, the
row's own): square roots are isolated and squared, absolute values and maxima split. A row that no pass
can make polynomial is left to the other contractors and listed in `PolynomialSystem.leftover`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network import coefficient as coef
from cpcal.solver.network.expression import Constraint, Expr, as_expr
from cpcal.solver.network.mathematics import sqr
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.polynomial import Expander

# For the readings of one row, by the digest of their leaf: a part of the set that decides the row.
ReadingSets = dict[bytes, IntervalArray]


@dataclass(frozen=True)
class Row:
    """`expr <= 0`, elementwise, wherever `guard >= 0` (everywhere when there is no guard).

    Where the guard v is only known to be >= -t, `expr <= t^2` still holds: see `_square_root`.
    """

    expr: Expr
    constraint: int
    guard: Expr | None = None
    elements: npt.NDArray[np.intp] | None = None  # of the constraint's body, flat; None: all


def one_sided(number: int, constraint: Constraint) -> list[Row]:
    """`lower <= body <= upper` as at most two rows; infinite bounds give none."""
    rows = []
    for bound, sign in ((constraint.upper, 1.0), (constraint.lower, -1.0)):
        body, elements = constraint.body, _bounded(bound, constraint.body.shape, sign)
        if elements is not None and not elements.size:
            continue
        if elements is not None and isinstance(bound.data, IntervalArray):
            where = np.unravel_index(elements, body.shape)
            body, bound = body[where], as_expr(bound.data.broadcast_to(body.shape)[where])
        rows.append(Row(body - bound if sign > 0.0 else bound - body, number, elements=elements))
    return rows


def _bounded(bound: Expr, shape: tuple[int, ...], sign: float) -> npt.NDArray[np.intp] | None:
    """The flat elements whose bound says something; None for all of them."""
    if bound.op != "constant" or not isinstance(bound.data, IntervalArray):
        return None
    idle = np.broadcast_to(bound.data.lo == sign * np.inf, shape).ravel()
    return np.flatnonzero(~idle) if idle.any() else None


def one_sided_rows(network: ConstraintNetwork) -> list[Row]:
    """Those of all constraints, in order."""
    return [row for k, c in enumerate(network.constraints) for row in one_sided(k, c)]


# passes: each returns the rows that replace the given one, or None where it has nothing to do -------------

Pass = Callable[[Row], list[Row] | None]
Term = tuple[Expr, Expr]  # constant factor, expression


def terms(expr: Expr) -> list[Term]:
    """`expr` as a sum of constants times expressions that are no sums themselves."""
    out: list[Term] = []
    stack: list[Term] = [(as_expr(1.0), expr)]
    while stack:
        factor, node = stack.pop()
        if node.op in ("add", "sub"):
            second = factor if node.op == "add" else -factor
            stack += [(second, node.args[1]), (factor, node.args[0])]
        elif node.op == "neg":
            stack.append((-factor, node.args[0]))
        elif node.op == "mul" and _constant(node.args[0]):
            stack.append((factor * node.args[0], node.args[1]))
        elif node.op == "mul" and _constant(node.args[1]):
            stack.append((factor * node.args[1], node.args[0]))
        elif node.op == "div" and _constant(node.args[1]):
            stack.append((factor / node.args[1], node.args[0]))
        else:
            out.append((factor, node))
    return out


def _constant(expr: Expr) -> bool:
    return expr.ops.isdisjoint(("variable", "reading"))


def _sign(factor: Expr, engine: Arithmetic) -> int:
    """1 or -1 for a constant of one sign, else 0."""
    empty = ConstraintNetwork()
    value = coef.total(engine, Expander(empty, engine, (factor,)).expand(factor).constant)
    return int(bool(np.all(value.lo > 0.0))) - int(bool(np.all(value.hi < 0.0)))


def _isolated(row: Row, op: str) -> tuple[Expr, Expr, Expr] | None:
    """The first term with operation `op`: its factor, its node and the sum of all other terms."""
    if op not in row.expr.ops:
        return None
    parts = terms(row.expr)
    for k, (factor, node) in enumerate(parts):
        if node.op == op:
            rest: Expr = as_expr(np.zeros(row.expr.shape))
            for j, (f, x) in enumerate(parts):
                if j != k:
                    rest = rest + f * x
            return factor, node, rest
    return None


def square_root(row: Row, engine: Arithmetic) -> list[Row] | None:
    """`c sqrt(u) + r <= 0`: r <= 0 and c^2 u <= r^2 for c > 0; for c < 0, r^2 <= c^2 u where r >= 0.

    Where r >= -t only, sqrt(c^2 u) >= r gives c^2 u >= r^2 - t^2: either r >= 0, or r^2 <= t^2.
    """
    found = _isolated(row, "sqrt")
    if found is None or row.guard is not None:
        return None
    factor, node, rest = found
    squared = sqr(factor) * node.args[0]
    sign = _sign(factor, engine)
    if sign > 0:
        return [replace(row, expr=rest), replace(row, expr=squared - sqr(rest))]
    if sign < 0:
        return [replace(row, expr=sqr(rest) - squared, guard=rest)]
    return None


def absolute_value(row: Row, engine: Arithmetic) -> list[Row] | None:
    """`c |u| + r <= 0` for c > 0 is two rows; for c < 0 it is a square root of u^2."""
    found = _isolated(row, "abs")
    if found is None or row.guard is not None:
        return None
    factor, node, rest = found
    sign = _sign(factor, engine)
    if sign > 0:
        return [replace(row, expr=rest + s * factor * node.args[0]) for s in (1.0, -1.0)]
    if sign < 0:
        return [replace(row, expr=sqr(rest) - sqr(factor * node.args[0]), guard=rest)]
    return None


def extremum(row: Row, engine: Arithmetic) -> list[Row] | None:
    """`c max(u, v) + r <= 0` for c > 0, or `c min(u, v) + r <= 0` for c < 0, is two rows."""
    for op, wanted in (("max", 1), ("min", -1)):
        found = _isolated(row, op)
        if found is not None and row.guard is None and _sign(found[0], engine) == wanted:
            factor, node, rest = found
            return [replace(row, expr=rest + factor * arg) for arg in node.args]
    return None


_MOST = 512  # rows made of one

PASSES = (extremum, absolute_value, square_root)


def rewritten(row: Row, engine: Arithmetic) -> list[Row]:
    """The rows that the passes make of one row; the row itself where they would be more than `_MOST`.

    A sum of n absolute values stands for 2^n rows.
    """
    todo, done, given = [row], list[Row](), row
    while todo:
        if len(todo) + len(done) > _MOST:
            return [given]
        row = todo.pop(0)
        for rewrite in PASSES:
            result = rewrite(row, engine)
            if result is not None:
                todo = result + todo
                break
        else:
            done.append(row)
    return done
