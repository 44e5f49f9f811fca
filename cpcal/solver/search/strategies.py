"""Where to cut a box in two."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows


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


class RoundRobin(LargestFirst):
    """Bisect one component after the other: number `depth` (modulo their number), or the next one that is wide."""

    def split(self, box: Box) -> tuple[Box, ...]:
        return self.split_at(box, 0)

    def split_at(self, box: Box, depth: int) -> tuple[Box, ...]:
        """The pieces of a box that `depth` divisions led to."""
        turn = (np.arange(len(box)) - depth) % max(len(box), 1)
        return self._cut(box, -turn.astype(np.float64))


_TINY = float(np.finfo(np.float64).tiny)

# |derivative| times width, shape (rows, components) -> score of each component
SMEARS: dict[str, Callable[[Floats], Floats]] = {
    "sum": lambda smear: np.asarray(smear.sum(axis=0)),
    "relative": lambda smear: np.asarray((smear / np.maximum(smear.sum(axis=1, keepdims=True), _TINY)).sum(axis=0)),
    "max": lambda smear: np.asarray(smear.max(axis=0, initial=0.0)),
}


class Smear(LargestFirst):
    """Bisect where the constraints vary most, by |derivative| times width at the midpoint of a box.

    Over the rows it is combined by `how`: their "sum", the sum "relative" to each row's total (so that no row counts
    more than another), or the "max".
    """

    def __init__(
        self,
        network: ConstraintNetwork,
        width: float = 0.0,
        scale: npt.ArrayLike = 1.0,
        skip: Iterable[str] = (),
        how: str = "sum",
    ) -> None:
        super().__init__(width, scale, skip)
        self._rows, self._how = Rows(network), how

    def split(self, box: Box) -> tuple[Box, ...]:
        if not box.is_bounded:
            return super().split(box)
        jacobian = np.abs(self._rows.linearize(box.mid).jacobian)
        with np.errstate(over="ignore"):
            score = np.nan_to_num(SMEARS[self._how](jacobian * box.width))
        return self._cut(box, score) if score.any() else super().split(box)


STRATEGIES: dict[str, Callable[[ConstraintNetwork, float], LargestFirst]] = {
    "largest": lambda network, width: LargestFirst(width),
    "round-robin": lambda network, width: RoundRobin(width),
    "smear": lambda network, width: Smear(network, width),
    "smear-relative": lambda network, width: Smear(network, width, how="relative"),
    "smear-max": lambda network, width: Smear(network, width, how="max"),
}
