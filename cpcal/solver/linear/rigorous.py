"""Rigorous bounds from the approximate multipliers of a linear program (DESIGN section 5, Rigour).

For interval rows U with `U z <= u` over a box of z, any y >= 0 gives, with r = c + U^T y,

    min c.z  >=  -y.u + sum_j min(r_j lo_j, r_j hi_j)

whatever the solver that proposed y did. With c = 0 a positive value proves that the polyhedron is empty.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Arithmetic, IntervalArray


def lower_bound(
    engine: Arithmetic,
    matrix: IntervalArray,
    rhs: Floats,
    multipliers: Floats,
    objective: Floats,
    columns: IntervalArray,
) -> float:
    """A proved lower bound of `objective . z` over `{z in columns : matrix z <= rhs}`.

    Shapes: matrix (m, n), rhs and multipliers (m,) (negative multipliers count as zero), objective and
    columns (n,). The bound holds for every matrix in the interval matrix.
    """
    y = np.maximum(multipliers, 0.0)
    y = np.where(np.isfinite(y), y, 0.0)[None, :]
    augmented = IntervalArray(
        np.concatenate([matrix.lo, -rhs[:, None]], axis=1), np.concatenate([matrix.hi, -rhs[:, None]], axis=1)
    )
    combined = engine.dot(IntervalArray.point(y), augmented)[0]
    residual = engine.add(combined[:-1], IntervalArray.point(objective))
    terms = engine.mul(residual, columns)
    lowest = IntervalArray.point(np.append(terms.lo, combined.lo[-1]))
    bound = float(engine.sum(lowest, 0).lo)
    return bound if np.isfinite(bound) else -np.inf
