"""Enclosures of rotation matrices, compiled: `rotation_numerators` in intervals takes a millisecond in numpy."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled
from cpcal.solver.interval.kernels import add, div, mul, sub


@compiled
def enclosed_rotations(quaternion: Floats) -> tuple[Floats, Floats]:
    """Bounds (N, 3, 3) of R(q) of quaternions (N, 4), scalar first: the numerators of `robot.rotation` over |q|^2."""
    lo, hi = np.empty((len(quaternion), 3, 3)), np.empty((len(quaternion), 3, 3))
    low, high = np.empty((4, 4)), np.empty((4, 4))
    for k in range(len(quaternion)):
        q = quaternion[k]
        for i in range(4):
            for j in range(i, 4):
                low[i, j], high[i, j] = mul(q[i], q[i], q[j], q[j])
        norm = low[0, 0], high[0, 0]
        for i in range(1, 4):
            norm = add(norm[0], norm[1], low[i, i], high[i, i])
        for i in range(3):
            a, b = 1 + (i + 1) % 3, 1 + (i + 2) % 3
            entry = add(low[0, 0], high[0, 0], low[i + 1, i + 1], high[i + 1, i + 1])
            entry = sub(entry[0], entry[1], low[a, a], high[a, a])
            entry = sub(entry[0], entry[1], low[b, b], high[b, b])
            lo[k, i, i], hi[k, i, i] = div(entry[0], entry[1], norm[0], norm[1])
            # the product of the two other components, minus and plus that of this one and the scalar
            c, d = min(a, b), max(a, b)
            less = sub(low[c, d], high[c, d], low[0, i + 1], high[0, i + 1])
            more = add(low[c, d], high[c, d], low[0, i + 1], high[0, i + 1])
            lo[k, a - 1, b - 1], hi[k, a - 1, b - 1] = div(2.0 * less[0], 2.0 * less[1], norm[0], norm[1])
            lo[k, b - 1, a - 1], hi[k, b - 1, a - 1] = div(2.0 * more[0], 2.0 * more[1], norm[0], norm[1])
    return lo, hi
