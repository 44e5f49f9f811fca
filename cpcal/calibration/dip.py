"""The dip of a sample, and the test of one mode against several (Hartigan and Hartigan 1985).

The dip is the least distance, as the largest difference of distribution functions, from the sample's to a unimodal one.
Backlash shows as two modes; the dip asks for nothing but "one mode or more", where a mixture of normals would also
take heavy tails or skewness for a second component.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.calibration.dip_table import LAWS, SURVIVAL
from cpcal.common.arrays import Floats, Ints
from cpcal.common.errors import InputError, Problem


def dip(sample: npt.ArrayLike) -> float:
    """The dip of a sample (N,): from 1/(2 N), one mode as clear as can be, to 1/4, two points of equal weight.

    A best unimodal distribution is convex up to a modal interval and concave from it on: the greatest convex minorant
    of the empirical one to its left, the least concave majorant to its right. The interval starts as everything and is
    narrowed to where minorant and majorant are furthest apart, until they are no further apart than what the narrowing
    has already cost outside it.
    """
    values = np.asarray(sample, dtype=np.float64)
    if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
        raise InputError([Problem("sample", f"has the shape {values.shape} or is not finite", "give numbers, (N,)")])
    x, counts = np.unique(values, return_counts=True)
    through = np.cumsum(counts).astype(np.float64)  # readings up to x, x included
    below = through - counts
    cost, low, high = 1.0, 0, len(x) - 1
    while high > low:
        part = slice(low, high + 1)
        under, over = _convex(x[part], below[part]) + low, _convex(x[part], -through[part]) + low
        minorant = np.interp(x[part], x[under], below[under])
        majorant = np.interp(x[part], x[over], through[over])
        left, right = _modal_interval(under, over, majorant - minorant, low)
        if (majorant - minorant)[[left - low, right - low]].max() <= cost:
            break
        rise, fall = through[part] - minorant, majorant - below[part]
        outside = np.concatenate([rise[: left - low], fall[right - low + 1 :]])
        cost = max(cost, float(np.max(outside, initial=0.0)))
        low, high = left, right  # narrower: both chains start at low and end at high
    return cost / (2 * len(values))


def dip_p_value(sample: npt.ArrayLike) -> float:
    """The probability of so large a dip if the distribution were uniform: small means more than one mode.

    The uniform distribution is the least favourable unimodal one. The law of sqrt(N) dip is that of dip_table.py, for
    the nearest size there, with 5,000 samples each; p-values below 0.01 are extrapolated from their tail.
    """
    values = np.asarray(sample, dtype=np.float64)
    seen = dip(values) * np.sqrt(len(values))
    sizes = np.array(list(LAWS))
    size = int(sizes[np.argmin(np.abs(np.log(sizes / len(values))))])
    levels, tail = LAWS[size]
    if seen >= levels[-1]:
        return min(float(SURVIVAL[-1]), float(np.exp(np.polyval(tail, seen**2))))
    return float(np.exp(np.interp(seen, levels, np.log(SURVIVAL), left=0.0)))


def _modal_interval(under: Ints, over: Ints, gap: Floats, low: int) -> tuple[int, int]:
    """The knots of minorant and majorant that enclose the place where the two are furthest apart."""
    at_under, at_over = gap[under - low], gap[over - low]
    if at_under.max() >= at_over.max():
        left = int(under[np.argmax(at_under)])
        return left, int(over[np.searchsorted(over, left)])
    right = int(over[np.argmax(at_over)])
    return int(under[np.searchsorted(under, right, side="right") - 1]), right


def _convex(x: Floats, y: Floats) -> Ints:
    """Indices of the vertices of the greatest convex minorant of the points (x, y), x increasing (monotone chain)."""
    xs, ys = x.tolist(), y.tolist()
    kept: list[int] = []
    for k in range(len(xs)):
        while len(kept) > 1:
            i, j = kept[-2], kept[-1]
            if (ys[j] - ys[i]) * (xs[k] - xs[j]) < (ys[k] - ys[j]) * (xs[j] - xs[i]):
                break
            kept.pop()
        kept.append(k)
    return np.array(kept, dtype=np.int64)
