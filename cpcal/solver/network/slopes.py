"""Elementary slopes: what the derivative is to the mean value form, the slope is to the slope form.

For an operation phi with arguments u(c) at a centre c and u(x) anywhere, numbers p_j with

    phi(u(x)) - phi(u(c)) = sum_j p_j (u_j(x) - u_j(c))                       (Krawczyk and Neumaier)

are enclosed. That is algebra, not calculus: it holds wherever both sides are defined, next to poles and kinks, and
the enclosure is about half as wide as that of the derivative. Operations that are not listed here use their
derivative over the hull of both values: it holds all such slopes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.expression import Expr
from cpcal.solver.network.operations import TABLE, Values, align


@dataclass(frozen=True)
class Pair:
    """Values of a node and of its arguments, at one place."""

    out: IntervalArray
    args: Values


# (engine, node, values at the centre, values anywhere) -> one array per argument
Slope = Callable[[Arithmetic, Expr, Pair, Pair], Values]


def slope(e: Arithmetic, node: Expr, center: Pair, values: Pair) -> Values:
    """The slopes of one operation that is not linear."""
    if node.op in SLOPES:
        return SLOPES[node.op](e, node, center, values)
    derivative = TABLE[node.op].derivative
    assert derivative is not None
    hulls = tuple(x.hull(c) for x, c in zip(values.args, center.args, strict=True))
    return derivative(e, node, values.out.hull(center.out), hulls)


def _mul(e: Arithmetic, node: Expr, center: Pair, values: Pair) -> Values:
    """u v - u_c v_c = v (u - u_c) + u_c (v - v_c)."""
    return align(values.args[1], node.ndim), align(center.args[0], node.ndim)


def _div(e: Arithmetic, node: Expr, center: Pair, values: Pair) -> Values:
    """u/v - q_c = ((u - u_c) - q_c (v - v_c)) / v with q_c = u_c/v_c."""
    v = align(values.args[1], node.ndim)
    return e.div(IntervalArray.point(1.0), v), e.neg(e.div(center.out, v))


def _sqr(e: Arithmetic, node: Expr, center: Pair, values: Pair) -> Values:
    return (e.add(values.args[0], center.args[0]),)


def _sqrt(e: Arithmetic, node: Expr, center: Pair, values: Pair) -> Values:
    return (e.div(IntervalArray.point(1.0), e.add(values.out, center.out)),)


def _power(e: Arithmetic, node: Expr, center: Pair, values: Pair) -> Values:
    """u^n - c^n = (u - c) sum_k u^k c^(n-1-k); for n < 0 that of -n, divided by -(u c)^-n."""
    n, u, c = node.parameter, values.args[0], center.args[0]
    m = abs(n)
    if m == 0:
        return (IntervalArray.point(np.zeros(1)),)
    total = e.power(c, m - 1)
    for k in range(1, m):
        total = e.add(total, e.mul(e.power(u, k), e.power(c, m - 1 - k)))
    if n < 0:
        return (e.neg(e.div(total, e.mul(e.power(u, m), e.power(c, m)))),)
    derivative = TABLE["power"].derivative
    assert derivative is not None
    return (total.intersect(derivative(e, node, values.out, (u.hull(c),))[0]),)


def _abs(e: Arithmetic, node: Expr, center: Pair, values: Pair) -> Values:
    """1 or -1 where u and c have one sign; else, for c > 0 > u, from (c - |u|) / (c + |u|) to 1: it grows in both."""
    u, c = values.args[0], center.args[0]
    flipped = c.hi < 0.0  # the slope of |.| between -u and -c is the opposite of that between u and c
    near = np.where(flipped, -c.hi, c.lo)
    far = np.maximum(np.where(flipped, u.hi, -u.lo), 0.0)
    known = (near > 0.0) & np.isfinite(near) & np.isfinite(far)
    a, b = (IntervalArray.point(np.where(known, bound, 1.0)) for bound in (near, far))
    least = np.where(known, np.maximum(e.div(e.sub(a, b), e.add(a, b)).lo, -1.0), -1.0)
    plus, minus = (u.lo >= 0.0) & (c.lo >= 0.0), (u.hi <= 0.0) & (c.hi <= 0.0)
    lo = np.where(plus, 1.0, np.where(flipped | minus, -1.0, least))
    hi = np.where(minus & ~plus, -1.0, np.where(flipped, -least, 1.0))
    return (IntervalArray(lo, hi),)


SLOPES: dict[str, Slope] = {
    "mul": _mul,
    "div": _div,
    "sqr": _sqr,
    "sqrt": _sqrt,
    "power": _power,
    "abs": _abs,
}
