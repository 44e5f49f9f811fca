"""Intervals whose ends are whole multiples of 2^-160, rounded outward: bounds of what is no finite fraction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction as F
from math import isqrt

from .refusal import Refused

_BITS = 160
_ONE = 1 << _BITS


class Bounds:
    """All numbers from lo to hi, both times 2^-160."""

    __slots__ = ("hi", "lo")

    def __init__(self, lo: int, hi: int) -> None:
        if lo > hi:
            raise Refused("an interval is empty that holds every solution", "proof")
        self.lo, self.hi = lo, hi

    def __add__(self, other: Bounds) -> Bounds:
        return Bounds(self.lo + other.lo, self.hi + other.hi)

    def __sub__(self, other: Bounds) -> Bounds:
        return Bounds(self.lo - other.hi, self.hi - other.lo)

    def __neg__(self) -> Bounds:
        return Bounds(-self.hi, -self.lo)

    def __mul__(self, other: Bounds) -> Bounds:
        if other.lo == other.hi:
            a, b = self.lo * other.lo, self.hi * other.lo
            return Bounds(min(a, b) >> _BITS, -(-max(a, b) >> _BITS))
        if self.lo >= 0 and other.lo >= 0:
            return Bounds(self.lo * other.lo >> _BITS, -(-self.hi * other.hi >> _BITS))
        a, b, c, d = self.lo * other.lo, self.lo * other.hi, self.hi * other.lo, self.hi * other.hi
        return Bounds(min(a, b, c, d) >> _BITS, -(-max(a, b, c, d) >> _BITS))

    def __truediv__(self, other: Bounds) -> Bounds:
        if other.lo <= 0 <= other.hi:
            raise Refused("a divisor may be zero", "proof")
        ends = [(n << _BITS, d) for n in (self.lo, self.hi) for d in (other.lo, other.hi)]
        return Bounds(min(n // d for n, d in ends), max(-(-n // d) for n, d in ends))

    def times(self, whole: int) -> Bounds:
        a, b = self.lo * whole, self.hi * whole
        return Bounds(min(a, b), max(a, b))

    @property
    def square(self) -> Bounds:
        least = 0 if self.lo <= 0 <= self.hi else min(abs(self.lo), abs(self.hi))
        most = max(abs(self.lo), abs(self.hi))
        return Bounds(least * least >> _BITS, -(-most * most >> _BITS))

    @property
    def root(self) -> Bounds:
        """Of what is not negative."""
        return Bounds(isqrt(max(self.lo, 0) << _BITS), isqrt(max(self.hi, 0) << _BITS) + 1)

    @property
    def size(self) -> Bounds:
        """The largest absolute value."""
        most = max(abs(self.lo), abs(self.hi))
        return Bounds(most, most)

    @property
    def middle(self) -> Bounds:
        half = self.lo + self.hi >> 1
        return Bounds(half, half)

    @property
    def radius(self) -> Bounds:
        """The distance from `middle` to the farther end."""
        half = self.hi - (self.lo + self.hi >> 1)
        return Bounds(half, half)

    @property
    def least(self) -> Bounds:
        return Bounds(self.lo, self.lo)

    @property
    def most(self) -> Bounds:
        return Bounds(self.hi, self.hi)

    def within(self, lo: int, hi: int) -> Bounds:
        """What of it lies between two whole numbers."""
        return Bounds(max(self.lo, lo << _BITS), min(self.hi, hi << _BITS))

    def around(self, radius: Bounds) -> Bounds:
        """All numbers at most so far from it."""
        return Bounds(self.lo - radius.hi, self.hi + radius.hi)


def number(value: F | int) -> Bounds:
    return between(F(value), F(value))


def between(lo: F, hi: F) -> Bounds:
    return Bounds((lo.numerator << _BITS) // lo.denominator, -((-hi.numerator << _BITS) // hi.denominator))


ZERO, ONE, TWO = Bounds(0, 0), Bounds(_ONE, _ONE), Bounds(2 * _ONE, 2 * _ONE)
UNIT = Bounds(-_ONE, _ONE)


def total(parts: Iterable[Bounds]) -> Bounds:
    lo = hi = 0
    for part in parts:
        lo, hi = lo + part.lo, hi + part.hi
    return Bounds(lo, hi)


def inner(x: Sequence[Bounds], y: Sequence[Bounds]) -> Bounds:
    return total(a * b for a, b in zip(x, y, strict=True))


Vector = Sequence[Bounds]
Matrix = Sequence[Vector]


def applied(matrix: Matrix, x: Vector) -> list[Bounds]:
    return [inner(row, x) for row in matrix]


def product(left: Matrix, right: Matrix) -> list[list[Bounds]]:
    columns = transposed(right)
    return [[inner(row, column) for column in columns] for row in left]


def transposed(matrix: Matrix) -> list[list[Bounds]]:
    return [list(column) for column in zip(*matrix, strict=True)]


def plus(x: Vector, y: Vector) -> list[Bounds]:
    return [a + b for a, b in zip(x, y, strict=True)]


def minus(x: Vector, y: Vector) -> list[Bounds]:
    return [a - b for a, b in zip(x, y, strict=True)]


def rotation(q: Vector) -> list[list[Bounds]]:
    """The rotation of a quaternion, scalar first, divided by its square."""
    w, x, y, z = q
    ww, xx, yy, zz = w.square, x.square, y.square, z.square
    rows = [
        [ww + xx - yy - zz, TWO * (x * y - w * z), TWO * (x * z + w * y)],
        [TWO * (x * y + w * z), ww - xx + yy - zz, TWO * (y * z - w * x)],
        [TWO * (x * z - w * y), TWO * (y * z + w * x), ww - xx - yy + zz],
    ]
    return [[(entry / (ww + xx + yy + zz)).within(-1, 1) for entry in row] for row in rows]


def half_turn(matrix: Matrix) -> list[Bounds]:
    """s with the rotation R(1, s) in the matrix. Refuses what may be a half-turn."""
    divisor = ONE + matrix[0][0] + matrix[1][1] + matrix[2][2]
    if divisor.lo <= 0:
        raise Refused("the rotation about the centre may be a half-turn", "proof")
    off = (matrix[2][1] - matrix[1][2], matrix[0][2] - matrix[2][0], matrix[1][0] - matrix[0][1])
    return [entry / divisor for entry in off]
