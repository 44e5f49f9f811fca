"""How far dots lie from their neighbours, compiled."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats, Ints
from cpcal.solver.compiled import compiled

_NEIGHBOURS = 5  # the nearest by their centres: one of them is the nearest by its edge


@compiled
def gaps(center: Floats, long: Floats, rising: Ints, out: Floats) -> None:
    """The pixels (n,) between a dot and its neighbours, whose longer semi-axes are `long` (n,); inf where none is.

    center  (n, 2) pixels
    rising  (n,) the dots' numbers in the order of x: a search to both sides ends where x alone is too far away
    """
    square, other = np.empty(_NEIGHBOURS), np.empty(_NEIGHBOURS, np.int64)
    for place in range(len(rising)):
        i = rising[place]
        square[:] = np.inf
        for way in (-1, 1):
            k = place + way
            while 0 <= k < len(rising):
                j = rising[k]
                dx, dy = center[j, 0] - center[i, 0], center[j, 1] - center[i, 1]
                if dx * dx >= square[-1]:
                    break
                _kept(square, other, dx * dx + dy * dy, j)
                k += way
        out[i] = np.inf
        for m in range(_NEIGHBOURS):
            if square[m] < np.inf:
                out[i] = min(out[i], np.sqrt(square[m]) - long[i] - long[other[m]])


@compiled
def _kept(square: Floats, other: Ints, value: float, number: int) -> None:
    """Puts a number among the nearest, where it is one of them."""
    m = len(square) - 1
    if not value < square[m]:
        return
    while m > 0 and value < square[m - 1]:
        square[m], other[m] = square[m - 1], other[m - 1]
        m -= 1
    square[m], other[m] = value, number
