"""The frames whose largest residual is least, near given ones: linear programs in a trust region, in float64.

It gives the upper end of the bracket; that a point satisfies every pixel is proved elsewhere.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.handeye.hand_eye_study import HandEyeFrames
from cpcal.handeye.pixel_model import PARAMETERS, PixelModel, moved
from cpcal.solver.linear import Dense, LinearStatus

_STEPS = 60
_START = 0.05  # rad: the trust region of rotations; that of translations is as far as it moves a point
_LEAST = 1e-13
_RESTARTS = 3


def minimax_fit(model: PixelModel, frames: HandEyeFrames) -> tuple[HandEyeFrames, float]:
    """Frames near those given, and their largest excess `|residual| - half-width` in px.

    The search begins again with a wide trust region until that finds nothing better: one that stops early leaves the
    bracket open.
    """
    best, value = _descent(model, frames, _START)
    for attempt in range(_RESTARTS):
        again, lower = _descent(model, best, _START * 0.2**attempt)
        if lower < value:
            better = value - lower > 1e-12 * value
            best, value = again, lower
            if better:
                continue
        break
    return best, value


def excess(model: PixelModel, frames: HandEyeFrames) -> float:
    """px: by how much the worst pixel is off beyond its half-width; from 0."""
    off = np.abs(model(frames)) - np.tile(model.study.half_width, 2)
    return max(float(off.max()), 0.0)


def _descent(model: PixelModel, frames: HandEyeFrames, radius: float) -> tuple[HandEyeFrames, float]:
    value = excess(model, frames)
    reach = float(np.linalg.norm(frames.in_camera(model.study), axis=1).mean())
    size = np.tile(np.repeat([1.0, reach], 3), 2)  # a turn of 1 rad, and the way that it moves a point
    for _ in range(_STEPS):
        step, promised = _step(model, frames, size * radius, value)
        if promised >= value * (1.0 - 1e-14):
            break
        trial = moved(frames, step)
        found = excess(model, trial)
        if found < value:
            good = (value - found) > 0.5 * (value - promised)
            frames, value, radius = trial, found, radius * (2.0 if good else 0.5)
        else:
            radius *= 0.25
        if radius < _LEAST:
            break
    return frames, value


def _step(model: PixelModel, frames: HandEyeFrames, reach: Floats, worst: float) -> tuple[Floats, float]:
    """The step of the linear program within the trust region, and the excess that it promises."""
    slope, residuals = model.jacobian(frames) * reach, model(frames)
    width = np.tile(model.study.half_width, 2)
    scale = max(worst, 1e-9)
    matrix = np.concatenate([slope, -slope]) / scale
    matrix = np.concatenate([matrix, -np.ones((len(matrix), 1))], axis=1)
    rhs = np.concatenate([width - residuals, width + residuals]) / scale
    size = np.abs(matrix).max(axis=1)
    bounds = np.append(np.ones(PARAMETERS), 2.0)
    engine = Dense()
    engine.load(matrix / size[:, None], rhs / size, np.append(-np.ones(PARAMETERS), 0.0), bounds)
    solution = engine.minimize(np.append(np.zeros(PARAMETERS), 1.0))
    if solution.status is not LinearStatus.OPTIMAL:
        return np.zeros(PARAMETERS), worst
    return reach * solution.point[:PARAMETERS], scale * float(solution.point[-1])
