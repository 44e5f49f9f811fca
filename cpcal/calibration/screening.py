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
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem

_QUARTILE = 0.6744897501960817  # of |z| for a standard normal z
_SAMPLES = 40_000  # groups that the medians of small groups are simulated with: to about 0.005
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
    def keep(self) -> npt.NDArray[np.bool_]:
        """(N,) which readings are within the threshold in every channel."""
        return np.asarray(np.isin(np.arange(len(self.scores)), self.rows, invert=True))

    @property
    def sentence(self) -> str:
        """How many, which, in which channel most."""
        beyond = f"beyond {self.threshold:g} robust standard deviations of their configuration's median"
        if not self.rows:
            said = f"None of {len(self.scores)} readings is {beyond}."
        else:
            worst = [int(np.argmax(np.abs(self.scores[row]))) for row in self.rows]
            listed = [
                f"{name} ({self.channels[k]}: {self.scores[row, k]:+.3g})"
                for row, name, k in zip(self.rows, self.names, worst, strict=True)
            ]
            more = f" and {len(listed) - 10} more" if len(listed) > 10 else ""
            said = f"{len(self.rows)} of {len(self.scores)} readings are {beyond}: {', '.join(listed[:10])}{more}."
        if self.untested:
            said += f" Not tested, as most of their readings agree exactly: {', '.join(self.untested)}."
        return said


def screen(deviations: Deviations, threshold: float = 5.0) -> Screening:
    """Which readings lie beyond `threshold` robust standard deviations in some channel.

    At 5, chance alone names one of about 1.7 million normal readings; fewer than half of a configuration's readings,
    and of a channel's, must be wrong.
    """
    if not 0 < threshold < np.inf:
        raise InputError(
            [Problem("option threshold", f"has no meaning: {threshold!r}", "give a number > 0, such as 5")]
        )
    distance = _from_medians(deviations)
    usual = np.array([_usual_distance(int(r)) for r in deviations.repeats])[deviations.group]
    several = usual > 0
    scale = np.median(np.abs(distance[several]) / usual[several, None], axis=0)
    tested = scale > 0
    scores = np.zeros_like(distance)
    scores[:, tested] = distance[:, tested] / scale[tested]
    rows = np.flatnonzero((np.abs(scores) > threshold).any(axis=1)).tolist()
    names = tuple(deviations.row_names[row] for row in rows)
    silent = tuple(name for name, good in zip(deviations.channels, tested, strict=True) if not good)
    return Screening(threshold, deviations.channels, scores, tuple(rows), names, silent)


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
