"""Readings that stand out from the repeats of their configuration: told by median and MAD, which they cannot hide from.

A reading's score is its distance from its configuration's median, in robust standard deviations of its channel:
distances are divided by their own median over the whole channel. In a group of r readings distances from the
group's median are smaller than from the centre (with r = 3 every third is zero), so each is first divided by the
median that it has for r normal readings. In a group of two both are as far off: which of them is wrong cannot be
told, and both are named.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from cpcal.calibration.statistics import Deviations
from cpcal.common.arrays import Bools, Floats
from cpcal.common.errors import InputError, Problem
from cpcal.common.names import listed

THRESHOLD = 5.0  # robust standard deviations

_QUARTILE = 0.6744897501960817  # of |z| for a standard normal z
_SAMPLES = 40_000  # groups that the medians of small groups are simulated with: to about 0.005
_OUTLIERS_MAX = 0.1  # share of the readings
_LARGE = 64  # readings from which the group's median is as good as the centre


@dataclass(frozen=True, eq=False)
class Screening:
    """Scores (N, C) in robust standard deviations, and the readings with one beyond the threshold.

    channels   C names; untested: those where more than half of the readings agree exactly, whose MAD is zero
    rows       numbers of the outlying readings, from 0; names: what they are called
    """

    threshold: float
    channels: tuple[str, ...]
    scores: Floats
    rows: tuple[int, ...]
    names: tuple[str, ...]
    untested: tuple[str, ...]

    @property
    def too_many(self) -> bool:
        """Whether so many are beyond that they are no outliers, but how the readings are distributed."""
        return len(self.rows) > _OUTLIERS_MAX * len(self.scores)

    @property
    def left_out(self) -> tuple[str, ...]:
        """The names of the outliers; none where they are too many to be such."""
        return () if self.too_many else self.names

    @property
    def keep(self) -> npt.NDArray[np.bool_]:
        """(N,) which readings are within the threshold in every channel; all where too many are not."""
        if self.too_many:
            return np.ones(len(self.scores), dtype=np.bool_)
        return np.asarray(np.isin(np.arange(len(self.scores)), self.rows, invert=True))

    @property
    def sentence(self) -> str:
        """How many, which, in which channel most."""
        beyond = f"beyond {self.threshold:g} robust standard deviations of their configuration's median"
        if not self.rows:
            said = f"None of {len(self.scores)} readings is {beyond}."
        else:
            worst = [int(np.argmax(np.abs(self.scores[row]))) for row in self.rows]
            named = [
                f"{name} ({self.channels[k]}: {self.scores[row, k]:+.3g})"
                for row, name, k in zip(self.rows, self.names, worst, strict=True)
            ]
            said = f"{len(self.rows)} of {len(self.scores)} readings are {beyond}: {listed(named, 10)}."
        if self.too_many:
            said += (
                " These are TOO MANY FOR OUTLIERS, and none is left out: look for play, or a set-up that was changed."
            )
        if self.untested:
            said += f" Not tested, as most of their readings agree exactly: {', '.join(self.untested)}."
        return said


def screen(deviations: Deviations, threshold: float = THRESHOLD) -> Screening:
    """Which readings lie beyond `threshold` robust standard deviations in some channel.

    At 5, chance alone names one of about 1.7 million normal readings; fewer than half of a configuration's readings,
    and of a channel's, must be wrong.
    """
    if not 0 < threshold < np.inf:
        raise InputError(
            [Problem("option threshold", f"has no meaning: {threshold!r}", "give a number > 0, such as 5")]
        )
    return beyond(deviations, scores(deviations), threshold)


def scores(deviations: Deviations) -> Floats:
    """(N, C) distances from the medians in robust standard deviations; nan in channels that cannot be tested."""
    distance = _from_medians(deviations)
    usual = np.array([_usual_distance(int(r)) for r in deviations.repeats])[deviations.group]
    several = usual > 0
    scale = np.median(np.abs(distance[several]) / usual[several, None], axis=0)
    return np.asarray(distance / np.where(scale > 0, scale, np.nan))


def beyond(deviations: Deviations, values: Floats, threshold: float) -> Screening:
    """The readings with a score (N, C) beyond the threshold."""
    silent: Bools = np.asarray(np.isnan(values).all(axis=0))
    known = np.where(np.isnan(values), 0.0, values)
    rows = np.flatnonzero((np.abs(known) > threshold).any(axis=1)).tolist()
    names = tuple(deviations.row_names[row] for row in rows)
    untested = tuple(name for name, quiet in zip(deviations.channels, silent, strict=True) if quiet)
    return Screening(threshold, deviations.channels, known, tuple(rows), names, untested)


def _from_medians(deviations: Deviations) -> Floats:
    """(N, C) readings less their configuration's median."""
    distance = np.empty_like(deviations.values)
    for rows in np.split(np.argsort(deviations.group, kind="stable"), np.cumsum(deviations.repeats)[:-1]):
        distance[rows] = deviations.values[rows] - np.median(deviations.values[rows], axis=0)
    return distance


@lru_cache(maxsize=_LARGE)
def _usual_distance(repeats: int) -> float:
    """The median of |z - median of the group| for groups of that many standard normal z; 0 for a single one."""
    if repeats == 1:
        return 0.0
    if repeats >= _LARGE:
        return _QUARTILE
    draw = np.random.default_rng(repeats).standard_normal((_SAMPLES, repeats))
    return float(np.median(np.abs(draw - np.median(draw, axis=1, keepdims=True))))
