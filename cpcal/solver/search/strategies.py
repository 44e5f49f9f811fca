"""Where to cut a box in two."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from typing import Self

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Floats, Ints
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows

_MAX = float(np.finfo(np.float64).max)


def bisect(box: Box, component: int) -> tuple[Box, ...]:
    """The two halves of a box, or () where float64 has no number between its bounds."""
    lo, hi = box.lo[component], box.hi[component]
    cut = float(_middle(lo[None], hi[None])[0])
    if not lo < cut < hi:
        return ()
    name = box.names[component]
    return box.replace(name, hi=cut), box.replace(name, lo=cut)


@np.errstate(over="ignore")  # what doubles beyond all floats is cut at the largest
def _middle(lo: Floats, hi: Floats) -> Floats:
    """Half way; of an unbounded interval a number that doubles its distance from zero, so that halves get finite."""
    low, high = np.isinf(lo), np.isinf(hi)
    if not (low.any() or high.any()):
        return np.asarray(0.5 * lo + 0.5 * hi)
    cut = 0.5 * np.where(low, 0.0, lo) + 0.5 * np.where(high, 0.0, hi)
    above = np.minimum(np.maximum(1.0, 2.0 * lo), _MAX)
    below = np.maximum(np.minimum(-1.0, 2.0 * hi), -_MAX)
    return np.asarray(np.where(low & high, 0.0, np.where(high, above, np.where(low, below, cut))))


class LargestFirst:
    """Bisect the component that is widest in units of `scale` (default 1); stop when all are below `width`.

    Other strategies of this kind derive from it and give another score.
    """

    _reach: Floats | float = np.inf

    def __init__(self, width: float = 0.0, scale: npt.ArrayLike = 1.0, skip: Iterable[str] = ()) -> None:
        self._width, self._scale, self._skip = width, np.asarray(scale, np.float64), frozenset(skip)

    def within(self, reach: Floats, unit: Floats | float = 1.0) -> Self:
        """The same, but no component (n,) is divided further than its `reach` from 0; widths are in `unit` (n,)."""
        out = copy(self)
        out._reach, out._scale = reach, self._scale * unit
        return out

    def split(self, box: Box) -> tuple[Box, ...]:
        return self.split_at(box, 0)

    def split_at(self, box: Box, depth: int) -> tuple[Box, ...]:
        """The pieces of a box that `depth` divisions led to."""
        (component,), _ = self.cuts(box.names, box.lo[None], box.hi[None], np.array([depth]))
        return bisect(box, int(component)) if component >= 0 else ()

    def cuts(self, names: Sequence[str], lo: Floats, hi: Floats, depths: Ints) -> tuple[Ints, Floats]:
        """Which component of boxes (B, n) to cut, -1 for none, and where: (B,) each."""
        with np.errstate(all="ignore"):
            return self._best(names, lo, hi, self._scores(lo, hi, depths))

    def _scores(self, lo: Floats, hi: Floats, depths: Ints) -> Floats:
        """The component with the highest one is cut: (B, n)."""
        return np.asarray(IntervalArray(lo, hi).width / self._scale)

    def _best(self, names: Sequence[str], lo: Floats, hi: Floats, score: Floats) -> tuple[Ints, Floats]:
        cut = _middle(lo, hi)
        able = (IntervalArray(lo, hi).width / self._scale > self._width) & (lo < cut) & (cut < hi)
        able &= (lo < self._reach) & (hi > -self._reach)
        if self._skip:
            able &= np.array([name not in self._skip for name in names])
        component = np.argmax(np.where(able, score, -np.inf), axis=1)
        rows = np.arange(len(lo))
        component = np.where(able[rows, component], component, np.where(able.any(axis=1), able.argmax(axis=1), -1))
        return component, cut[rows, component]


class RoundRobin(LargestFirst):
    """Bisect one component after the other: number `depth` (modulo their number), or the next one that is wide."""

    def _scores(self, lo: Floats, hi: Floats, depths: Ints) -> Floats:
        turn = (np.arange(lo.shape[1])[None] - depths[:, None]) % max(lo.shape[1], 1)
        return np.asarray(-turn.astype(np.float64))


_TINY = float(np.finfo(np.float64).tiny)

_SIZE = 1_000_000  # derivatives that are held at a time

# |derivative| times width, shape (boxes, rows, components) -> score of each component (boxes, components)
SMEARS: dict[str, Callable[[Floats], Floats]] = {
    "sum": lambda smear: np.asarray(smear.sum(axis=1)),
    "relative": lambda smear: np.asarray((smear / np.maximum(smear.sum(axis=2, keepdims=True), _TINY)).sum(axis=1)),
    "max": lambda smear: np.asarray(smear.max(axis=1, initial=0.0)),
}


class Smear(LargestFirst):
    """Bisect where the constraints vary most, by |derivative| times width at the midpoint of a box.

    Over the rows it is combined by `how`: their "sum", the sum "relative" to each row's total (so that no row counts
    more than another), or the "max". Where nothing varies, and on unbounded boxes, the widest component.
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
        self._rows, self._how = network.once("rows at points", lambda: Rows(network)), how

    def _scores(self, lo: Floats, hi: Floats, depths: Ints) -> Floats:
        widths, mids = IntervalArray(lo, hi).width, IntervalArray(lo, hi).mid
        scores = widths / self._scale
        bounded = np.flatnonzero(np.isfinite(lo).all(axis=1) & np.isfinite(hi).all(axis=1))
        most = max(1, _SIZE // max(self._rows.count * lo.shape[1], 1))
        for some in (bounded[k : k + most] for k in range(0, len(bounded), most)):
            smear = np.abs(self._rows.jacobians(mids[some])) * widths[some][:, None]
            found = np.nan_to_num(SMEARS[self._how](smear))
            varies = found.any(axis=1)
            scores[some[varies]] = found[varies]
        return np.asarray(scores)


STRATEGIES: dict[str, Callable[[ConstraintNetwork, float], LargestFirst]] = {
    "largest": lambda network, width: LargestFirst(width),
    "round-robin": lambda network, width: RoundRobin(width),
    "smear": lambda network, width: Smear(network, width),
    "smear-relative": lambda network, width: Smear(network, width, how="relative"),
    "smear-max": lambda network, width: Smear(network, width, how="max"),
}
