"""SCIP through pyscipopt."""

from __future__ import annotations

from typing import Any

from benchmarks.methods import expanded
from benchmarks.methods.expanded import AB, BB, COLUMNS, OFFSET, A, B, ExpandedRows, Q, Solved
from benchmarks.methods.method import TaskQuestion, Work, not_installed


class Scip:
    """Spatial branch and bound; default settings, one thread."""

    guarantee = "floating point, rounded data"

    def missing(self) -> str | None:
        return not_installed("pyscipopt")

    def prepare(self, question: TaskQuestion) -> Work:
        import pyscipopt  # noqa: F401  so that loading it takes none of the time

        return expanded.work(question, _Model)


class _Model:
    def __init__(self, data: ExpandedRows, eps: float | None) -> None:
        from pyscipopt import Model, quicksum

        model = self._model = Model()
        model.hideOutput()
        columns: list[Any] = [model.addVar(lb=float(lo), ub=float(hi)) for lo, hi in zip(data.lo, data.hi, strict=True)]
        columns += [model.addVar(lb=None, ub=None) for _ in range(COLUMNS - len(columns))]
        offset = columns[OFFSET]
        error: Any = model.addVar(lb=0.0, ub=data.longest) if eps is None else eps
        product: Any = model.addVar(lb=None, ub=None) if eps is None else eps * offset
        square: Any = model.addVar(lb=0.0, ub=None) if eps is None else eps * eps
        if eps is None:
            model.addCons(product == error * offset)
            model.addCons(square == error * error)
        model.addCons(columns[Q] == sum(columns[i] * columns[i] for i in A) - offset * offset)
        for (i, j), column in AB.items():
            model.addCons(columns[column] == columns[A[i]] * columns[B[j]])
        for (i, j), column in BB.items():
            model.addCons(columns[column] == columns[B[i]] * columns[B[j]])
        for row, constant, length in zip(
            data.matrix.tolist(), data.constant.tolist(), data.length.tolist(), strict=True
        ):
            value = quicksum(c * x for c, x in zip(row, columns, strict=True)) + constant
            model.addCons(value - 2.0 * length * error - 2.0 * product - square <= 0.0)
            model.addCons(value + 2.0 * length * error + 2.0 * product - square >= 0.0)
        model.addCons(offset + float(data.length.min()) >= error)
        self._columns, self._error = columns, error

    def solve(self, objective: tuple[int, float] | None, limit: float, gap: float, gap_absolute: float) -> Solved:
        model = self._model
        model.freeTransform()
        model.setObjective(self._error if objective is None else objective[1] * self._columns[objective[0]])
        model.setParam("limits/time", limit)
        model.setParam("limits/gap", gap)
        model.setParam("limits/absgap", gap_absolute)
        model.optimize()
        status = str(model.getStatus())
        hi = float(model.getPrimalbound())
        return Solved(
            float(model.getDualbound()),
            hi if hi < 1e19 else float("inf"),
            float(model.getNTotalNodes()),
            status in ("optimal", "gaplimit"),
            status == "infeasible",
            status,
        )
