"""codac: one contractor for each equation, and a best-first search written here.

Rotation matrices are rounded to doubles, so that its answers are rigorous for the rounded data.
"""

from __future__ import annotations

import heapq
import itertools
import time
from typing import Any

import numpy as np

from benchmarks.methods.hull import widths
from benchmarks.methods.method import TaskQuestion, Work, not_installed
from benchmarks.methods.sweep import timed_sweep
from benchmarks.problems import Leg
from benchmarks.records import MethodAnswer
from benchmarks.tasks import Unsupported
from cpcal.legs import residuals
from cpcal.robot import rotation_matrix
from cpcal.solver.interval import IntervalArray

_PASSES = 10  # at most, while the box shrinks


class Codac:
    """CtcInverse (its centred form included) for every equation."""

    guarantee = "rigorous, rounded data"

    def missing(self) -> str | None:
        return not_installed("codac")

    def contractors(self, leg: Leg, eps: float | None) -> list[Any]:
        """On boxes of 7 components, or of 8 with eps as the last one."""
        import codac

        if eps is not None:
            return [codac.CtcInverse(f, codac.Interval(-eps, eps)) for f in _functions(leg, 0.0)]
        above, below = _functions(leg, -1.0), _functions(leg, 1.0)
        negative, positive = codac.Interval(-codac.oo, 0.0), codac.Interval(0.0, codac.oo)
        return [codac.CtcInverse(f, negative) for f in above] + [codac.CtcInverse(f, positive) for f in below]

    def prepare(self, question: TaskQuestion) -> Work:
        import codac

        leg, kind = question.leg, question.task.kind
        _ = leg.middle
        if kind == "sweep":
            contractors = self.contractors(leg, question.tolerance)
            return timed_sweep(leg, question, lambda batch: _each(codac, contractors, batch))
        if kind == "minimise":
            return lambda: _minimise(leg, self.contractors(leg, None), question)
        if kind in ("refute", "hull"):
            return lambda: _pave(leg, self.contractors(leg, question.tolerance), question)
        raise Unsupported(f"has no task {kind}")


class CodacFwdBwd(Codac):
    """Without the centred form: forward and backward only, like hc4."""

    def contractors(self, leg: Leg, eps: float | None) -> list[Any]:
        import codac

        if eps is None:
            raise Unsupported("is there for sweeps")
        return [codac.CtcInverse(f, codac.Interval(-eps, eps), False) for f in _functions(leg, 0.0)]


def _functions(leg: Leg, sign: float) -> list[Any]:
    """g for each measurement, plus `sign` times the last component where sign is not 0."""
    import codac

    campaign = leg.campaign
    x = codac.VectorVar(8 if sign else 7)
    made = []
    length = campaign.length[:, leg.leg - 1].tolist()
    rotations = rotation_matrix(campaign.quaternion).tolist()
    for p, r, measured in zip(campaign.position.tolist(), rotations, length, strict=True):
        v = [p[i] + r[i][0] * x[3] + r[i][1] * x[4] + r[i][2] * x[5] - x[i] for i in range(3)]
        g = codac.sqrt(codac.sqr(v[0]) + codac.sqr(v[1]) + codac.sqr(v[2])) - x[6] - measured
        made.append(codac.AnalyticFunction([x], g + sign * x[7] if sign else g))
    return made


def _each(codac: Any, contractors: list[Any], batch: IntervalArray) -> IntervalArray:
    lo, hi = batch.lo.copy(), batch.hi.copy()
    for row, bounds in enumerate(np.stack([batch.lo[:, :7], batch.hi[:, :7]], axis=2).tolist()):
        box = codac.IntervalVector(bounds)
        for contractor in contractors:
            contractor.contract(box)
        empty = box.is_empty()
        lo[row, :7] = np.nan if empty else np.asarray(box.lb()).ravel()
        hi[row, :7] = np.nan if empty else np.asarray(box.ub()).ravel()
    return IntervalArray(lo, hi)


def contract(contractors: list[Any], box: Any) -> None:
    """Each in turn while the volume of the box shrinks by a fifth."""
    for _ in range(_PASSES):
        before = box.volume()
        for contractor in contractors:
            contractor.contract(box)
            if box.is_empty():
                return
        if not box.volume() < 0.8 * before:
            return


def _start(leg: Leg, eps: tuple[float, float] | None) -> Any:
    import codac

    bounds = np.stack([leg.box.lo, leg.box.hi], axis=1).tolist()
    return codac.IntervalVector(bounds + ([list(eps)] if eps else []))


def _minimise(leg: Leg, contractors: list[Any], question: TaskQuestion) -> MethodAnswer:
    """Best first by the lower bound of eps; midpoints are tried, the first of them the least-squares fit."""
    deadline, serial = time.monotonic() + question.limit, itertools.count()
    best = float(np.abs(residuals(leg.campaign, leg.leg, leg.middle)).max())
    queue: list[tuple[float, int, Any]] = [(0.0, next(serial), _start(leg, (0.0, leg.longest)))]
    nodes = 0
    while queue and time.monotonic() < deadline and queue[0][0] < best * (1.0 - question.task.value):
        box = heapq.heappop(queue)[2]
        nodes += 1
        box[7] = box[7] & _interval(0.0, best)
        contract(contractors, box)
        if box.is_empty():
            continue
        middle = np.asarray(box.mid()).ravel()[:7]
        best = min(best, float(np.abs(residuals(leg.campaign, leg.leg, middle)).max()))
        for half in box.bisect(int(np.argmax(np.asarray(box.diam()).ravel()[:7]))):
            heapq.heappush(queue, (float(half[7].lb()), next(serial), half))
    lo = min([best] + [entry[0] for entry in queue[:1]])
    return MethodAnswer(lo >= best * (1.0 - question.task.value), {"lo": lo, "hi": best, "nodes": nodes}, "own search")


def _interval(lo: float, hi: float) -> Any:
    import codac

    return codac.Interval(lo, hi)


def _pave(leg: Leg, contractors: list[Any], question: TaskQuestion) -> MethodAnswer:
    """Widest box first. Empty: refuted; else the hull of what is left when the time is up."""
    deadline, serial = time.monotonic() + question.limit, itertools.count()
    first = _start(leg, None)
    queue: list[tuple[float, int, Any]] = [(0.0, next(serial), first)]
    nodes = 0
    while queue and time.monotonic() < deadline:
        box = heapq.heappop(queue)[2]
        nodes += 1
        contract(contractors, box)
        if not box.is_empty():
            for half in box.bisect(box.max_diam_index()):
                heapq.heappush(queue, (-float(half.max_diam()), next(serial), half))
    figures: dict[str, float] = {"nodes": nodes}
    if queue and question.task.kind == "hull":
        lo = np.min([np.asarray(box.lb()).ravel() for _, _, box in queue], axis=0)
        hi = np.max([np.asarray(box.ub()).ravel() for _, _, box in queue], axis=0)
        figures |= widths(hi - lo)
    return MethodAnswer(not queue and question.task.kind == "refute", figures, f"{len(queue)} boxes left")
