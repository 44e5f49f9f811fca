"""Expressions over boxes: forms contain every value, derivatives equal differences, parts lose no solution."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import Lifted, lifted
from cpcal.common.values import Floats
from cpcal.solver.interval import Box, Interval, IntervalArray
from cpcal.solver.network import CentredForm, ConstraintNetwork, Expr, Tape, evaluate, maximum, minimum, norm, sqr, sqrt
from cpcal.solver.network.network import restricted
from cpcal.solver.network.rows import Extremes, Rows
from cpcal.solver.network.sweeps import slopes, total_slopes
from cpcal.solver.testing import CONFORMANCE
from tests.networks import network

SEEDS = st.integers(0, 2**32 - 1)

# Expressions of x (3,), y (4, 3) and readings m (4, 3), s (): row-wise, shared, broadcast and mixed uses.
Formula = Callable[[Any, Any, Any, Any], Expr]
FORMULAS: dict[str, Formula] = {
    "leg": lambda x, y, m, s: norm(m * 2.0 + y - x) - (x[0] + s),
    "dependency": lambda x, y, m, s: x * x - x * (x + 1.0) + m,
    "cross": lambda x, y, m, s: m[:, [1, 2, 0]] * y[:, [2, 0, 1]] - m[:, [2, 0, 1]] * y[:, [1, 2, 0]],
    "sum of rows": lambda x, y, m, s: y[:, 0] * (y * m).sum(0)[0] - (y + m).sum(0).sum(-1),
    "rows of others": lambda x, y, m, s: y[::-1] * m + y[[0, 0, 1, 1]] * x,
    "rows of a vector": lambda x, y, m, s: x[[0, 2, 2, 1]] * m[:, 0] + sqr(y[:, 1]),
    "own and shared": lambda x, y, m, s: sqr(y[:, 0]) - sqr(y[:, 0]).sum(0) + sqr(m[:, 0]) * m[:, 0].sum(0),
    "new axes": lambda x, y, m, s: (x[None, :] * y[:, :1] + m[:, :1])[:, None, :] * s,
    "matrix": lambda x, y, m, s: (y @ x) * s + m @ x,
    "scalar": lambda x, y, m, s: (y * m).sum(-1).sum(0) * x[1] - s * x[2],
    "kinks": lambda x, y, m, s: abs(y - x) + maximum(m, x * y) - minimum(y, s) * abs(m),
    "powers": lambda x, y, m, s: x**3 - y**4 + (sqr(m) + 1.0) ** -2 + (3.0 + sqr(x)) ** -1,
    "quotients": lambda x, y, m, s: (x + m) / (1.5 + sqr(y)) - 1.0 / (sqr(x) + 0.5) + sqrt(sqr(y) + sqr(m)),
    "poles": lambda x, y, m, s: 1.0 / y + sqrt(x) * m + y**-1,
    "nothing": lambda x, y, m, s: np.ones((2, 3)) * s,
    "constant": lambda x, y, m, s: x[0] * 0.0 + 2.0,
}


def variables() -> tuple[ConstraintNetwork, Expr, Expr]:
    net = ConstraintNetwork()
    return net, net.variable("x", 3), net.variable("y", (4, 3))


def readings(rng: np.random.Generator) -> tuple[IntervalArray, IntervalArray]:
    """Sets of m (4, 3) and s ()."""
    size = 10.0 ** rng.uniform(-3, 0.5)
    return (
        IntervalArray.around(rng.uniform(-2, 2, (4, 3)), size * rng.random((4, 3))),
        IntervalArray.around(rng.uniform(-2, 2), size * rng.random()),
    )


def as_readings(net: ConstraintNetwork, sets: tuple[IntervalArray, IntervalArray]) -> list[Expr]:
    return [net.reading(s.mid, s.rad) for s in sets]


def inside(rng: np.random.Generator, x: IntervalArray) -> Floats:
    """A point of a box, with some coordinates at their ends."""
    inner = np.clip(rng.uniform(x.lo, x.hi), x.lo, x.hi)
    return np.asarray(np.where(rng.random(x.shape) < 0.3, np.where(rng.random(x.shape) < 0.5, x.lo, x.hi), inner))


@pytest.mark.parametrize("name", FORMULAS)
@settings(max_examples=4, deadline=None)
@given(seed=SEEDS)
def test_every_form_contains_the_values_at_points_of_the_box_and_of_the_sets(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    net, x, y = variables()
    sets = readings(rng)
    expr = FORMULAS[name](x, y, *as_readings(net, sets))
    size = 10.0 ** rng.uniform(-4, 1) * rng.random(15) * rng.integers(0, 3, 15).clip(0, 1)
    flat = IntervalArray.around(rng.normal(0, 2, 15), size)
    box = Box(net.names, flat.lo, flat.hi)
    form = CentredForm(net, expr)
    found = {"natural": evaluate(net, expr, box)}
    if box.is_bounded:
        center = form.at(box.mid) + (form.jacobian(box) * (box.array - box.mid)).sum(1)
        found["centred"] = center.reshape(expr.shape)
    for _ in range(3):
        point, values = inside(rng, flat), [inside(rng, s) for s in sets]
        exact_net, x2, y2 = variables()
        exact = FORMULAS[name](x2, y2, *(exact_net.constant(v) for v in values))
        value = evaluate(exact_net, exact, Box(net.names, point, point))
        for name_of, enclosure in found.items():
            assert enclosure.shape == expr.shape
            missed = ~((enclosure.lo <= value.hi) & (value.lo <= enclosure.hi)) & ~value.empty & ~enclosure.empty
            assert not missed.any(), f"{name_of} misses {value} by {enclosure}"


@pytest.mark.parametrize("name", FORMULAS)
def test_derivatives_by_variables_and_readings_equal_differences(name: str) -> None:
    rng = np.random.default_rng(5)
    net, x, y = variables()
    expr = FORMULAS[name](x, y, *as_readings(net, readings(rng)))
    rows, point, step = Extremes(net, expr), rng.uniform(0.5, 2.0, 15), 1e-6
    tape = rows.tape
    centers = {leaf.digest: IntervalArray.point(leaf.data.mid) for leaf in tape.readings}
    slots = tape.forward(IntervalArray.point(point[None]), centers)
    enclosed = tape.gradients(slots[0])[tape.reach.entry]
    of_leaves = np.zeros((1, tape.count, tape.program.first))
    slopes(tape.program, tape.reach, tape.near(point[None]), of_leaves)
    found = of_leaves[0, tape.reach.row, tape.reach.leaf]
    np.testing.assert_allclose(found, enclosed.mid, rtol=1e-12, atol=1e-12)
    total = np.bincount(tape.reach.leaf, found, tape.program.first)
    of_constants = slice(tape.size, tape.program.given)
    both = [np.delete(each, of_constants) for each in (total_slopes(tape.program, tape.near(point[None])[0]), total)]
    np.testing.assert_allclose(*both, rtol=1e-12, atol=1e-12)
    expected, given = np.zeros((tape.program.first, tape.count)), tape.program.given
    leaves = np.concatenate([point, tape.middles])
    for k in [*range(tape.size), *range(given, tape.program.first)]:
        moves = (leaves + s * step * (np.arange(len(leaves)) == k) for s in (1, -1))
        up, down = (tape.near(at[None, : tape.size], at[given:])[0, tape.program.roots] for at in moves)
        expected[k] = (up - down) / (2 * step)
    np.testing.assert_allclose(found, expected[tape.reach.leaf, tape.reach.row], rtol=1e-5, atol=1e-6)
    expected[tape.reach.leaf, tape.reach.row] = 0.0
    assert np.abs(expected).max() < 1e-9  # what a row does not reach does not change it


ACROSS: dict[str, Callable[[Expr], Expr]] = {  # poles whose derivatives have one sign
    "pole first": lambda x: x[:, 0] ** -1 + sqr(x[:, 1]),
    "pole last": lambda x: 3.0 * x[:, 1] - sqr(x[:, 0]) ** 2 + x[:, 0] ** -3,
    "pole inside": lambda x: sqr(x[:, 0] ** -1 + x[:, 1]) + x[:, 1],
}


@pytest.mark.parametrize("name", ACROSS)
def test_derivatives_across_a_pole_hold_every_secant_whatever_stands_beside_it(name: str) -> None:
    """Row by row: the first has a pole in its box, the second has none."""
    rng = np.random.default_rng(7)
    net, x = network((2, 2), x=(np.array([[-1.0, -1.0], [0.5, -1.0]]), np.array([[1.0, 1.0], [2.0, 1.0]])))
    form = CentredForm(net, ACROSS[name](x))
    matrix = form.jacobian(net.domain)
    assert np.isfinite(matrix.lo[1]).all()
    for _ in range(20):
        a, b = rng.uniform(net.domain.lo, net.domain.hi, (2, 4))
        b = np.where(np.arange(4) % 2 == 0, b, a)  # only the poles' variables move
        one, two = (evaluate(net, ACROSS[name](x), Box(net.names, p, p)).mid for p in (a, b))
        secant = (two - one) / (b - a)[[0, 2]]
        for row, column in ((0, 0), (1, 2)):
            room = 1e-9 * abs(secant[row])
            assert matrix.lo[row, column] - room <= secant[row] <= matrix.hi[row, column] + room


# known values ---------------------------------------------------------------------------------------------


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
    net, x = network(x=(-1, 1))
    values = np.random.default_rng(3).normal(size=1000)
    net.add((x + values).within((-0.5, 0.5)))
    (chosen,) = Rows(net).telling(np.zeros(1), 20)
    worst = np.argsort(values)
    assert set(worst[:20]) | set(worst[-20:]) <= set(chosen)
    assert np.diff(chosen).max() < 200


@pytest.mark.parametrize("telling", [1, 3])
@pytest.mark.parametrize("check", ["keeps_solutions", "leaves_a_part", "is_repeatable"])
def test_lifted_on_few_telling_rows_conforms(check: str, telling: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("_MANY", 0), ("_MANY_EACH", 0), ("_TELLING", telling), ("_ENCLOSING", telling)):
        monkeypatch.setattr(lifted, name, value)
    CONFORMANCE[check](Lifted)
