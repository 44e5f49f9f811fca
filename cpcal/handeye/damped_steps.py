"""The loop of Levenberg and Marquardt, whatever it moves: steps that lower a cost, damped more where they do not."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from cpcal.common.arrays import Floats

T = TypeVar("T")

_FIRST, _LEAST, _MOST = 1e-6, 1e-9, 1e3  # damping, of the scaled normal matrix


def descended(
    start: T,
    cost: Callable[[T], float],
    stepped: Callable[[T], Callable[[float], T]],
    *,
    steps: int,
    settled: float,
) -> T:
    """Where the cost settles near `start`: a step lowers it by less than `settled` of itself, or none lowers it.

    `stepped` linearises at a place and gives the place that a damping leads to.
    """
    at, value, damping = start, cost(start), _FIRST
    towards = stepped(at)
    for _ in range(steps):
        trial = towards(damping)
        new = cost(trial)
        if new < value:
            ended = value - new <= settled * value
            at, value, damping = trial, new, 0.1 * damping
            if ended:
                break
            towards = stepped(at)
        else:
            damping = max(10.0 * damping, _LEAST)
            if damping > _MOST:
                break
    return at


def damped_step(normal: Floats, right: Floats, damping: float) -> Floats:
    """Solution (k,) of the normal equations (k, k), (k,), damped in units of their own diagonal."""
    scale = np.sqrt(np.diagonal(normal))
    damped = normal / np.outer(scale, scale) + damping * np.eye(len(right))
    return np.asarray(np.linalg.solve(damped, right / scale) / scale)
