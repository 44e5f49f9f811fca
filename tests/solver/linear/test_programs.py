"""Engines propose, rigorous bounds dispose: against exact rationals, HiGHS and points of the polyhedron."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from cpcal.solver.interval import IntervalArray, get_arithmetic
from cpcal.solver.linear import Glop, LazyRows, lower_bound
from cpcal.solver.linear.engine import LinearStatus

Floats = npt.NDArray[np.float64]
SEEDS = st.integers(0, 2**32 - 1)
ENGINES = ["float64", "arb"]


class Program:
    """A random dense program over [-1, 1]^n, feasible around a known point unless `room` is negative."""

    def __init__(self, seed: int, *, rows: int = 40, columns: int = 6, room: float = 0.1) -> None:
        rng = np.random.default_rng(seed)
        self.matrix = rng.normal(size=(rows, columns))
        self.matrix[rng.random(self.matrix.shape) < 0.2] = 0.0
        self.matrix /= np.maximum(np.abs(self.matrix).max(axis=1), 1e-3)[:, None]
        self.inside = rng.uniform(-0.9, 0.9, columns)
        self.rhs = self.matrix @ self.inside + room * rng.random(rows)
        self.lower, self.upper = -np.ones(columns), np.ones(columns)
        self.objective = rng.normal(size=columns)

    def oracle(self, objective: Floats | None = None) -> float | None:
        """The optimum by HiGHS; None if there is no point."""
        cost = self.objective if objective is None else objective
        bounds = np.stack([self.lower, self.upper], axis=1)
        found = linprog(cost, A_ub=self.matrix, b_ub=self.rhs, bounds=bounds, method="highs")
        return float(found.fun) if found.status == 0 else None

    def engine(self) -> Glop:
        glop = Glop()
        glop.load(self.matrix, self.rhs, self.lower, self.upper)
        return glop

    def bound(self, engine: str, multipliers: Floats, objective: Floats | None = None, radius: float = 0.0) -> float:
        """The rigorous bound, of the matrix or of an interval matrix around it."""
        matrix = IntervalArray.around(self.matrix, radius)
        cost = self.objective if objective is None else objective
        columns = IntervalArray(self.lower, self.upper)
        return lower_bound(get_arithmetic(engine), matrix, self.rhs, multipliers, cost, columns)

    def exact_bound(self, multipliers: Floats) -> Fraction:
        """The same formula in rationals."""
        y = [Fraction(v) for v in multipliers]
        total = -sum((v * Fraction(u) for v, u in zip(y, self.rhs, strict=True)), Fraction(0))
        for j, cost in enumerate(self.objective):
            r = Fraction(cost) + sum((v * Fraction(c) for v, c in zip(y, self.matrix[:, j], strict=True)), Fraction(0))
            total += min(r * Fraction(self.lower[j]), r * Fraction(self.upper[j]))
        return total


@pytest.mark.parametrize("engine", ENGINES)
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_bound_from_multipliers_is_below_the_exact_one_and_close(engine: str, seed: int) -> None:
    program = Program(seed)
    solution = program.engine().minimize(program.objective)
    assert solution.status is LinearStatus.OPTIMAL
    bound = program.bound(engine, solution.multipliers)
    exact = program.exact_bound(solution.multipliers)
    assert Fraction(bound) <= exact
    assert float(exact - Fraction(bound)) < 1e-12
    optimum = program.oracle()
    assert optimum is not None
    assert bound == pytest.approx(optimum, abs=1e-7)
    assert bound <= optimum + 1e-9


GARBAGE = st.sampled_from([0.0, -1.0, 1.0, 1e-320, 1e10, 1e200, 1.7e308, np.nan, np.inf, -np.inf]) | st.floats()


@pytest.mark.parametrize("engine", ENGINES)
@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, garbage=st.lists(GARBAGE, min_size=12, max_size=12), radius=st.sampled_from([0.0, 1e-6, 0.1]))
def test_no_multipliers_make_a_wrong_bound(engine: str, seed: int, garbage: list[float], radius: float) -> None:
    """Whatever an engine proposes: the bound is below the value at a point of every polyhedron of the enclosure."""
    program = Program(seed, rows=12)
    room = radius * np.abs(program.inside).sum() * 1.001
    program.rhs += room  # now `inside` satisfies the rows of every matrix within the radius
    y = np.array(garbage)
    value = sum(
        (Fraction(c) * Fraction(v) for c, v in zip(program.objective, program.inside, strict=True)),
        Fraction(0),
    )
    bound = program.bound(engine, y, radius=radius)
    assert not np.isnan(bound)
    assert bound < np.inf
    assert bound == -np.inf or Fraction(bound) <= value
    assert program.bound(engine, y, np.zeros(6), radius) <= 0.0  # never a proof of emptiness


@pytest.mark.parametrize("engine", ENGINES)
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_negative_multipliers_count_as_zero(engine: str, seed: int) -> None:
    """A row with a negative weight says the opposite of what it says."""
    rng = np.random.default_rng([seed, 2])
    program = Program(seed, room=3.0)
    weights = -10.0 * rng.random(40)
    assert program.bound(engine, weights) == program.bound(engine, np.zeros(40))
    assert program.bound(engine, weights, np.zeros(6)) <= 0.0


@pytest.mark.parametrize("engine", ENGINES)
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_bound_never_exceeds_values_at_points_of_the_polyhedron(engine: str, seed: int) -> None:
    rng = np.random.default_rng([seed, 1])
    program = Program(seed, room=1.0)
    weights = program.engine().minimize(program.objective).multipliers * rng.uniform(0, 2, 40)
    bound = program.bound(engine, weights)
    points = program.inside + 0.3 * rng.normal(size=(200, 6))
    feasible = [p for p in points if (program.matrix @ p <= program.rhs - 1e-9).all() and np.abs(p).max() <= 1]
    assert all(bound <= program.objective @ p + 1e-9 for p in [*feasible, program.inside])


def test_bound_with_unbounded_columns_and_infinite_sides() -> None:
    program = Program(1)
    solution = program.engine().minimize(program.objective)
    program.lower = program.lower.copy()
    program.lower[0] = -np.inf
    assert program.bound("float64", solution.multipliers) < np.inf
    program.rhs = program.rhs.copy()
    program.rhs[:] = np.inf
    assert program.bound("float64", solution.multipliers) == -np.inf


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, columns=st.integers(1, 12), rows=st.integers(0, 60))
def test_glop_agrees_with_highs(seed: int, columns: int, rows: int) -> None:
    program = Program(seed, rows=rows, columns=columns)
    rng = np.random.default_rng(seed)
    glop = program.engine()
    for _ in range(4):  # changing objectives on one model
        objective = rng.normal(size=columns) * rng.integers(0, 2, columns)
        solution = glop.minimize(objective)
        assert solution.status is LinearStatus.OPTIMAL
        assert objective @ solution.point == pytest.approx(program.oracle(objective), abs=1e-7)
        assert (program.matrix @ solution.point <= program.rhs + 1e-7).all()
        assert (solution.multipliers >= 0).all()
        assert solution.multipliers.shape == (rows,)


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_glop_takes_rows_later(seed: int) -> None:
    program = Program(seed)
    glop = Glop()
    glop.load(program.matrix[:10], program.rhs[:10], program.lower, program.upper)
    first = glop.minimize(program.objective)
    assert first.multipliers.shape == (10,)
    for k in range(10, 40, 10):
        glop.add_rows(program.matrix[k : k + 10], program.rhs[k : k + 10])
    solution = glop.minimize(program.objective)
    assert program.objective @ solution.point == pytest.approx(program.oracle(), abs=1e-7)
    assert program.bound("float64", solution.multipliers) == pytest.approx(program.oracle(), abs=1e-7)
    glop.load(program.matrix[:10], program.rhs[:10], program.lower, program.upper)
    again = glop.minimize(program.objective)
    assert program.objective @ again.point == pytest.approx(program.objective @ first.point, abs=1e-7)


def emptied(seed: int) -> Program:
    """Two rows that ask for a sum at least 0.01 above what the other allows."""
    program = Program(seed)
    row = program.matrix[0]
    program.matrix = np.concatenate([program.matrix, -row[None]])
    program.rhs = np.append(program.rhs, -program.rhs[0] - 0.01)
    return program


@pytest.mark.parametrize("engine", ENGINES)
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_infeasible_programs_give_a_ray_that_proves_it(engine: str, seed: int) -> None:
    program = emptied(seed)
    assert program.oracle() is None
    glop = program.engine()
    for _ in range(2):  # the model stays usable
        solution = glop.minimize(program.objective)
        assert solution.status is LinearStatus.INFEASIBLE
        assert program.bound(engine, solution.multipliers, np.zeros(6)) > 0.0


def test_feasible_again_after_an_infeasible_answer() -> None:
    program = Program(4)
    glop = program.engine()
    glop.add_rows(-program.matrix[:1], -program.rhs[:1] - 0.01)
    assert glop.minimize(program.objective).status is LinearStatus.INFEASIBLE
    glop.load(program.matrix, program.rhs, program.lower, program.upper)
    assert glop.minimize(program.objective).status is LinearStatus.OPTIMAL


def test_thin_polyhedra_are_not_called_empty() -> None:
    """Statuses lie on these (DESIGN section 5); the multipliers must not."""
    for seed in range(30):
        program = Program(seed, room=0.0)
        solution = program.engine().minimize(program.objective)
        assert program.bound("float64", solution.multipliers, np.zeros(6)) <= 0.0
        assert program.bound("float64", solution.multipliers) <= program.objective @ program.inside + 1e-12


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_lazy_rows_equal_the_full_program(seed: int) -> None:
    program = Program(seed, rows=600, columns=5, room=0.5)
    few = (program.matrix[:7], program.rhs[:7])
    lazy = LazyRows(Glop(), few, (program.matrix[7:], program.rhs[7:]), (program.lower, program.upper))
    rng = np.random.default_rng(seed)
    for _ in range(4):
        objective = rng.normal(size=5)
        solution = lazy.minimize(objective)
        assert objective @ solution.point == pytest.approx(program.oracle(objective), abs=1e-7)
        weights = np.zeros(600)
        weights[:7] = solution.multipliers[:7]
        weights[7 + lazy.active[: len(solution.multipliers) - 7]] = solution.multipliers[7:]
        assert program.bound("float64", weights, objective) == pytest.approx(program.oracle(objective), abs=1e-7)
    assert len(lazy.active) < 300
    assert len(set(lazy.active.tolist())) == len(lazy.active)
    assert lazy.programs >= 4


def test_lazy_rows_find_emptiness() -> None:
    program = emptied(5)
    lazy = LazyRows(
        Glop(), (np.zeros((0, 6)), np.zeros(0)), (program.matrix, program.rhs), (program.lower, program.upper)
    )
    solution = lazy.minimize(program.objective)
    assert solution.status is LinearStatus.INFEASIBLE
    weights = np.zeros(41)
    weights[lazy.active[: len(solution.multipliers)]] = solution.multipliers
    assert program.bound("float64", weights, np.zeros(6)) > 0.0


def test_programs_without_rows() -> None:
    lazy = LazyRows(Glop(), (np.zeros((0, 2)), np.zeros(0)), (np.zeros((0, 2)), np.zeros(0)), (-np.ones(2), np.ones(2)))
    solution = lazy.minimize(np.array([1.0, -2.0]))
    np.testing.assert_allclose(solution.point, [-1.0, 1.0])
