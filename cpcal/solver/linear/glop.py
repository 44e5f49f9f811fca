"""The default linear engine: ortools' GLOP, one model whose objective changes."""

from __future__ import annotations

import numpy as np
from ortools.linear_solver import pywraplp

from cpcal.common.arrays import Floats
from cpcal.solver.linear.engine import LinearSolution, LinearStatus

# Columns arrive centred and scaled, so the solver's own scaling and presolve only cost time and hot starts.
# The primal simplex cycles now and then on degenerate programs: after the iterations that it never needs
# otherwise the dual simplex takes over, from scratch.
_FAST = "use_preprocessing:false use_scaling:false use_dual_simplex:false max_number_of_iterations:1000"
_CAREFUL = "use_preprocessing:false use_scaling:true use_dual_simplex:true max_number_of_iterations:20000"


class Glop:
    """`LinearEngine` on GLOP. The primal simplex starts from the last basis when only the objective changed.

    An elastic column t, fixed at zero, sits in every row; when the program has no solution it is freed and
    `min t` is solved, whose multipliers are a Farkas ray.
    """

    def load(self, matrix: Floats, rhs: Floats, lower: Floats, upper: Floats) -> None:
        solver = pywraplp.Solver.CreateSolver("GLOP")
        if solver is None:  # pragma: no cover - every ortools wheel holds GLOP
            raise RuntimeError("this build of ortools has no GLOP")
        self._solver = solver
        self._columns = [solver.NumVar(float(lo), float(hi), "") for lo, hi in zip(lower, upper, strict=True)]
        self._elastic = solver.NumVar(0.0, 0.0, "elastic")
        self._rows: list[pywraplp.Constraint] = []
        self._objective = solver.Objective()
        self._objective.SetMinimization()
        self.add_rows(matrix, rhs)

    def add_rows(self, matrix: Floats, rhs: Floats) -> None:
        infinity = self._solver.infinity()
        for coefficients, bound in zip(matrix, rhs, strict=True):
            row = self._solver.Constraint(-infinity, float(bound))
            for j in np.flatnonzero(coefficients):
                row.SetCoefficient(self._columns[j], float(coefficients[j]))
            row.SetCoefficient(self._elastic, -1.0)
            self._rows.append(row)

    def minimize(self, objective: Floats) -> LinearSolution:
        self._objective.Clear()
        self._objective.SetMinimization()
        for j in np.flatnonzero(objective):
            self._objective.SetCoefficient(self._columns[j], float(objective[j]))
        if self._solve(_FAST) or self._solve(_CAREFUL):
            return self._solution(LinearStatus.OPTIMAL)
        return self._elastic_program()

    def _solve(self, parameters: str) -> bool:
        """Whether the program was solved to the end, by these parameters."""
        start = pywraplp.MPSolverParameters()
        if parameters == _CAREFUL:
            start.SetIntegerParam(start.INCREMENTALITY, start.INCREMENTALITY_OFF)
        self._solver.SetSolverSpecificParametersAsString(parameters)
        return bool(self._solver.Solve(start) == pywraplp.Solver.OPTIMAL)

    def _elastic_program(self) -> LinearSolution:
        """`min t : rows z <= rhs + t`: always solvable; t > 0 when the rows have no common point."""
        self._objective.Clear()
        self._objective.SetMinimization()
        self._objective.SetCoefficient(self._elastic, 1.0)
        self._elastic.SetBounds(0.0, self._solver.infinity())
        if self._solve(_FAST) or self._solve(_CAREFUL):
            found = self._solution(LinearStatus.INFEASIBLE)
        else:
            found = LinearSolution(LinearStatus.FAILED, np.zeros(len(self._columns)), np.zeros(len(self._rows)))
        self._elastic.SetBounds(0.0, 0.0)
        return found

    def _solution(self, status: LinearStatus) -> LinearSolution:
        point = np.array([column.solution_value() for column in self._columns])
        duals = np.array([row.dual_value() for row in self._rows])
        return LinearSolution(status, point, np.maximum(-duals, 0.0))
