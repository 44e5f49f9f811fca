"""The classical enclosures of interval linear systems: known results, sampled solutions, honest failures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import LinearSystem
from contractors.linear_system import enclose_gauss, enclose_krawczyk, enclose_rump
from cpcal.solver.interval import IntervalArray, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, sqr

Enclose = Callable[..., IntervalArray | None]
METHODS: dict[str, Enclose] = {"gauss": enclose_gauss, "krawczyk": enclose_krawczyk, "rump": enclose_rump}
SEEDS = st.integers(0, 2**32 - 1)

BARTH_NUDING = IntervalArray(np.array([[2.0, -2], [-1, 2]]), np.array([[4.0, 1], [2, 4]]))
HANSEN = IntervalArray(np.array([[2.0, 0], [1, 2]]), np.array([[3.0, 1], [2, 3]]))


@pytest.mark.parametrize("engine", ["float64", "arb"])
@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_sampled_solutions_are_enclosed(method: str, engine: str, seed: int) -> None:
    """Also of over-determined systems: a right side is made to fit each sampled matrix."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    m = n + int(rng.integers(0, 6)) * int(rng.integers(0, 2))
    size = 10.0 ** rng.uniform(-12, -0.5)
    center, x = rng.normal(0, 1, (m, n)), rng.normal(0, 10, (8, n))
    matrix = IntervalArray.around(center, size * rng.random((m, n)) * rng.integers(0, 2, (m, n)))
    samples = rng.uniform(matrix.lo, matrix.hi, (8, m, n))
    right = np.einsum("kij,kj->ki", samples, x)
    room = 1e-12 * (1 + np.abs(right).max())  # of the product above
    enclosure = METHODS[method](matrix, IntervalArray(right.min(0) - room, right.max(0) + room), get_arithmetic(engine))
    if enclosure is None:  # honest only where the matrices may come near a singular one
        assert size * m * n * np.linalg.norm(np.linalg.pinv(center), 2) > 0.1
        return
    assert (enclosure.lo <= x).all()
    assert (x <= enclosure.hi).all()


@pytest.mark.parametrize("method", METHODS)
def test_narrow_systems_are_solved_narrowly(method: str) -> None:
    rng = np.random.default_rng(1)
    center, x = rng.normal(0, 1, (64, 7)), rng.normal(0, 10, 7)
    found = METHODS[method](IntervalArray.around(center, 1e-9), IntervalArray.around(center @ x, 1e-6))
    assert found is not None
    assert ((found.lo <= x) & (x <= found.hi)).all()
    assert (found.hi - found.lo < 1e-5).all()


def test_textbook_systems() -> None:
    """Barth and Nuding: hull [-4, 4]^2, with preconditioning [-14, 14]^2. Hansen: hull [-120, 90] x [-60, 240]."""
    for method in METHODS.values():
        found = method(BARTH_NUDING, IntervalArray.point(np.zeros(2)))
        assert found is not None
        assert np.abs([found.lo, found.hi]).max() < 1e-12
        found = method(BARTH_NUDING, IntervalArray(np.full(2, -2.0), np.full(2, 2.0)))
        assert found is not None
        assert np.abs([found.lo, found.hi]) == pytest.approx(14.0, rel=0.03)
        found = method(HANSEN, IntervalArray(np.array([0.0, 60]), np.array([120.0, 240])))
        assert found is not None
        assert (found.lo <= [-120, -60]).all()
        assert (found.hi >= [90, 240]).all()
        assert (found.hi - found.lo < [320, 450]).all()


@pytest.mark.parametrize("method", METHODS)
def test_singular_systems_and_too_few_equations_are_a_failure(method: str) -> None:
    right = IntervalArray.point(np.ones(2))
    wide = IntervalArray(np.array([[1.0, -3], [-3, 1]]), np.array([[3.0, 3], [3, 3]]))
    assert METHODS[method](wide, right) is None
    assert METHODS[method](IntervalArray.point(np.ones((2, 2))), right) is None
    assert METHODS[method](IntervalArray.point(np.ones((1, 2))), right[:1]) is None
    assert METHODS[method](IntervalArray.point(np.full((2, 2), np.nan)), right) is None


def test_krawczyk_with_a_start_proves_that_there_is_no_solution() -> None:
    start = IntervalArray(np.full(2, 20.0), np.full(2, 30.0))
    found = enclose_krawczyk(BARTH_NUDING, IntervalArray(np.full(2, -2.0), np.full(2, 2.0)), start=start)
    assert found is not None
    assert found.empty.all()


def test_rump_refuses_systems_too_large_to_invert() -> None:
    assert enclose_rump(IntervalArray.point(np.ones((2000, 2))), IntervalArray.point(np.ones(2000))) is None


@pytest.mark.parametrize("method", METHODS)
def test_contractor_contracts_a_nonlinear_system_quadratically(method: str) -> None:
    net = ConstraintNetwork()
    x, y = net.variable("x", (), (1.95, 2.07)), net.variable("y", (), (0.9, 1.06))
    net.add([sqr(x) + sqr(y) == 5, x * y == 2, x - y == 1])
    contractor, box = LinearSystem(net, method=method), net.domain  # type: ignore[arg-type]
    widths = [float(box.width.max())]
    for _ in range(3):
        box = contractor.contract(box).box
        widths.append(float(box.width.max()))
        assert [2.0, 1.0] in box
    assert widths[1] < 0.2 * widths[0]
    assert widths[3] < 1e-9


def test_contractor_uses_the_sets_of_readings_and_the_bounds_of_constraints() -> None:
    net = ConstraintNetwork()
    x, eps = net.variable("x", (), (-50, 50)), net.variable("eps", (), (0, 0.25))
    net.add((net.reading([2.0, 4.0], 0.5) - net.reading([1.0, 2.0], 0.0) * x).within((-eps, eps)))
    found = LinearSystem(net).contract(net.domain)
    assert found.box["x"].lo == pytest.approx(2 - 0.75 * 3 / 5)  # least squares weights (1, 2) / 5
    assert found.box["x"].hi == pytest.approx(2 + 0.75 * 3 / 5)
    assert found.box["eps"].hi == 0.25
    assert {step.variable for step in found.steps} == {"x"}
    with pytest.raises(ValueError, match="gauss, krawczyk, rump"):
        LinearSystem(net, method="magic")  # type: ignore[arg-type]
