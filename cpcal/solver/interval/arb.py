"""arb's primitives: every bound computed at 128 bits, then rounded outward to float64.

Slow (a few microseconds for each). They compute at numbers, each an exact ball, and take the place of the compiled
functions that round (`rebound`): whatever intervals compose of those is computed in arb then. A wide interval held in a
ball would lose signs and the last bits of its radius. Infinite operands and NaN never reach arb.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from math import inf, isfinite, isinf, isnan, nan, nextafter
from typing import Any, TypeAlias, TypeVar

import flint
import numpy as np
from flint import arb

from cpcal.common.values import Floats

PRECISION = 128  # bits; products of two floats are exact, and so are most sums

Pair: TypeAlias = tuple[float, float]  # the bounds of one interval, or an enclosure of one real number

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


def _directed(
    exact: Callable[..., arb], beyond: Callable[..., float]
) -> tuple[Callable[..., float], Callable[..., float]]:
    """A bound below and one above of an operation on numbers; `beyond`: where one of them is infinite or NaN."""

    def value(given: tuple[float, ...]) -> arb | float:
        numbers = [float(number) for number in given]
        return exact(*map(arb, numbers)) if all(map(isfinite, numbers)) else beyond(*numbers)

    def below(*given: float) -> float:
        found = value(given)
        return min(found, _MAX) if isinstance(found, float) else float_below(found)

    def above(*given: float) -> float:
        found = value(given)
        return max(found, -_MAX) if isinstance(found, float) else float_above(found)

    return below, above


def _at(function: Callable[[arb], arb], *ends: tuple[float, Pair], far: float = inf) -> Callable[[float], Pair]:
    """Bounds of a function at a number, at some `ends` those given; beyond +-far the values there are bound enough."""
    known = dict(ends)

    def pair(number: float) -> Pair:
        x = float(number)
        if isnan(x):
            return x, x
        return known[x] if x in known else number_pair(function(arb(max(min(x, far), -far))))

    return pair


def _infinite_product(a: float, b: float) -> float:
    return 0.0 if 0.0 in (a, b) and not (isnan(a) or isnan(b)) else a * b


_HALF_PI = float_below(arb.pi() / 2), float_above(arb.pi() / 2)
_FAR = 1000.0  # exp of it is beyond all floats
_LEAST, _MOST = (-inf, -_MAX), (_MAX, inf)


def _with_exponent(exact: Callable[[arb, int], arb], beyond: Callable[[float, int], float]) -> Callable[..., float]:
    """A bound of an operation on a number and an integer, above it if so asked; `beyond` as in `_directed`."""

    def bound(number: float, n: int, up: bool) -> float:
        sides = _directed(lambda a: exact(a, int(n)), lambda a: beyond(a, int(n)))
        return sides[bool(up)](number)

    return bound


# By the names in `kernels` and `functions`, which compose intervals of them.
PRIMITIVES: dict[str, Callable[..., Any]] = {
    **{
        f"{name}_{side}": function
        for name, both in {
            "sum": _directed(lambda a, b: a + b, lambda a, b: a + b),
            "product": _directed(lambda a, b: a * b, _infinite_product),
            "quotient": _directed(lambda a, b: a / b, lambda a, b: abs(a) * 0.0 if isinf(b) else a / b),
            "root": _directed(lambda a: a.sqrt(), lambda a: a),
        }.items()
        for side, function in zip(("below", "above"), both, strict=True)
    },
    "rounded_power": _with_exponent(lambda a, n: a**n, lambda a, n: a if n > 0 or isnan(a) else 0.0),
    "rounded_root": _with_exponent(lambda a, n: a.root(n) if a != 0 else a, lambda a, n: a),
    "total_below": _total_below,
    "exp_at": _at(lambda x: x.exp(), far=_FAR),
    "expm1_at": _at(lambda x: x.expm1(), far=_FAR),
    "log_at": _at(lambda x: x.log(), (0.0, _LEAST), (inf, _MOST)),
    "log1p_at": _at(lambda x: x.log1p(), (-1.0, _LEAST), (inf, _MOST)),
    "sin_at": _at(lambda x: x.sin()),
    "cos_at": _at(lambda x: x.cos()),
    "atan_at": _at(lambda x: x.atan(), (-inf, (-_HALF_PI[1], -_HALF_PI[0])), (inf, _HALF_PI)),
    "_asin_at": _at(lambda x: x.asin()),
    "_acos_at": _at(lambda x: x.acos()),
    "_sinh_at": _at(lambda x: x.sinh(), far=_FAR),
    "_cosh_at": _at(lambda x: x.cosh(), far=_FAR),
    "_tanh_at": _at(lambda x: x.tanh(), far=_FAR),
}
