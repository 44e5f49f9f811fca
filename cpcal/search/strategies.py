"""Where to cut a box in two."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from cpcal.interval import Box
from cpcal.network import ConstraintNetwork
from cpcal.network.rows import Rows

Floats = npt.NDArray[np.float64]


def bisect(box: Box, component: int) -> tuple[Box, ...]:
    """The two halves of a box, or () where float64 has no number between its bounds."""
    lo, hi = box.lo[component], box.hi[component]
    cut = _middle(lo, hi)
    if not lo < cut < hi:
        return ()
    name = box.names[component]
    return box.replace(name, hi=cut), box.replace(name, lo=cut)


def _middle(lo: float, hi: float) -> float:
    """Half way; of an unbounded interval a number that doubles its distance from zero, so that halves get finite."""
    if np.isinf(lo) and np.isinf(hi):
        return 0.0
    if np.isinf(hi):
        return min(max(1.0, 2.0 * float(lo)), float(np.finfo(np.float64).max))
    if np.isinf(lo):
        return max(min(-1.0, 2.0 * float(hi)), -float(np.finfo(np.float64).max))
    return float(0.5 * lo + 0.5 * hi)


class LargestFirst:
    """Bisect the component that is widest in units of `scale` (default 1); stop when all are below `width`."""

    def __init__(self, width: float = 0.0, scale: npt.ArrayLike = 1.0, skip: Iterable[str] = ()) -> None:
        self._width, self._scale, self._skip = width, np.asarray(scale, np.float64), frozenset(skip)

    def split(self, box: Box) -> tuple[Box, ...]:
        return self._cut(box, box.width / self._scale)

    def _cut(self, box: Box, score: Floats) -> tuple[Box, ...]:
        allowed = np.array([name not in self._skip for name in box.names])
        wide = allowed & (box.width / self._scale > self._width)
        for component in np.argsort(np.where(wide, -score, np.inf), kind="stable"):
            if not wide[component]:
                break
            pieces = bisect(box, int(component))
            if pieces:
                return pieces
        return ()


class Smear(LargestFirst):
    """Bisect where the constraints vary most: the largest sum over rows of |derivative| times width."""

    def __init__(
        self,
        network: ConstraintNetwork,
        width: float = 0.0,
        scale: npt.ArrayLike = 1.0,
        skip: Iterable[str] = (),
    ) -> None:
        super().__init__(width, scale, skip)
        self._rows = Rows(network)

    def split(self, box: Box) -> tuple[Box, ...]:
        if not box.is_bounded:
            return super().split(box)
        jacobian = np.abs(self._rows.linearize(box.mid).jacobian)
        score = np.nan_to_num(jacobian).sum(axis=0) * box.width
        return self._cut(box, score) if score.any() else super().split(box)
