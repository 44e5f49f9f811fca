"""Coefficients that depend on the readings: first-order Taylor models.

A coefficient is an array of shape (1 + J, *S): entry 0 is the value at the centre of the reading sets
plus everything of second order (an interval), entry j the derivative with respect to the j-th scaled
reading `delta_j` in [-1, 1]. Without readings the shape is (1, *S).
"""

from __future__ import annotations

import math

import numpy as np

from cpcal.common.values import Bools, Floats, Indices
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.coefficient_kernels import centred_sums, combined, occurring, products, summed

_MAX = np.finfo(np.float64).max
_ETA = 5e-324


def _over(terms: int) -> float:
    """What covers, as a share, the rounding of sums of so many terms of one sign and of what is made of them below."""
    return float((2 * terms + 64) * np.finfo(np.float64).eps)


def occurring_terms(c: IntervalArray) -> Bools:
    """Which terms of a polynomial's coefficients (1 + J, T, *S) are not zero everywhere."""
    size = (*c.shape[:2], math.prod(c.shape[2:]))
    return np.asarray(occurring(*_contiguous(c, size)))


def _contiguous(c: IntervalArray, size: tuple[int, ...]) -> tuple[Floats, Floats]:
    lo = np.ascontiguousarray(c.lo).reshape(size)
    return lo, lo if c.hi is c.lo else np.ascontiguousarray(c.hi).reshape(size)


def combined_terms(
    e: Arithmetic, x: IntervalArray, y: IntervalArray, of_x: Indices, of_y: Indices, sign: float
) -> IntervalArray:
    """Terms (T,) of x + sign y: those of x at `of_x` and of y at `of_y`, -1 for none."""
    shape, count = _common(x, y)
    if e.name == "float64":
        lo, hi = combined(*_terms(x, shape, count), *_terms(y, shape, count), of_x, of_y, sign, count)
        return IntervalArray(lo, hi).reshape((*lo.shape[:2], *shape))
    slots = max(x.shape[0], y.shape[0])
    signed = y if sign > 0.0 else e.neg(y)
    out = _zeros((slots, len(of_x), *shape))
    for t, (i, j) in enumerate(zip(of_x.tolist(), of_y.tolist(), strict=True)):
        parts = [_padded(z[:, k], slots) for z, k in ((x, i), (signed, j)) if k >= 0]
        total = parts[0] if len(parts) == 1 else e.add(*parts)
        out.lo[:, t], out.hi[:, t] = total.lo, total.hi
    return out


def term_products(
    e: Arithmetic, x: IntervalArray, y: IntervalArray, pairs: Indices, size: int, square: bool
) -> IntervalArray:
    """All terms of a product; `pairs` (P, 3): of x, of y, and the term (of `size`) that their product belongs to.

    `square`: x is y, and a pair of two different terms stands for both orders.
    """
    shape, count = _common(x, y)
    if e.name == "float64":
        lo, hi = products(*_terms(x, shape, count), *_terms(y, shape, count), pairs, size, count, square)
        return IntervalArray(lo, hi).reshape((*lo.shape[:2], *shape))
    out = _zeros((max(x.shape[0], y.shape[0]), size, *shape))
    for i, j, m in pairs.tolist():
        one = e.sqr(x[:, i]) if square and i == j and x.shape[0] == 1 else _product(e, x[:, i], y[:, j])
        total = e.add(out[:, m], _padded(doubled(one) if square and i != j else one, out.shape[0]))
        out.lo[:, m], out.hi[:, m] = total.lo, total.hi
    return out


def _zeros(shape: tuple[int, ...]) -> IntervalArray:
    return IntervalArray(np.zeros(shape), np.zeros(shape))


def _common(x: IntervalArray, y: IntervalArray) -> tuple[tuple[int, ...], int]:
    """The shape of the elements of both, and their number."""
    shape = x.shape[2:] if x.shape[2:] == y.shape[2:] else np.broadcast_shapes(x.shape[2:], y.shape[2:])
    return shape, math.prod(shape)


def _terms(x: IntervalArray, shape: tuple[int, ...], count: int) -> tuple[Floats, Floats]:
    """Bounds (1 + J, T, count), or (1 + J, T, 1) where all elements are the same."""
    alike = math.prod(x.shape[2:]) == 1
    if x.shape[2:] == shape:
        return _contiguous(x, (*x.shape[:2], count))
    return _contiguous(x if alike else x.broadcast_to((*x.shape[:2], *shape)), (*x.shape[:2], 1 if alike else count))


def doubled(c: IntervalArray) -> IntervalArray:
    """Exactly, but where it overflows."""
    with np.errstate(over="ignore"):
        return IntervalArray(np.minimum(2.0 * c.lo, _MAX), np.maximum(2.0 * c.hi, -_MAX))


def _padded(c: IntervalArray, slots: int) -> IntervalArray:
    """The same coefficient with zero derivatives added up to `slots` entries."""
    if c.shape[0] == slots:
        return c
    zeros = np.zeros((slots - c.shape[0], *c.shape[1:]))
    return IntervalArray(np.concatenate([c.lo, zeros]), np.concatenate([c.hi, zeros]))


def total_over(e: Arithmetic, x: IntervalArray, axis: int) -> IntervalArray:
    """The sum of the elements along one of their axes, counted from 0."""
    if e.name != "float64":
        return e.sum(x, axis + 1)
    shape = x.shape
    left = (*shape[: axis + 1], *shape[axis + 2 :])
    if shape[0] > 1:  # slopes, whose rounding the value bears
        ends = shape[2 : axis + 1], shape[axis + 2 :]
        size = (*shape[:2], math.prod(ends[0]), shape[axis + 1], math.prod(ends[1]))
        of_slots = (size[0], size[1] * size[2], *size[3:])
        lo, hi = centred_sums(*_contiguous(x, of_slots))
        return IntervalArray(lo, hi).reshape(left)
    flat = (math.prod(shape[: axis + 1]), shape[axis + 1], math.prod(shape[axis + 2 :]))
    lo, hi = summed(*_contiguous(x, flat))
    return IntervalArray(lo, hi).reshape(left)


def _product(e: Arithmetic, x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """`x0 y0 + (x0 y_j + y0 x_j) delta_j` and the range of `(x_j delta_j)(y_j delta_j)`, as the kernel has it."""
    if x.shape[0] == 1 or y.shape[0] == 1:
        return e.mul(x, y)
    slots = max(x.shape[0], y.shape[0])
    x, y = _padded(x, slots), _padded(y, slots)
    value = e.add(e.mul(x[:1], y[:1]), _second_order(e, x[1:], y[1:]))
    slopes = e.add(e.mul(x[:1], y[1:]), e.mul(y[:1], x[1:]))
    return IntervalArray(np.concatenate([value.lo, slopes.lo]), np.concatenate([value.hi, slopes.hi]))


def _second_order(e: Arithmetic, x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Range of `sum_i x_i d_i * sum_j y_j d_j` over |d| <= 1, shape (1, *S): d_i^2 is in [0, 1]."""
    squares = e.mul(x, y)
    lo = np.minimum(squares.lo, 0.0).sum(axis=0, keepdims=True)
    hi = np.maximum(squares.hi, 0.0).sum(axis=0, keepdims=True)
    a, b, over = x.mag, y.mag, _over(len(x.lo))
    all_pairs = a.sum(axis=0, keepdims=True) * b.sum(axis=0, keepdims=True)
    mixed = np.maximum(all_pairs * (1.0 + over) - (a * b).sum(axis=0, keepdims=True) * (1.0 - over), 0.0)
    mixed += np.where(a.any(axis=0) & b.any(axis=0), (len(x.lo) + 2) * _ETA, 0.0)  # what underflows
    return IntervalArray((lo - mixed) * (1.0 + over), (hi + mixed) * (1.0 + over))


def reciprocal(e: Arithmetic, x: IntervalArray) -> IntervalArray:
    """`1 / x = 1/m - h/m^2 + h^2 / (m^2 (m + h))` with value m and h = sum x_j delta_j."""
    m = x[:1]
    value = e.div(IntervalArray.point(np.ones(1)).reshape((1,) * m.ndim), m)
    if x.shape[0] == 1:
        return value
    h_max = x[1:].mag.sum(axis=0, keepdims=True) * (1.0 + _over(len(x.lo)))
    square = e.sqr(IntervalArray(np.zeros_like(h_max), h_max))
    whole = e.add(m, IntervalArray(-h_max, h_max))
    m2 = e.sqr(m)
    value = e.add(value, e.div(square, e.mul(m2, whole)))
    slopes = e.neg(e.div(x[1:], m2))
    return IntervalArray(np.concatenate([value.lo, slopes.lo]), np.concatenate([value.hi, slopes.hi]))


def total(e: Arithmetic, x: IntervalArray) -> IntervalArray:
    """The whole range over the reading sets, shape (1, *S)."""
    if x.shape[0] == 1:
        return x
    spread = x[1:].mag.sum(axis=0, keepdims=True) * (1.0 + _over(len(x.lo)))
    return e.add(x[:1], IntervalArray(-spread, spread))
