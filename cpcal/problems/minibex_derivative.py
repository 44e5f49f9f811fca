"""Derivatives of expressions as expressions: what `diff` of Minibex means.

diff(e, x) is defined where the formula of the derivative is; expressions with a kink or a jump (abs, min, max, floor,
ceil, sign) have no such formula and are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.solver.network import Expr, mathematics, sqr, sqrt
from cpcal.solver.network.dag import topological
from cpcal.solver.network.expression import as_expr

# of the node and its arguments: the partial derivative by each argument
_PARTIALS: dict[str, Callable[[Expr, Sequence[Expr]], tuple[Any, ...]]] = {
    "neg": lambda z, a: (-1.0,),
    "add": lambda z, a: (1.0, 1.0),
    "sub": lambda z, a: (1.0, -1.0),
    "mul": lambda z, a: (a[1], a[0]),
    "div": lambda z, a: (1.0 / a[1], -a[0] / sqr(a[1])),
    "sqr": lambda z, a: (2.0 * a[0],),
    "sqrt": lambda z, a: (0.5 / z,),
    "power": lambda z, a: (z.parameter * a[0] ** (z.parameter - 1),),
    "pow": lambda z, a: (a[1] * mathematics.power(a[0], a[1] - 1.0), z * mathematics.log(a[0])),
    "exp": lambda z, a: (z,),
    "expm1": lambda z, a: (z + 1.0,),
    "log": lambda z, a: (1.0 / a[0],),
    "log1p": lambda z, a: (1.0 / (a[0] + 1.0),),
    "sin": lambda z, a: (mathematics.cos(a[0]),),
    "cos": lambda z, a: (-mathematics.sin(a[0]),),
    "tan": lambda z, a: (1.0 + sqr(z),),
    "asin": lambda z, a: (1.0 / sqrt(1.0 - sqr(a[0])),),
    "acos": lambda z, a: (-1.0 / sqrt(1.0 - sqr(a[0])),),
    "atan": lambda z, a: (1.0 / (1.0 + sqr(a[0])),),
    "sinh": lambda z, a: (mathematics.cosh(a[0]),),
    "cosh": lambda z, a: (mathematics.sinh(a[0]),),
    "tanh": lambda z, a: (1.0 - sqr(z),),
    "atan2": lambda z, a: (a[1] / (sqr(a[0]) + sqr(a[1])), -a[0] / (sqr(a[0]) + sqr(a[1]))),
}


def gradient(expression: Expr, by: Sequence[Expr]) -> list[Expr]:
    """Of a scalar expression, by components of variables. Raises ModelError for an operation without a formula."""
    order = topological((expression,))
    wanted = {component.digest for component in by}
    holding: set[bytes] = set()  # what depends on one of them
    for node in order:
        if node.digest in wanted or any(arg.digest in holding for arg in node.args):
            holding.add(node.digest)
    total: dict[bytes, Expr] = {expression.digest: as_expr(1.0)}
    for node in reversed(order):
        if node.digest in wanted or node.digest not in holding or node.digest not in total:
            continue
        if node.op not in _PARTIALS:
            raise ModelError(f"the derivative of {node.op!r} has no formula here")
        for arg, partial in zip(node.args, _PARTIALS[node.op](node, node.args), strict=True):
            if arg.digest in holding:
                step = _times(total[node.digest], partial)
                total[arg.digest] = total[arg.digest] + step if arg.digest in total else step
    return [total.get(component.digest, as_expr(0.0)) for component in by]


def _times(factor: Expr, partial: Any) -> Expr:
    """Without factors of 1, which would lengthen every derivative."""
    if isinstance(partial, float) and abs(partial) == 1.0:
        return factor if partial > 0.0 else -factor
    one = factor.op == "constant" and bool(np.all(factor.data.lo == 1.0) and np.all(factor.data.hi == 1.0))  # type: ignore[union-attr]
    return as_expr(partial) if one else factor * partial
