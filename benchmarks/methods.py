"""Everything that can be asked: cpcal by its contractors' names, and peers, each behind a small adapter.

Gurobi and SCIP (spatial branch and bound) get the best formulation found for them: squared, expanded, products shared.
With q = a.a - l*l and one column for each product a_i b_j and b_i b_j, every measurement is linear,

    E = q + b'R'R b - 2 a'R b + 2 P'R b - 2 P.a - 2 L l + P.P - L^2
    E - 2 L eps - 2 l eps - eps^2 <= 0 <= E + 2 L eps + 2 l eps - eps^2,          L + l >= eps.

The coefficients are rounded to doubles, so that no answer is certified for the exact data.
"""

import gc
import heapq
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol, TextIO

import numpy as np

import cpcal
from benchmarks import runs
from benchmarks.problems import Leg, PosedProblem, problem
from benchmarks.runs import Job, MethodAnswer, Run, Task, Unsupported
from cpcal.checker import check
from cpcal.common.values import Floats
from cpcal.files import campaign_sha256
from cpcal.models import fit_model, model_residuals
from cpcal.questions import LegResult
from cpcal.robot import rotation_matrix
from cpcal.solver import plugins
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.optimize.bound import minimize, run

Work = Callable[[], MethodAnswer]


@dataclass(frozen=True)
class TaskQuestion:
    """`eps` (mm) is the tolerance that a task is about, where it is about one; `limit` is in seconds."""

    problem: PosedProblem
    task: Task
    eps: float | None
    limit: float

    @property
    def leg(self) -> Leg:
        """The problem as a leg with exact readings. Raises Unsupported."""
        if not isinstance(self.problem, Leg) or self.problem.uncertain:
            raise Unsupported("is written for legs with exact readings only")
        return self.problem


class Method(Protocol):
    """`guarantee` says in a few words what its answers are worth."""

    guarantee: str

    def missing(self) -> str | None:
        """Why it cannot run here, or None."""
        ...

    def prepare(self, question: TaskQuestion) -> Work:
        """Read what the problem says; the task itself is the returned function, which is timed. Raises Unsupported."""
        ...


class Cpcal:
    """Answers are proved."""

    guarantee = "proved"

    def __init__(self, contractors: tuple[str, ...]) -> None:
        self._contractors = contractors

    def missing(self) -> str | None:
        unknown = [name for name in self._contractors if name not in plugins.found()]
        return f"no contractor is registered as {', '.join(unknown)}" if unknown else None

    def prepare(self, question: TaskQuestion) -> Work:
        _ready(question)
        if question.task.kind in ("minimise", "refute"):
            return lambda: self._search(question)
        if not isinstance(question.problem, Leg):
            raise Unsupported("the task is about legs")
        leg = question.problem
        if question.task.kind == "certify":
            return lambda: self._certified(leg, leg.campaign, question, None)
        place = tempfile.TemporaryDirectory()
        _certify_another(leg, Path(place.name) / "before")
        cpcal.save_campaign(leg.campaign, Path(place.name) / "campaign")
        campaign = cpcal.load_campaign(Path(place.name) / "campaign")

        def prove() -> MethodAnswer:
            with place:
                return self._certified(leg, campaign, question, Path(place.name) / "run")

        return prove

    def _search(self, question: TaskQuestion) -> MethodAnswer:
        eps = question.eps
        network = question.problem.network(eps)
        named = plugins.build_each(network, self._contractors, objective="eps")
        limits = Limits(seconds=question.limit, gap=question.task.value if eps is None else 1e-6)
        start = question.problem.start
        found = run(minimize(network, "eps", named, limits=limits, start=start), None)
        bounds = {"lo": found.lo, "hi": found.hi} if eps is None else {}  # else nothing is said of eps*
        wanted = Verdict.PROVED if eps is None else Verdict.REFUTED
        figures = {**bounds, "nodes": found.nodes, "programs": found.programs}
        return MethodAnswer(found.verdict is wanted, figures, found.verdict.value)

    def _certified(
        self, leg: Leg, campaign: cpcal.Campaign, question: TaskQuestion, folder: Path | None
    ) -> MethodAnswer:
        found: LegResult = cpcal.certify(
            campaign, legs=[leg.leg], delta=leg.delta, gap=question.task.value, time_limit=question.limit,
            contractors=self._contractors, certificates=folder,
        ).legs[0]  # fmt: skip
        figures = {"lo": found.bracket.lo, "hi": found.bracket.hi}
        figures |= {"nodes": found.work.nodes, "programs": found.work.programs}
        if folder is None:
            answered = found.bracket.verdict is Verdict.PROVED
            return MethodAnswer(answered, figures | {"support": float(len(found.support))}, found.bracket.verdict.value)
        if found.bracket.certificate is None:
            return MethodAnswer(False, figures, "no certificate")
        began, file = time.perf_counter(), folder / found.bracket.certificate
        steps = check(file).steps  # reads the campaign.json beside it
        seconds, size = time.perf_counter() - began, file.stat().st_size / 1000
        return MethodAnswer(True, figures | {"steps": steps, "size": size, "check": seconds}, "checked")


def _ready(question: TaskQuestion) -> None:
    """Data and fit belong to the problem, compiled code to the libraries: have them before the clock starts."""
    net = cpcal.Network()
    x = net.variable("x", 2, ((-2.0, -2.0), (2.0, 2.0)))
    eps = net.variable("eps", (), (0.0, 9.0))
    net.add((cpcal.norm(np.array([[3.0, 0.0], [0.0, 3.0], [-3.0, 0.0]]) - x) - 2.5).within((-eps, eps)))
    net.minimize(eps)
    problem = question.problem
    _ = problem.measurements, problem.start
    if isinstance(problem, Leg):
        _certify_another(problem, None)
        _ = campaign_sha256(problem.campaign)  # belongs to reading the files


def _certify_another(leg: Leg, folder: Path | None) -> None:
    """Another leg of such readings, in a small box, with a certificate for those who write one."""
    other = cpcal.simulate(seed=2, joint_error=1.0, factor=3.0 if leg.uncertain else 0.0)
    cpcal.certify(other, legs=[1], delta=1.0, certificates=folder)


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


class Codac(_Peer):
    """CtcInverse, with its centred form, of each side of each equation; the search is ours: best first by eps."""

    guarantee, package = "rigorous, rounded data", "codac"

    def work(self, leg: Leg, question: TaskQuestion) -> Work:
        import codac

        def work() -> MethodAnswer:
            campaign, eps, wanted = leg.campaign, question.eps, 1.0 - question.task.value
            x, sides, nodes, end = codac.VectorVar(8), [], 0, time.monotonic() + question.limit
            turns, lengths = rotation_matrix(campaign.quaternion).tolist(), campaign.length[:, leg.leg - 1].tolist()
            for p, r, length in zip(campaign.position.tolist(), turns, lengths, strict=True):
                v = [p[i] + r[i][0] * x[3] + r[i][1] * x[4] + r[i][2] * x[5] - x[i] for i in range(3)]
                g = codac.sqrt(codac.sqr(v[0]) + codac.sqr(v[1]) + codac.sqr(v[2])) - x[6] - length
                sides += [codac.CtcInverse(codac.AnalyticFunction([x], s * g - x[7]), [-np.inf, 0.0]) for s in (1, -1)]
            error = [0.0, leg.longest] if eps is None else [eps, eps]
            start = codac.IntervalVector([*np.stack([leg.box.lo, leg.box.hi], axis=1).tolist(), error])
            queue, hi = [(0.0, 0, start)], np.inf
            while queue and queue[0][0] < hi * wanted and time.monotonic() < end:
                box, nodes = heapq.heappop(queue)[2], nodes + 1
                box[7] &= codac.Interval(0.0, hi)
                for side in sides:
                    side.contract(box)
                if eps is None and not box.is_empty():  # the first midpoint is the least-squares fit
                    hi = min(hi, float(np.abs(model_residuals(campaign, leg.leg, np.ravel(box.mid())[:7])).max()))
                widest = int(np.argmax(np.ravel(box.diam())[:7]))
                for k, half in enumerate(() if box.is_empty() else box.bisect(widest)):
                    heapq.heappush(queue, (float(half[7].lb()), 2 * nodes + k, half))
            lo = min([hi, *(low for low, *_ in queue[:1])])  # infinite where a given eps is refuted
            figures = {"nodes": float(nodes)} | ({"lo": lo, "hi": hi} if eps is None else {})
            return MethodAnswer(lo >= hi * wanted, figures, f"own search, {len(queue)} boxes left")

        return work


class LeastSquares(_Peer):
    """cpcal's own fit, from the nominal parameters."""

    guarantee, package = "a point only", "cpcal"

    def work(self, leg: Leg, question: TaskQuestion) -> Work:
        if question.task.kind != "minimise":
            raise Unsupported("bounds nothing")

        def work() -> MethodAnswer:
            residuals = model_residuals(leg.campaign, leg.leg, fit_model(leg.campaign, leg.leg))
            return MethodAnswer(False, {"hi": float(np.abs(residuals).max())}, "no lower bound")

        return work


PEERS: dict[str, Callable[[], Method]] = {"scip": Scip, "gurobi": Gurobi, "codac": Codac, "least-squares": LeastSquares}


def method(name: str) -> Method:
    """A peer, a `module:Class` of a user, or cpcal with contractors, "hc4,lifted"."""
    if name in PEERS:
        return PEERS[name]()
    module, _, member = name.partition(":")
    if not member:
        return Cpcal(tuple(name.split(",")))
    made: Method = getattr(import_module(module), member)()
    return made


def work(job: Job, tell: TextIO) -> Run:
    """What a worker does, which `runs` starts for each task: the run in this process; its failure is a result."""
    name = (job.problem, job.task, job.method)
    try:
        asked = method(job.method)
        if (lacking := asked.missing()) is not None:
            return Run(*name, runs.SKIPPED, note=lacking)
        posed = problem(job.problem, None if job.data is None else Path(job.data))
        task = asked.prepare(TaskQuestion(posed, Task.named(job.task), job.eps, job.limit))
        print(json.dumps("ready"), file=tell, flush=True)
        gc.collect()
        began, cpu = time.perf_counter(), time.process_time()
        answer = task()
        seconds, cpu = time.perf_counter() - began, time.process_time() - cpu
    except (Unsupported, FileNotFoundError) as reason:
        return Run(*name, runs.SKIPPED, note=str(reason))
    except Exception as error:
        return Run(*name, runs.FAILED, note=f"{type(error).__name__}: {error}"[:300])
    late = seconds > job.limit or (not answer.answered and seconds > runs.NEARLY * job.limit)
    status = runs.TIMEOUT if late else runs.ANSWERED if answer.answered else runs.UNDECIDED
    return Run(*name, status, seconds, cpu, answer.figures, answer.note)


if __name__ == "__main__":
    from benchmarks import methods  # whose classes those of other modules know

    told = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    print(json.dumps(asdict(methods.work(Job(**json.loads(sys.stdin.read())), told))), file=told, flush=True)
