"""Which pixels a dot's fit takes, compiled: a square round the dot, of which those near its edge are kept."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled
from cpcal.vision.dots.edge_model import Single
from cpcal.vision.dots.grey import Grey

OUTSIDE = 3.0  # pixels beyond the edge that take part
INSIDE = 3.5  # pixels inside the edge that take part, at least
_FEW = 150  # pixels, of which the rough steps take them all


@compiled
def reach(spread: Floats) -> int:
    """How many pixels from its own a dot reaches, room included."""
    half = 0.5 * (spread[0, 0] + spread[1, 1])
    long = half + np.sqrt(max(0.25 * (spread[0, 0] - spread[1, 1]) ** 2 + spread[0, 1] ** 2, 0.0))
    return int(2.0 * np.sqrt(long) + OUTSIDE + 0.7) + 1


@compiled
def square(
    shape: tuple[int, int], at_x: int, at_y: int, far: int, unit: float, x: Single, y: Single
) -> tuple[int, int]:
    """The places of the pixels in a square round the dot, every third one first; how many, and how many of these."""
    height, width = shape
    low, high = max(-far, -at_x), min(far, width - 1 - at_x)
    size, third = 0, 0
    for turn in range(2):
        for row in range(max(-far, -at_y), min(far, height - 1 - at_y) + 1):
            first = low + (row - low) % 3  # the first column of those that are taken in the first turn
            if turn == 0:
                for column in range(first, high + 1, 3):
                    x[size], y[size] = column / unit, row / unit
                    size += 1
                continue
            for column in range(low, high + 1):
                if column == first:
                    first += 3
                else:
                    x[size], y[size] = column / unit, row / unit
                    size += 1
        third = size if turn == 0 else third
    return size, third


@compiled
def gathered(
    grey: Grey,
    at_x: int,
    at_y: int,
    unit: float,
    room: float,
    size: int,
    third: int,
    x: Single,
    y: Single,
    depth: Single,
    level: Single,
) -> tuple[int, int]:
    """Keeps the pixels of a square that are the dot's: how many, and how many of these the rough steps take."""
    count, rough = 0, 0
    least, most = -room / unit, INSIDE / unit
    for k in range(size):
        if least < depth[k] < most:
            x[count], y[count], depth[count] = x[k], y[k], depth[k]
            level[count] = grey[at_y + int(np.rint(y[k] * unit)), at_x + int(np.rint(x[k] * unit))]
            count += 1
            rough += k < third
    return count, (rough if count >= _FEW else count)
