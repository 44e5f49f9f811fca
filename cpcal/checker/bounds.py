"""Intervals whose ends are whole multiples of 2^-160, rounded outward, and vectors and matrices of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction as F
from math import isqrt
from typing import TypeVar

from .polynomial import inner, rotation_rows
from .readers import Refused
from .rule import Box

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

    def __mul__(self, other: Bounds) -> Bounds:
        if other.lo == other.hi:
            a, b = self.lo * other.lo, self.hi * other.lo
            return Bounds(min(a, b) >> _BITS, -(-max(a, b) >> _BITS))
        if self.lo >= 0 and other.lo >= 0:
            return Bounds(self.lo * other.lo >> _BITS, -(-self.hi * other.hi >> _BITS))
        a, b, c, d = self.lo * other.lo, self.lo * other.hi, self.hi * other.lo, self.hi * other.hi
        return Bounds(min(a, b, c, d) >> _BITS, -(-max(a, b, c, d) >> _BITS))

    def __rmul__(self, whole: int) -> Bounds:
        a, b = self.lo * whole, self.hi * whole
        return Bounds(min(a, b), max(a, b))

    def __truediv__(self, other: Bounds) -> Bounds:
        if other.lo <= 0 <= other.hi:
            raise Refused("a divisor may be zero", "proof")
        ends = [(n << _BITS, d) for n in (self.lo, self.hi) for d in (other.lo, other.hi)]
        return Bounds(min(n // d for n, d in ends), max(-(-n // d) for n, d in ends))

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
        return _at(max(abs(self.lo), abs(self.hi)))

    @property
    def middle(self) -> Bounds:
        return _at(self.lo + self.hi >> 1)

    @property
    def least(self) -> Bounds:
        return _at(self.lo)

    @property
    def most(self) -> Bounds:
        return _at(self.hi)

    def within(self, lo: int, hi: int) -> Bounds:
        """What of it lies between two whole numbers."""
        return Bounds(max(self.lo, lo << _BITS), min(self.hi, hi << _BITS))

    def around(self, radius: Bounds) -> Bounds:
        """All numbers at most so far from it."""
        return Bounds(self.lo - radius.hi, self.hi + radius.hi)

    def floor(self, bits: int) -> int:
        """The largest whole multiple of 2^-bits that is not above it."""
        return self.lo >> _BITS - bits

    def ceiling(self, bits: int) -> int:
        return -(-self.hi >> _BITS - bits)

    @property
    def ends(self) -> tuple[F, F]:
        return F(self.lo, _ONE), F(self.hi, _ONE)


def _at(value: int) -> Bounds:
    return Bounds(value, value)


def multiple(whole: int, bits: int) -> Bounds:
    """whole 2^-bits."""
    return _at(whole << _BITS - bits)


def between(lo: F, hi: F) -> Bounds:
    return Bounds((lo.numerator << _BITS) // lo.denominator, -((-hi.numerator << _BITS) // hi.denominator))


def number(value: F | int) -> Bounds:
    return between(F(value), F(value))


ZERO, ONE, UNIT = number(0), number(1), Bounds(-_ONE, _ONE)
T = TypeVar("T")
Vector = Sequence[Bounds]
Matrix = Sequence[Vector]


def total(parts: Iterable[Bounds]) -> Bounds:
    lo = hi = 0
    for part in parts:
        lo, hi = lo + part.lo, hi + part.hi
    return Bounds(lo, hi)


def dot(x: Vector, y: Vector) -> Bounds:
    """The inner product, rounded once."""
    low = high = 0
    for a, b in zip(x, y, strict=True):
        if b.lo == b.hi:
            one, other = a.lo * b.lo, a.hi * b.lo
        else:
            corners = a.lo * b.lo, a.lo * b.hi, a.hi * b.lo, a.hi * b.hi
            one, other = min(corners), max(corners)
        if one > other:
            one, other = other, one
        low += one
        high += other
    return Bounds(low >> _BITS, -(-high >> _BITS))


def longest(x: Vector) -> Bounds:
    """Of all vectors in it: the largest value of x . t, for |t| <= 1."""
    return _at(isqrt(sum(max(-v.lo, v.hi) ** 2 for v in x)) + 1)


def numbers(values: Iterable[F | int]) -> list[Bounds]:
    return [number(value) for value in values]


def sizes(x: Vector) -> list[Bounds]:
    return [v.size for v in x]


def matrix(entries: Sequence[T]) -> list[Sequence[T]]:
    """(3, 3), from its entries row by row."""
    return [entries[k : k + 3] for k in (0, 3, 6)]


def rotation(q: Vector) -> list[list[Bounds]]:
    """The rotation of a quaternion, scalar first, divided by its square."""
    square = inner(q, q)
    return [[(entry / square).within(-1, 1) for entry in row] for row in rotation_rows(q)]


def half_turn(turn: Matrix) -> list[Bounds]:
    """s with the rotation R(1, s) in the matrix. Refuses what may be a half-turn."""
    divisor = ONE + turn[0][0] + turn[1][1] + turn[2][2]
    if divisor.lo <= 0:
        raise Refused("the rotation about the centre may be a half-turn", "proof")
    return [entry / divisor for entry in skew(turn)]


def skew(turn: Matrix) -> list[Bounds]:
    """Twice the vector of a matrix's skew part: 2 sin(angle) times the axis of a rotation."""
    return [turn[k - 1][k - 2] - turn[k - 2][k - 1] for k in range(3)]


def bounds_of(box: Box) -> list[Bounds]:
    return [between(lo, hi) for lo, hi in zip(box.lo, box.hi, strict=True)]


def box_of(parts: Vector, bits: int) -> Box:
    """Outward to whole multiples of 2^-bits."""
    return Box(tuple(F(v.floor(bits), 1 << bits) for v in parts), tuple(F(v.ceiling(bits), 1 << bits) for v in parts))
