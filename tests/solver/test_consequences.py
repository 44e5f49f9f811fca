"""What follows from polynomial equations holds wherever they do."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

import cpcal
from cpcal.problems.problem import load_problem
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.model import consequences

PROBLEMS = Path(__file__).parents[2] / "benchmarks" / "problems"


def test_consequences_hold_at_planted_points() -> None:
    count = 0
    for seed in range(12):
        net, point = planted(seed)
        for constraint in consequences(net):
            found = cpcal.evaluate(net, constraint.body, cpcal.Box(net.names, point, point))
            assert found.lo <= 0.0 <= found.hi, seed
            count += 1
    assert count > 12


def planted(seed: int) -> tuple[cpcal.Network, Any]:
    """Three polynomial equations that hold exactly at a point of whole numbers."""
    rng = np.random.default_rng(seed)
    net = cpcal.Network()
    x, point = net.variable("x", 3, (-4, 4)), rng.integers(-3, 4, 3)
    for _ in range(3):
        at, e = rng.integers(0, 3, 4).tolist(), rng.integers(0, 3, 3).tolist()
        p, q = int(rng.integers(1, 5)), int(rng.integers(-4, 5))

        def body(v: Any, at: list[int] = at, e: list[int] = e, p: int = p, q: int = q) -> Any:
            return p * v[at[0]] ** e[0] * v[at[1]] ** e[1] + q * v[at[2]] ** e[2] - v[at[3]] / 4

        net.add(body(x) == body([Fraction(int(v)) for v in point]))
    return net, point


def test_a_system_of_large_terms_that_cancel_is_solved_by_what_follows_from_it() -> None:
    problem = load_problem(PROBLEMS / "neurophysiology.bch")
    paving = problem.network.solve(limits=Limits(seconds=60))
    assert [s.verdict for s in paving.solutions] == [Verdict.PROVED] * 8
    assert "consequences" in paving.method
