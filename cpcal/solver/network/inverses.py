"""What is left of an operation's arguments where its result is known: the backward part of hc4."""

from __future__ import annotations

import math

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.kernels import (
    Bounds,
    add,
    div,
    factor,
    hull,
    meet,
    mul,
    neg,
    root,
    sqr,
    sqrt,
    sub,
)
from cpcal.solver.network.operations import ABS, ADD, DIV, MAX, MIN, MUL, NEG, POWER, SQR, SQRT, SUB


@compiled
def either_sign(x_lo: float, x_hi: float, r_lo: float, r_hi: float) -> Bounds:
    """The part of x in r or in -r, as a hull (r >= 0)."""
    one_lo, one_hi = meet(x_lo, x_hi, r_lo, r_hi)
    two_lo, two_hi = meet(x_lo, x_hi, -r_hi, -r_lo)
    return hull(one_lo, one_hi, two_lo, two_hi)


@compiled
def _power_argument(n: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float) -> Bounds:
    if n == 0:
        return a_lo, a_hi
    if n < 0:
        z_lo, z_hi = div(1.0, 1.0, z_lo, z_hi)
        n = -n
    r_lo, r_hi = root(z_lo, z_hi, n)
    return (r_lo, r_hi) if n % 2 else either_sign(a_lo, a_hi, r_lo, r_hi)


@compiled
def _at_least(z_lo: float, z_hi: float, other_lo: float) -> Bounds:
    """An argument of a minimum in z: at least z, and in z where the other argument can not be the minimum."""
    return z_lo, z_hi if other_lo > z_hi else math.inf


@compiled
def first_argument(
    code: int, n: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float, b_lo: float, b_hi: float
) -> Bounds:
    """A set that holds all points of a for which some point of b gives a result in z (to be intersected with a)."""
    if code == MUL:
        return factor(z_lo, z_hi, b_lo, b_hi, a_lo, a_hi)
    if code == ADD:
        return sub(z_lo, z_hi, b_lo, b_hi)
    if code == SUB:
        return add(z_lo, z_hi, b_lo, b_hi)
    if code == SQR:
        r_lo, r_hi = sqrt(z_lo, z_hi)
        return either_sign(a_lo, a_hi, r_lo, r_hi)
    if code == NEG:
        return neg(z_lo, z_hi)
    if code == SQRT:
        return sqr(max(z_lo, 0.0), z_hi)
    if code == DIV:
        return mul(z_lo, z_hi, b_lo, b_hi)
    if code == POWER:
        return _power_argument(n, z_lo, z_hi, a_lo, a_hi)
    if code == ABS:
        return either_sign(a_lo, a_hi, max(z_lo, 0.0), z_hi)
    if code == MIN:
        return _at_least(z_lo, z_hi, b_lo)
    if code == MAX:
        low, high = _at_least(-z_hi, -z_lo, -b_hi)
        return -high, -low
    return a_lo, a_hi


@compiled
def second_argument(
    code: int, n: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float, b_lo: float, b_hi: float
) -> Bounds:
    """The same for b."""
    if code == MUL:
        return factor(z_lo, z_hi, a_lo, a_hi, b_lo, b_hi)
    if code == ADD:
        return sub(z_lo, z_hi, a_lo, a_hi)
    if code == SUB:
        return sub(a_lo, a_hi, z_lo, z_hi)
    if code == DIV:
        return factor(a_lo, a_hi, z_lo, z_hi, b_lo, b_hi)
    if code == MIN:
        return _at_least(z_lo, z_hi, a_lo)
    if code == MAX:
        low, high = _at_least(-z_hi, -z_lo, -a_hi)
        return -high, -low
    return b_lo, b_hi
