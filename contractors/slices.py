"""Boxes cut into slices along one variable, and all slices contracted: what shaving and CID have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.contract import Contractor, shrunk, takes_batches
from cpcal.solver.interval import Box, IntervalArray


def slice_of(box: Box, component: int, lo: float, hi: float) -> Box:
    """The part of a box between two values of one component."""
    return box.replace(component, lo=lo, hi=hi)


def cuts(lo: float, hi: float, pieces: int) -> Floats:
    """`pieces + 1` numbers from lo to hi (finite), increasing, the ends exact."""
    inner = lo + (hi - lo) * (np.arange(1, pieces) / pieces) if hi - lo < np.inf else np.zeros(pieces - 1)
    return np.unique(np.concatenate([[lo], np.clip(inner, lo, hi), [hi]]))


def contract_all(inner: Contractor, boxes: Sequence[Box], passes: int) -> list[Box]:
    """Each box contracted by `inner`; all at once, `passes` times, where it can do that."""
    if not boxes:
        return []
    if not takes_batches(inner):
        return [inner.contract(box).box for box in boxes]
    array = IntervalArray(np.stack([box.lo for box in boxes]), np.stack([box.hi for box in boxes]))
    left = contracted(inner, array, passes)
    return [box.with_bounds(lo, hi) for box, lo, hi in zip(boxes, left.lo, left.hi, strict=True)]


def contracted(inner: Contractor, array: IntervalArray, passes: int) -> IntervalArray:
    """The same for bounds (B, n) of boxes, with a contractor that takes batches; NaN where nothing is left."""
    for _ in range(passes):
        alive = np.flatnonzero(~array.empty.any(axis=1))
        if not alive.size:
            break
        lo, hi = array.lo.copy(), array.hi.copy()
        narrowed = inner.contract_batch(array[alive])  # type: ignore[attr-defined]
        lo[alive], hi[alive] = narrowed.lo, narrowed.hi
        with np.errstate(all="ignore"):
            pays = shrunk((array.hi - array.lo)[alive], (hi - lo)[alive], 0.9)
        array = IntervalArray(lo, hi)
        if not pays:
            break
    return array
