"""Points near the ends of S(eps), for branch and bound to prove: local optima, by sequential quadratic programming."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from benchmarks.problems import Leg
from cpcal.common.arrays import Floats
from cpcal.solver.interval import Box
from cpcal.solver.linear import Dense
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize import fit

_ROOM = 1e-9  # of eps, for the rounding of a proof
_BACK = (0.0, 1e-9, 1e-7, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0)


def minimax(leg: Leg) -> Floats:
    """The point of the smallest eps, well inside of S(eps) for a larger one."""
    network = leg.network()
    return np.asarray(fit(Rows(network), 7, network.domain, leg.start, Dense())[:7])


def extreme(network: ConstraintNetwork, box: Box, eps: float, end: tuple[int, float], inside: Floats) -> Floats:
    """x of S(eps) with `sign * x_k` as small as it gets nearby, drawn back towards `inside` until it is in the set."""
    k, sign = end
    rows = Rows(network)
    cost = np.zeros(7)
    cost[k] = sign

    def value(x: Floats) -> float:
        return float(cost @ x)

    def gradient(x: Floats) -> Floats:
        return cost

    def slack(x: Floats) -> Floats:
        return np.asarray(-rows.linearize(np.append(x, eps)).values)

    def slope(x: Floats) -> Floats:
        return np.asarray(-rows.linearize(np.append(x, eps)).jacobian[:, :7])

    found = optimize.minimize(
        value,
        inside,
        jac=gradient,
        method="SLSQP",
        bounds=list(zip(box.lo.tolist(), box.hi.tolist(), strict=True)),
        constraints=optimize.NonlinearConstraint(slack, 0.0, np.inf, jac=slope),
    )
    points = (np.asarray(found.x + share * (inside - found.x)) for share in _BACK)
    return next((x for x in points if float(np.min(slack(x))) > _ROOM * eps), inside)
