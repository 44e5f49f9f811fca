"""The median without numpy's generality, which takes five times as long for the hundred numbers of an image's dots."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def median(values: npt.NDArray[np.floating]) -> float:
    """Of (n,), n at least 1; nan where one is."""
    rising = np.sort(values)  # with any nan at the end
    if np.isnan(rising[-1]):
        return float("nan")
    return 0.5 * float(rising[(len(rising) - 1) // 2] + rising[len(rising) // 2])
