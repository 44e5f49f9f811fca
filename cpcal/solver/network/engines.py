"""The sweeps for an arithmetic: compiled ones for float64; for arb the same source on arb's primitives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from cpcal.solver.compiled import ready, rebound
from cpcal.solver.interval import Arithmetic, IntervalArray, functions, inverse_functions, kernels
from cpcal.solver.network import derivatives, inverses, operations, sweeps
from cpcal.solver.network.expression import Expr
from cpcal.solver.network.operations import TABLE

_SOURCES = (kernels, functions, inverse_functions, operations, inverses, derivatives, sweeps)


def sweeps_of(engine: Arithmetic) -> Any:
    """The functions of `sweeps`, by name, in an engine's arithmetic."""
    return in_arithmetic(engine.name, sweeps)


def elementwise(engine: Arithmetic, node: Expr, args: Sequence[IntervalArray]) -> IntervalArray:
    """The operation of a node on arrays of intervals (1, *S), element by element."""
    row, value = TABLE[node.op], sweeps_of(engine).value
    bounds = [x.reshape(x.shape[1:]).broadcast_to(node.shape) for x in args]
    out = IntervalArray(np.empty(node.shape), np.empty(node.shape))
    for k in np.ndindex(node.shape):
        at = [float(bound[k]) for x in (bounds[0], bounds[-1]) for bound in (x.lo, x.hi)]
        out.lo[k], out.hi[k] = value(row.code, node.parameter, *at)
    return out[None]


@cache
def in_arithmetic(name: str, source: ModuleType) -> Any:
    """The functions of a module of kernels (and those of the tape's), by name, in the arithmetic of that name."""
    sources = [*_SOURCES, source] if source not in _SOURCES else list(_SOURCES)
    functions = [function for module in sources for function in _defined_in(module)]
    if name == "float64":
        found = {f.__name__: ready(f) for f in functions}
        return SimpleNamespace(**{name: f if hasattr(f, "py_func") else _quiet(f) for name, f in found.items()})
    from cpcal.solver.interval.arb_primitives import PRIMITIVES, in_arb

    return SimpleNamespace(**{k: in_arb(v) for k, v in rebound(functions, PRIMITIVES).items()})


def _defined_in(source: Any) -> list[Callable[..., Any]]:
    """The functions of a module, in the order of the file."""
    found = [v for v in vars(source).values() if callable(v) and not isinstance(v, type)]
    return [function for function in found if getattr(function, "__module__", "") == source.__name__]


def _quiet(function: Callable[..., Any]) -> Callable[..., Any]:
    """Plain Python on numpy's numbers, without its warnings."""

    def silent(*args: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*args)

    return silent
