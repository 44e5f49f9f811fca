"""Engines propose, rigorous bounds dispose: against exact rationals, HiGHS and points of the polyhedron."""

from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from contractors.krawczyk import PolyhedralPrograms, Polyhedron
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.linear import Dense, LinearSolution, LinearStatus, lower_bound
from tests.solver.test_exact_programs import Highs

Floats = npt.NDArray[np.float64]
SEEDS = st.integers(0, 2**32 - 1)
SOLVERS = [Dense, Highs]
both = pytest.mark.parametrize("solver", SOLVERS)


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

    def engine(self, solver: type[Dense] = Dense) -> Dense:
        engine = solver()
        engine.load(self.matrix, self.rhs, self.lower, self.upper)
        return engine

    def weights(self, solution: LinearSolution) -> Floats:
        """One multiplier for every row."""
        out = np.zeros(len(self.rhs))
        out[solution.rows] = solution.multipliers
        return out

    def bound(self, multipliers: Floats, objective: Floats | None = None) -> float:
        """The rigorous bound from a multiplier for every row."""
        cost = self.objective if objective is None else objective
        columns, rows = IntervalArray(self.lower, self.upper), np.arange(len(self.rhs))
        return lower_bound(self.matrix, self.rhs, rows, multipliers, cost, columns)

    def exact_bound(self, multipliers: Floats) -> Fraction:
        """The same formula in rationals."""
        y = [Fraction(v) for v in multipliers]
        total = -sum((v * Fraction(u) for v, u in zip(y, self.rhs, strict=True)), Fraction(0))
        for j, cost in enumerate(self.objective):
            r = Fraction(cost) + sum((v * Fraction(c) for v, c in zip(y, self.matrix[:, j], strict=True)), Fraction(0))
            total += min(r * Fraction(self.lower[j]), r * Fraction(self.upper[j]))
        return total


@both
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_bound_from_multipliers_is_below_the_exact_one_and_close(solver: type[Dense], seed: int) -> None:
    program = Program(seed)
    solution = program.engine(solver).minimize(program.objective)
    assert solution.status is LinearStatus.OPTIMAL
    weights = program.weights(solution)
    bound = program.bound(weights)
    exact = program.exact_bound(weights)
    assert Fraction(bound) <= exact
    assert float(exact - Fraction(bound)) < 2e-13 * (1.0 + weights.sum())
    optimum = program.oracle()
    assert optimum is not None
    assert bound == pytest.approx(optimum, abs=1e-7)
    assert bound <= optimum + 1e-9


GARBAGE = st.sampled_from([0.0, -1.0, 1.0, 1e-320, 1e10, 1e200, 1.7e308, np.nan, np.inf, -np.inf]) | st.floats()


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, garbage=st.lists(GARBAGE, min_size=12, max_size=12), room=st.sampled_from([0.1, 1e-6, 0.0]))
def test_no_multipliers_make_a_wrong_bound(seed: int, garbage: list[float], room: float) -> None:
    """Whatever an engine proposes: the bound is below the value at every point of the polyhedron."""
    program = Program(seed, rows=12, room=room)
    # now `inside` satisfies the rows in exact arithmetic, too
    program.rhs += 1e-15
    y = np.array(garbage)
    products = (Fraction(c) * Fraction(v) for c, v in zip(program.objective, program.inside, strict=True))
    value = sum(products, Fraction(0))
    bound = program.bound(y)
    assert not np.isnan(bound)
    assert bound < np.inf
    assert bound == -np.inf or Fraction(bound) <= value
    assert program.bound(y, np.zeros(6)) <= 0.0  # never a proof of emptiness


def test_bound_with_unbounded_columns_and_infinite_sides() -> None:
    program = Program(1)
    solution = program.engine().minimize(program.objective)
    program.lower = program.lower.copy()
    program.lower[0] = -np.inf
    assert program.bound(program.weights(solution)) < np.inf
    program.rhs = program.rhs.copy()
    program.rhs[:] = np.inf
    assert program.bound(program.weights(solution)) == -np.inf


def emptied(seed: int) -> Program:
    """Two rows that ask for a sum at least 0.01 above what the other allows."""
    program = Program(seed)
    row = program.matrix[0]
    program.matrix = np.concatenate([program.matrix, -row[None]])
    program.rhs = np.append(program.rhs, -program.rhs[0] - 0.01)
    return program


@both
def test_emptiness_is_found_among_many_rows(solver: type[Dense]) -> None:
    program = emptied(5)
    slack = Program(6, rows=1500, room=3.0)
    program.matrix = np.concatenate([slack.matrix, program.matrix])
    program.rhs = np.concatenate([slack.rhs, program.rhs])
    solution = program.engine(solver).minimize(program.objective)
    assert solution.status is LinearStatus.INFEASIBLE
    assert program.bound(program.weights(solution), np.zeros(6)) > 0.0


def test_a_program_that_holds_one_point_alone_is_not_proved_empty() -> None:
    """x >= 1 in [-1, 1], with the multiplier that would exclude anything less."""
    above = Polyhedron(np.array([[-1.0]]), np.array([-1.0]), np.array([[0, 0]]))
    program = PolyhedralPrograms("krawczyk", above, Box(("x",), [-1.0], [1.0]))
    only = LinearSolution(LinearStatus.INFEASIBLE, np.zeros(1), np.array([0]), np.ones(1))
    assert program.empty(only) is None


def test_a_bound_is_below_the_exact_one_also_where_the_reduced_costs_cancel() -> None:
    rng = np.random.default_rng(7)
    for _ in range(100):
        half = rng.normal(size=20) * 1e8
        matrix = np.concatenate([half, -half + rng.normal(size=20) * 1e-6])[rng.permutation(40), None]
        y, nothing = rng.uniform(0.9, 1.1) * np.ones(40), np.zeros(40)
        columns = IntervalArray(-np.ones(1), np.ones(1))
        found = lower_bound(matrix, nothing, np.arange(40), y, np.zeros(1), columns)
        r = sum((Fraction(a) * Fraction(b) for a, b in zip(y, matrix[:, 0], strict=True)), Fraction(0))
        assert Fraction(found) <= -abs(r)


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_negative_multipliers_count_as_zero(seed: int) -> None:
    """A row with a negative weight says the opposite of what it says."""
    rng = np.random.default_rng([seed, 2])
    program = Program(seed, room=3.0)
    weights = -10.0 * rng.random(40)
    assert program.bound(weights) == program.bound(np.zeros(40))
    assert program.bound(weights, np.zeros(6)) <= 0.0
