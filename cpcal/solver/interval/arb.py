"""arb's primitives: every bound computed at 128 bits, then rounded outward to float64.

Slow (a few microseconds for each). They compute on bounds, each an exact ball, with the formulas of interval
arithmetic: a wide interval held in a ball would lose signs and the last bits of its radius. Infinite and empty operands
never reach arb. In the place of the compiled functions that round, the same sweeps then compute in arb (`rebound`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from math import copysign, inf, isinf, isnan, nan, nextafter
from typing import Any, TypeAlias, TypeVar

import flint
import numpy as np
from flint import arb

from cpcal.common.values import Floats

PRECISION = 128  # bits; products of two floats are exact, and so are most sums

Pair: TypeAlias = tuple[float, float]  # the bounds of one interval, or an enclosure of one real number

EMPTY: Pair = (nan, nan)
_ENTIRE: Pair = (-inf, inf)
_ZERO: Pair = (0.0, 0.0)
_MAX = float(np.finfo(np.float64).max)
_lock = threading.RLock()


@contextmanager
def precision(bits: int) -> Iterator[None]:
    """Compute in arb with this many bits inside the `with` block, one thread at a time.

    flint has a single precision for all threads: without the lock, a thread that leaves its block would
    change the precision under another one.
    """
    with _lock:
        before = flint.ctx.prec
        flint.ctx.prec = bits
        try:
            yield
        finally:
            flint.ctx.prec = before


def float_below(ball: arb) -> float:
    """The greatest float64 that is at most every point of a finite ball."""
    low = ball.lower()
    bound = min(float(low), _MAX)  # a neighbour of `low`; the comparison of exact balls decides
    while arb(bound) > low:
        bound = nextafter(bound, -inf)
    return bound


def float_above(ball: arb) -> float:
    """The least float64 that is at least every point of a finite ball."""
    return -float_below(-ball)


def number_pair(value: arb) -> Pair:
    return float_below(value), float_above(value)


def hull_pair(enclosures: list[Pair]) -> Pair:
    return min(lo for lo, _ in enclosures), max(hi for _, hi in enclosures)


def _meet(x: Pair, y: Pair) -> Pair:
    if isnan(x[0]):
        return EMPTY
    lo, hi = max(x[0], y[0]), min(x[1], y[1])
    return (lo, hi) if lo <= hi else EMPTY


def add_pair(x: Pair, y: Pair) -> Pair:
    lo = -inf if -inf in (x[0], y[0]) else float_below(arb(x[0]) + arb(y[0]))
    hi = inf if inf in (x[1], y[1]) else float_above(arb(x[1]) + arb(y[1]))
    return lo, hi


def mul_pair(x: Pair, y: Pair) -> Pair:
    return hull_pair([_product(a, b) for a in x for b in y])


def _product(a: float, b: float) -> Pair:
    """a b with 0 inf = 0, which is what bounds of intervals need."""
    if a == 0.0 or b == 0.0:
        return _ZERO
    if isinf(a) or isinf(b):
        infinite = copysign(inf, a) * copysign(1.0, b)
        return infinite, infinite
    return number_pair(arb(a) * arb(b))


def div_pair(x: Pair, y: Pair) -> Pair:
    if y == _ZERO:
        return EMPTY
    if y[0] < 0.0 < y[1]:
        return _ZERO if x == _ZERO else _ENTIRE
    quotients = [_quotient(a, b) for a in x for b in y if b != 0.0 and not (isinf(a) and isinf(b))]
    if y[0] == 0.0 or y[1] == 0.0:  # divisors next to zero, of one sign
        sign = 1.0 if y[0] == 0.0 else -1.0
        quotients += [(inf * sign, inf * sign)] * (x[1] > 0.0) + [(-inf * sign, -inf * sign)] * (x[0] < 0.0)
    return hull_pair(quotients)


def _quotient(a: float, b: float) -> Pair:
    """a / b for b != 0, not both infinite."""
    if a == 0.0 or isinf(b):
        return _ZERO
    if isinf(a):
        infinite = copysign(inf, a) * copysign(1.0, b)
        return infinite, infinite
    return number_pair(arb(a) / arb(b))


def power_pair(x: Pair, n: int) -> Pair:
    if n == 0:
        return 1.0, 1.0
    if n < 0 and x == _ZERO:
        return EMPTY
    if n < 0 and n % 2 and x[0] < 0.0 < x[1]:
        return _ENTIRE
    if n % 2 == 0:
        x = max(x[0], -x[1], 0.0), max(-x[0], x[1])
    # n < 0 at zero: the power tends to the infinity on the interval's side of zero.
    return hull_pair([_monomial(v, n, 1.0 if x[1] > 0.0 else -1.0) for v in x])


def _monomial(v: float, n: int, side: float) -> Pair:
    if v == 0.0:
        return _ZERO if n > 0 else (side * inf, side * inf)
    if isinf(v):
        infinite = v if n % 2 else inf
        return (infinite, infinite) if n > 0 else _ZERO
    return number_pair(arb(v) ** n)


def root_pair(x: Pair, n: int) -> Pair:
    if n % 2 == 0:
        if x[1] < 0.0:
            return EMPTY
        x = max(x[0], 0.0), x[1]
    return hull_pair([_root_of(v, n) for v in x])


def _root_of(v: float, n: int) -> Pair:
    if v == 0.0 or isinf(v) or n == 1:
        return v, v
    lo, hi = number_pair(arb(abs(v)).root(n))
    return (lo, hi) if v > 0.0 else (-hi, -lo)


def factor_pair(z: Pair, y: Pair, x: Pair) -> Pair:
    zero_in_y, zero_in_z = y[0] <= 0.0 <= y[1], z[0] <= 0.0 <= z[1]
    if zero_in_y and zero_in_z:
        return x
    parts = [(y[0], min(y[1], 0.0)), (max(y[0], 0.0), y[1])] if zero_in_y else [y]
    pieces = [_meet(div_pair(z, part), x) for part in parts]
    pieces = [piece for piece in pieces if not isnan(piece[0])]
    return hull_pair(pieces) if pieces else EMPTY


def _total_below(terms: Floats) -> float:
    """The greatest float64 at most the sum of lower bounds."""
    values = terms.tolist()
    if any(map(isnan, values)):
        return nan
    return -inf if -inf in values else float_below(sum(map(arb, values), arb(0)))


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
PRIMITIVES: dict[str, Callable[..., Any]] = {
    "add": _primitive(add_pair, 2),
    "sub": _primitive(lambda x, y: add_pair(x, (-y[1], -y[0])), 2),
    "mul": _primitive(mul_pair, 2),
    "div": _primitive(div_pair, 2),
    "sqr": _primitive(lambda x: power_pair(x, 2), 1),
    "sqrt": _primitive(lambda x: root_pair(x, 2), 1),
    "power": _primitive(power_pair, 1),
    "root": _primitive(root_pair, 1),
    "factor": _primitive(factor_pair, 3),
    "total_below": _total_below,
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
