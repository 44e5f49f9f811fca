"""Peers: Gurobi and SCIP (spatial branch and bound), least squares.

Gurobi and SCIP get the best formulation found for them: squared, expanded, products shared. With q = a.a - l*l and one
column for each product a_i b_j and b_i b_j, every measurement is linear,

    E = q + b'R'R b - 2 a'R b + 2 P'R b - 2 P.a - 2 L l + P.P - L^2
    E - 2 L eps - 2 l eps - eps^2 <= 0 <= E + 2 L eps + 2 l eps - eps^2,          L + l >= eps.

The coefficients are rounded to doubles, so that no answer is certified for the exact data.
"""

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.methods import TaskQuestion, Work
from benchmarks.problems import Leg
from benchmarks.runs import MethodAnswer, Unsupported
from cpcal.common.values import Floats
from cpcal.models import fit_model, model_residuals
from cpcal.robot import rotation_matrix

A, B, OFFSET, Q = range(3), range(3, 6), 6, 7  # columns: a, b, l, q, then the products
AB = {(i, j): 8 + 3 * i + j for i in range(3) for j in range(3)}
BB = {pair: 17 + n for n, pair in enumerate((i, j) for i in range(3) for j in range(i, 3))}
COLUMNS = 23


@dataclass(frozen=True)
class ExpandedRows:
    """`matrix @ columns + constant` is E; parameters lie between `lo` and `hi`, eps below `longest`."""

    matrix: Floats
    constant: Floats
    length: Floats
    lo: Floats
    hi: Floats
    longest: float


def rows(leg: Leg) -> ExpandedRows:
    """The coefficients of one leg, in doubles."""
    campaign = leg.campaign
    p, r = campaign.position, rotation_matrix(campaign.quaternion)
    length = campaign.length[:, leg.leg - 1]
    gram = np.einsum("kji,kjl->kil", r, r)
    matrix = np.zeros((len(p), COLUMNS))
    matrix[:, A] = -2.0 * p
    matrix[:, B] = 2.0 * np.einsum("ki,kij->kj", p, r)
    matrix[:, OFFSET] = -2.0 * length
    matrix[:, Q] = 1.0
    for (i, j), column in AB.items():
        matrix[:, column] = -2.0 * r[:, i, j]
    for (i, j), column in BB.items():
        matrix[:, column] = gram[:, i, j] * (1.0 if i == j else 2.0)
    return ExpandedRows(matrix, (p * p).sum(axis=1) - length**2, length, leg.box.lo, leg.box.hi, leg.longest)


def _stated(data: ExpandedRows, eps: float | None, variable: Any, require: Any, summed: Any) -> Any:
    """State the program by a solver's `variable(lo, hi)`, `require(constraint)` and `summed(row, columns)`. Gives the
    objective: eps, or 0 where it is given."""
    columns = [variable(float(lo), float(hi)) for lo, hi in zip(data.lo, data.hi, strict=True)]
    columns += [variable(None, None) for _ in range(COLUMNS - len(columns))]
    offset = columns[OFFSET]
    error: Any = variable(0.0, data.longest) if eps is None else eps
    product: Any = variable(None, None) if eps is None else eps * offset
    square: Any = variable(0.0, None) if eps is None else eps * eps
    if eps is None:
        require(product == error * offset)
        require(square == error * error)
    require(columns[Q] == sum(columns[i] * columns[i] for i in A) - offset * offset)
    for (i, j), column in AB.items():
        require(columns[column] == columns[A[i]] * columns[B[j]])
    for (i, j), column in BB.items():
        require(columns[column] == columns[B[i]] * columns[B[j]])
    for row, constant, length in zip(data.matrix.tolist(), data.constant.tolist(), data.length.tolist(), strict=True):
        value = summed(row, columns) + constant
        require(value - 2.0 * length * error - 2.0 * product - square <= 0.0)
        require(value + 2.0 * length * error + 2.0 * product - square >= 0.0)
    require(offset + float(data.length.min()) >= error)
    return error if eps is None else 0.0 * offset


class _Peer:
    """Of a package of its own; asked to minimise eps or to refute a given one."""

    guarantee, package = "floating point, rounded data", ""

    def missing(self) -> str | None:
        return None if find_spec(self.package) else f"the package {self.package} is not installed (extra `peers`)"

    def prepare(self, question: TaskQuestion) -> Work:
        if question.task.kind not in ("minimise", "refute"):
            raise Unsupported(f"has no task {question.task.kind}")
        import_module(self.package)
        return self.work(question.leg, question)

    def work(self, leg: Leg, question: TaskQuestion) -> Work:
        raise NotImplementedError


class Gurobi(_Peer):
    """NonConvex, one thread, else default settings; its size-limited licence is part of the package."""

    package = "gurobipy"

    def work(self, leg: Leg, question: TaskQuestion) -> Work:
        import gurobipy

        environment, data = gurobipy.Env(params={"OutputFlag": 0}), rows(leg)

        def work() -> MethodAnswer:
            model, minimise = gurobipy.Model(env=environment), question.eps is None
            settings = {"NonConvex": 2, "Threads": 1, "TimeLimit": question.limit, "MIPGapAbs": 0.0}
            for name, value in (settings | {"MIPGap": question.task.value if minimise else 0.0}).items():
                model.setParam(name, value)

            def variable(lo: float | None, hi: float | None) -> Any:
                return model.addVar(lb=-np.inf if lo is None else lo, ub=np.inf if hi is None else hi)

            model.setObjective(_stated(data, question.eps, variable, model.addConstr, gurobipy.LinExpr))
            model.optimize()
            names = ("OPTIMAL", "INFEASIBLE", "INF_OR_UNBD", "TIME_LIMIT")
            codes = {getattr(gurobipy.GRB, name): name.lower() for name in names}
            status = codes.get(model.Status, f"status {model.Status}")
            infeasible = status in ("infeasible", "inf_or_unbd")  # every column that matters is bounded
            if not minimise or infeasible:
                return MethodAnswer(infeasible and not minimise, {"nodes": model.NodeCount}, status)
            hi = float(model.ObjVal) if model.SolCount else float("inf")
            figures = {"lo": float(model.ObjBound), "hi": hi, "nodes": float(model.NodeCount)}
            return MethodAnswer(status == "optimal", figures, status)

        return work


class Scip(_Peer):
    """Default settings, one thread."""

    package = "pyscipopt"

    def work(self, leg: Leg, question: TaskQuestion) -> Work:
        from pyscipopt import Model, quicksum

        data = rows(leg)

        def work() -> MethodAnswer:
            model, minimise = Model(), question.eps is None
            model.hideOutput()
            gap = question.task.value if minimise else 0.0
            for name, value in (("time", question.limit), ("gap", gap), ("absgap", 0.0)):
                model.setParam(f"limits/{name}", value)

            def variable(lo: float | None, hi: float | None) -> Any:
                return model.addVar(lb=lo, ub=hi)

            def summed(row: list[float], columns: list[Any]) -> Any:
                return quicksum(c * x for c, x in zip(row, columns, strict=True))

            model.setObjective(_stated(data, question.eps, variable, model.addCons, summed))
            model.optimize()
            status, nodes, hi = str(model.getStatus()), float(model.getNTotalNodes()), float(model.getPrimalbound())
            if not minimise:
                return MethodAnswer(status == "infeasible", {"nodes": nodes}, status)
            figures = {"lo": float(model.getDualbound()), "hi": hi if hi < 1e19 else float("inf"), "nodes": nodes}
            return MethodAnswer(status in ("optimal", "gaplimit"), figures, status)

        return work


class LeastSquares:
    """cpcal's own fit, from the nominal parameters."""

    guarantee = "a point only"

    def missing(self) -> str | None:
        return None

    def prepare(self, question: TaskQuestion) -> Work:
        if question.task.kind != "minimise":
            raise Unsupported("bounds nothing")
        leg = question.leg

        def work() -> MethodAnswer:
            residuals = model_residuals(leg.campaign, leg.leg, fit_model(leg.campaign, leg.leg))
            return MethodAnswer(False, {"hi": float(np.abs(residuals).max())}, "no lower bound")

        return work
