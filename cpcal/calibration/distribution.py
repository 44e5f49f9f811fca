"""What the errors of repeated readings look like: spread, extremes, normal or not.

Tests are of the errors pooled over all configurations (figures 3 and 4 of the paper). A spread that differs between
configurations makes a pooled distribution with heavy tails.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpcal.calibration.statistics import Deviations
from cpcal.common.arrays import Floats

LEVEL = 0.01  # probability of a word in capitals for a study in which all is well
_SHAPIRO_MAX = 5000  # readings; beyond, scipy's p-value is not accurate
_DAGOSTINO_MIN = 20


@dataclass(frozen=True)
class ChannelStatistics:
    """Of one channel, in its own unit; p-values are nan where a test does not apply.

    sigma       standard deviation of one reading (tables 2 and 3)
    extreme     largest error
    skewness, kurtosis    of the errors; 0 and 0 (excess) for a normal distribution
    dagostino   p-value of D'Agostino and Pearson's test: skewness and kurtosis of a normal distribution. Not used: far
                out its law is not chi-square, and of normal samples of 704 readings 3.5 times as many as should have p
                below 0.00015, where the words' level lies
    shapiro     p-value of Shapiro and Wilk's, by which the words go (0.8 times as many); of every second, third, ...
                reading where there are more than 5000
    tests       how many tests the p-values are among: the words take it into account (Bonferroni)
    """

    name: str
    readings: int
    sigma: float
    extreme: float
    skewness: float
    kurtosis: float
    dagostino: float
    shapiro: float
    tests: int = 1

    def not_normal(self, level: float = LEVEL) -> bool:
        """`level` is the probability of calling a good channel bad among all `tests`; False where it is not tested."""
        return self.shapiro < level / self.tests

    def sentence(self, level: float = LEVEL) -> str:
        """The channel in words."""
        spread = f"{self.name}: standard deviation {self.sigma:.3g}, largest error {self.extreme:.3g}"
        tested = not math.isnan(self.shapiro)
        shape = "not tested for normality" if not tested else "NOT NORMAL" if self.not_normal(level) else "looks normal"
        return f"{spread} ({self.readings} readings); {shape}."


def describe(deviations: Deviations, chosen: slice = slice(None)) -> tuple[ChannelStatistics, ...]:
    """Statistics of every channel, or of the chosen ones."""
    columns = list(zip(deviations.channels, deviations.sigma, deviations.errors.T, strict=True))
    return tuple(_described(name, float(sigma), errors) for name, sigma, errors in columns[chosen])


def _described(name: str, sigma: float, errors: Floats) -> ChannelStatistics:
    from scipy import stats  # here: it takes half a second to load, which certification need not wait for

    count, scatters = len(errors), sigma > 0.0
    thinned = errors[:: -(-count // _SHAPIRO_MAX)]

    def tested(statistic: Callable[[], Any], applies: bool = True) -> float:
        return float(statistic()) if scatters and applies else math.nan

    return ChannelStatistics(
        name=name,
        readings=count,
        sigma=sigma,
        extreme=float(np.max(np.abs(errors))),
        skewness=tested(lambda: stats.skew(errors)),
        kurtosis=tested(lambda: stats.kurtosis(errors)),
        dagostino=tested(lambda: stats.normaltest(errors).pvalue, count >= _DAGOSTINO_MIN),
        shapiro=tested(lambda: stats.shapiro(thinned).pvalue, count >= 3),
    )
