"""Sets of boxes: what is left of a box without another, which boxes touch, how much room they take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cpcal.solver.interval import Box, Interval, IntervalArray
from cpcal.solver.interval.float64 import Float64

_ENGINE = Float64()


def difference(box: Box, part: Box) -> tuple[Box, ...]:
    """At most 2n boxes that cover `box` without `part`, a subset of it; they meet only at their faces."""
    if part.is_empty:
        return () if box.is_empty else (box,)
    low, high = part.lo > box.lo, part.hi < box.hi
    if not (low.any() or high.any()):
        return ()
    lo, hi = box.lo.copy(), box.hi.copy()
    lower, upper = [], []
    for k in np.flatnonzero(low | high).tolist():
        for cut, end, other in ((low[k], part.lo[k], hi), (high[k], part.hi[k], lo)):
            if cut:
                before, other[k] = other[k], end
                lower.append(lo.copy())
                upper.append(hi.copy())
                other[k] = before
        lo[k], hi[k] = part.lo[k], part.hi[k]
    return tuple(Box.rows(box.names, np.array(lower), np.array(upper)))


def clusters(boxes: Sequence[Box]) -> npt.NDArray[np.intp]:
    """For each box the number of its cluster: boxes that touch, and those that touch them, are one cluster.

    Clusters are numbered in the order of their first box. Sorted by one component (of the most different ends), boxes
    are compared only with those that begin before they end.
    """
    from scipy.sparse import coo_array  # here: it takes a third of a second to load
    from scipy.sparse.csgraph import connected_components

    count = len(boxes)
    if count == 0 or len(boxes[0]) == 0:
        return np.zeros(count, dtype=np.intp)
    lo, hi = np.stack([box.lo for box in boxes]), np.stack([box.hi for box in boxes])
    by = int(np.argmax([len(np.unique(column)) for column in lo.T]))
    order = np.argsort(lo[:, by], kind="stable")
    lo, hi = lo[order], hi[order]
    ends = np.searchsorted(lo[:, by], hi[:, by], side="right")
    first, second = [], []
    for i in range(count):
        others = np.arange(i + 1, ends[i])
        touching = others[((lo[others] <= hi[i]) & (hi[others] >= lo[i])).all(axis=1)]
        first.append(np.full(len(touching), order[i]))
        second.append(order[touching])
    pairs = (np.concatenate(first), np.concatenate(second))
    graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(count, count))
    label = np.asarray(connected_components(graph, directed=False)[1])
    seen: dict[int, int] = {}
    return np.array([seen.setdefault(int(k), len(seen)) for k in label], dtype=np.intp)


def volume(boxes: Sequence[Box]) -> Interval:
    """Enclosure of the sum of the boxes' volumes."""
    full = [box for box in boxes if not box.is_empty]
    if not full:
        return Interval(0.0)
    lo, hi = np.stack([box.lo for box in full]), np.stack([box.hi for box in full])
    widths = _ENGINE.sub(IntervalArray.point(hi), IntervalArray.point(lo))
    product = IntervalArray.point(np.ones(len(full)))
    for k in range(lo.shape[1]):
        product = _ENGINE.mul(product, widths[:, k])
    total = _ENGINE.sum(product, 0)
    return Interval(max(float(total.lo), 0.0), float(total.hi))


def hull(boxes: Sequence[Box]) -> Box:
    """The smallest box around some boxes (at least one)."""
    out = boxes[0]
    for box in boxes[1:]:
        out = out.hull(box)
    return out
