"""Gurobi through gurobipy, whose size-limited licence is part of the package."""

from __future__ import annotations

from typing import Any

from benchmarks.methods import expanded
from benchmarks.methods.expanded import AB, BB, COLUMNS, OFFSET, A, B, ExpandedRows, Q, Solved
from benchmarks.methods.method import TaskQuestion, Work, not_installed


class Gurobi:
    """Spatial branch and bound (NonConvex), one thread, else default settings."""

    guarantee = "floating point, rounded data"

    def missing(self) -> str | None:
        return not_installed("gurobipy")

    def prepare(self, question: TaskQuestion) -> Work:
        import gurobipy

        environment = gurobipy.Env(params={"OutputFlag": 0})
        return expanded.work(question, lambda data, eps: _Model(environment, data, eps))


class _Model:
    def __init__(self, environment: Any, data: ExpandedRows, eps: float | None) -> None:
        import gurobipy

        model = self._model = gurobipy.Model(env=environment)
        model.setParam("NonConvex", 2)
        model.setParam("Threads", 1)
        free = gurobipy.GRB.INFINITY
        columns = [model.addVar(lb=float(lo), ub=float(hi)) for lo, hi in zip(data.lo, data.hi, strict=True)]
        columns += [model.addVar(lb=-free) for _ in range(COLUMNS - len(columns))]
        offset = columns[OFFSET]
        error: Any = model.addVar(ub=data.longest) if eps is None else eps
        product: Any = model.addVar(lb=-free) if eps is None else eps * offset
        square: Any = model.addVar() if eps is None else eps * eps
        if eps is None:
            model.addConstr(product == error * offset)
            model.addConstr(square == error * error)
        model.addConstr(columns[Q] == sum(columns[i] * columns[i] for i in A) - offset * offset)
        for (i, j), column in AB.items():
            model.addConstr(columns[column] == columns[A[i]] * columns[B[j]])
        for (i, j), column in BB.items():
            model.addConstr(columns[column] == columns[B[i]] * columns[B[j]])
        for row, constant, length in zip(
            data.matrix.tolist(), data.constant.tolist(), data.length.tolist(), strict=True
        ):
            value = gurobipy.LinExpr(row, columns) + constant
            model.addConstr(value - 2.0 * length * error - 2.0 * product - square <= 0.0)
            model.addConstr(value + 2.0 * length * error + 2.0 * product - square >= 0.0)
        model.addConstr(offset + float(data.length.min()) >= error)
        self._columns, self._error = columns, error

    def solve(self, objective: tuple[int, float] | None, limit: float, gap: float, gap_absolute: float) -> Solved:
        import gurobipy

        model = self._model
        model.reset()
        model.setObjective(self._error if objective is None else objective[1] * self._columns[objective[0]])
        model.setParam("TimeLimit", limit)
        model.setParam("MIPGap", gap)
        model.setParam("MIPGapAbs", gap_absolute)
        model.optimize()
        codes = {
            getattr(gurobipy.GRB, name): name.lower() for name in ("OPTIMAL", "INFEASIBLE", "INF_OR_UNBD", "TIME_LIMIT")
        }
        status = codes.get(model.Status, f"status {model.Status}")
        infeasible = status in ("infeasible", "inf_or_unbd")  # every column that matters is bounded
        return Solved(
            float("nan") if infeasible else float(model.ObjBound),
            float(model.ObjVal) if model.SolCount else float("inf"),
            float(model.NodeCount),
            status == "optimal",
            infeasible,
            status,
        )
