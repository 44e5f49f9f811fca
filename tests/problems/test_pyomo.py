"""Pyomo's models: proved optima, bounds, infeasibility, all solutions, a certificate. Skipped without pyomo."""

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cpcal.solver.contract import Verdict

pyo: Any = pytest.importorskip("pyomo.environ")
results_: Any = pytest.importorskip("pyomo.contrib.solver.common.results")

from cpcal.checker.certificate import check  # noqa: E402
from cpcal.cli.app import app  # noqa: E402
from cpcal.problems import pyomo_solver  # noqa: E402

errors_: Any = pytest.importorskip("pyomo.common.errors")


def solver(**options: Any) -> Any:
    return pyomo_solver.SolverFactory("cpcal", **options)


def hs071() -> Any:
    m = pyo.ConcreteModel("hs071")
    m.x = pyo.Var(range(4), bounds=(1, 5), initialize=1.0)
    m.goal = pyo.Objective(expr=m.x[0] * m.x[3] * (m.x[0] + m.x[1] + m.x[2]) + m.x[2])
    m.product = pyo.Constraint(expr=m.x[0] * m.x[1] * m.x[2] * m.x[3] >= 25)
    m.squares = pyo.Constraint(expr=sum(m.x[k] ** 2 for k in range(4)) == 40)
    return m


def test_hs071_has_its_optimum_between_two_proved_bounds() -> None:
    model = hs071()
    results = solver().solve(model)
    assert results.solution_status is results_.SolutionStatus.optimal
    assert results.objective_bound <= 17.0140173 <= results.incumbent_objective + 1e-7
    assert results.incumbent_objective - results.objective_bound <= 1e-6 * 18
    assert [pyo.value(model.x[k]) for k in range(4)] == pytest.approx([1.0, 4.743, 3.82115, 1.379408], abs=1e-3)


def test_a_maximum_has_its_bound_above() -> None:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, 3)), pyo.Var(bounds=(0, 3))
    m.goal = pyo.Objective(expr=m.x * m.y - m.x**2, sense=pyo.maximize)
    m.row = pyo.Constraint(expr=m.x + m.y <= 4)
    results = solver().solve(m)
    assert results.incumbent_objective <= 2.0 + 1e-9 <= results.objective_bound + 1e-8
    assert pyo.value(m.x) == pytest.approx(1.0, abs=1e-3)


def test_a_model_without_an_objective_has_all_its_solutions() -> None:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(-3, 3)), pyo.Var(bounds=(-3, 3))
    m.circle = pyo.Constraint(expr=m.x**2 + m.y**2 == 4)
    m.line = pyo.Constraint(expr=m.x == m.y)
    results = solver().solve(m)
    assert results.solution_loader.get_number_of_solutions() == 2
    found = []
    for k in results.solution_loader.get_solution_ids():
        with results.solution_loader.solution(k) as one:
            one.load_vars()
            found.append(pyo.value(m.x))
    assert sorted(found) == pytest.approx([-(2**0.5), 2**0.5], abs=1e-6)


def test_limits_and_the_certificate_reach_the_solver(tmp_path: Path) -> None:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(-2, 2)), pyo.Var(bounds=(-2, 2))
    m.goal = pyo.Objective(expr=m.x * m.y)
    m.row = pyo.Constraint(expr=m.x + m.y >= 1)
    file = tmp_path / "model.cert.jsonl"
    results = solver(certificate=str(file)).solve(m)
    assert results.extra_info.certificate == str(file)
    check(file)  # raises what it refuses
    stopped = solver().solve(hs071(), time_limit=0.0, raise_exception_on_nonoptimal_result=False, load_solutions=False)
    assert stopped.termination_condition is results_.TerminationCondition.maxTimeLimit
    assert Verdict.UNKNOWN.value not in stopped.extra_info.sentence


def test_an_exponent_that_is_an_interval_of_one_number_is_that_number(tmp_path: Path) -> None:
    text = "Variables\nx in [-3, -1];\nConstraints\nx^[{}] = 4;\nend\n"
    (tmp_path / "two.bch").write_text(text.format("2, 2"))
    (tmp_path / "some.bch").write_text(text.format("1.5, 2.5"))
    runs = [
        CliRunner().invoke(app, ["solve", str(tmp_path / f"{name}.bch"), "-o", str(tmp_path / "out.json")])
        for name in ("two", "some")
    ]
    assert "1 box holds exactly one solution" in runs[0].output
    assert runs[1].exit_code == 2
    assert "may be a whole power of a negative number" in " ".join(runs[1].output.split())


def test_an_infeasible_model_is_proved_infeasible() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(-3, 3))
    m.goal = pyo.Objective(expr=m.x)
    m.row = pyo.Constraint(expr=m.x**2 <= -1)
    found = solver().solve(m, raise_exception_on_nonoptimal_result=False, load_solutions=False)
    assert found.termination_condition is results_.TerminationCondition.provenInfeasible
    assert found.incumbent_objective is None
    for asked in ({}, {"raise_exception_on_nonoptimal_result": False}):  # there is nothing to load
        with pytest.raises(errors_.PyomoException, match="satisfies the constraints: proved"):
            solver().solve(m, **asked)
