"""Points at the ends of S(eps): local optima, by linear programs about one point after the other, and proved."""

from __future__ import annotations

import numpy as np

from benchmarks.problems import Leg
from cpcal.common.values import Floats
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local import fit, linear_steps
from cpcal.solver.optimize.witness import WitnessProver

_MARGIN = 1e-11  # of rows, in units of their gradients across the box: room for the rounding of a proof


def minimax(leg: Leg) -> Floats:
    """The point of the smallest eps, well inside of S(eps) for a larger one."""
    network = leg.network()
    return np.asarray(fit(Rows(network), 7, network.domain, leg.start)[:7])


class Ends:
    """Of one leg at one eps, the last component of `box`; `inside` (7,) is a point of the set."""

    def __init__(self, network: ConstraintNetwork, box: Box, inside: Floats) -> None:
        self.inside, self._box, self._rows = inside, box, Rows(network)
        self._prover = WitnessProver(network, len(box) - 1, get_arithmetic("float64"))

    def proved(self, k: int, sign: float) -> Floats | None:
        """x (7,), proved to be in the set, with `sign * x_k` as small as it gets nearby; None where none was found."""
        cost = np.zeros(len(self._box))
        cost[k] = sign
        start = np.append(self.inside, self._box.mid[-1])
        scale = np.maximum(self._box.width, 1e-9)
        x = linear_steps(self._rows, cost, self._box, start, scale=scale, margin=_MARGIN)
        return None if x is None or self._prover.excess(x) > 0.0 else x[:7]
