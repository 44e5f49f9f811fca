"""The systems of `benchmarks/problems` by codac: one CtcInverse for each equation, boxes divided where they are widest.

codac has no proof of single solutions in this form: what it leaves are clusters of boxes narrower than 1e-6. It has no
minimiser.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np

from benchmarks.methods.codac import contract
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, Expr
from cpcal.solver.network.dag import topological
from cpcal.solver.search import clusters

_WIDTH = 1e-6
_UNARY = ("sqr", "sqrt", "sin", "cos", "tan", "exp", "log", "abs", "atan", "asin", "acos")
_BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
}


@dataclass(frozen=True)
class CodacResult:
    """`clusters` of boxes that are left; `complete` where none of them is wider than 1e-6; processor seconds."""

    clusters: int
    complete: bool
    nodes: int
    processor: float

    @property
    def text(self) -> str:
        """For a cell of a table."""
        return f"{self.clusters} clusters" if self.complete else "not finished"


def by_codac(network: ConstraintNetwork, limit: float) -> CodacResult:
    """Depth first, for so many seconds of processor time. Raises KeyError for an operation that is not written here.

    In a process of its own: codac switches the processor's rounding, which cpcal refuses to compute with.
    """
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(_searched, network, limit).result()


def _searched(network: ConstraintNetwork, limit: float) -> CodacResult:
    import codac

    contractors = _contractors(network)
    domain = network.domain
    stack = [codac.IntervalVector(np.stack([domain.lo, domain.hi], axis=1).tolist())]
    kept, nodes, began = [], 0, time.process_time()
    while stack and time.process_time() - began < limit:
        box = stack.pop()
        nodes += 1
        contract(contractors, box)
        if box.is_empty():
            continue
        widths = np.asarray(box.diam()).ravel()
        if widths.max() <= _WIDTH:
            kept.append(box)
        else:
            stack += box.bisect(int(np.argmax(widths)))
    spent = time.process_time() - began
    left = [Box(network.names, np.asarray(b.lb()).ravel(), np.asarray(b.ub()).ravel()) for b in kept]
    count = int(clusters(left).max(initial=-1)) + 1
    return CodacResult(count, not stack, nodes, spent)


def _contractors(network: ConstraintNetwork) -> list[Any]:
    import codac

    x = codac.VectorVar(len(network.names))
    start, count = {}, itertools.count()
    for leaf in network.variables:
        start[leaf.digest] = [x[next(count)] for _ in range(math.prod(leaf.shape))]
    out = []
    for constraint in network.constraints:
        body = _elements(constraint.body, start)
        lower = np.broadcast_to(_constant(constraint.lower), constraint.body.shape).ravel()
        upper = np.broadcast_to(_constant(constraint.upper), constraint.body.shape).ravel()
        for element, low, high in zip(body.flat, lower, upper, strict=True):
            function = codac.AnalyticFunction([x], element)
            out.append(codac.CtcInverse(function, codac.Interval(low[0], high[1])))
    return out


def _constant(expr: Expr) -> Any:
    assert isinstance(expr.data, IntervalArray)
    out = np.empty(expr.shape, object)
    for index in np.ndindex(expr.shape):
        out[index] = (float(expr.data.lo[index]), float(expr.data.hi[index]))
    return out


def _elements(root: Expr, start: dict[bytes, list[Any]]) -> Any:
    """codac's expressions for the elements of one of ours, an array of its shape."""
    import codac

    done: dict[bytes, Any] = {}
    for node in topological((root,)):
        args = [done[arg.digest] for arg in node.args]
        if node.op == "variable":
            out = _shaped(start[node.digest], node.shape)
        elif node.op == "constant":
            pairs = _constant(node)
            out = np.empty(node.shape, object)
            for index in np.ndindex(node.shape):
                low, high = pairs[index]
                out[index] = low if low == high else codac.ScalarExpr(codac.Interval(low, high))
        elif node.op == "index":
            assert isinstance(node.data, np.ndarray)
            flat = list(args[0].flat)
            out = _shaped([flat[k] for k in node.data.ravel().tolist()], node.shape)
        elif node.op == "sum":
            total = np.sum(args[0], axis=node.parameter)
            out = _shaped(list(total.flat) if isinstance(total, np.ndarray) else [total], node.shape)
        elif node.op == "neg":
            out = _each(lambda a: -a, args, node.shape)
        elif node.op == "power":
            out = _each(lambda a, p=node.parameter: codac.pow(a, p), args, node.shape)
        elif node.op in _UNARY:
            out = _each(getattr(codac, node.op), args, node.shape)
        else:
            out = _each(_BINARY[node.op], args, node.shape)
        done[node.digest] = out
    return done[root.digest]


def _shaped(values: list[Any], shape: tuple[int, ...]) -> Any:
    out = np.empty(shape, object)
    for index, value in zip(np.ndindex(shape), values, strict=True):
        out[index] = value
    return out


def _each(function: Callable[..., Any], args: list[Any], shape: tuple[int, ...]) -> Any:
    out = np.empty(shape, object)
    full = [np.broadcast_to(arg, shape) for arg in args]
    for index in np.ndindex(shape):
        out[index] = function(*(arg[index] for arg in full))
    return out
