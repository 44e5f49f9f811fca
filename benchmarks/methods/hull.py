"""The hull of S(eps) by cpcal: contraction first, then each bound of the box by a branch and bound of its own."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.methods.extreme import extreme, minimax
from benchmarks.methods.method import HULL_GAP
from benchmarks.problems import Leg
from benchmarks.records import MethodAnswer
from cpcal.common.arrays import Floats
from cpcal.legs import PARAMETERS, leg_network
from cpcal.solver import plugins
from cpcal.solver.contract import Limits, Repeat, Verdict
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize import Minimum, minimize, run

_ENGINE = get_arithmetic("float64")


def hull(leg: Leg, contractors: tuple[str, ...], eps: float, limit: float) -> MethodAnswer:
    """An outer box, each bound within HULL_GAP of a proved point unless the time was up."""
    deadline = time.monotonic() + limit
    network = _network(leg, leg.box, eps)
    box = Repeat(plugins.build(network, contractors)).contract(network.domain).box
    if box.is_empty:
        return MethodAnswer(False, {}, "proved to be empty")
    box = Box(PARAMETERS, box.lo[:7], box.hi[:7])
    inside = minimax(leg)
    nodes = programs = closed = 0
    sides = [(k, sign) for k in range(7) for sign in (1.0, -1.0)]
    for done, (k, sign) in enumerate(sides):
        share = (deadline - time.monotonic()) / (len(sides) - done)
        limits = Limits(seconds=max(share, 0.0), gap=0.0, gap_absolute=HULL_GAP)
        found = _end(leg, box, eps, (k, sign), inside, contractors, limits)
        nodes, programs = nodes + found.nodes, programs + found.programs
        closed += found.verdict is Verdict.PROVED
        name = PARAMETERS[k]
        if sign > 0.0:
            box = box.replace(name, lo=max(float(box.lo[k]), found.lo))
        else:
            box = box.replace(name, hi=min(float(box.hi[k]), -found.lo))
    figures = {"nodes": nodes, "programs": programs, **widths(box.width)}
    return MethodAnswer(closed == len(sides), figures, f"{closed} of {len(sides)} bounds closed")


def widths(width: Floats) -> dict[str, float]:
    """The figures that a hull is compared by."""
    return {"width": float(np.max(width)), "mean width": float(np.mean(width))}


def _network(leg: Leg, box: Box, eps: float) -> ConstraintNetwork:
    return leg_network(leg.campaign, leg.leg, box, engine=_ENGINE, eps=(eps, eps))


def _end(
    leg: Leg,
    box: Box,
    eps: float,
    end: tuple[int, float],
    inside: Floats,
    contractors: tuple[str, ...],
    limits: Limits,
) -> Minimum:
    """The smallest t with `sign * x_k <= t` for some x of the set."""
    k, sign = end
    network = _network(leg, box, eps)
    corner = extreme(network, box, eps, end, inside)
    a, b, offset, *_ = network.variables
    component = offset if k == 6 else (a, b)[k // 3][k % 3]
    ends = sorted((sign * float(box.lo[k]), sign * float(box.hi[k])))
    t = network.variable("t", (), (ends[0], ends[1]))
    network.add(sign * component <= t)
    contractor = plugins.build(network, contractors, objective="t")
    start = np.append(corner, [eps, sign * corner[k]])
    return run(minimize(network, "t", contractor, engine=_ENGINE, limits=limits, start=start), None)
