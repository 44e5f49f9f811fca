"""Linear programs of every unpleasant kind: no multipliers prove what is not true in exact rational arithmetic.

As a command, many of them: `python -m tests.solver.test_exact_programs 3000`.
"""

from dataclasses import dataclass
from fractions import Fraction as F
from functools import cache

import numpy as np
import pytest

from cpcal.common.values import Floats
from cpcal.solver.interval import IntervalArray
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
    engine = solver()
    engine.load(case.matrix, case.rhs, case.lower, case.upper)
    columns, nothing = IntervalArray(case.lower, case.upper), np.zeros(len(case.lower))
    wrong, failed = [], 0
    for objective, exact in zip(case.objectives, optima(seed), strict=True):
        solution = engine.minimize(objective)
        rows, y = solution.rows, solution.multipliers
        bound = lower_bound(case.matrix, case.rhs, rows, y, objective, columns)
        empty = lower_bound(case.matrix, case.rhs, rows, y, nothing, columns) > 0.0
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
            engine = Dense()
            engine.load(case.matrix, case.rhs, case.lower, case.upper)
            for objective in case.objectives:
                engine.minimize(objective)
