"""Ordinary floating point in the clothes of an interval engine, for what needs no proof.

Values are `IntervalArray`s whose two bounds are the same array. Nothing computed here is rigorous: it
proposes points and derivatives to the rigorous engines.
"""

from __future__ import annotations

import numpy as np

from cpcal.solver.interval import IntervalArray


def _p(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> IntervalArray:
    return IntervalArray(values, values)


class Point:
    """`Arithmetic` without rounding control on degenerate intervals."""

    name = "point"

    def neg(self, x: IntervalArray) -> IntervalArray:
        return _p(-x.lo)

    def add(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _p(x.lo + y.lo)

    def sub(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _p(x.lo - y.lo)

    def mul(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _p(x.lo * y.lo)

    def div(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _p(x.lo / y.lo)

    def sqr(self, x: IntervalArray) -> IntervalArray:
        return _p(x.lo * x.lo)

    def sqrt(self, x: IntervalArray) -> IntervalArray:
        return _p(np.sqrt(x.lo))

    def power(self, x: IntervalArray, n: int) -> IntervalArray:
        return _p(x.lo ** float(n))

    def root(self, x: IntervalArray, n: int) -> IntervalArray:
        return _p(np.copysign(np.abs(x.lo) ** (1.0 / n), x.lo))

    def abs(self, x: IntervalArray) -> IntervalArray:
        return _p(np.abs(x.lo))

    def minimum(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _p(np.minimum(x.lo, y.lo))

    def maximum(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _p(np.maximum(x.lo, y.lo))

    def factor(self, z: IntervalArray, y: IntervalArray, x: IntervalArray) -> IntervalArray:
        return _p(z.lo / y.lo)

    def sum(self, x: IntervalArray, axis: int) -> IntervalArray:
        return _p(x.lo.sum(axis=axis))

    def dot(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        return _p(x.lo @ y.lo)
