"""Points that are each other's nearest, and how near, compiled: this is asked some times an image."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats, Ints
from cpcal.solver.compiled import compiled


@compiled
def mutually_nearest(points: Floats, places: Floats, reach: float, out: Ints) -> None:
    """For each of the places (n, 2) which of the points (m, 2) is nearest, if it is no further than `reach` and no
    other place is nearer to that point; -1 where none is. A place that is nan has none."""
    closest, owner = np.full(len(points), np.inf), np.full(len(points), -1)
    for i in range(len(places)):
        out[i], least = -1, np.inf
        for k in range(len(points)):
            dx, dy = points[k, 0] - places[i, 0], points[k, 1] - places[i, 1]
            square = dx * dx + dy * dy
            if square < least:
                out[i], least = k, square
            if square < closest[k]:
                closest[k], owner[k] = square, i
        if not least <= reach * reach:
            out[i] = -1
    for i in range(len(places)):
        if out[i] >= 0 and owner[out[i]] != i:
            out[i] = -1


@compiled
def nearest_squares(points: Floats, out: Floats) -> None:
    """The squared distances (n,) of points (n, 2) to the nearest other one; inf where none is."""
    out[:] = np.inf
    for i in range(len(points)):
        for k in range(i):
            dx, dy = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
            square = dx * dx + dy * dy
            out[i], out[k] = min(out[i], square), min(out[k], square)
