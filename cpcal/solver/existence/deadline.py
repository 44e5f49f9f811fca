"""How compiled functions hear of a deadline: they cannot read the clock, and hold no lock while they run."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer

import numpy as np

from cpcal.common.arrays import Ints

_QUICK = 100**3  # steps of an elimination: some milliseconds, not worth a thread


@contextmanager
def stop_flag(deadline: float, unknowns: int, boxes: int = 1) -> Iterator[Ints]:
    """A flag (1,) that becomes 1 at the deadline (of time.monotonic()), for Newton's method on so many boxes.

    Where that takes some milliseconds only, it stays 0.
    """
    flag = np.zeros(1, np.int64)
    if math.isinf(deadline) or boxes * unknowns**3 < _QUICK:
        yield flag
        return
    timer = Timer(max(0.0, deadline - time.monotonic()), flag.fill, (1,))
    timer.daemon = True
    timer.start()
    try:
        yield flag
    finally:
        timer.cancel()
