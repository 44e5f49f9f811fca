"""Pyomo's door: `from cpcal.problems import pyomo_solver` registers the solver "cpcal" in `pyomo.contrib.solver`.

    solver = SolverFactory("cpcal")            # of pyomo.contrib.solver.common.factory
    results = solver.solve(model, time_limit=60, rel_gap=1e-6, certificate="model.cert.jsonl")

A model goes through Pyomo's own NL writer (presolve and scaling off) and through `read_nl`, so that the variable x[k]
is the writer's k-th. `results.objective_bound` and `incumbent_objective` are proved, and so is `provenInfeasible`;
without an objective all solutions are found, each a member of `results.solution_loader`'s pool.
"""

import datetime
import io
import math
import os
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pyomo.common.config import ConfigValue, NonNegativeInt
from pyomo.common.errors import InfeasibleConstraintException
from pyomo.contrib.solver.common.base import Availability, SolverBase
from pyomo.contrib.solver.common.config import BranchAndBoundConfig
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import Results, SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.solution_loader import NoSolutionSolutionLoader, SolutionLoader
from pyomo.contrib.solver.common.util import NoOptimalSolutionError, NoSolutionError
from pyomo.core.base.objective import Objective
from pyomo.core.staleflag import StaleFlagManager
from pyomo.repn.plugins.nl_writer import NLWriter

from cpcal.common.version import __version__
from cpcal.problems.nl import read_nl
from cpcal.problems.problem import answer
from cpcal.solver.contract import Limits, Verdict

__all__ = ["CpcalConfig", "PooledSolutions", "PyomoCpcal", "SolverFactory"]

_ABSOLUTE_GAP = Limits().gap_absolute
_OPTIONS = (
    ("certificate", os.fspath, "File for the proof of a minimisation, which `cpcal verify` checks."),
    ("width", float, "Of boxes that are not divided further."),
    ("node_limit", NonNegativeInt, "Boxes at most."),
)


class CpcalConfig(BranchAndBoundConfig):  # type: ignore[misc]  # Pyomo has no types
    """Pyomo's options for branch and bound, and the solver's own."""

    def __init__(self, *args: Any, **kwds: Any) -> None:
        super().__init__(*args, **kwds)
        for name, domain, text in _OPTIONS:
            self.declare(name, ConfigValue(domain=domain, default=None, description=text))


class PooledSolutions(SolutionLoader):  # type: ignore[misc]
    """Values of the model's variables in each solution, the best first."""

    def __init__(self, model: Any, variables: Sequence[Any], points: Sequence[Sequence[float]]) -> None:
        super().__init__()
        self._pyomo_model, self._variables, self._points, self._chosen = model, variables, points, 0

    def get_number_of_solutions(self) -> int:
        return len(self._points)

    def get_solution_ids(self) -> list[Any]:
        return list(range(len(self._points)))

    def _set_solution_id(self, solution_id: Any) -> Any:
        before, self._chosen = self._chosen, 0 if solution_id is None else int(solution_id)
        return before

    def get_vars(self, vars_to_load: Sequence[Any] | None = None) -> Any:
        from pyomo.common.collections import ComponentMap

        wanted = None if vars_to_load is None else {id(v) for v in vars_to_load}
        pairs = zip(self._variables, self._points[self._chosen], strict=True)
        return ComponentMap((v, value) for v, value in pairs if wanted is None or id(v) in wanted)

    load_solution = SolutionLoader.load_vars  # there are no multipliers for a model's suffixes


@SolverFactory.register("cpcal", doc="Global optima and all solutions, proved by interval arithmetic")
class PyomoCpcal(SolverBase):  # type: ignore[misc]
    """A solver in the sense of `pyomo.contrib.solver`."""

    CONFIG = CpcalConfig()
    name = "cpcal"

    def available(self) -> Availability:
        return Availability.FullLicense

    def version(self) -> tuple[int, ...]:
        return tuple(int(part) for part in __version__.split(".")[:3] if part.isdigit())

    def solve(self, model: Any, **kwds: Any) -> Results:
        """Solve a model, and load what was found into it unless `load_solutions=False`."""
        began, config = time.monotonic(), self.config(value=kwds, preserve_implicit=True)
        StaleFlagManager.mark_all_as_stale()
        results = Results()
        results.timing_info.start_timestamp = datetime.datetime.now(datetime.UTC)
        results.solver_name, results.solver_version, results.solver_config = self.name, self.version(), config
        results.solution_loader = NoSolutionSolutionLoader(model, "no solution was found")
        self._fill(results, model, config)
        results.timing_info.wall_time = time.monotonic() - began
        said = str(getattr(results.extra_info, "sentence", "no solution was found"))
        if config.raise_exception_on_nonoptimal_result and results.solution_status is not SolutionStatus.optimal:
            raise NoOptimalSolutionError(said)
        if config.load_solutions:
            if results.solution_status is SolutionStatus.noSolution:
                raise NoSolutionError(said)
            results.solution_loader.load_solution()
        return results

    def _fill(self, results: Results, model: Any, config: CpcalConfig) -> None:
        text, goals = io.StringIO(), model.component_data_objects(Objective, active=True)
        system = next(iter(goals), None) is None  # though the format has objectives always
        if system:
            model._cpcal_objective = Objective(expr=0.0)
        try:
            info = NLWriter().write(model, text, linear_presolve=False, scale_model=False)
        except InfeasibleConstraintException as reason:  # of constants alone
            results.termination_condition = TerminationCondition.provenInfeasible
            results.extra_info.sentence = str(reason)
            return
        finally:
            if system:
                model.del_component("_cpcal_objective")
        if not info.variables:
            results.termination_condition = TerminationCondition.emptyModel
            return
        problem = read_nl(text.getvalue(), model.name)
        if system:
            problem = replace(problem, objective=None)
        limits = Limits(
            seconds=config.time_limit,
            nodes=config.node_limit,
            gap=Limits().gap if config.rel_gap is None else config.rel_gap,
            gap_absolute=_ABSOLUTE_GAP if config.abs_gap is None else config.abs_gap,
        )
        found = answer(problem, width=config.width, limits=limits, certificate=config.certificate)
        results.extra_info.sentence, results.extra_info.nodes = found.status, found.nodes
        results.extra_info.certificate, results.extra_info.verdict = config.certificate, found.verdict.value
        if found.verdict is Verdict.REFUTED:
            results.termination_condition = TerminationCondition.provenInfeasible
            return
        proved = found.verdict is not Verdict.UNKNOWN
        reasons = (
            (proved, TerminationCondition.convergenceCriteriaSatisfied),
            (config.time_limit is not None, TerminationCondition.maxTimeLimit),
            (config.node_limit is not None, TerminationCondition.iterationLimit),
            (True, TerminationCondition.unknown),
        )
        results.termination_condition = next(reason for holds, reason in reasons if holds)
        if found.objective is not None:
            lo, hi = found.objective
            results.objective_bound = hi if found.problem.maximize else lo
            attained = lo if found.problem.maximize else hi
            results.incumbent_objective = attained if math.isfinite(attained) else None
        if found.points:
            results.solution_loader = PooledSolutions(model, info.variables, found.points)
            results.solution_status = SolutionStatus.unknown
            if found.paving is None or any(s.verdict is Verdict.PROVED for s in found.paving.solutions):
                results.solution_status = SolutionStatus.optimal if proved else SolutionStatus.feasible
