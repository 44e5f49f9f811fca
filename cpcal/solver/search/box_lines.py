"""Boxes as values of JSON and back, to the last bit; infinite bounds are texts, an empty box is null."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cpcal.solver.interval import Box


def bounds_of(box: Box) -> list[list[float | str]] | None:
    """Lower and upper bounds."""
    if box.is_empty:
        return None
    return [[v if math.isfinite(v) else str(v) for v in side.tolist()] for side in (box.lo, box.hi)]


def box_of(names: tuple[str, ...], bounds: Any) -> Box:
    """The box of `bounds_of`. Raises TypeError, ValueError."""
    if bounds is None:
        return Box.empty(names)
    lo, hi = (np.array([float(v) for v in side], np.float64) for side in bounds)
    if not len(lo) == len(hi) == len(names) or not (lo <= hi).all():
        raise ValueError("a box is none")
    return Box(names, lo, hi)
