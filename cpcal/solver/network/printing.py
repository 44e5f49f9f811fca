"""Expressions, constraints and networks as mathematics: `sqrt(x[0]^2 + x[1]^2) - 5 = 0`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpcal.solver.interval import IntervalArray
from cpcal.solver.interval.scalar import format_bound
from cpcal.solver.network.expression import topological

if TYPE_CHECKING:
    from cpcal.solver.network.expression import Constraint, Expr
    from cpcal.solver.network.network import ConstraintNetwork

_LONGEST = 400  # characters of one expression: what is longer is cut in its middle
_SIGNS = {"add": " + ", "sub": " - ", "mul": " * ", "div": " / ", "pow": "^"}
_RANK = {"add": 1, "sub": 1, "mul": 2, "div": 2, "neg": 2, "sqr": 4, "power": 4, "pow": 4}
_TIGHT = 5


def text(expr: Expr) -> str:
    """As mathematics; arrays of numbers by their shape."""
    done: dict[bytes, tuple[str, int]] = {}
    for node in topological((expr,)):
        written, rank = _written(node, [done[arg.digest] for arg in node.args])
        if len(written) > _LONGEST:
            half = _LONGEST // 2
            written = f"{written[:half]} ... {written[-half:]}"
        done[node.digest] = written, rank
    return done[expr.digest][0]


def constraint_text(constraint: Constraint) -> str:
    """`lower <= body <= upper` without the bounds that say nothing; `body = number` for equal ones."""
    lower, upper = constraint.lower, constraint.upper
    body = text(constraint.body)
    if lower.digest == upper.digest:
        return f"{body} = {text(lower)}"
    left = "" if _says_nothing(lower) else f"{text(lower)} <= "
    right = "" if _says_nothing(upper) else f" <= {text(upper)}"
    return f"{left}{body}{right}"


def network_text(network: ConstraintNetwork) -> str:
    """One line for each variable with its domain, then one for each constraint."""
    lines = [f"{name} in {network.domain[name]}" for name in network.names]
    return "\n".join([f"{network.name}:", *lines, *map(constraint_text, network.constraints)])


def _says_nothing(bound: Expr) -> bool:
    data = bound.data
    return isinstance(data, IntervalArray) and bool(np.isinf(data.lo).all() and np.isinf(data.hi).all())


def _written(node: Expr, args: list[tuple[str, int]]) -> tuple[str, int]:
    rank = _RANK.get(node.op, _TIGHT)
    if not node.args:
        return _leaf(node), _TIGHT
    first = args[0][0] if args[0][1] >= rank else f"({args[0][0]})"
    if node.op in _SIGNS:
        loose = args[1][1] <= rank if node.op in ("sub", "div", "pow") else args[1][1] < rank
        return first + _SIGNS[node.op] + (f"({args[1][0]})" if loose else args[1][0]), rank
    if node.op == "neg":
        return f"-{first}", rank
    if node.op in ("sqr", "power"):
        base = first if args[0][1] > rank else f"({args[0][0]})"
        return f"{base}^{2 if node.op == 'sqr' else node.parameter}", rank
    if node.op == "index":
        return _indexed(node, args[0][0]), _TIGHT
    if node.op == "sum":
        return f"sum({args[0][0]}, axis={node.parameter})", _TIGHT
    return f"{node.op}({', '.join(arg for arg, _ in args)})", _TIGHT


def _indexed(node: Expr, inner: str) -> str:
    assert isinstance(node.data, np.ndarray)
    if not node.args[0].shape:
        return inner
    if node.data.size != 1:
        return f"{inner}[...]"
    place = np.unravel_index(int(node.data.ravel()[0]), node.args[0].shape)
    return f"{inner}[{','.join(str(int(k)) for k in place)}]"


def _leaf(node: Expr) -> str:
    if node.op == "variable":
        return node.name
    data = node.data
    assert isinstance(data, IntervalArray)
    if data.lo.size != 1:
        return f"{node.op}{node.shape}"
    lo, hi = float(data.lo.ravel()[0]), float(data.hi.ravel()[0])
    if lo == hi:
        return format_bound(lo) if lo >= 0 else f"({format_bound(lo)})"
    return f"[{format_bound(lo)}, {format_bound(hi)}]"
