"""Coefficients that depend on the readings: first-order Taylor models.

A coefficient is an array of shape (1 + J, *S): entry 0 is the value at the centre of the reading sets
plus everything of second order (an interval), entry j the derivative with respect to the j-th scaled
reading `delta_j` in [-1, 1]. Without readings the shape is (1, *S).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.coefficient_kernels import added, multiplied, summed

# Factor that covers the rounding of the few dozen float64 operations below that are not interval operations.
_ROUND_UP = 1.0 + 64 * np.finfo(np.float64).eps
_MAX = np.finfo(np.float64).max
_ROUND_DOWN = 1.0 - 64 * np.finfo(np.float64).eps


def is_zero(c: IntervalArray) -> bool:
    return not (c.lo.any() or c.hi.any())


def doubled(c: IntervalArray) -> IntervalArray:
    """Exactly, but where it overflows."""
    with np.errstate(over="ignore"):
        return IntervalArray(np.minimum(2.0 * c.lo, _MAX), np.maximum(2.0 * c.hi, -_MAX))


def padded(c: IntervalArray, slots: int) -> IntervalArray:
    """The same coefficient with zero derivatives added up to `slots` entries."""
    if c.shape[0] == slots:
        return c
    zeros = np.zeros((slots - c.shape[0], *c.shape[1:]))
    return IntervalArray(np.concatenate([c.lo, zeros]), np.concatenate([c.hi, zeros]))


def _same_slots(x: IntervalArray, y: IntervalArray) -> tuple[IntervalArray, IntervalArray]:
    slots = max(x.shape[0], y.shape[0])
    return padded(x, slots), padded(y, slots)


def add(e: Arithmetic, x: IntervalArray, y: IntervalArray) -> IntervalArray:
    return _compiled(added, x, y) if e.name == "float64" else e.add(*_same_slots(x, y))


Kernel = Callable[[Floats, Floats, Floats, Floats, int], tuple[Floats, Floats]]


def _compiled(kernel: Kernel, x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """What a kernel makes of coefficients whose elements broadcast."""
    shape = x.shape[1:] if x.shape[1:] == y.shape[1:] else np.broadcast_shapes(x.shape[1:], y.shape[1:])
    count = math.prod(shape)
    lo, hi = kernel(*_flat(x, shape, count), *_flat(y, shape, count), count)
    return IntervalArray(lo, hi).reshape((len(lo), *shape))


def total_over(e: Arithmetic, x: IntervalArray, axis: int) -> IntervalArray:
    """The sum of the elements along one of their axes, counted from 0."""
    if e.name != "float64":
        return e.sum(x, axis + 1)
    shape = x.shape
    size = (math.prod(shape[: axis + 1]), shape[axis + 1], math.prod(shape[axis + 2 :]))
    lo, hi = summed(np.ascontiguousarray(x.lo).reshape(size), np.ascontiguousarray(x.hi).reshape(size))
    return IntervalArray(lo, hi).reshape((*shape[: axis + 1], *shape[axis + 2 :]))


def _flat(x: IntervalArray, shape: tuple[int, ...], count: int) -> tuple[Floats, Floats]:
    """Bounds (1 + J, count), or (1 + J, 1) where all elements are the same."""
    slots = x.shape[0]
    if x.shape[1:] != shape and math.prod(x.shape[1:]) > 1:
        x = x.broadcast_to((slots, *shape))
    size = (slots, count if x.shape[1:] == shape else 1)
    lo = np.ascontiguousarray(x.lo.reshape(size))
    return lo, lo if x.hi is x.lo else np.ascontiguousarray(x.hi.reshape(size))


def mul(e: Arithmetic, x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Product: `x0 y0 + (x0 y_j + y0 x_j) delta_j` and the range of `(x_j delta_j)(y_j delta_j)`."""
    if e.name == "float64":
        return _compiled(multiplied, x, y)
    if x.shape[0] == 1 or y.shape[0] == 1:
        return e.mul(x, y)
    x, y = _same_slots(x, y)
    value = e.add(e.mul(x[:1], y[:1]), _second_order(e, x[1:], y[1:]))
    slopes = e.add(e.mul(x[:1], y[1:]), e.mul(y[:1], x[1:]))
    return IntervalArray(np.concatenate([value.lo, slopes.lo]), np.concatenate([value.hi, slopes.hi]))


def _second_order(e: Arithmetic, x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Range of `sum_i x_i d_i * sum_j y_j d_j` over |d| <= 1, shape (1, *S): d_i^2 is in [0, 1]."""
    squares = e.mul(x, y)
    lo = np.minimum(squares.lo, 0.0).sum(axis=0, keepdims=True)
    hi = np.maximum(squares.hi, 0.0).sum(axis=0, keepdims=True)
    a, b = x.mag, y.mag
    all_pairs = a.sum(axis=0, keepdims=True) * b.sum(axis=0, keepdims=True) * _ROUND_UP
    mixed = np.maximum(all_pairs - (a * b).sum(axis=0, keepdims=True) * _ROUND_DOWN, 0.0)
    return IntervalArray((lo - mixed) * _ROUND_UP, (hi + mixed) * _ROUND_UP)


def reciprocal(e: Arithmetic, x: IntervalArray) -> IntervalArray:
    """`1 / x = 1/m - h/m^2 + h^2 / (m^2 (m + h))` with value m and h = sum x_j delta_j."""
    m = x[:1]
    value = e.div(IntervalArray.point(np.ones(1)).reshape((1,) * m.ndim), m)
    if x.shape[0] == 1:
        return value
    h_max = x[1:].mag.sum(axis=0, keepdims=True) * _ROUND_UP
    square = IntervalArray(np.zeros_like(h_max), h_max * h_max * _ROUND_UP)
    whole = e.add(m, IntervalArray(-h_max, h_max))
    m2 = e.sqr(m)
    value = e.add(value, e.div(square, e.mul(m2, whole)))
    slopes = e.neg(e.div(x[1:], m2))
    return IntervalArray(np.concatenate([value.lo, slopes.lo]), np.concatenate([value.hi, slopes.hi]))


def total(e: Arithmetic, x: IntervalArray) -> IntervalArray:
    """The whole range over the reading sets, shape (1, *S)."""
    if x.shape[0] == 1:
        return x
    spread = x[1:].mag.sum(axis=0, keepdims=True) * _ROUND_UP
    return e.add(x[:1], IntervalArray(-spread, spread))
