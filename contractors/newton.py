"""newton: the interval Newton operator on a square part of a network's equalities (see `solver.existence.operators`).

Near a simple zero the widths of a box are squared at every pass. To prove that a zero exists is the matter of
`cpcal.solver.existence.prove_unique`, which `Network.solve` asks about each box that it keeps.
"""

from __future__ import annotations

import math
import time

import numpy as np

from cpcal.solver.contract import Composable, Contraction, narrowed
from cpcal.solver.existence.operators import Equalities, newton_all
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork

_MOST = 10  # times that the operator is applied to a box
_QUICK = 100  # unknowns, beyond which the clock is looked at before each box


class Newton(Composable):
    """Repeats the operator while it halves some width. Bounded boxes only.

    With more equations than unknowns the best conditioned ones are taken; with fewer, some components stay as they
    are and count as parameters. Inequalities are ignored.
    """

    def __init__(self, network: ConstraintNetwork, *, objective: str | None = None) -> None:
        self._equalities = Equalities.of(network)
        self.unused_constraints = self._equalities.inequalities

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        return narrowed("newton", box, box.intersect(self.contract_batch(box.array[None], deadline)[0]))

    def contract_batch(self, boxes: IntervalArray, deadline: float = math.inf) -> IntervalArray:
        """Contract B boxes at once: shape (B, n) in and out, NaN where a box holds no solution."""
        if not self._equalities.count:
            return boxes
        bounds = np.stack([boxes.lo, boxes.hi], axis=-1)
        together = max(1, len(bounds) if boxes.shape[1] <= _QUICK else 1)
        for k in range(0, len(bounds), together):
            if time.monotonic() < deadline:
                newton_all(self._equalities.program, _MOST, bounds[k : k + together])
        return IntervalArray(bounds[..., 0], bounds[..., 1])
