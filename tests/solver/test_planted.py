"""Random networks with a planted solution: no answer loses it, and no proved lower bound exceeds its value."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
import pytest

import cpcal
from cpcal.solver.limits import Limits

COUNT = int(os.environ.get("CPCAL_PLANTED", "500"))  # 10,000 at night
PARTS = 10  # of the networks, a test each
_ONE: tuple[Callable[[cpcal.Expr], cpcal.Expr], ...] = (
    cpcal.sin,
    cpcal.cos,
    cpcal.exp,
    cpcal.atan,
    cpcal.tanh,
    cpcal.sqr,
    abs,
    lambda x: cpcal.sqrt(x + 4),
    lambda x: cpcal.log(x + 4),
    lambda x: x**3,
    lambda x: 1 / (x + 4),
)


def expression(rng: np.random.Generator, x: cpcal.Expr, depth: int = 3) -> cpcal.Expr:
    """A random expression in the components of x, which lie in [-3, 3]."""
    kind = rng.integers(0, 5) if depth else 4
    if kind == 4:
        return x[int(rng.integers(0, x.shape[0]))]
    if kind == 3:  # of something in [-3, 3]
        return _ONE[int(rng.integers(0, len(_ONE)))](x[int(rng.integers(0, x.shape[0]))])
    one, two = expression(rng, x, depth - 1), expression(rng, x, depth - 1)
    return (one + two, one * two, one - float(rng.integers(1, 4)) * two)[kind]


def planted(seed: int) -> tuple[cpcal.Network, np.ndarray, cpcal.Expr]:
    """A network, a point that satisfies it (with room for rounding), and an objective."""
    rng = np.random.default_rng([seed, 42])
    net = cpcal.Network()
    x = net.variable("x", int(rng.integers(1, 4)), (-3, 3))
    point = rng.uniform(-3, 3, x.shape)
    at = cpcal.Box(net.names, point, point)
    for _ in range(int(rng.integers(1, 4))):
        body = expression(rng, x)
        value = cpcal.evaluate(net, body, at)
        room = 1e-9 * (1.0 + float(value.mag))
        low, high = float(value.lo) - room, float(value.hi) + room
        kind = rng.integers(0, 3)
        net.add(body.within((low if kind != 1 else -np.inf, high if kind != 2 else np.inf)))
    return net, point, expression(rng, x)


@pytest.mark.parametrize("part", range(PARTS))
def test_a_planted_solution_is_not_lost_and_bounds_the_least_value(part: int) -> None:
    for seed in range(part, COUNT, PARTS):
        net, point, objective = planted(seed)
        paving = net.solve(width=0.5, limits=Limits(nodes=20))
        assert any(point in s.box for s in paving.solutions), seed
        value = float(cpcal.evaluate(net, objective, cpcal.Box(net.names, point, point)).hi)
        best = net.minimize(objective, limits=Limits(nodes=1 + seed % 5))
        assert best.lo <= value, seed
        assert best.lo <= best.hi, seed
