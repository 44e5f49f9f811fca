"""Bound tightening: two linear programs for each variable of a box, each bound proved from its multipliers."""

from __future__ import annotations

import math
import time
from collections.abc import Collection
from typing import Protocol

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.contract import Contraction, Step
from cpcal.solver.interval import Box
from cpcal.solver.linear.engine import LinearSolution, LinearStatus

_WORTHWHILE = 1e-3  # a bound that some vertex already meets to this (in [-1, 1]) needs no program


class Programs(Protocol):
    """A polyhedron around the solutions in a bounded box, with a coordinate u = (x - mid) / rad for some variables."""

    @property
    def variables(self) -> Collection[int]:
        """Those with a coordinate."""
        ...

    @property
    def count(self) -> int:
        """Programs solved so far."""
        ...

    def minimize(self, variable: int, sign: float) -> LinearSolution:
        """The least `sign * u` of one variable."""
        ...

    def coordinates(self, solution: LinearSolution) -> Floats:
        """u (n,) at the vertex that a program found; 0 for the other variables."""
        ...

    def bound(self, variable: int, side: str, solution: LinearSolution) -> Step | None:
        """What the multipliers prove of a bound ("lo" or "hi"), if that is better than the box's."""
        ...

    def empty(self, solution: LinearSolution) -> Step | None:
        """The proof that no solution lies in the box, if the multipliers give one."""
        ...


def tightened(programs: Programs, box: Box, first: int | None, deadline: float = math.inf) -> Contraction:
    """The box around the polyhedron, the lower bound of variable `first` (the objective) before all others.

    After the `deadline` no program begins.

    `point` is the optimum of the first program. A bound that a vertex shows to move by next to nothing is left alone.
    """
    lo, hi, radius = box.lo.copy(), box.hi.copy(), box.rad
    point, met = None, _Met(len(box))
    steps: list[Step] = []
    for variable, side in _order(programs.variables, first):
        sign = 1.0 if side == "lo" else -1.0
        if radius[variable] == 0.0 or met(variable, sign):
            continue
        if time.monotonic() > deadline:
            break
        solution = programs.minimize(variable, sign)
        proof = programs.empty(solution) if solution.status is LinearStatus.INFEASIBLE else None
        if proof is not None:
            return Contraction(Box.empty(box.names), (*steps, proof), None, programs.count)
        if solution.status is not LinearStatus.OPTIMAL:
            continue
        vertex = programs.coordinates(solution)
        point = vertex if point is None else point
        met.add(vertex)
        step = None if met(variable, sign) else programs.bound(variable, side, solution)
        if step is None:
            continue
        steps.append(step)
        (lo if side == "lo" else hi)[variable] = step.bound
        if lo[variable] > hi[variable]:
            return Contraction(Box.empty(box.names), tuple(steps), None, programs.count)
    left = box.with_bounds(lo, hi)
    if point is not None:
        point = np.clip(box.mid + radius * point, left.lo, left.hi)
    return Contraction(left, tuple(steps), point, programs.count)


def _order(variables: Collection[int], first: int | None) -> list[tuple[int, str]]:
    """The objective's lower bound first; its upper one last, which the vertices before mostly meet."""
    others = [(v, side) for v in sorted(variables) for side in ("lo", "hi") if v != first]
    return others if first is None or first not in variables else [(first, "lo"), *others, (first, "hi")]


class _Met:
    """Which bounds some vertex of a program shows not to move by much."""

    def __init__(self, count: int) -> None:
        self._lowest, self._highest = np.full(count, np.inf), np.full(count, -np.inf)

    def add(self, vertex: Floats) -> None:
        np.minimum(self._lowest, vertex, out=self._lowest)
        np.maximum(self._highest, vertex, out=self._highest)

    def __call__(self, variable: int, sign: float) -> bool:
        end = self._lowest[variable] if sign > 0.0 else -self._highest[variable]
        return bool(end < -1.0 + _WORTHWHILE)
