"""A strategy: the first variable that is wide enough is cut in two."""

from __future__ import annotations

from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork


class FirstWide:
    """`split` returns pieces that cover the box, or () when it is fine enough to be kept."""

    def __init__(self, network: ConstraintNetwork, width: float) -> None:
        self._width = width

    def split(self, box: Box) -> tuple[Box, ...]:
        for name, lo, hi, middle in zip(box.names, box.lo, box.hi, box.mid, strict=True):
            if hi - lo > self._width and lo < middle < hi:
                return box.replace(name, hi=middle), box.replace(name, lo=middle)
        return ()
