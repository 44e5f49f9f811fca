"""cpcal with a list of contractors, named as in `cpcal plugins`."""

import tempfile
import time
from pathlib import Path

import numpy as np

import cpcal
from benchmarks.methods import TaskQuestion, Work
from benchmarks.problems import Leg
from benchmarks.runs import MethodAnswer, Unsupported
from cpcal.checker import check
from cpcal.files import campaign_sha256
from cpcal.questions import LegResult
from cpcal.solver import plugins
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.optimize.bound import minimize, run


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
        figures = {
            "lo": found.bracket.lo,
            "hi": found.bracket.hi,
            "nodes": found.work.nodes,
            "programs": found.work.programs,
        }
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
