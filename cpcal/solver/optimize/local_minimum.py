"""A local minimum by sequential linear programming. Proposes a point; proves nothing.

Minimises one variable (the objective, say eps) subject to the rows of a network, each at the readings in
their sets that suit it best. For `|g_k(x)| <= eps` this is Chebyshev approximation: the optimum is a
vertex, so the steps converge quadratically.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Box
from cpcal.solver.linear.engine import LinearEngine, LinearStatus
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.restrict import restricted
from cpcal.solver.network.rows import Rows, RowValues

_ITERATIONS = 60
_PENALTY = 1e3  # weight of a violated row that the objective cannot mend, per unit
_TOLERANCE = 1e-13  # relative decrease below which the fit has converged
_ROUGH = 1e-3  # and while measurements may still be missing
_SMALLEST_RADIUS = 1e-12  # of the trust region, relative to the box
_MANY = 2048  # elements of constraints, beyond which those that matter are looked for
_WORST = 64  # of each side of a constraint, those that enter at a time
_EXTENSIONS = 8  # times that they enter
_FLOOR = 1e-12  # an objective below this is small enough whatever the model promises


@dataclass(frozen=True)
class _State:
    """A point whose objective component has been moved to its smallest value; the rows there; the merit."""

    point: Floats
    rows: RowValues
    merit: float


class _Problem:
    def __init__(self, rows: Rows, objective: int, box: Box) -> None:
        self._rows, self.objective, self._box = rows, objective, box
        self.free = np.arange(len(box.names)) != objective
        width = np.where(np.isfinite(box.width), box.width, np.maximum(np.abs(box.mid), 1.0))
        self.scale = np.where(self.free, np.maximum(width, 1e-300), 1.0)

    def state(self, point: Floats) -> _State:
        point = np.where(self.free, np.clip(point, self._box.lo, self._box.hi), point)
        rows = self._rows.linearize(point)
        excess = rows.values
        slope = rows.jacobian[:, self.objective]
        mended = slope < -1e-12
        move = float(np.max(excess[mended] / -slope[mended], initial=-np.inf))
        if np.isfinite(move):
            point = point.copy()
            point[self.objective] += move
            rows = RowValues(rows.values + slope * move, rows.jacobian)
            excess = rows.values
        worst = float(np.max(excess[~mended], initial=0.0))
        merit = float(point[self.objective]) + _PENALTY * max(worst, 0.0)
        return _State(point, rows, merit if np.isfinite(merit) else np.inf)

    def step(self, state: _State, radius: float, engine: LinearEngine) -> Floats | None:
        """The step to the minimum of the linearised problem within the trust region, or None."""
        reach = np.where(self.free, radius * self.scale, max(abs(state.merit), radius))
        lower = np.where(self.free, np.maximum(-1.0, (self._box.lo - state.point) / reach), -1.0)
        upper = np.where(self.free, np.minimum(1.0, (self._box.hi - state.point) / reach), 1.0)
        matrix = state.rows.jacobian * reach
        largest = np.maximum(np.abs(matrix).max(axis=1, initial=0.0), 1e-300)
        slack = -state.rows.values
        engine.load(
            matrix / largest[:, None],
            np.maximum(slack, 0.0) / largest,
            np.minimum(lower, 0.0),
            np.maximum(upper, 0.0),
        )
        cost = np.zeros(len(reach))
        cost[self.objective] = 1.0
        solution = engine.minimize(cost)
        if solution.status is not LinearStatus.OPTIMAL:
            return None
        return np.asarray(reach * solution.point)


def fit_of_many(
    network: ConstraintNetwork,
    rows: Rows,
    objective: int,
    start: Floats,
    engine: LinearEngine,
    domain: Box | None = None,
) -> Floats:
    """The same in the network's domain (or a part of it), for many measurements: of those that matter, which are few.

    Measurements that the fitted point violates more than it may are added, and the fit goes on.
    """
    box = network.domain if domain is None else domain
    if sum(int(np.prod(c.body.shape)) for c in network.constraints) <= _MANY:
        return fit(rows, objective, box, start, engine)
    point, chosen = np.asarray(start, np.float64), [np.zeros(0, np.intp)] * len(network.constraints)
    some: Rows | None = None
    for _ in range(_EXTENSIONS):
        worst = rows.likely(box.with_bounds(point, point), _WORST)
        more = [np.union1d(old, new) for old, new in zip(chosen, worst, strict=True)]
        if all(len(new) == len(old) for new, old in zip(more, chosen, strict=True)):
            break
        chosen = more
        some = Rows(restricted(network, chosen))
        point = fit(some, objective, box, point, engine, _ROUGH)
    return point if some is None else fit(some, objective, box, point, engine)


def fit(
    rows: Rows, objective: int, box: Box, start: Floats, engine: LinearEngine, tolerance: float = _TOLERANCE
) -> Floats:
    """A local minimiser in `box`, from `start` (n,); `objective` is the component to minimise.

    It ends where the next step promises a relative decrease below `tolerance`.

    The objective's own lower bound is ignored: a negative optimum means room to spare.
    """
    problem = _Problem(rows, objective, box)
    state = problem.state(np.asarray(start, np.float64))
    radius = 0.1
    for _ in range(_ITERATIONS if np.isfinite(state.merit) else 0):
        step = problem.step(state, radius, engine)
        if step is None:
            break
        promised = -float(step[objective])
        if not promised > tolerance * max(abs(state.merit), _FLOOR):
            break
        trial = problem.state(state.point + step)
        length = float(np.max(np.abs(step / problem.scale), where=problem.free, initial=0.0))
        gained = (state.merit - trial.merit) / promised
        if gained > 0.0:
            state = trial
        if gained > 0.75 and length > 0.9 * radius:
            radius *= 4.0
        elif gained > 0.25:
            radius = min(radius, 10.0 * length) if length > 0.0 else radius
        else:
            radius = 0.25 * min(radius, length) if length > 0.0 else 0.25 * radius
        if radius < _SMALLEST_RADIUS:
            break
    return state.point
