"""What Minibex has besides functions of numbers: diff, chi, ends of an interval, and inverse hyperbolic functions."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.problems.minibex_arrays import flattened
from cpcal.problems.minibex_derivative import gradient
from cpcal.problems.minibex_values import (
    FUNCTIONS,
    Value,
    applied,
    array_of,
    as_operand,
    entrywise,
    interval_of,
    minus,
    negative,
    plus,
    power,
    times,
)
from cpcal.solver.interval import Interval
from cpcal.solver.network import Expr
from cpcal.solver.network.dag import topological

_PARTIAL = {"sqrt", "log", "log1p", "div", "pow", "asin", "acos", "tan", "atan2"}  # not defined everywhere


def _diff(arguments: list[Value]) -> Value:
    """A number for one component, else a row, one entry a component; of a vector a row for each entry."""
    if len(arguments) < 2:
        raise ModelError("diff takes an expression, and the variables to differentiate it by")
    by = [entry for variable in arguments[1:] for entry in np.ravel(np.asarray(variable, dtype=object))]
    if not all(isinstance(entry, Expr) and _is_component(entry) for entry in by):
        raise ModelError("diff differentiates by variables: name them, or entries of them")
    of = [as_operand(entry) for entry in np.ravel(np.asarray(arguments[0], dtype=object))]
    rows = [gradient(e, by) if isinstance(e, Expr) else [Interval(0.0, 0.0)] * len(by) for e in of]
    if len(of) == len(by) == 1:
        return rows[0][0]
    return flattened(array_of([entry for row in rows for entry in row], (len(of), len(by))))


def _is_component(expression: Expr) -> bool:
    leaf = expression.args[0] if expression.op == "index" else expression
    return leaf.op == "variable"


def _chi(arguments: list[Value]) -> Value:
    """b where a <= 0, else c."""
    if len(arguments) != 3:
        raise ModelError("chi takes three arguments: chi(a, b, c) is b where a <= 0, else c")
    return entrywise(_chosen, *arguments)


def _chosen(condition: Value, low: Value, high: Value) -> Any:
    for part in (low, high):
        if isinstance(part, Expr) and any(_is_partial(node) for node in topological((part,))):
            raise ModelError("a part of chi may be undefined where the other one counts: move it out of chi")
    above = applied("max", [applied("sign", [condition]), Interval(0.0, 0.0)])  # 1 where a > 0, else 0
    if not isinstance(above, Expr):
        found = interval_of(above)
        if found.lo < found.hi:
            raise ModelError("chi of an interval about 0 is neither of its parts")
        return high if found.lo > 0.0 else low
    return as_operand(low) * (1.0 - above) + as_operand(high) * above


def _is_partial(node: Expr) -> bool:
    return node.op in _PARTIAL or (node.op == "power" and node.parameter < 0)


def _end(name: str, of: Callable[[Interval], float]) -> Callable[[list[Value]], Value]:
    def found(arguments: list[Value]) -> Value:
        if len(arguments) != 1:
            raise ModelError(f"{name} takes one argument, not {len(arguments)}")
        return entrywise(lambda value: Interval(of(interval_of(value)), of(interval_of(value))), arguments[0])

    return found


def _middle(interval: Interval) -> float:
    if not interval.is_bounded:
        raise ModelError("an interval without bounds has no middle")
    return interval.mid


def _hyperbolic(name: str, of: Callable[[Value], Value]) -> Callable[[list[Value]], Value]:
    def found(arguments: list[Value]) -> Value:
        if len(arguments) != 1:
            raise ModelError(f"{name} takes one argument, not {len(arguments)}")
        return entrywise(of, arguments[0])

    return found


def _asinh(x: Value) -> Value:
    """The same on both sides of 0, where log(x + sqrt(x^2 + 1)) alone would cancel for x < 0."""
    sides = (applied("max", [part, Fraction(0)]) for part in (x, negative(x)))
    up, down = (applied("log", [plus(s, applied("sqrt", [plus(power(s, Fraction(2)), Fraction(1))]))]) for s in sides)
    return minus(up, down)


def _acosh(x: Value) -> Value:
    return applied("log", [plus(x, applied("sqrt", [minus(power(x, Fraction(2)), Fraction(1))]))])


def _atanh(x: Value) -> Value:
    return times(Fraction(1, 2), minus(applied("log1p", [x]), applied("log1p", [negative(x)])))


FORMS: dict[str, Callable[[list[Value]], Value]] = {
    "diff": _diff,
    "chi": _chi,
    "inf": _end("inf", lambda interval: interval.lo),
    "sup": _end("sup", lambda interval: interval.hi),
    "mid": _end("mid", _middle),
    "acosh": _hyperbolic("acosh", _acosh),
    "asinh": _hyperbolic("asinh", _asinh),
    "atanh": _hyperbolic("atanh", _atanh),
}
RESERVED = (*FUNCTIONS, *FORMS, "integer", "sum")
