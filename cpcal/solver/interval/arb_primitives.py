"""arb in the place of the compiled functions that round: the same sweeps then compute in arb (see `rebound`)."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from math import inf, isinf, isnan
from typing import TypeVar

import numpy as np
from flint import arb

from cpcal.solver.interval.arb import (
    EMPTY,
    PRECISION,
    Pair,
    add_pair,
    div_pair,
    factor_pair,
    float_above,
    float_below,
    mul_pair,
    number_pair,
    power_pair,
    precision,
    root_pair,
)

T = TypeVar("T")


def in_arb(function: Callable[..., T]) -> Callable[..., T]:
    """A function that calls the primitives below, at our precision."""

    @wraps(function)
    def with_precision(*args: object) -> T:
        with precision(PRECISION), np.errstate(all="ignore"):
            return function(*args)

    return with_precision


def _primitive(operation: Callable[..., Pair], operands: int) -> Callable[..., Pair]:
    """An operation of arb as one of `kernels`: bounds one after the other, then perhaps an integer."""

    def one(*given: float) -> Pair:
        bounds = [float(bound) for bound in given[: 2 * operands]]
        if any(map(isnan, bounds)):
            return EMPTY
        pairs = [(bounds[i], bounds[i + 1]) for i in range(0, len(bounds), 2)]
        return operation(*pairs, *(int(n) for n in given[2 * operands :]))

    return one


def _growing(function: Callable[[arb], arb], domain: Pair, limits: Pair, far: float = inf) -> Callable[..., Pair]:
    """A function that grows, with its domain and its limits there; beyond +-far its value at +-far is bound enough."""

    def pair(x: Pair) -> Pair:
        if x[1] < domain[0] or x[0] > domain[1]:
            return EMPTY
        low = limits[0] if x[0] <= max(domain[0], -far) else number_pair(function(arb(min(x[0], far))))[0]
        high = limits[1] if x[1] >= min(domain[1], far) else number_pair(function(arb(max(x[1], -far))))[1]
        return max(low, limits[0]), min(high, limits[1])

    return _primitive(pair, 1)


def _wave(function: Callable[[arb], arb], offset: float) -> Callable[..., Pair]:
    """sin or cos: extrema at (m + offset) pi, maxima for even m."""

    def pair(x: Pair) -> Pair:
        if isinf(x[0]) or isinf(x[1]):
            return -1.0, 1.0
        first = float((arb(x[0]) / arb.pi() - offset).lower().ceil().mid())
        last = float((arb(x[1]) / arb.pi() - offset).upper().floor().mid())
        if last > first:
            return -1.0, 1.0
        ends = [number_pair(function(arb(v))) for v in x]
        low, high = max(min(a for a, _ in ends), -1.0), min(max(b for _, b in ends), 1.0)
        if first == last:
            return (low, 1.0) if first % 2 == 0 else (-1.0, high)
        return low, high

    return _primitive(pair, 1)


def _acos(x: Pair) -> Pair:
    lo, hi = max(x[0], -1.0), min(x[1], 1.0)
    return (float_below(arb(hi).acos()), float_above(arb(lo).acos())) if lo <= hi else EMPTY


def _cosh(x: Pair) -> Pair:
    most = max(-x[0], x[1])
    least = max(x[0], -x[1], 0.0)
    return float_below(arb(min(least, 1000.0)).cosh()), inf if most > 1000.0 else float_above(arb(most).cosh())


_LINE = -inf, inf
_HALF_PI = float_below(-arb.pi() / 2), float_above(arb.pi() / 2)

# By the names in `kernels` and `functions`.
PRIMITIVES: dict[str, Callable[..., Pair]] = {
    "add": _primitive(add_pair, 2),
    "sub": _primitive(lambda x, y: add_pair(x, (-y[1], -y[0])), 2),
    "mul": _primitive(mul_pair, 2),
    "div": _primitive(div_pair, 2),
    "sqr": _primitive(lambda x: power_pair(x, 2), 1),
    "sqrt": _primitive(lambda x: root_pair(x, 2), 1),
    "power": _primitive(power_pair, 1),
    "root": _primitive(root_pair, 1),
    "factor": _primitive(factor_pair, 3),
    "exp": _growing(lambda x: x.exp(), _LINE, (0.0, inf), 1000.0),
    "expm1": _growing(lambda x: x.expm1(), _LINE, (-1.0, inf), 1000.0),
    "log": _growing(lambda x: x.log(), (0.0, inf), _LINE),
    "log1p": _growing(lambda x: x.log1p(), (-1.0, inf), _LINE),
    "sinh": _growing(lambda x: x.sinh(), _LINE, _LINE, 1000.0),
    "tanh": _growing(lambda x: x.tanh(), _LINE, (-1.0, 1.0), 1000.0),
    "asin": _growing(lambda x: x.asin(), (-1.0, 1.0), _HALF_PI),
    "atan": _growing(lambda x: x.atan(), _LINE, _HALF_PI),
    "acos": _primitive(_acos, 1),
    "cosh": _primitive(_cosh, 1),
    "sin": _wave(lambda x: x.sin(), 0.5),
    "cos": _wave(lambda x: x.cos(), 0.0),
}
