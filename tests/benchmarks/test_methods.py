"""The methods ask what they should, peers against cpcal where there are any; classic problems agree with the books."""

import numpy as np
import pytest

from benchmarks.methods import AB, BB, COLUMNS, OFFSET, A, B, Q, TaskQuestion, method, rows
from benchmarks.problems import Leg, problem
from benchmarks.runs import MINIMISE, MethodAnswer, Task
from benchmarks.solver_problems import PROBLEMS, literature, page, run
from cpcal.models import model_residuals

BEST = 0.5042169  # mm, eps* of the leg, rounded down


def leg() -> Leg:
    found = problem("leg1-e1-n64-d100")
    assert isinstance(found, Leg)
    return found


def ask(name: str, task: str, eps: float | None = None, limit: float = 60.0) -> MethodAnswer:
    return method(name).prepare(TaskQuestion(leg(), Task.named(task), eps, limit))()


def test_the_expanded_rows_are_the_squared_equations() -> None:
    asked, eps = leg(), 0.7
    data, x = rows(asked), asked.middle + np.linspace(-20.0, 30.0, 7)
    columns = np.zeros(COLUMNS)
    columns[:7] = x
    columns[Q] = x[:3] @ x[:3] - x[OFFSET] ** 2
    for (i, j), column in AB.items():
        columns[column] = x[A[i]] * x[B[j]]
    for (i, j), column in BB.items():
        columns[column] = x[B[i]] * x[B[j]]
    value = data.matrix @ columns + data.constant
    reach = data.length + x[OFFSET]
    distance = model_residuals(asked.campaign, asked.leg, x) + reach
    for sign in (1.0, -1.0):
        term = sign * 2.0 * eps * reach + eps * eps
        assert value - term == pytest.approx(distance**2 - (reach + sign * eps) ** 2, abs=1e-6)


def test_cpcal_closes_and_refutes() -> None:
    found = ask("lifted", MINIMISE)
    assert found.answered
    assert found.figures["lo"] <= BEST + 1e-6
    assert found.figures["hi"] >= BEST
    assert ask("lifted", "refute-0.9", 0.9 * BEST).answered
    assert not ask("lifted", "refute-0.9", 1.1 * BEST).answered


@pytest.mark.peers
@pytest.mark.parametrize("name", ["gurobi", "scip"])
def test_solvers_agree_where_they_are_installed(name: str) -> None:
    if method(name).missing():
        pytest.skip(f"{name} is not installed")
    found = ask(name, MINIMISE)
    assert found.answered
    assert found.figures["lo"] == pytest.approx(BEST, rel=1e-5)
    assert ask(name, "refute-0.9", 0.9 * BEST).answered
    assert not ask(name, "refute-0.9", 1.1 * BEST, 5.0).answered


def test_each_problem_has_its_entry_from_the_literature() -> None:
    assert sorted(path.stem for path in PROBLEMS.glob("*.bch")) == sorted(literature())
    assert len(literature()) >= 40


@pytest.mark.parametrize("name", ["himmelblau_gradient", "kin1", "no_real_solution", "hs071", "branin", "ex7_2_1"])
def test_a_problem_agrees_with_the_literature(name: str) -> None:
    row = run(name, 600.0)
    assert row.complete, row
    assert row.name in page([row], 600.0)
    assert "Misses: none" in page([row], 600.0)
