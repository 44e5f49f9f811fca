"""Half-widths of reading sets; among them distribution-free tolerance limits from order statistics (Wilks 1941).

Sort n independent errors from any continuous distribution by their size. The values up to the one that leaves m of the
n + 1 gaps above it hold a share of the distribution that is Beta(n + 1 - m, m) distributed, whatever the distribution.
So they hold at least `coverage` of it with the probability I_{1 - coverage}(m, n + 1 - m): the confidence.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from cpcal.calibration.statistics import Deviations
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem

Method = Literal["sigma", "extreme", "tolerance"]


def confidence_of(count: int, gaps: int, coverage: float) -> float:
    """That `count` readings, with that many of the count + 1 gaps left out, cover a share `coverage` or more."""
    from scipy import special  # here: it takes a third of a second to load

    return float(special.betainc(gaps, count + 1 - gaps, 1.0 - coverage))


def readings_needed(coverage: float, confidence: float) -> int:
    """The fewest readings whose largest error is such a half-width: 59 for coverage 0.95 with confidence 0.95."""
    _check(coverage, confidence)
    few, enough = 0, 1  # the confidence grows with the count: doubling, then bisection
    while confidence_of(enough, 1, coverage) < confidence:
        few, enough = enough, 2 * enough
    while enough - few > 1:
        middle = (few + enough) // 2
        few, enough = (few, middle) if confidence_of(middle, 1, coverage) >= confidence else (middle, enough)
    return enough


def tolerance_half_width(errors: npt.ArrayLike, coverage: float = 0.95, confidence: float = 0.95) -> float:
    """The least order statistic h of |errors| so that [-h, h] holds `coverage` of them with that confidence."""
    values = np.sort(np.abs(_sample(errors)))
    return float(values[len(values) - _gaps(len(values), coverage, confidence)])


def half_widths(
    deviations: Deviations,
    method: Method = "sigma",
    *,
    factor: float = 3.0,
    coverage: float = 0.95,
    confidence: float = 0.95,
) -> Floats:
    """(C,) half-widths of the reading sets of SINGLE readings, about their true value, channel by channel.

    "sigma"      factor standard deviations (the paper's 3): 99.7 % of normal errors
    "extreme"    the largest error seen
    "tolerance"  `coverage` of the errors with `confidence`, whatever their distribution

    of the errors of `Deviations.errors`. Each channel is taken by itself: a reading with C channels lies in all its
    sets less often than in each.
    """
    if method == "sigma":
        if not 0 < factor < np.inf:
            raise InputError([Problem("option factor", f"has no meaning: {factor!r}", "give a number > 0")])
        return factor * deviations.sigma
    if method == "extreme":
        return np.asarray(np.max(np.abs(deviations.errors), axis=0))
    if method == "tolerance":
        return np.array([tolerance_half_width(column, coverage, confidence) for column in deviations.errors.T])
    remedy = "give one of 'sigma', 'extreme', 'tolerance'"
    raise InputError([Problem("option method", f"has no meaning: {method!r}", remedy)])


def _gaps(count: int, coverage: float, confidence: float) -> int:
    """The most gaps that may be left out; by bisection, as the confidence falls with each."""
    needed = readings_needed(coverage, confidence)
    if count < needed:
        what = f"{count} readings are too few for coverage {coverage:g} with confidence {confidence:g}"
        raise InputError([Problem("readings", what, f"give at least {needed}, or ask for less")])
    good, bad = 1, count + 1
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if confidence_of(count, middle, coverage) >= confidence else (good, middle)
    return good


def _check(coverage: float, confidence: float) -> None:
    for name, value in (("coverage", coverage), ("confidence", confidence)):
        if not 0 < value < 1:
            what = f"has no meaning: {value!r}"
            raise InputError([Problem(f"option {name}", what, "give a number between 0 and 1")])


def _sample(values: npt.ArrayLike) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not np.isfinite(array).all():
        what = f"have the shape {array.shape}, or hold a number that is not finite"
        raise InputError([Problem("readings", what, "give finite numbers, (N,)")])
    return array
