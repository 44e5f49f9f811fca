"""A local minimum by linear programs, each about the point before: for optima that are vertices. Proves nothing.

Where as many rows hold with equality at an optimum as there are components, such steps converge quadratically, and
each costs a program of a few dozen microseconds. Elsewhere they end without an answer, and `LocalSearch` goes on with
SLSQP.
"""

from __future__ import annotations

import math
import time

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Box
from cpcal.solver.linear import LinearEngine
from cpcal.solver.linear.engine import LinearStatus
from cpcal.solver.network.rows import Rows, RowValues

_STEPS = 20
_SETTLED = 1e-11  # a step below this, in scales, ends it
_HOLDS = 1e-9  # by which a row may be violated in the end, in units of its gradient
_SMALLEST = 1e-6  # of the trust region: an optimum that is no vertex takes ever shorter steps


def linear_steps(
    rows: Rows,
    cost: Floats,
    box: Box,
    start: Floats,
    engine: LinearEngine,
    *,
    scale: Floats,
    margin: float = 0.0,
    deadline: float = math.inf,
) -> Floats | None:
    """A vertex near `start` (n,) at which `cost @ x` is least among the points of a box where all rows hold; None where
    the steps do not end in one.

    `margin`: by how much, in units of its gradient in components over their `scale`, every row holds to first order.
    """
    point = np.clip(start, box.lo, box.hi)
    at, radius, penalty = rows.linearize(point), 1.0, 0.0
    for _ in range(_STEPS):
        if time.monotonic() > deadline:
            return None
        found = _program(at, point, cost, box, engine, scale, radius, margin)
        if found is None:
            return None
        step, weight = found
        penalty = max(penalty, 2.0 * weight)
        new = np.clip(point + step, box.lo, box.hi)
        length = float(np.max(np.abs(step) / scale, initial=0.0))
        there = rows.linearize(new)
        excess = _excess(there, scale)
        if length <= _SETTLED:
            return new if excess <= _HOLDS else None
        before = _excess(at, scale)
        promised = penalty * before - float(cost @ step)
        gained = penalty * (before - excess) - float(cost @ step)
        if gained > 0.1 * promised or length <= 100.0 * _SETTLED:
            point, at = new, there
            radius = min(2.0 * radius, 1.0) if gained > 0.75 * promised else radius
        else:
            radius = 0.25 * min(radius, length)
        if radius < _SMALLEST:
            return None
    return None


def _program(
    at: RowValues,
    point: Floats,
    cost: Floats,
    box: Box,
    engine: LinearEngine,
    scale: Floats,
    radius: float,
    margin: float,
) -> tuple[Floats, float] | None:
    """The best step in a trust region, where the linearised rows hold, and the sum of the rows' multipliers."""
    unit = scale * radius
    matrix, size = at.jacobian * unit, _sizes(at, scale)
    limits = -at.values / size - margin
    if not (np.isfinite(matrix).all() and np.isfinite(limits).all()):
        return None
    lower, upper = np.maximum((box.lo - point) / unit, -1.0), np.minimum((box.hi - point) / unit, 1.0)
    engine.load(matrix / (size * radius)[:, None], limits / radius, lower, upper)
    solution = engine.minimize(cost * unit)
    if solution.status is not LinearStatus.OPTIMAL:
        return None
    return np.asarray(solution.point * unit), float(solution.multipliers.sum()) / radius


def _sizes(at: RowValues, scale: Floats) -> Floats:
    return np.asarray(np.maximum(np.abs(at.jacobian * scale).max(axis=1, initial=0.0), 1e-300))


def _excess(at: RowValues, scale: Floats) -> float:
    """By how much the worst row is violated, in units of its gradient."""
    return float(np.max(at.values / _sizes(at, scale), initial=0.0))
