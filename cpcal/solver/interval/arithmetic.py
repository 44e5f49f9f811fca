"""What an interval engine must offer, and the one place where an engine is chosen by name."""

from __future__ import annotations

from typing import Protocol

from cpcal.common.errors import InputError, Problem
from cpcal.solver.interval.float64 import check_rounding
from cpcal.solver.interval.numbers import IntervalArray


class Arithmetic(Protocol):
    """Rigorous elementwise arithmetic on `IntervalArray`; operands broadcast as in numpy.

    Every result contains the exact image of the operands' points (where the operation is defined
    there); the empty interval gives the empty interval; overflow gives an infinite bound.
    """

    name: str

    def neg(self, x: IntervalArray) -> IntervalArray: ...
    def add(self, x: IntervalArray, y: IntervalArray) -> IntervalArray: ...
    def sub(self, x: IntervalArray, y: IntervalArray) -> IntervalArray: ...
    def mul(self, x: IntervalArray, y: IntervalArray) -> IntervalArray: ...

    def div(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        """Hull of `{a / b : a in x, b in y, b != 0}`.

        A zero of y at an end gives a half line, y == [0, 0] the empty interval.
        """
        ...

    def sqr(self, x: IntervalArray) -> IntervalArray: ...

    def sqrt(self, x: IntervalArray) -> IntervalArray:
        """Square root of the part of x that is >= 0; empty where x < 0."""
        ...

    def power(self, x: IntervalArray, n: int) -> IntervalArray:
        """`x ** n` for an integer n of any sign."""
        ...

    def root(self, x: IntervalArray, n: int) -> IntervalArray:
        """n-th root, n >= 1: for odd n of all x (sign kept), for even n as `sqrt`."""
        ...

    def abs(self, x: IntervalArray) -> IntervalArray: ...
    def minimum(self, x: IntervalArray, y: IntervalArray) -> IntervalArray: ...
    def maximum(self, x: IntervalArray, y: IntervalArray) -> IntervalArray: ...

    def factor(self, z: IntervalArray, y: IntervalArray, x: IntervalArray) -> IntervalArray:
        """Hull of `{a in x : a * b in z for some b in y}` (IEEE 1788 mulRev with a prior)."""
        ...

    def sum(self, x: IntervalArray, axis: int) -> IntervalArray:
        """Sum along one axis (which disappears)."""
        ...

    def dot(self, x: IntervalArray, y: IntervalArray) -> IntervalArray:
        """Matrix product of shapes (m, k) and (k, n), all entries finite."""
        ...


def get_arithmetic(name: str) -> Arithmetic:
    """The engine called `name`: "float64" (fast) or "arb" (slow, tight).

    Raises InputError for another name, RoundingError where float64 numbers are not rounded to nearest.
    """
    check_rounding()
    if name == "float64":
        from cpcal.solver.interval.float64 import Float64

        return Float64()
    if name == "arb":
        from cpcal.solver.interval.arb import Arb

        return Arb()
    raise InputError([Problem("arithmetic", f"{name!r} is not an engine", 'use "float64" or "arb"')])
