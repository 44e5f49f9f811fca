"""The frames whose largest residual is least, near given ones: linear programs in a trust region, in float64.

With readings of the robot's poses these are unknowns of the programs too. It gives the upper end of the bracket; that a
point satisfies every pixel is proved elsewhere.
"""

from __future__ import annotations

from typing import Any, Protocol, TypeVar

import numpy as np

from cpcal.common.values import Floats
from cpcal.handeye.study import HandEyeStudy
from cpcal.solver.linear import Dense, LinearStatus

At = TypeVar("At")  # frames, or frames with readings


class MinimaxModel(Protocol[At]):
    """Residuals (2 N,) of what is fitted, in `size` unknowns.

    `reach`: what counts as a step of one in each of them; `room`: the least and greatest step allowed.
    """

    study: HandEyeStudy
    size: int

    def __call__(self, at: At, /) -> Floats: ...
    def jacobian(self, at: At, /) -> Floats: ...
    def moved(self, at: At, step: Floats, /) -> At: ...
    def reach(self, at: At, /) -> Floats: ...
    def room(self, at: At, /) -> tuple[Floats, Floats]: ...


_STEPS = 60
_START = 0.05  # rad: the trust region of rotations; that of translations is as far as it moves a point
_LEAST = 1e-13
_RESTARTS = 3
_MANY = 150  # unknowns, from which on a program is nearly all zeros: each image has readings of its own


def minimax_fit(model: MinimaxModel[At], at: At, *, restarts: int = _RESTARTS) -> tuple[At, float]:
    """Frames near those given, and their largest excess `|residual| - half-width` in px.

    The search begins again with a wide trust region until that finds nothing better: one that stops early leaves the
    bracket open.
    """
    best, value = _descent(model, at, _START)
    for attempt in range(restarts):
        again, lower = _descent(model, best, _START * 0.2**attempt)
        if lower < value:
            better = value - lower > 1e-12 * value
            best, value = again, lower
            if better:
                continue
        break
    return best, value


def excess(model: MinimaxModel[At], at: At) -> float:
    """px: by how much the worst pixel is off beyond its half-width; from 0."""
    off = np.abs(model(at)) - np.tile(model.study.half_width, 2)
    return max(float(off.max()), 0.0)


def _descent(model: MinimaxModel[At], at: At, radius: float) -> tuple[At, float]:
    value, size = excess(model, at), model.reach(at)
    for _ in range(_STEPS):
        step, promised = _step(model, at, size * radius, value)
        if promised >= value * (1.0 - 1e-11):
            break
        trial = model.moved(at, step)
        found = excess(model, trial)
        if found < value:
            good = (value - found) > 0.5 * (value - promised)
            at, value, radius = trial, found, radius * (2.0 if good else 0.5)
        else:
            radius *= 0.25
        if radius < _LEAST:
            break
    return at, value


def _step(model: MinimaxModel[At], at: At, reach: Floats, worst: float) -> tuple[Floats, float]:
    """The step of the linear program within the trust region, and the excess that it promises."""
    slope, residuals = model.jacobian(at) * reach, model(at)
    width = np.tile(model.study.half_width, 2)
    scale = max(worst, 1e-9)
    matrix = np.concatenate([slope, -slope]) / scale
    matrix = np.concatenate([matrix, -np.ones((len(matrix), 1))], axis=1)
    rhs = np.concatenate([width - residuals, width + residuals]) / scale
    size = np.abs(matrix).max(axis=1)
    low, high = (np.clip(end / reach, -1.0, 1.0) for end in model.room(at))
    low, high = np.append(low, 0.0), np.append(high, 2.0)
    point = (_of_many if model.size > _MANY else _of_few)(matrix / size[:, None], rhs / size, low, high)
    if point is None:
        return np.zeros(model.size), worst
    return reach * point[: model.size], scale * float(point[-1])


def _of_few(matrix: Floats, rhs: Floats, low: Floats, high: Floats) -> Floats | None:
    """The x of least last entry with `matrix @ x <= rhs` between bounds."""
    engine = Dense()
    engine.load(matrix, rhs, low, high)
    solution = engine.minimize(np.append(np.zeros(len(low) - 1), 1.0))
    return solution.point if solution.status is LinearStatus.OPTIMAL else None


def _of_many(matrix: Floats, rhs: Floats, low: Floats, high: Floats) -> Floats | None:
    """The same by HiGHS, which passes over zeros; a little outside of the bounds or rows does no harm here."""
    from scipy.optimize import linprog  # when it is needed
    from scipy.sparse import csr_array

    rows: Any = csr_array(matrix)
    cost, bounds = np.append(np.zeros(len(low) - 1), 1.0), list(zip(low.tolist(), high.tolist(), strict=True))
    found = linprog(cost, rows, rhs, bounds=bounds, method="highs")
    return np.asarray(found.x) if found.status == 0 else None
