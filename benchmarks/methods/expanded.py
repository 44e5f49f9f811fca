"""The best formulation found for solvers of mathematical programs: squared, expanded, products shared.

With q = a.a - l*l and one column for each product a_i b_j and b_i b_j, every measurement is linear,

    E = q + b'R'R b - 2 a'R b + 2 P'R b - 2 P.a - 2 L l + P.P - L^2
    E - 2 L eps - 2 l eps - eps^2 <= 0 <= E + 2 L eps + 2 l eps - eps^2,          L + l >= eps.

The coefficients are rounded to doubles, so that no answer is certified for the exact data.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from benchmarks.methods.hull import widths
from benchmarks.methods.method import HULL_GAP, TaskQuestion, Work
from benchmarks.problems import Leg
from benchmarks.records import MethodAnswer
from benchmarks.tasks import Unsupported
from cpcal.common.values import Floats
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


@dataclass(frozen=True)
class Solved:
    """What a solver says of a minimisation: a bound from below, the best point's value, whether it is done."""

    lo: float
    hi: float
    nodes: float
    done: bool
    infeasible: bool
    status: str


class Model(Protocol):
    """One program; `objective` is a column of the parameters with its sign, or None for eps."""

    def solve(self, objective: tuple[int, float] | None, limit: float, gap: float, gap_absolute: float) -> Solved: ...


Build = Callable[[ExpandedRows, float | None], Model]  # eps None: a variable


def work(question: TaskQuestion, build: Build) -> Work:
    """The tasks that these solvers can be given."""
    leg = question.leg
    data = rows(leg)
    if question.task.kind == "minimise":
        return lambda: _minimise(build(data, None), question)
    if question.task.kind == "refute":
        return lambda: _refute(build(data, question.tolerance), question)
    if question.task.kind == "hull":
        return lambda: _hull(build(data, question.tolerance), data, question.limit)
    raise Unsupported(f"has no task {question.task.kind}")


def _minimise(model: Model, question: TaskQuestion) -> MethodAnswer:
    found = model.solve(None, question.limit, question.task.value, 0.0)
    return MethodAnswer(found.done, {"lo": found.lo, "hi": found.hi, "nodes": found.nodes}, found.status)


def _refute(model: Model, question: TaskQuestion) -> MethodAnswer:
    found = model.solve((OFFSET, 0.0), question.limit, 0.0, 0.0)
    return MethodAnswer(found.infeasible, {"nodes": found.nodes}, found.status)


def _hull(model: Model, data: ExpandedRows, limit: float) -> MethodAnswer:
    lo, hi = data.lo.copy(), data.hi.copy()
    deadline, nodes, closed = time.monotonic() + limit, 0.0, 0
    sides = [(k, sign) for k in range(7) for sign in (1.0, -1.0)]
    for done, (k, sign) in enumerate(sides):
        share = (deadline - time.monotonic()) / (len(sides) - done)
        found = model.solve((k, sign), max(share, 1e-3), 0.0, HULL_GAP)
        if found.infeasible:
            return MethodAnswer(False, {"nodes": nodes + found.nodes}, "claims that there is none")
        nodes, closed = nodes + found.nodes, closed + found.done
        if math.isfinite(found.lo):
            lo[k], hi[k] = (max(lo[k], found.lo), hi[k]) if sign > 0.0 else (lo[k], min(hi[k], -found.lo))
    return MethodAnswer(
        closed == len(sides), {"nodes": nodes, **widths(hi - lo)}, f"{closed} of {len(sides)} bounds closed"
    )
