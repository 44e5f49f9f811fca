"""A network with some of its measurements is the same network for those, and loses no solution."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import Lifted, lifted
from cpcal.solver.contract import Contractor
from cpcal.solver.interval import Interval, IntervalArray
from cpcal.solver.network import ConstraintNetwork, Expr, Tape, maximum, norm, sqr
from cpcal.solver.network.network import restricted
from cpcal.solver.network.rows import Rows
from cpcal.solver.testing import CONFORMANCE


def frugal(network: ConstraintNetwork, **options: Any) -> Contractor:
    return Lifted(network, **options)


def few_rows(monkeypatch: pytest.MonkeyPatch, telling: int) -> None:
    monkeypatch.setattr(lifted, "_MANY", 0)
    monkeypatch.setattr(lifted, "_MANY_EACH", 0)
    monkeypatch.setattr(lifted, "_TELLING", telling)
    monkeypatch.setattr(lifted, "_ENCLOSING", telling)


N = 6


def bodies(net: ConstraintNetwork, x: Expr, y: Expr, rng: np.random.Generator) -> list[Expr]:
    """Expressions over N measurements that use every way of combining rows; y has N components itself."""
    p, r = net.reading(rng.normal(size=(N, 3)), 0.1), net.reading(rng.normal(size=N), 0.2)
    matrix, square = rng.normal(size=(N, 3, 3)), rng.normal(size=(N, N))
    return [
        norm(p + matrix @ x - y[:3]) - r,
        (p[:, [2, 0, 1]] * x).sum(-1) / (1 + sqr(r)),
        p - x,
        y * r + y[::-1] - y.sum(),
        square @ y + (square * r).sum(0),
        maximum(p[:, 0], r[[1, 1, 0, 5, 4, 2]]) * x[0] + p.sum(0)[0],
        (matrix + p[:, None]) @ x * Interval(1, 1.5),
        abs(p[::-1, 1]) - rng.normal(size=(N, 1))[:, 0] * x[1] ** 3,
        sqr(y)[:, None] + p,
        y[1:4][[0, 1, 2, 2, 1, 0]] - r,
        p[np.arange(N), [0, 2, 1, 1, 0, 2]] * x[0] - r,
    ]


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), data=st.data())
def test_elements_of_a_restricted_network_are_those_of_the_whole(seed: int, data: st.DataObject) -> None:
    rng = np.random.default_rng(seed)
    net = ConstraintNetwork()
    x, y = net.variable("x", 3, (-2, 2)), net.variable("y", N, (-2, 2))
    for body in bodies(net, x, y, rng):
        upper = rng.normal(size=body.shape) if rng.random() < 0.5 else 1.0
        net.add(body.within((-np.inf, upper)))
    net.add(x[0] <= 1)
    chosen = st.lists(st.integers(0, N - 1), min_size=1, unique=True).map(lambda rows: np.array(sorted(rows)))
    keep = [data.draw(chosen) if c.body.shape else np.zeros(0, np.intp) for c in net.constraints]
    part = restricted(net, keep)
    assert part.names == net.names
    assert part.domain == net.domain
    box = IntervalArray.point(rng.uniform(-2, 2, (1, 3 + N)))
    for whole, less, rows in zip(net.constraints, part.constraints, keep, strict=True):
        for one, other in ((whole.body, less.body), (whole.upper, less.upper)):
            full, few = (natural(net, e, box) for e in (one, other))
            shape = (1, *whole.body.shape)
            wanted = full.broadcast_to(shape)
            wanted = wanted[:, rows] if rows.size else wanted
            np.testing.assert_array_equal(np.broadcast_to(few.lo, wanted.shape), wanted.lo)
            np.testing.assert_array_equal(np.broadcast_to(few.hi, wanted.shape), wanted.hi)


def natural(net: ConstraintNetwork, expr: Expr, box: IntervalArray) -> IntervalArray:
    tape = Tape(net, [expr])
    return tape.value(tape.forward(box), expr)


def test_telling_elements_are_the_worst_and_some_of_everywhere() -> None:
    net = ConstraintNetwork()
    x = net.variable("x", (), (-1, 1))
    values = np.random.default_rng(3).normal(size=1000)
    net.add((x + values).within((-0.5, 0.5)))
    (chosen,) = Rows(net).telling(np.zeros(1), 20)
    worst = np.argsort(values)
    assert set(worst[:20]) | set(worst[-20:]) <= set(chosen)
    assert np.diff(chosen).max() < 200


@pytest.mark.parametrize("telling", [1, 3])
@pytest.mark.parametrize("check", ["keeps_solutions", "leaves_a_part", "is_repeatable"])
def test_lifted_on_few_telling_rows_conforms(check: str, telling: int, monkeypatch: pytest.MonkeyPatch) -> None:
    few_rows(monkeypatch, telling)
    CONFORMANCE[check](frugal)
