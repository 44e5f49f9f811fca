"""The hull of S(eps) by cpcal: contraction first, then a proved point near each bound of the box.

Bounds that are too far from one get a branch and bound of their own.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.methods.extreme import Ends, minimax
from benchmarks.methods.method import HULL_GAP
from benchmarks.problems import Leg
from benchmarks.records import MethodAnswer
from cpcal.common.values import Floats
from cpcal.legs import PARAMETERS, leg_network
from cpcal.solver import plugins
from cpcal.solver.contract import Limits, Repeat, Verdict
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize.bound import minimize, run
from cpcal.solver.optimize.minimum import Minimum

_ENGINE = get_arithmetic("float64")


def hull(leg: Leg, contractors: tuple[str, ...], eps: float, limit: float) -> MethodAnswer:
    """An outer box, each bound within HULL_GAP of a proved point unless the time was up."""
    deadline = time.monotonic() + limit
    network = _network(leg, leg.box, eps)
    contracted = Repeat(plugins.build(network, contractors)).contract(network.domain)
    if contracted.box.is_empty:
        return MethodAnswer(False, {}, "proved to be empty")
    box = Box(PARAMETERS, contracted.box.lo[:7], contracted.box.hi[:7])
    search = Ends(network, contracted.box, minimax(leg))
    nodes, programs, closed = 1, contracted.programs, 0
    sides = [(k, sign) for k in range(7) for sign in (1.0, -1.0)]
    for done, (k, sign) in enumerate(sides):
        corner = search.proved(k, sign)
        if corner is not None and sign * corner[k] - _bound(box, k, sign) <= HULL_GAP:
            closed += 1
            continue
        share = (deadline - time.monotonic()) / (len(sides) - done)
        limits = Limits(seconds=max(share, 0.0), gap=0.0, gap_absolute=HULL_GAP)
        found = _end(leg, box, eps, (k, sign), search.inside if corner is None else corner, contractors, limits)
        nodes, programs = nodes + found.nodes, programs + found.programs
        closed += found.verdict is Verdict.PROVED
        reached = max(_bound(box, k, sign), found.lo)
        box = box.replace(PARAMETERS[k], lo=reached) if sign > 0.0 else box.replace(PARAMETERS[k], hi=-reached)
    figures = {"nodes": nodes, "programs": programs, **widths(box.width)}
    return MethodAnswer(closed == len(sides), figures, f"{closed} of {len(sides)} bounds closed")


def _bound(box: Box, k: int, sign: float) -> float:
    """A lower bound of `sign * x_k`."""
    return float(box.lo[k]) if sign > 0.0 else -float(box.hi[k])


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
    corner: Floats,
    contractors: tuple[str, ...],
    limits: Limits,
) -> Minimum:
    """The smallest t with `sign * x_k <= t` for some x of the set."""
    k, sign = end
    network = _network(leg, box, eps)
    a, b, offset, *_ = network.variables
    component = offset if k == 6 else (a, b)[k // 3][k % 3]
    ends = sorted((sign * float(box.lo[k]), sign * float(box.hi[k])))
    t = network.variable("t", (), (ends[0], ends[1]))
    network.add(sign * component <= t)
    contractor = plugins.build(network, contractors, objective="t")
    start = np.append(corner, [eps, sign * corner[k]])
    return run(minimize(network, "t", contractor, engine=_ENGINE, limits=limits, start=start), None)
