"""ortools' GLOP as a linear engine: to compare with, and for programs that the dense simplex method fails at."""

from __future__ import annotations

import numpy as np
from ortools.linear_solver import pywraplp

from cpcal.common.arrays import Floats, Indices
from cpcal.solver.linear.engine import LinearSolution, LinearStatus

# Columns arrive centred and scaled, so the solver's own scaling and presolve only cost time and hot starts.
# The primal simplex cycles now and then on degenerate programs: after the iterations that it never needs
# otherwise the dual simplex takes over, from scratch.
_FAST = "use_preprocessing:false use_scaling:false use_dual_simplex:false max_number_of_iterations:1000"
_CAREFUL = "use_preprocessing:false use_scaling:true use_dual_simplex:true max_number_of_iterations:20000"

_FIRST_ROWS = 3  # rows at the start, per column
_MORE_ROWS = 24  # violated rows added at a time
_ROUNDS = 12  # times that rows are added for one objective
_VIOLATION = 1e-9  # of a row scaled to a largest coefficient of about 1


class Glop:
    """`LinearEngine` on GLOP. The primal simplex starts from the last basis when only the objective changed.

    Rows enter when a vertex violates them; bounds from a part of them are valid, only weaker. An elastic column t,
    fixed at zero, sits in every row; when the program has no solution it is freed and `min t` is solved, whose
    multipliers are a Farkas ray.
    """

    def load(self, matrix: Floats, rhs: Floats, lower: Floats, upper: Floats, always: int = 0) -> None:
        solver = pywraplp.Solver.CreateSolver("GLOP")
        if solver is None:  # pragma: no cover - every ortools wheel holds GLOP
            raise RuntimeError("this build of ortools has no GLOP")
        self._solver = solver
        self._columns = [solver.NumVar(float(lo), float(hi), "") for lo, hi in zip(lower, upper, strict=True)]
        self._elastic = solver.NumVar(0.0, 0.0, "elastic")
        self._objective = solver.Objective()
        self._objective.SetMinimization()
        self._matrix, self._rhs = matrix, rhs
        self._entered = np.zeros(0, np.intp)
        self._constraints: list[pywraplp.Constraint] = []
        self._enter(self._first(lower, upper, always))

    def _first(self, lower: Floats, upper: Floats, always: int) -> Indices:
        """Of the rows that some point within the bounds violates, those with the least room at the origin."""
        matrix, rhs = self._matrix[always:], self._rhs[always:]
        largest = np.maximum(matrix, 0.0) @ upper + np.minimum(matrix, 0.0) @ lower
        candidates = np.flatnonzero(largest > rhs)
        likeliest = candidates[np.argsort(rhs[candidates], kind="stable")[: _FIRST_ROWS * matrix.shape[1]]]
        return np.concatenate([np.arange(always), np.sort(always + likeliest)])

    def _enter(self, rows: Indices) -> None:
        infinity = self._solver.infinity()
        for i in rows:
            row = self._solver.Constraint(-infinity, float(self._rhs[i]))
            for j in np.flatnonzero(self._matrix[i]):
                row.SetCoefficient(self._columns[j], float(self._matrix[i, j]))
            row.SetCoefficient(self._elastic, -1.0)
            self._constraints.append(row)
        self._entered = np.concatenate([self._entered, rows])

    def _enter_violated(self, point: Floats) -> bool:
        excess = self._matrix @ point - self._rhs
        excess[self._entered] = 0.0
        violated = np.flatnonzero(excess > _VIOLATION)
        self._enter(np.sort(violated[np.argsort(-excess[violated], kind="stable")[:_MORE_ROWS]]))
        return bool(violated.size)

    def minimize(self, objective: Floats) -> LinearSolution:
        for _ in range(_ROUNDS):
            solution = self._minimized(objective)
            if solution.status is not LinearStatus.OPTIMAL or not self._enter_violated(solution.point):
                break
        return solution

    def _minimized(self, objective: Floats) -> LinearSolution:
        """Over the rows that have entered."""
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
            nothing = np.zeros(0, np.intp)
            found = LinearSolution(LinearStatus.FAILED, np.zeros(len(self._columns)), nothing, np.zeros(0))
        self._elastic.SetBounds(0.0, 0.0)
        return found

    def _solution(self, status: LinearStatus) -> LinearSolution:
        point = np.array([column.solution_value() for column in self._columns])
        weights = np.array([-row.dual_value() for row in self._constraints])
        carrying = np.flatnonzero(weights > 0.0)
        return LinearSolution(status, point, self._entered[carrying], weights[carrying])
