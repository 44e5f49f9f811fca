"""Small networks with known solutions, and random boxes to try a contractor on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Box, Interval
from cpcal.solver.network import ConstraintNetwork, maximum, minimum, norm, sqr, sqrt

BOXES = 8  # random boxes for each network


@dataclass(frozen=True)
class Case:
    """A network and some of its solutions, (S, n): exact ones, or ones with room to spare."""

    name: str
    network: ConstraintNetwork
    solutions: Floats


def cases(seed: int = 0) -> list[Case]:
    """The networks of the suite. Known solutions have few binary digits wherever a constraint is tight."""
    rng = np.random.default_rng(seed)
    return [make(ConstraintNetwork(), rng) for make in _MAKERS]


def _dyadic(rng: np.random.Generator, shape: int | tuple[int, ...], largest: int = 24) -> Floats:
    """Random multiples of 1/8: sums and products of a few of them are exact in float64."""
    return rng.integers(-largest, largest + 1, shape) / 8.0


def _linear(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x = net.variable("x", 3, (-10, 10))
    a, y = _dyadic(rng, (4, 3)), _dyadic(rng, (6, 3))
    net.add((a[:2] @ x).within((np.min(y @ a[:2].T, axis=0), np.max(y @ a[:2].T, axis=0))))
    net.add(a[2] @ x <= float(np.max(y @ a[2])))
    return Case("linear", net, y)


def _circle(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x, y = net.variable("x", (), (-8, 8)), net.variable("y", (), (-8, 8))
    net.add([sqr(x) + y * y == 25, sqrt(x + 8) >= y - 3])
    return Case("circle", net, np.array([[3.0, 4], [-4, 3], [5, 0], [0, -5], [-3, -4], [1.4, 4.8]][:5]))


def _products(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x = net.variable("x", 4, (-40, 40))
    net.add([x[0] * x[1] == x[2], x[0] * x[1] * x[2] - x[3] ** 3 <= 8, x[3] >= x[0] ** 2 - 20])
    y = _dyadic(rng, (40, 4))
    y[:, 2] = y[:, 0] * y[:, 1]
    y = y[(y[:, 2] ** 2 <= 8 + y[:, 3] ** 3) & (y[:, 3] >= y[:, 0] ** 2 - 20)]
    return Case("products", net, y)


def _leg(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    a, b = net.variable("a", 3, (-60, 60)), net.variable("b", 3, (-60, 60))
    offset, eps = net.variable("l", (), (-60, 60)), net.variable("eps", (), (0, 50))
    y = rng.uniform(-20, 20, (6, 8))
    position = rng.uniform(-100, 100, (10, 3)) + [0, 0, 400]
    turn = np.linalg.qr(rng.standard_normal((10, 3, 3)))[0]
    arms = position + np.einsum("kij,sj->ski", turn, y[:, 3:6]) - y[:, None, :3]
    lengths = np.linalg.norm(arms, axis=2) - y[:, 6:7]
    y[:, 7] = np.max(np.abs(lengths - lengths[0]), axis=1) + 1e-6
    y = y[y[:, 7] <= 50]
    net.add((norm(position + turn @ b - a) - (lengths[0] + offset)).within((-eps, eps)))
    return Case("leg", net, y)


def _readings(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    """Distances to points, both uncertain: a point solves when SOME readings in their sets fit."""
    a = net.variable("a", 2, (-60, 60))
    point, away = rng.uniform(-20, 20, 2), rng.uniform(-100, 100, (8, 2))
    radius = np.array([0.2, 0.1])
    slack = 0.999 * rng.uniform(-1, 1, (8, 2)) * radius
    lengths = np.linalg.norm(away + slack - point, axis=1)
    read = lengths + 0.999 * rng.uniform(-0.5, 0.5, 8)
    net.add(norm(net.reading(away, radius) - a) == net.reading(read, 0.5))
    return Case("readings", net, point[None])


def _twins(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    """Two readings of equal sets are two numbers; so are two equal enclosures of constants."""
    x = net.variable("x", 4, (-3, 3))
    net.add([x[0] == net.reading(0.0, 1.0) - net.reading(0.0, 1.0)])
    net.add([x[1] == x[2] * net.reading(1.0, 0.5), x[3] <= Interval(1, 2) * net.reading(1.0, 0.5)])
    return Case("twins", net, np.array([[1.5, 1.25, 1.0, -1], [-1.75, -0.5, -1.0, 0.5], [0.0, 0.0, 0.0, 0.25]]))


def _unbounded(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x, y = net.variable("x"), net.variable("y", (), (0, np.inf))
    net.add([x - 2 * y == 1, x * y >= -4, x.within((-np.inf, 1e6))])
    y_ = np.abs(_dyadic(rng, 8))
    return Case("unbounded", net, np.stack([1 + 2 * y_, y_], axis=1))


def _kinks(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x = net.variable("x", 4, (-30, 30))
    net.add([maximum(x[0], x[1]) <= x[2], minimum(x[0], 2 * x[1]) >= x[3], abs(x[0] - x[1]) + abs(x[2]) <= 9])
    net.add([2 - abs(x[0]) <= x[2] - x[3], maximum(x[2], x[3]) == x[2]])
    y = _dyadic(rng, (300, 4))
    y[:, 2] = np.maximum(y[:, 0], y[:, 1])
    y[:, 3] = np.minimum(y[:, 0], 2 * y[:, 1])
    y = y[(np.abs(y[:, 0] - y[:, 1]) + np.abs(y[:, 2]) <= 9) & (2 - np.abs(y[:, 0]) <= y[:, 2] - y[:, 3])]
    return Case("kinks", net, y[:8])


def _division(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x = net.variable("x", 3, (-12, 12))
    net.add([x[0] / x[1] == x[2], 1 / (1 + sqr(x[0])) <= 0.9, x[1] ** -2 <= 70, sqrt(x[2] + 12) >= 1])
    y = _dyadic(rng, (60, 3))
    y[:, 1] = 2.0 ** rng.integers(-3, 3, 60) * rng.choice([-1, 1], 60)
    y[:, 2] = y[:, 0] / y[:, 1]
    good = (np.abs(y[:, 2]) <= 10) & (np.abs(y[:, 0]) >= 0.5)
    return Case("division", net, y[good][:8])


_MAKERS = (_linear, _circle, _products, _leg, _readings, _twins, _unbounded, _kinks, _division)


def boxes(case: Case, seed: int = 0) -> Iterator[Box]:
    """The domain, then random boxes in it: around solutions, with solutions on a face, single points, any."""
    rng = np.random.default_rng([seed, 1])
    domain = case.network.domain
    yield domain
    lo, hi = np.maximum(domain.lo, -1e3), np.minimum(domain.hi, 1e3)
    for k in range(BOXES):
        center = case.solutions[k % len(case.solutions)] if k % 4 else rng.uniform(lo, hi)
        below, above = 10.0 ** rng.uniform(-4, 2) * rng.uniform(0, 1, (2, len(lo)))
        if k % 4 == 2:
            below[rng.random(len(lo)) < 0.5] = 0.0
        if k % 8 == 7:
            below, above = np.zeros_like(below), np.zeros_like(above)
        yield domain.with_bounds(np.maximum(domain.lo, center - below), np.minimum(domain.hi, center + above))
