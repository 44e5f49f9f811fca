"""The polynomial form never excludes a solution: evaluated in exact fractions at random points and readings."""

from collections.abc import Callable
from fractions import Fraction
from math import prod

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.common.values import Floats
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.interval.kernels import Arrays
from cpcal.solver.network import (
    ConstraintNetwork,
    Expr,
    PolynomialForms,
    PolynomialSystem,
    maximum,
    minimum,
    norm,
    sqr,
    sqrt,
)
from cpcal.solver.network import coefficient as coef
from cpcal.solver.network.rows import DecisiveReadings
from tests.networks import network

SEEDS, FIRST = st.integers(0, 2**32 - 1), np.zeros(1, np.intp)


def span(lo: float, hi: float, factor: Fraction) -> tuple[Fraction, Fraction]:
    ends = sorted((Fraction(lo) * factor, Fraction(hi) * factor))
    return ends[0], ends[1]


def holds(system: PolynomialSystem, point: Floats, box_guard: bool = True) -> list[bool]:
    """For every row whether its widened form `q <= t^2` can hold at a point for SOME readings, exactly."""
    x = [Fraction(v) for v in point]
    values = [prod((x[i] for i in m), start=Fraction(1)) for m in system.monomials]

    def lowest(c: IntervalArray, row: int, monomials: list[Fraction]) -> tuple[Fraction, Fraction]:
        """Range of the row's form over the scaled readings: lowest, highest."""
        lo, hi = Fraction(0), Fraction(0)
        for j in range(c.shape[0]):
            ends = [span(c.lo[j, row, m], c.hi[j, row, m], v) for m, v in enumerate(monomials)]
            low, high = sum((e[0] for e in ends), Fraction(0)), sum((e[1] for e in ends), Fraction(0))
            lo, hi = (lo + low, hi + high) if j == 0 else (lo - max(abs(low), abs(high)), hi + max(abs(low), abs(high)))
        return lo, hi

    out = []
    for row in range(len(system.origin)):
        shortfall = Fraction(0)
        if system.guarded[row]:
            guard = lowest(system.guards, row, values)[0]
            shortfall = min(guard, Fraction(0)) if box_guard else Fraction(0)
        out.append(lowest(system.coefficients, row, values)[0] <= shortfall**2)
    return out


def true_network(seed: int) -> tuple[ConstraintNetwork, Floats]:
    """Norms, products, quotients by readings, kinks; one known solution x for readings inside their sets."""
    rng = np.random.default_rng(seed)
    net = ConstraintNetwork()
    x, t = net.variable("x", 3, (-5, 5)), net.variable("t", (), (0, 100))
    point, count = rng.uniform(-5, 5, 3), int(rng.integers(1, 5))
    p, r = 10.0 ** rng.uniform(-6, 0.5, 2) * rng.integers(0, 2, 2)
    center = rng.uniform(-9, 9, (count, 3))
    true = center + 0.999 * p * rng.uniform(-1, 1, (count, 3))
    scale = rng.uniform(1, 2, count)
    true_scale = scale + 0.999 * r * rng.uniform(-0.2, 0.2, count)
    position, factor = net.reading(center, p), net.reading(scale, 0.2 * r)
    body = norm(position - x) + x[1] / factor + (sqr(factor)[:, None] * position).sum(-1) * x[0] - position[:, 2] ** 3
    value = (
        np.linalg.norm(true - point, axis=1)
        + point[1] / true_scale
        + (true_scale[:, None] ** 2 * true).sum(-1) * point[0]
    )
    value = value - true[:, 2] ** 3
    room = 1e-9 * (1 + np.abs(value).max())
    net.add((body - (value + 0.0)).within((-room, room)))
    net.add((norm(position - x) - factor).within((-t, t)))
    worst = np.max(np.abs(np.linalg.norm(true - point, axis=1) - true_scale))
    return net, np.append(point, worst * (1 + 1e-9))


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_no_row_excludes_a_solution(seed: int) -> None:
    net, point = true_network(seed)
    system = PolynomialForms(net).on()
    assert system.leftover == ()
    assert all(holds(system, point))


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_no_row_excludes_a_solution_with_the_readings_that_decide(seed: int) -> None:
    net, point = true_network(seed)
    rng = np.random.default_rng([seed, 1])
    decisive = DecisiveReadings(net)
    for _ in range(3):
        size = 10.0 ** rng.uniform(-6, 1, 4)
        lo, hi = np.maximum(point - size, [-5, -5, -5, 0]), np.minimum(point + size, [5, 5, 5, 100])
        sets = decisive.on(Box(net.names, lo, hi)) if decisive.tape.readings else None
        assert all(holds(PolynomialForms(net).on(sets), point))


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_a_reading_that_several_rows_share_is_not_fixed_for_one_of_them(seed: int) -> None:
    """Readings that solve all rows still do when they are moved into the sets that are said to decide."""
    rng = np.random.default_rng(seed)
    net, x = network(x=(-4, 4))
    shared, own = net.reading(0.0, 1.0), net.reading(np.zeros(4), 1.0)
    factors, m, k = rng.choice([-2.0, -1.0, 1.0, 2.0], (2, 4)), *np.split(rng.integers(-8, 9, 5) / 8.0, [1])
    bound = factors[0] * m + factors[1] * k + 0.5
    net.add(factors[0] * shared + factors[1] * own + x <= bound)  # which (0.5, m, k) solves
    sets = DecisiveReadings(net).on(net.domain)[0]
    moved = {
        d: np.clip(value, sets[d].lo, sets[d].hi) for d, value in ((shared.digest, m), (own.digest, k)) if d in sets
    }
    assert own.digest in sets  # each enters one row
    left = factors[0] * moved.get(shared.digest, m) + factors[1] * moved[own.digest] + 0.5
    assert (left <= bound).all()


KINKS: dict[str, tuple[Callable[[Expr, Expr], Expr], Callable[[Floats, Floats], Floats]]] = {
    "sqrt": (lambda x, y: sqrt(x + 4) - 2 * y, lambda x, y: np.sqrt(x + 4) - 2 * y),
    "minus sqrt": (lambda x, y: 0.5 * y - 3 * sqrt(4 + x), lambda x, y: 0.5 * y - 3 * np.sqrt(4 + x)),
    "abs": (lambda x, y: 2 * abs(x) - y, lambda x, y: 2 * np.abs(x) - y),
    "minus abs": (lambda x, y: y - abs(x - 1) / 2, lambda x, y: y - np.abs(x - 1) / 2),
    "max": (lambda x, y: maximum(x, 2 * y) + x, lambda x, y: np.maximum(x, 2 * y) + x),
    "minus min": (lambda x, y: y - minimum(x, -y), lambda x, y: y - np.minimum(x, -y)),
    "nested": (lambda x, y: abs(x) + maximum(y, abs(x - y)), lambda x, y: np.abs(x) + np.maximum(y, np.abs(x - y))),
    "two abs": (lambda x, y: abs(x) + abs(y) - 1, lambda x, y: np.abs(x) + np.abs(y) - 1),
}


@pytest.mark.parametrize("name", KINKS)
def test_eliminated_kinks_have_the_same_solutions(name: str) -> None:
    """On a grid: `f <= c` holds exactly where its polynomial rows hold (with the guards, where v >= 0)."""
    make, value = KINKS[name]
    net, x, y = network(x=(-4, 4), y=(-4, 4))
    net.add(make(x, y) <= 0.3)
    system = PolynomialForms(net).on()
    assert system.leftover == ()
    for a in np.arange(-4, 4.1, 0.5):
        for b in np.arange(-4, 4.1, 0.5):
            true = bool(value(np.float64(a), np.float64(b)) <= 0.3)
            assert true <= all(holds(system, np.array([a, b])))
            # a guarded row speaks where its guard is not negative; elsewhere it is true by itself
            exact = all(holds(system, np.array([a, b]), box_guard=False)) or _guard_is_negative(system, a, b)
            assert true == exact


def _guard_is_negative(system: PolynomialSystem, a: float, b: float) -> bool:
    if not system.guarded.any():
        return False
    values = [prod(((a, b)[i] for i in m), start=1.0) for m in system.monomials]
    return bool((system.guards.hi[0, system.guarded] @ np.array(values) < 0).all())


LEFT_OVER: dict[str, Callable[[Expr, Expr], Expr]] = {
    "quotient": lambda x, r: x[0] / x[1],
    "power": lambda x, r: x[0] ** -1,
    "root in a product": lambda x, r: sqrt(x[0]) * x[1],
    "guard twice": lambda x, r: -(abs(x[0]) + abs(x[1])),
    "reading summed over measurements": lambda x, r: r.sum(0) * x[0],
    "reading of another measurement": lambda x, r: r[::-1] * x[0],
    "reading in all rows": lambda x, r: r[0] * x[0],
}


@pytest.mark.parametrize("name", LEFT_OVER)
def test_what_is_not_polynomial_is_left_over_with_a_reason(name: str) -> None:
    net, x = network(3, x=(1, 2))
    reading = net.reading([1.0, 2.0, 3.0], 0.1)
    net.add(x[2] <= 1.5)
    net.add(LEFT_OVER[name](x, reading) <= 1)
    system = PolynomialForms(net).on()
    assert [number for number, _ in system.leftover] == [1]
    assert all(reason for _, reason in system.leftover)
    assert system.origin.tolist() == [[0, 0]]


# Taylor models ----------------------------------------------------------------------------------------------


def model(rng: np.random.Generator, slots: int) -> IntervalArray:
    lo = rng.normal(size=(slots, 1)) * 10.0 ** rng.uniform(-3, 1, (slots, 1))
    lo[0] += np.sign(lo[0]) * 2 * np.abs(lo[1:]).sum(axis=0)  # clear of zero, so that it has a reciprocal
    return IntervalArray(lo, lo + rng.random((slots, 1)) * rng.choice([0.0, 1e-9]))


def exact(rng: np.random.Generator, c: IntervalArray, delta: list[Fraction]) -> Fraction:
    """A value of the model at some readings, for some numbers in its enclosures."""
    numbers = [Fraction(rng.choice([c.lo[j, 0], c.hi[j, 0]])) for j in range(c.shape[0])]
    return numbers[0] + sum((v * d for v, d in zip(numbers[1:], delta, strict=False)), Fraction(0))


def encloses(c: IntervalArray, delta: list[Fraction], value: Fraction) -> bool:
    ends = [span(c.lo[j, 0], c.hi[j, 0], d) for j, d in enumerate([Fraction(1), *delta[: c.shape[0] - 1]])]
    return sum(e[0] for e in ends) <= value <= sum(e[1] for e in ends)


def terms(x: IntervalArray) -> Arrays:
    return x.lo[:, None].copy(), x.hi[:, None].copy()


def sum_of(x: IntervalArray, y: IntervalArray, sign: float) -> IntervalArray:
    return IntervalArray(*coef.combined(terms(x), terms(y), FIRST, FIRST, sign, 1))[:, 0]


def product(x: IntervalArray, y: IntervalArray, *, square: bool = False) -> IntervalArray:
    return IntervalArray(*coef.products(terms(x), terms(y), np.zeros((1, 3), np.intp), 1, 1, square))[:, 0]


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, slots=st.tuples(st.integers(1, 5), st.integers(1, 5)))
def test_taylor_models_contain_the_exact_value(seed: int, slots: tuple[int, int]) -> None:
    rng = np.random.default_rng(seed)
    x, y = model(rng, slots[0]), model(rng, slots[1])
    delta = [Fraction(v) for v in rng.choice([-1.0, 0.0, 1.0, *rng.uniform(-1, 1, 2)], 4)]
    a, b = exact(rng, x, delta), exact(rng, y, delta)
    assert encloses(sum_of(x, y, 1.0), delta, a + b)
    assert encloses(sum_of(x, y, -1.0), delta, a - b)
    assert encloses(product(x, y), delta, a * b)
    assert encloses(product(x, x), delta, a * a)
    assert encloses(product(x, x, square=True), delta, a * a)
    assert encloses(IntervalArray(*coef.reciprocal(terms(y)))[:, 0], delta, 1 / b)
    assert encloses(IntervalArray(*coef.total(terms(x)))[:, 0], [], a)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, count=st.integers(2, 40))
def test_sums_that_cancel_are_enclosed(seed: int, count: int) -> None:
    """Of elements of an array, and of products that belong to one monomial."""
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(2, 3, count)) * 10.0 ** rng.uniform(-9, 9, (2, 3, count))
    y[:, 0] = 1.0
    x[:, 0] = -x[:, 1:].sum(axis=1)
    delta = [Fraction(v) for v in (1.0, *rng.uniform(-1, 1, 2))]
    a, b = ([sum(Fraction(v) * d for v, d in zip(c, delta, strict=True)) for c in z.T] for z in (x, y))
    total = IntervalArray(*coef.centred_sums((x[:, None, :, None],) * 2))[:, 0, 0]
    assert encloses(total[:, None], delta[1:], sum(a, Fraction(0)))
    x[:, 0] = -(x[:, 1:] * y[:, 1:]).sum(), 0.0, 0.0
    a[0] = Fraction(x[0, 0])
    pairs = np.array([(k, k, 0) for k in range(count)], np.intp)
    products = IntervalArray(*coef.products((x[..., None],) * 2, (y[..., None],) * 2, pairs, 1, 1, False))[:, 0, 0]
    assert encloses(products[:, None], delta[1:], sum((v * w for v, w in zip(a, b, strict=True)), Fraction(0)))
