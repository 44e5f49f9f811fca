"""The tight engine: every bound computed with arb at 128 bits, then rounded outward to float64.

Slow (a few microseconds per element), and an oracle for the fast engine. It computes on bounds, each an exact
ball, with the formulas of interval arithmetic: a wide interval held in a ball would lose signs and the last
bits of its radius. Infinite and empty operands never reach arb.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import copysign, inf, isinf, isnan, nan, nextafter
from typing import TypeAlias

import flint
import numpy as np
from flint import arb

from cpcal.common.arrays import Floats
from cpcal.solver.interval.array import IntervalArray
from cpcal.solver.interval.float64 import Float64

PRECISION = 128  # bits; products of two floats are exact, and so are most sums

Pair: TypeAlias = tuple[float, float]  # the bounds of one interval, or an enclosure of one real number

EMPTY: Pair = (nan, nan)
_ENTIRE: Pair = (-inf, inf)
_ZERO: Pair = (0.0, 0.0)
_MAX = float(np.finfo(np.float64).max)
_EXACT = Float64()  # for the operations that do not round
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


class Arb:
    """`Arithmetic` in arb, element by element."""

    name = "arb"

    def neg(self, x: IntervalArray) -> IntervalArray:
        return _EXACT.neg(x)

    def add(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _apply(add_pair, x, y)

    def sub(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _apply(add_pair, x, _EXACT.neg(y))

    def mul(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _apply(mul_pair, x, y)

    def div(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _apply(div_pair, x, y)

    def sqr(self, x: IntervalArray) -> IntervalArray:
        return self.power(x, 2)

    def sqrt(self, x: IntervalArray) -> IntervalArray:
        return self.root(x, 2)

    def power(self, x: IntervalArray, n: int) -> IntervalArray:
        return _apply(lambda p: power_pair(p, n), x)

    def root(self, x: IntervalArray, n: int) -> IntervalArray:
        if n < 1:
            raise ValueError(f"the order of a root is at least 1, not {n}")
        return _apply(lambda p: root_pair(p, n), x)

    def abs(self, x: IntervalArray) -> IntervalArray:
        return _EXACT.abs(x)

    def minimum(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _EXACT.minimum(x, y)

    def maximum(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _EXACT.maximum(x, y)

    def factor(self, z: IntervalArray, y: IntervalArray, x: IntervalArray) -> IntervalArray:
        return _apply(factor_pair, z, y, x)

    def sum(self, x: IntervalArray, axis: int) -> IntervalArray:
        lo, hi = np.moveaxis(x.lo, axis, -1), np.moveaxis(x.hi, axis, -1)
        shape = lo.shape[:-1]
        with precision(PRECISION):
            low = [_total_below(lo[i].tolist()) for i in np.ndindex(shape)]
            high = [-_total_below((-hi[i]).tolist()) for i in np.ndindex(shape)]
        return IntervalArray(np.reshape(low, shape), np.reshape(high, shape))

    def dot(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        rows, columns = _pairs(x), _pairs(IntervalArray(y.lo.T, y.hi.T))
        with precision(PRECISION):
            products = [_dot(row, column) for row in rows for column in columns]
        bounds = np.array(products, dtype=np.float64).reshape(len(rows), len(columns), 2)
        return IntervalArray(bounds[..., 0], bounds[..., 1])


def _apply(operation: Callable[..., Pair], *operands: IntervalArray) -> IntervalArray:
    """The operation on each element; an empty operand gives the empty interval."""

    def one(*bounds: float) -> Pair:
        if any(map(isnan, bounds)):
            return EMPTY
        return operation(*[(bounds[i], bounds[i + 1]) for i in range(0, len(bounds), 2)])

    arrays: list[Floats] = [bound for x in operands for bound in (x.lo, x.hi)]
    elementwise: Callable[..., tuple[object, object]] = np.frompyfunc(one, len(arrays), 2)
    with precision(PRECISION), np.errstate(all="ignore"):
        lo, hi = elementwise(*arrays)
    return IntervalArray(np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64))


def _pairs(x: IntervalArray) -> list[list[Pair]]:
    """The rows of a matrix."""
    shape = x.shape
    return [[(float(x.lo[i, j]), float(x.hi[i, j])) for j in range(shape[1])] for i in range(shape[0])]


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


def _total_below(terms: list[float]) -> float:
    """The greatest float64 at most the sum of lower bounds."""
    if any(map(isnan, terms)):
        return nan
    return -inf if -inf in terms else float_below(sum(map(arb, terms), arb(0)))


def _dot(row: list[Pair], column: list[Pair]) -> Pair:
    """Sum of the products, each bound rounded once; no knowledge of non-finite entries."""
    low = high = arb(0)
    for x, y in zip(row, column, strict=True):
        if not all(-inf < bound < inf for bound in (*x, *y)):
            return _ENTIRE
        products = [arb(a) * arb(b) for a in x for b in y]  # exact at 128 bits, so `min` compares numbers
        low, high = low + min(products), high + max(products)
    return float_below(low), float_above(high)
