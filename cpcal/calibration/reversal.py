"""Reversal values: how far a leg is off when it comes from the other side (ISO 230-2).

A target is a configuration that was approached in both directions. With m+ and m- the means of a leg's equation g over
the runs that came from either side, and s+ and s- their standard deviations, ISO 230-2 has for target i

    B_i = m+ - m-       R_i+ = 4 s+       R_i- = 4 s-       R_i = max(2 s+ + 2 s- + |B_i|, R_i+, R_i-)

and for the axis the largest |B_i|, the mean of B_i, and the largest R_i. The axes here are the legs, and g is how much
longer a leg is, by the camera, than its sensor says: what the robot as a whole does not repeat is not in it. The
deviations hold the camera's and the sensors' noise too, so that B of a good robot is not zero; the test says whether it
is beyond that noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.calibration.repeatability import Repeatability
from cpcal.common.arrays import Floats, Ints
from cpcal.robot import POSITIVE


@dataclass(frozen=True)
class Reversal:
    """Of one leg, mm.

    targets   configurations approached in both directions
    largest   B: the largest |B_i|, at the configuration `at`; mean: of B_i, with its standard error
    forward, backward, both    R+, R- and R, the largest over the targets; nan where a target was approached once only
    p         probability of such differences if the direction did not matter
    """

    leg: int
    targets: int
    largest: float
    at: str
    mean: float
    error: float
    forward: float
    backward: float
    both: float
    statistic: float
    p: float

    @property
    def sentence(self) -> str:
        """B, its mean and R."""
        return (
            f"leg {self.leg}: B {self.largest:.2g} mm (at {self.at}), mean {self.mean:+.2g} ± {2.0 * self.error:.1g} "
            f"mm (k = 2), R {self.both:.2g} mm"
        )


def reversals(found: Repeatability, approach: Sequence[str] | None) -> tuple[Reversal, ...]:
    """Leg by leg, from the direction of each of the rows that `found` is of; none where no target has both."""
    if approach is None:
        return ()
    group = found.spread.group
    forward = np.array([one == POSITIVE for one in approach])
    count = len(found.spread.names)
    several = np.bincount(group[forward], minlength=count), np.bincount(group[~forward], minlength=count)
    targets = np.flatnonzero((several[0] > 0) & (several[1] > 0))
    if not len(targets):
        return ()
    rows = np.isin(group, targets)
    legs = range(found.equations.shape[1])
    sides = tuple(side[targets] for side in several)
    place = np.searchsorted(targets, group[rows])
    return tuple(
        _reversal(
            k + 1, found.equations[rows, k], place, forward[rows], sides, [found.spread.names[t] for t in targets]
        )
        for k in legs
    )


def _reversal(
    leg: int, values: Floats, group: Ints, forward: np.ndarray, sides: tuple[Ints, ...], names: list[str]
) -> Reversal:
    from scipy import stats  # here: it takes half a second to load, which certification need not wait for

    means, deviations, rest = [], [], 0.0
    for mask, repeats in zip((forward, ~forward), sides, strict=True):
        mean = np.bincount(group[mask], values[mask], len(names)) / repeats
        squares = np.bincount(group[mask], (values[mask] - mean[group[mask]]) ** 2, len(names))
        with np.errstate(divide="ignore", invalid="ignore"):
            deviations.append(np.sqrt(np.where(repeats > 1, squares / (repeats - 1), np.nan)))
        means.append(mean)
        rest += float(squares.sum())
    b = means[0] - means[1]
    share = sides[0] * sides[1] / (sides[0] + sides[1])  # variance of B_i is that of a reading over this
    freedom = len(values) - 2 * len(names)
    variance = rest / freedom if freedom > 0 else math.nan
    one, other = (4.0 * each for each in deviations)
    both = np.maximum(0.5 * (one + other) + np.abs(b), np.maximum(one, other))
    statistic = float(share @ b**2) / len(names) / variance if variance > 0.0 else math.nan
    return Reversal(
        leg=leg,
        targets=len(names),
        largest=float(np.abs(b).max()),
        at=names[int(np.abs(b).argmax())],
        mean=float(b.mean()),
        error=float(np.sqrt(variance * np.sum(1.0 / share)) / len(names)),
        forward=float(one.max()),
        backward=float(other.max()),
        both=float(both.max()),
        statistic=statistic,
        p=float(stats.f.sf(statistic, len(names), freedom)) if math.isfinite(statistic) else math.nan,
    )
