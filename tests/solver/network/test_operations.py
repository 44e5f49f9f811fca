"""Every row of the operation table: values contain, narrowing loses nothing, derivatives are right."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import cpcal
from contractors import HC4
from cpcal.common.values import Floats
from cpcal.solver.interval import IntervalArray
from cpcal.solver.interval.operations import CODES
from cpcal.solver.network import ConstraintNetwork, Expr, Tape, maximum, minimum, norm, sqr, sqrt
from cpcal.solver.network.rows import Extremes

SEEDS = st.integers(0, 2**32 - 1)

# name: (expression of x (3,) and y (2, 3), the same in numpy)
Pair = tuple[Callable[[Expr, Expr], Expr], Callable[[Floats, Floats], Floats]]
FORMULAS: dict[str, Pair] = {
    "neg": (lambda x, y: -x, lambda x, y: -x),
    "index": (lambda x, y: y[:, [2, 0, 0]], lambda x, y: y[:, [2, 0, 0]]),
    "slice": (lambda x, y: y[1, ::-1], lambda x, y: y[1, ::-1]),
    "sum": (lambda x, y: y.sum(0), lambda x, y: y.sum(0)),
    "sum all": (lambda x, y: y.sum(-1).sum(0), lambda x, y: y.sum()),
    "add": (lambda x, y: x + y, lambda x, y: x + y),
    "sub": (lambda x, y: y - x, lambda x, y: y - x),
    "mul": (lambda x, y: x * y, lambda x, y: x * y),
    "mul by self": (lambda x, y: x * x, lambda x, y: x * x),
    "div": (lambda x, y: x / y, lambda x, y: x / y),
    "sqr": (lambda x, y: sqr(x), lambda x, y: x**2),
    "sqrt": (lambda x, y: sqrt(y), lambda x, y: np.sqrt(y)),
    "power 0": (lambda x, y: x**0, lambda x, y: x**0),
    "power 1": (lambda x, y: x**1, lambda x, y: x**1),
    "power 3": (lambda x, y: x**3, lambda x, y: x**3),
    "power 4": (lambda x, y: y**4, lambda x, y: y**4),
    "power -1": (lambda x, y: x**-1, lambda x, y: 1 / x),
    "power -2": (lambda x, y: y**-2, lambda x, y: y**-2.0),
    "abs": (lambda x, y: abs(x), lambda x, y: np.abs(x)),
    "min": (lambda x, y: minimum(x, y), lambda x, y: np.minimum(x, y)),
    "max": (lambda x, y: maximum(y, x), lambda x, y: np.maximum(y, x)),
    "matmul": (lambda x, y: y @ x, lambda x, y: y @ x),
    "matmul left": (lambda x, y: x @ y[:, :, None][0], lambda x, y: x @ y[:, :, None][0]),
    "norm": (lambda x, y: norm(y - x), lambda x, y: np.linalg.norm(y - x, axis=-1)),
    "exp": (lambda x, y: cpcal.exp(x), lambda x, y: np.exp(x)),
    "log": (lambda x, y: cpcal.log(y), lambda x, y: np.log(y)),
    "sin": (lambda x, y: np.sin(y), lambda x, y: np.sin(y)),
    "cos": (lambda x, y: cpcal.cos(x), lambda x, y: np.cos(x)),
    "tan": (lambda x, y: cpcal.tan(x), lambda x, y: np.tan(x)),
    "asin": (lambda x, y: np.arcsin(x / 3.01), lambda x, y: np.arcsin(x / x.dtype.type(3.01))),
    "acos": (lambda x, y: np.arccos(x / 3.01), lambda x, y: np.arccos(x / x.dtype.type(3.01))),
    "atan": (lambda x, y: np.arctan(y), lambda x, y: np.arctan(y)),
    "sinh": (lambda x, y: cpcal.sinh(x), lambda x, y: np.sinh(x)),
    "cosh": (lambda x, y: cpcal.cosh(x), lambda x, y: np.cosh(x)),
    "tanh": (lambda x, y: cpcal.tanh(y), lambda x, y: np.tanh(y)),
    "pow": (lambda x, y: x**1.5, lambda x, y: np.where(x > 0, x ** x.dtype.type(1.5), np.nan)),
    "pow of both": (lambda x, y: x ** y[0], lambda x, y: np.where(x > 0, x ** y[0], np.nan)),
    "atan2": (lambda x, y: cpcal.atan2(x, y), lambda x, y: np.arctan2(x, y)),
    "hypot": (lambda x, y: np.hypot(x, y), lambda x, y: np.hypot(x, y)),
    "concatenate": (
        lambda x, y: np.concatenate([x, np.stack([x[0], y[1, 2]])]),  # type: ignore[return-value, list-item]
        lambda x, y: np.concatenate([x, np.stack([x[0], y[1, 2]])]),
    ),
    "transpose": (lambda x, y: y.T @ y[:, 0] + x.reshape(3), lambda x, y: y.T @ y[:, 0] + x.reshape(3)),
    "mixed": (
        lambda x, y: 2.0 / (1 + sqr(x[0])) - norm(y) * x[1] + 1.5 * abs(y[0, 0] - 3),
        lambda x, y: 2.0 / (1 + x[0] ** 2) - np.linalg.norm(y, axis=-1) * x[1] + 1.5 * np.abs(y[0, 0] - 3),
    ),
}


def test_formulas_use_every_operation_of_the_table() -> None:
    net, x, y = variables()
    used = {code for make, _ in FORMULAS.values() for code in Tape(net, [make(x, y)]).program.code.tolist()}
    assert set(CODES.values()) <= used


def variables() -> tuple[ConstraintNetwork, Expr, Expr]:
    net = ConstraintNetwork()
    return net, net.variable("x", 3), net.variable("y", (2, 3))


def random_boxes(rng: np.random.Generator, count: int) -> tuple[IntervalArray, Floats]:
    """Boxes (count, 9), some half unbounded, and a point in each, sometimes on a face or at zero."""
    size = 10.0 ** rng.uniform(-3, 3, (count, 9))
    points = rng.normal(0, 3, (count, 9)) * rng.integers(0, 5, (count, 9)).clip(0, 1)
    below, above = size * rng.random((2, count, 9)) * rng.integers(0, 2, (2, count, 9))
    lo, hi = points - below, points + above
    lo[rng.random(lo.shape) < 0.05] = -np.inf
    hi[rng.random(hi.shape) < 0.05] = np.inf
    return IntervalArray(lo, hi), points


def exact_value(name: str, point: Floats) -> Floats | None:
    """The formula at a point in long double; None where it is not defined."""
    x, y = point[:3].astype(np.longdouble), point[3:].reshape(2, 3).astype(np.longdouble)
    with np.errstate(all="ignore"):
        result = np.asarray(FORMULAS[name][1](x, y))
    return result if np.isfinite(result).all() else None


@pytest.mark.parametrize("name", FORMULAS)
@settings(max_examples=4, deadline=None)
@given(seed=SEEDS)
def test_forward_contains_values_and_backward_loses_none(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    net, x, y = variables()
    root = FORMULAS[name][0](x, y)
    boxes, points = random_boxes(rng, 4)
    tape = Tape(net, [root])
    found = tape.value(tape.forward(boxes), root)
    for k, point in enumerate(points):
        value = exact_value(name, point)
        if value is None:
            continue
        slack = 1e-17 * np.abs(value)  # of the long double reference
        assert (found.lo[k] <= value + slack).all()
        assert (value - slack <= found.hi[k]).all()
        narrowed = _backward(net, root, boxes[k : k + 1], value, rng)
        assert (narrowed.lo[0] <= point).all()
        assert (point <= narrowed.hi[0]).all()


def _backward(net, root, box, value, rng):
    """What is left of a box where the root lies in a small interval around `value`."""
    room = 1e-12 + np.abs(value) * rng.choice([1e-15, 1e-3])
    low, high = np.asarray(value - room, np.float64), np.asarray(value + room, np.float64)
    return Tape(net, [root - high, low - root]).contract(box)


@pytest.mark.parametrize("name", FORMULAS)
@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_points_equal_numpy_and_derivatives_equal_differences(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    point = rng.uniform(0.5, 3.0, 9)
    x, y = point[:3], point[3:].reshape(2, 3)
    assume(np.min(np.abs(x - y)) > 1e-3)
    assume(abs(y[0, 0] - 3) > 1e-3)
    assume(np.min(np.abs(x - np.pi / 2.0)) > 0.02)  # next to the pole of tan differences tell nothing
    net, vx, vy = variables()
    root = FORMULAS[name][0](vx, vy)
    rows = Extremes(net, root).linearize(point)
    expected = np.asarray(FORMULAS[name][1](x, y))
    assert root.shape == expected.shape
    assume(np.max(np.abs(expected)) < 1e3)  # next to a pole a difference says nothing of a derivative
    np.testing.assert_allclose(rows.values.reshape(root.shape), expected, rtol=1e-13, atol=1e-14)
    step = 1e-5
    for k in range(9):
        ends = [point + s * step * np.eye(9)[k] for s in (1, -1)]
        up, down = (np.asarray(FORMULAS[name][1](p[:3], p[3:].reshape(2, 3))) for p in ends)
        exact = rows.jacobian[:, k].reshape(root.shape)
        np.testing.assert_allclose(exact, (up - down) / (2 * step), rtol=1e-5, atol=1e-6)


def test_an_undefined_element_means_that_there_is_no_solution() -> None:
    net = ConstraintNetwork()
    x = net.variable("x", 2)
    root = sqrt(x).sum(0)
    tape = Tape(net, [root])
    box = IntervalArray.point(np.array([[1.0, -1.0]]))
    assert not tape.continuous(tape.forward(box))
    assert np.isnan(Tape(net, [sqrt(x)[0] - 2.0, root - 9.0]).contract(box).lo).all()
    alone = Tape(net, [sqrt(x)[0] - 2.0])  # which does not hold the other element
    assert alone.continuous(alone.forward(box))
    assert not np.isnan(alone.contract(box).lo).any()


@pytest.mark.parametrize("name", FORMULAS)
@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_interval_derivatives_enclose_slopes_between_points_of_the_box(name: str, seed: int) -> None:
    """The mean value theorem, also across the kinks of abs, min and max."""
    rng = np.random.default_rng(seed)
    positive = name in ("sqrt", "power -1", "power -2", "div", "log", "pow", "pow of both", "atan2")
    lo = rng.uniform(0.5, 2.0, 9) if positive else rng.uniform(-3, 3, 9)
    hi = lo + rng.uniform(0, 2, 9) * rng.integers(0, 2, 9)
    hi = np.minimum(hi, 3.0) if name in ("asin", "acos") else hi
    net, x, y = variables()
    root = FORMULAS[name][0](x, y)
    tape = Tape(net, [root])
    slots = tape.forward(IntervalArray(lo[None], hi[None]))
    matrix = tape.jacobian(slots[0])
    a, b = rng.uniform(lo, hi), rng.choice([0, 1], 9)
    b = np.where(b == 0, lo, hi)
    difference = np.asarray(exact_value(name, b) - exact_value(name, a), np.float64)
    full = IntervalArray(matrix.lo.T, matrix.hi.T).reshape((9, *root.shape))
    moves = (b - a).reshape((9,) + (1,) * root.ndim)
    assert (full.lo <= full.hi).all()
    with np.errstate(invalid="ignore"):
        ends = np.sort(np.where(moves == 0.0, 0.0, [full.lo * moves, full.hi * moves]), axis=0)
    assert (ends[0].sum(axis=0) <= difference + 1e-9 * (1 + np.abs(difference))).all()
    assert (ends[1].sum(axis=0) >= difference - 1e-9 * (1 + np.abs(difference))).all()


def test_where_an_exponent_may_be_zero_any_base_gives_one() -> None:
    net = ConstraintNetwork()
    x, p = net.variable("x", (), (0.5, 3.0)), net.variable("p", (), (-1.0, 1.0))
    net.add(x**p == 1.0)
    for fixed in ((-1.0, 1.0), (0.0, 1.0), (0.0, 0.0)):
        box = cpcal.Box(net.names, [0.5, fixed[0]], [3.0, fixed[1]])
        left = HC4(net).contract(box).box
        assert (0.5, 0.0) in left
        assert (3.0, 0.0) in left
