"""Linear programs of every unpleasant kind: engines propose, rigorous bounds dispose, in exact rational arithmetic."""

from dataclasses import dataclass
from fractions import Fraction
from fractions import Fraction as F
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors.krawczyk import PolyhedralPrograms, Polyhedron
from cpcal.common.values import Floats
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.linear import Dense, LinearSolution, LinearStatus, lower_bound

KINDS = ("random", "degenerate", "rank-deficient", "infeasible", "thin", "badly scaled", "products")


@dataclass(frozen=True)
class ExactProgram:
    """`min objective . z : matrix z <= rhs, lower <= z <= upper`."""

    kind: str
    matrix: Floats
    rhs: Floats
    lower: Floats
    upper: Floats
    objectives: tuple[Floats, ...]


def program(seed: int) -> ExactProgram:
    """Number `seed`: all kinds in turn. Small numbers are dyadic, so that ties are ties."""
    kind, rng = KINDS[seed % len(KINDS)], np.random.default_rng(seed)
    n, m = int(rng.integers(1, 7)), int(rng.integers(1, 25))
    matrix = rng.integers(-4, 5, (m, n)) / 4.0
    inside = rng.integers(-2, 3, n) / 4.0
    lower, upper = -np.ones(n), np.ones(n)
    rhs = matrix @ inside + rng.integers(0, 3, m) / 4.0
    if kind == "random":
        matrix = rng.normal(size=(m, n))
        rhs = matrix @ inside + rng.random(m)
    elif kind == "degenerate":  # many rows through one point
        rhs = matrix @ inside
    elif kind == "rank-deficient":
        matrix = matrix[:, :1] * rng.integers(-2, 3, n) + np.zeros((m, n))
        rhs = matrix @ inside + rng.integers(0, 2, m) / 4.0
    elif kind == "infeasible":
        matrix = np.concatenate([matrix, -matrix[:1]])
        rhs = np.append(rhs, -rhs[0] - 2.0 ** -int(rng.integers(1, 20)))
    elif kind == "thin":
        matrix = np.concatenate([matrix, -matrix])
        rhs = np.concatenate([matrix[:m] @ inside, -(matrix[:m] @ inside)]) + 2.0 ** -int(rng.integers(20, 60))
    elif kind == "badly scaled":
        size = 2.0 ** rng.integers(-30, 30, m)
        matrix, rhs = matrix * size[:, None], rhs * size
        lower, upper = lower * 2.0 ** rng.integers(-10, 10, n), upper * 2.0 ** rng.integers(-10, 10, n)
    elif kind == "products":  # all bounds' products of neighbouring columns
        matrix = np.array([np.roll([p, q, -p * q, *np.zeros(n)], j)[: n + 3] for j in range(n) for p in S for q in S])
        rhs, n = np.ones(len(matrix)), n + 3
        lower, upper = -np.ones(n), np.ones(n)
    objectives = (*rng.integers(-2, 3, (2, n)).astype(np.float64), np.eye(n)[0], -np.eye(n)[-1])
    return ExactProgram(kind, matrix, rhs, lower, upper, objectives)


S = (-1.0, 1.0)


def optimum(program: ExactProgram, objective: Floats) -> F | None:
    """In exact rationals, by the simplex method with Bland's rule; None when there is no point."""
    n = len(objective)
    low = [F(v) for v in program.lower]
    rows = [([F(a) for a in row], F(b)) for row, b in zip(program.matrix, program.rhs, strict=True)]
    rows += [([F(int(j == k)) for j in range(n)], F(u)) for k, u in enumerate(program.upper)]
    # z = low + x with x >= 0, and slacks
    sides = [b - sum((a * v for a, v in zip(row, low, strict=True)), F(0)) for row, b in rows]
    tableau = [row + [F(int(i == k)) for i in range(len(rows))] for k, (row, _) in enumerate(rows)]
    basis = [n + k for k in range(len(rows))]
    # one artificial column, in every row that the origin violates
    if min(sides) < 0:
        for row in tableau:
            row.append(F(-1))
        artificial = len(tableau[0]) - 1
        _pivot(tableau, sides, basis, min(range(len(sides)), key=sides.__getitem__), artificial)
        cost = [F(0)] * artificial + [F(1)]
        if _minimised(tableau, sides, basis, cost) > 0:
            return None
        if artificial in basis:
            k = basis.index(artificial)
            _pivot(tableau, sides, basis, k, next(j for j in range(artificial) if tableau[k][j]))
        for row in tableau:
            row.pop()
    costs = [F(c) for c in objective] + [F(0)] * len(rows)
    return _minimised(tableau, sides, basis, costs) + sum((F(c) * v for c, v in zip(objective, low, strict=True)), F(0))


def _pivot(tableau: list[list[F]], sides: list[F], basis: list[int], k: int, j: int) -> None:
    scale = tableau[k][j]
    tableau[k] = [v / scale for v in tableau[k]]
    sides[k] /= scale
    for i, row in enumerate(tableau):
        if i != k and row[j]:
            factor = row[j]
            tableau[i] = [a - factor * b if b else a for a, b in zip(row, tableau[k], strict=True)]
            sides[i] -= factor * sides[k]
    basis[k] = j


def _minimised(tableau: list[list[F]], sides: list[F], basis: list[int], cost: list[F]) -> F:
    while True:
        reduced = [c - sum((cost[b] * row[j] for b, row in zip(basis, tableau, strict=True) if cost[b]), F(0))
                   for j, c in enumerate(cost)]  # fmt: skip
        entering = next((j for j, r in enumerate(reduced) if r < 0), None)
        if entering is None:
            return sum((cost[b] * s for b, s in zip(basis, sides, strict=True)), F(0))
        ratios = [(s / row[entering], b, k) for k, (s, row, b) in enumerate(zip(sides, tableau, basis, strict=True))
                  if row[entering] > 0]  # fmt: skip
        _pivot(tableau, sides, basis, min(ratios)[2], entering)


@cache  # for one engine after another
def optima(seed: int) -> tuple[F | None, ...]:
    """Of each objective of program `seed`; None where the program is infeasible."""
    case = program(seed)
    return tuple(optimum(case, objective) for objective in case.objectives)


class Highs(Dense):
    """What takes over where the simplex method gives up, asked at once."""

    def minimize(self, objective: Floats) -> LinearSolution:
        return self._by_highs(objective)


def contradictions(seed: int, solver: type[Dense] = Dense) -> tuple[list[str], int]:
    """What an engine proves of a program that is not true (nothing, or there is a mistake), and how often it failed."""
    case = program(seed)
    engine = solver(case.matrix, case.rhs, case.lower, case.upper)
    columns, nothing = IntervalArray(case.lower, case.upper), np.zeros(len(case.lower))
    wrong, failed = [], 0
    for objective, exact in zip(case.objectives, optima(seed), strict=True):
        solution = engine.minimize(objective)
        rows, y = solution.rows, solution.multipliers
        bound = lower_bound(case.matrix, case.rhs, rows, y, objective, columns)
        of_nothing = lower_bound(case.matrix, case.rhs, rows, y, nothing, columns)
        empty = of_nothing > 0.0
        said = {LinearStatus.OPTIMAL: bound, LinearStatus.INFEASIBLE: of_nothing}
        assert solution.lowest == said.get(solution.status, -np.inf)
        if exact is not None and (empty or F(bound) > exact):
            wrong.append(f"program {seed} ({case.kind}): {bound} where the optimum is {float(exact)}")
        close = exact is not None and float(exact) - bound <= 1e-6 * max(1.0, float(np.abs(case.upper).max()))
        told = solution.status is LinearStatus.INFEASIBLE and empty if exact is None else close
        failed += not told
    return wrong, failed


COUNT = 35


@pytest.mark.parametrize("count", [COUNT, pytest.param(3000, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("solver", [Dense, Highs])
@pytest.mark.parametrize("kind", KINDS)
def test_no_bound_is_contradicted_and_nearly_every_program_is_solved(
    solver: type[Dense], kind: str, count: int
) -> None:
    outcomes = [contradictions(seed, solver) for seed in range(KINDS.index(kind), count, len(KINDS))]
    assert [line for lines, _ in outcomes for line in lines] == []
    failed = sum(count for _, count in outcomes)
    allowed = 0.2 if kind == "badly scaled" else 0.02  # of programs that nobody has scaled
    assert failed <= allowed * 4 * len(outcomes)


def test_the_kernel_ends_in_its_bounded_number_of_pivots_without_help(monkeypatch: pytest.MonkeyPatch) -> None:
    """HiGHS, which takes over where it gives up, is never asked."""

    def asked(*_: object) -> None:
        raise AssertionError("HiGHS was asked")

    monkeypatch.setattr(Dense, "_by_highs", asked)
    for seed in range(COUNT):
        case = program(seed)
        if case.kind != "badly scaled":
            engine = Dense(case.matrix, case.rhs, case.lower, case.upper)
            for objective in case.objectives:
                engine.minimize(objective)


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

    def engine(self, solver: type[Dense] = Dense) -> Dense:
        return solver(self.matrix, self.rhs, self.lower, self.upper)

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
