"""Sums and products of coefficients (see `coefficient`) in float64, compiled: arrays (1 + J, E) of E elements.

An array of one element stands for all E of them.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled
from cpcal.solver.interval import kernels
from cpcal.solver.interval.kernels import mul as interval_product

interval_sum = kernels.add
_ROUND_UP = 1.0 + 64 * 2.0**-52  # covers the rounding of the few dozen operations that are not those of intervals


@compiled
def added(x_lo: Floats, x_hi: Floats, y_lo: Floats, y_hi: Floats, count: int) -> tuple[Floats, Floats]:
    """The sum (max(1 + J, 1 + K), count); derivatives that one of them has not are zero."""
    p, q = x_lo.shape[0], y_lo.shape[0]
    of_x, of_y = int(x_lo.shape[1] > 1), int(y_lo.shape[1] > 1)
    lo, hi = np.empty((max(p, q), count)), np.empty((max(p, q), count))
    for j in range(max(p, q)):
        for k in range(count):
            a, b = k * of_x, k * of_y
            if j >= q:
                lo[j, k], hi[j, k] = x_lo[j, a], x_hi[j, a]
            elif j >= p:
                lo[j, k], hi[j, k] = y_lo[j, b], y_hi[j, b]
            else:
                lo[j, k], hi[j, k] = interval_sum(x_lo[j, a], x_hi[j, a], y_lo[j, b], y_hi[j, b])
    return lo, hi


@compiled
def multiplied(x_lo: Floats, x_hi: Floats, y_lo: Floats, y_hi: Floats, count: int) -> tuple[Floats, Floats]:
    """The product: see `coefficient.mul`."""
    p, q = x_lo.shape[0], y_lo.shape[0]
    n = max(p, q)
    of_x, of_y = int(x_lo.shape[1] > 1), int(y_lo.shape[1] > 1)
    lo, hi = np.empty((n, count)), np.empty((n, count))
    for k in range(count):
        a, b = k * of_x, k * of_y
        value = interval_product(x_lo[0, a], x_hi[0, a], y_lo[0, b], y_hi[0, b])
        if p > 1 and q > 1:
            more = _second_order(x_lo[:, a], x_hi[:, a], y_lo[:, b], y_hi[:, b])
            value = interval_sum(value[0], value[1], more[0], more[1])
        lo[0, k], hi[0, k] = value
        for j in range(1, n):
            slope = 0.0, 0.0
            if j < p:
                slope = interval_product(x_lo[j, a], x_hi[j, a], y_lo[0, b], y_hi[0, b])
            if j < q:
                other = interval_product(x_lo[0, a], x_hi[0, a], y_lo[j, b], y_hi[j, b])
                slope = interval_sum(slope[0], slope[1], other[0], other[1])
            lo[j, k], hi[j, k] = slope
    return lo, hi


@compiled
def summed(lo: Floats, hi: Floats) -> tuple[Floats, Floats]:
    """Sums over the middle axis of arrays of three."""
    before, count, after = lo.shape
    low, high = np.zeros((before, after)), np.zeros((before, after))
    for i in range(before):
        for k in range(count):
            for j in range(after):
                low[i, j], high[i, j] = interval_sum(low[i, j], high[i, j], lo[i, k, j], hi[i, k, j])
    return low, high


@compiled
def _second_order(x_lo: Floats, x_hi: Floats, y_lo: Floats, y_hi: Floats) -> tuple[float, float]:
    """Range of `sum_i x_i d_i * sum_j y_j d_j` over |d| <= 1, entries from 1 on: d_i^2 is in [0, 1]."""
    low, high, both, of_x, of_y = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(1, max(len(x_lo), len(y_lo))):
        a = max(abs(x_lo[j]), abs(x_hi[j])) if j < len(x_lo) else 0.0
        b = max(abs(y_lo[j]), abs(y_hi[j])) if j < len(y_lo) else 0.0
        of_x, of_y, both = of_x + a, of_y + b, both + a * b
        if j < len(x_lo) and j < len(y_lo):
            square = interval_product(x_lo[j], x_hi[j], y_lo[j], y_hi[j])
            low, high = low + min(square[0], 0.0), high + max(square[1], 0.0)
    mixed = max(of_x * of_y * _ROUND_UP - both * (2.0 - _ROUND_UP), 0.0)
    return (low - mixed) * _ROUND_UP, (high + mixed) * _ROUND_UP
