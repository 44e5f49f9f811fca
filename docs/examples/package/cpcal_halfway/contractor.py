"""A contractor: each variable's halves, contracted by hc4 one by one; what both leave is put together again."""

from __future__ import annotations

import math

import numpy as np

from contractors import HC4
from cpcal.solver.contract import Composable, Contraction, Step
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork


class Bisected(Composable):
    """Keeps the contract of `cpcal.solver.contract`: a box in, a smaller box out, no solution lost, no state kept."""

    def __init__(self, network: ConstraintNetwork) -> None:
        self._inner = HC4(network)

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        left = box
        for k in range(len(box) if not box.is_empty else 0):
            middle = left.mid[k]
            if not left.is_empty and left.lo[k] < middle < left.hi[k] and np.isfinite(left.width[k]):
                halves = [left.replace(left.names[k], hi=middle), left.replace(left.names[k], lo=middle)]
                one, two = (self._inner.contract(half).box for half in halves)
                left = left.intersect(one.hull(two))
        moved = Step("bisected", None, "", np.nan) if left.is_empty and not box.is_empty else None
        return Contraction(left, () if moved is None else (moved,))


def bisected(network: ConstraintNetwork, *, objective: str | None = None) -> Bisected:
    """What the entry point names: called with the network, and with these options."""
    return Bisected(network)
