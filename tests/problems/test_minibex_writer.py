"""What is written is read as the same problem."""

from __future__ import annotations

import numpy as np
import pytest

import cpcal
from benchmarks.solver_problems import PROBLEMS
from cpcal.common.errors import ModelError
from cpcal.problems.minibex import read_minibex
from cpcal.problems.minibex_writer import minibex_text
from cpcal.problems.problem import load_problem


def values(net: cpcal.Network, point: np.ndarray, objective: cpcal.Expr | None) -> np.ndarray:
    """Both ends of all rows, and of the objective, at a point, as rows `r <= 0`."""
    box = cpcal.Box(net.names, point, point)
    out = []
    for c in net.constraints:
        for e in (c.body - c.upper, c.lower - c.body):
            found = cpcal.evaluate(net, e, box)
            out += [v for v in found.mid.ravel().tolist() if abs(v) < 1e300]
    if objective is not None:
        out.append(float(cpcal.evaluate(net, objective, box).mid))
    return np.array(out)


@pytest.mark.parametrize("name", sorted(path.stem for path in PROBLEMS.glob("*.bch")))
def test_a_problem_is_the_same_after_writing_and_reading(name: str) -> None:
    first = load_problem(PROBLEMS / f"{name}.bch")
    again = read_minibex(minibex_text(first.network, first.objective), "again.bch")
    assert again.network.names == first.network.names
    assert again.network.domain == first.network.domain
    rng = np.random.default_rng(0)
    lo, hi = np.maximum(first.network.domain.lo, -3.0), np.minimum(first.network.domain.hi, 3.0)
    lo, hi = np.where(lo <= hi, lo, first.network.domain.lo), np.where(lo <= hi, hi, first.network.domain.hi)
    for point in rng.uniform(lo, hi, (3, len(lo))):
        one, two = values(first.network, point, first.objective), values(again.network, point, again.objective)
        assert sorted(one) == pytest.approx(sorted(two), rel=1e-9, abs=1e-12)


def test_arrays_functions_and_bounds_are_written_out() -> None:
    net = cpcal.Network()
    x, m = net.variable("x", 2, ([0, -1], [1, np.inf])), net.variable("m", (2, 2), (-1, 1))
    net.add([(m @ x).within((-1, [1, np.inf])), cpcal.atan2(x[0], x[1]) + cpcal.exp(x[1]) ** 3 <= x[0] ** -2])
    net.add(cpcal.minimum(x[0], 2) + abs(m[0, 1]) == x[1] ** 1.5)
    again = read_minibex(minibex_text(net), "again.bch").network
    assert again.domain == net.domain
    point = np.array([0.5, 0.7, 0.1, -0.2, 0.3, 0.4])
    assert sorted(values(net, point, None)) == pytest.approx(sorted(values(again, point, None)))


def test_what_minibex_can_not_say_is_refused() -> None:
    net = cpcal.Network()
    x, r = net.variable("x", domain=(0, 1)), net.reading(1.0, 0.5)
    net.add(x * r <= 1)
    assert "*[0." in minibex_text(net)
    net.add(x + r >= 1)
    with pytest.raises(ModelError, match="used twice"):
        minibex_text(net)
