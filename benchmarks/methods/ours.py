"""cpcal with a list of contractors."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import cpcal
from benchmarks.methods.hull import hull
from benchmarks.methods.linear_time import LinearTime
from benchmarks.methods.method import TaskQuestion, Work
from benchmarks.methods.proof import checked
from benchmarks.methods.sweep import timed_sweep
from benchmarks.problems import Leg
from benchmarks.records import MethodAnswer
from benchmarks.tasks import Unsupported
from contractors import HC4
from cpcal.files import campaign_sha256
from cpcal.questions import LegResult
from cpcal.solver import plugins
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.optimize.bound import minimize, run
from cpcal.solver.optimize.minimum import Minimum


class Cpcal:
    """Contractors are named as in `cpcal plugins`; those that are not registered are not there yet."""

    guarantee = "proved"

    def __init__(self, contractors: tuple[str, ...]) -> None:
        self._contractors = contractors

    def missing(self) -> str | None:
        unknown = [name for name in self._contractors if name not in plugins.found()]
        return f"no contractor is registered as {', '.join(unknown)}" if unknown else None

    def prepare(self, question: TaskQuestion) -> Work:
        kinds = {
            "minimise": self._minimise,
            "refute": self._refute,
            "hull": self._hull,
            "certify": self._certify,
            "prove": self._prove,
            "sweep": self._sweep,
        }
        return kinds[question.task.kind](question)

    def _minimise(self, question: TaskQuestion) -> Work:
        _ready(question)
        return lambda: self._search(question, None, question.task.value)

    def _refute(self, question: TaskQuestion) -> Work:
        _ready(question)
        return lambda: self._search(question, question.tolerance, 1e-6)

    def _search(self, question: TaskQuestion, eps: float | None, gap: float) -> MethodAnswer:
        with LinearTime() as linear:
            network = question.problem.network(eps)
            contractor = plugins.build(network, self._contractors, objective="eps")
            limits = Limits(seconds=question.limit, gap=gap)
            engine, start = get_arithmetic("float64"), question.problem.start
            found = run(minimize(network, "eps", contractor, engine=engine, limits=limits, start=start), None)
        figures = {**_figures(found), **linear.figures}
        if eps is not None:
            del figures["lo"], figures["hi"]  # say nothing of eps*
        wanted = Verdict.PROVED if eps is None else Verdict.REFUTED
        return MethodAnswer(found.verdict is wanted, figures, found.verdict.value)

    def _hull(self, question: TaskQuestion) -> Work:
        leg = _leg(question)
        _ready(question)
        return lambda: hull(leg, self._contractors, question.tolerance, question.limit)

    def _certify(self, question: TaskQuestion) -> Work:
        leg = _leg(question)
        _ready(question)

        def work() -> MethodAnswer:
            with LinearTime() as linear:
                found = self._certified(leg.campaign, leg, question)
            figures = {**_leg_figures(found), **linear.figures, "support": float(len(found.support))}
            return MethodAnswer(found.verdict is Verdict.PROVED, figures, found.verdict.value)

        return work

    def _certified(
        self, campaign: cpcal.Campaign, leg: Leg, question: TaskQuestion, run: Path | None = None
    ) -> LegResult:
        return cpcal.certify(
            campaign,
            legs=[leg.leg],
            delta=leg.delta,
            gap=question.task.value,
            time_limit=question.limit,
            contractors=self._contractors,
            certificates=run,
        ).legs[0]

    def _prove(self, question: TaskQuestion) -> Work:
        leg = _leg(question)
        place = tempfile.TemporaryDirectory()
        _load_kernels_of(leg, Path(place.name) / "before")
        folder = Path(place.name) / "campaign"
        cpcal.save_campaign(leg.campaign, folder)
        campaign = cpcal.load_campaign(folder)

        def work() -> MethodAnswer:
            with place:
                run = Path(place.name) / "run"
                found = self._certified(campaign, leg, question, run)
                if found.certificate is None:
                    return MethodAnswer(False, _leg_figures(found), "no certificate")
                return MethodAnswer(True, _leg_figures(found) | checked(run / found.certificate), "checked")

        return work

    def _sweep(self, question: TaskQuestion) -> Work:
        leg = _leg(question)
        if self._contractors != ("hc4",):
            raise Unsupported("only hc4 contracts batches of boxes")
        hc4 = HC4(leg.network(question.tolerance))
        return timed_sweep(leg, question, hc4.contract_batch)


def _leg(question: TaskQuestion) -> Leg:
    if not isinstance(question.problem, Leg):
        raise Unsupported("the task is about legs")
    return question.problem


def _ready(question: TaskQuestion) -> None:
    """Data and fit belong to the problem, compiled code to the libraries: have them before the clock starts."""
    _load_kernels()
    problem = question.problem
    _ = problem.measurements, problem.start
    if isinstance(problem, Leg):
        _load_kernels_of(problem)
        _ = campaign_sha256(problem.campaign)  # belongs to reading the files


def _load_kernels() -> None:
    """A small problem of the same operations: machine code is loaded, or made, when it is first called."""
    net = cpcal.Network()
    x = net.variable("x", 2, ((-2.0, -2.0), (2.0, 2.0)))
    eps = net.variable("eps", (), (0.0, 9.0))
    net.add((cpcal.norm(np.array([[3.0, 0.0], [0.0, 3.0], [-3.0, 0.0]]) - x) - 2.5).within((-eps, eps)))
    net.minimize(eps)


def _load_kernels_of(leg: Leg, run: Path | None = None) -> None:
    """Another leg of such readings, in a small box, with a certificate for those who write one."""
    other = cpcal.simulate(seed=2, joint_error=1.0, factor=3.0 if leg.uncertain else 0.0)
    cpcal.certify(other, legs=[1], delta=1.0, certificates=run)


def _figures(found: Minimum) -> dict[str, float]:
    return {"lo": found.lo, "hi": found.hi, "nodes": found.nodes, "programs": found.programs}


def _leg_figures(found: LegResult) -> dict[str, float]:
    return {"lo": found.eps_lo, "hi": found.eps_hi, "nodes": found.nodes, "programs": found.programs}
