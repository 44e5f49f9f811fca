"""The micro-benchmark: every equation of a leg once, forward and backward, over a batch of boxes."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from benchmarks.methods.method import TaskQuestion, Work
from benchmarks.problems import Leg
from benchmarks.records import MethodAnswer
from cpcal.solver.interval import IntervalArray

_SECONDS = 1.0  # at least this long, and at least thrice

Sweep = Callable[[IntervalArray], IntervalArray]


def boxes(leg: Leg, eps: float, count: int) -> IntervalArray:
    """Boxes (count, 8) around random points of X0, their half-widths from its own down to a thousandth of it."""
    rng = np.random.default_rng(0)
    half = leg.delta * 10.0 ** rng.uniform(-3.0, 0.0, (count, 1))
    middle = leg.middle + rng.uniform(-1.0, 1.0, (count, 7)) * (leg.delta - half)
    eps_column = np.full((count, 1), eps)
    return IntervalArray(np.hstack([middle - half, eps_column]), np.hstack([middle + half, eps_column]))


def timed_sweep(leg: Leg, question: TaskQuestion, sweep: Sweep) -> Work:
    """Medians of CPU time over calls in one process, the first one left out."""
    batch = boxes(leg, question.tolerance, int(question.task.value))

    def work() -> MethodAnswer:
        left = sweep(batch)
        times: list[float] = []
        while len(times) < 3 or (sum(times) < _SECONDS and len(times) < 200):
            began = time.process_time()
            sweep(batch)
            times.append(time.process_time() - began)
        each = statistics.median(times) / batch.shape[0]
        empty = np.isnan(left.lo).any(axis=1)
        share = (left.hi - left.lo)[~empty, :7] / (batch.hi - batch.lo)[~empty, :7]
        figures = {
            "us per box": 1e6 * each,
            "ns per equation": 1e9 * each / leg.measurements,
            "emptied": float(empty.sum()),
            "width left": float(share.mean()) if share.size else 0.0,
        }
        return MethodAnswer(True, figures, cpu=statistics.median(times))

    return work
