"""Do repeats scatter as independent noise does? Drift, play, and shapes that are not normal.

All tests of a study are corrected for their number (Bonferroni), so that a good study has one false alarm among all of
them in a hundred at level 0.01:

    runs         analysis of variance: do runs have means of their own, over all configurations? (drift, warming up)
    variances    Bartlett's test: do configurations scatter alike? (play that only some loads take up)
    normality    Shapiro and Wilk's

Channels are the readings themselves and, leg by leg, g between repeats (`Repeatability.equations`) in standard
deviations that camera and sensors explain. There the robot's own scatter is no disturbance, and play is plain, which
the length sensors of the legs do not see and the camera does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpcal.calibration.distribution import LEVEL, ChannelStatistics
from cpcal.calibration.repeatability import Repeatability
from cpcal.calibration.statistics import Deviations
from cpcal.common.arrays import Floats, Ints
from cpcal.common.names import listed

RUNS, VARIANCES = "runs", "variances"
KINDS = {  # what is said where a test says no, where all say yes, and what may be the cause
    RUNS: ("RUNS DIFFER", "Runs do not differ", "drift, or something changed between them"),
    VARIANCES: ("CONFIGURATIONS SCATTER DIFFERENTLY", "Configurations scatter alike", "play or stick-slip"),
}


@dataclass(frozen=True)
class RepeatTest:
    """One test of one channel: `statistic` F of "runs", chi-square over its degrees of freedom of "variances"; `p` as
    it is, and `corrected` for the number of tests."""

    kind: str
    channel: str
    statistic: float
    p: float
    corrected: float


@dataclass(frozen=True)
class RepeatTests:
    """All that a study's repeats were tested for, and how many tests they were with those of the channels' shapes."""

    tests: tuple[RepeatTest, ...]
    count: int

    def __post_init__(self) -> None:
        """Raises ValueError where p-values are none."""
        if any(not 0.0 <= p <= 1.0 for test in self.tests for p in (test.p, test.corrected)):
            raise ValueError("a test's p is not between 0 and 1")

    def found(self, kind: str, level: float = LEVEL) -> tuple[RepeatTest, ...]:
        """Tests of that kind that say no, the clearest first."""
        bad = [test for test in self.tests if test.kind == kind and test.corrected < level]
        return tuple(sorted(bad, key=lambda test: (test.p, -test.statistic)))

    @property
    def sentences(self) -> tuple[str, ...]:
        """One for each kind of test that was made."""
        return tuple(self.sentence(kind) for kind in KINDS if any(test.kind == kind for test in self.tests))

    def sentence(self, kind: str) -> str:
        """Which channels say no to that kind of test; ValueError where it was not made."""
        bad, good, cause = KINDS[kind]
        found, made = self.found(kind), sum(test.kind == kind for test in self.tests)
        about = f"corrected for {self.count} tests"
        if not found:
            least = min(test.corrected for test in self.tests if test.kind == kind)
            return f"{good}: of {made} channels none beyond chance (least p {least:.2g}, {about})."
        names = listed([test.channel for test in found], 6)
        return f"{bad}: {cause}? {names} (p {found[0].corrected:.2g}, {about})."


def repeat_tests(
    found: Repeatability, runs: Sequence[str], statistics: Sequence[ChannelStatistics]
) -> tuple[RepeatTests, tuple[ChannelStatistics, ...]]:
    """The tests, and the channels' statistics with their p-values corrected for the number of all tests.

    runs   the run of each of the rows that `found` is of
    """
    spread = found.spread
    legs = tuple(f"g of leg {k}" for k in range(1, found.equations.shape[1] + 1))
    safe = np.where(found.expected > 0.0, found.expected, 1.0)
    scaled = found.equations / safe
    every = np.concatenate([spread.values, scaled], axis=1)
    made = _runs((*spread.channels, *legs), every, spread.group, runs)
    made += _variances(legs, scaled, spread)
    shapes = sum(not math.isnan(one.shapiro) for one in statistics)
    count = len(made) + shapes
    tests = tuple(replace(test, corrected=min(1.0, count * test.p)) for test in made)
    return RepeatTests(tests, count), tuple(replace(one, tests=count) for one in statistics)


def _runs(channels: Sequence[str], values: Floats, group: Ints, runs: Sequence[str]) -> list[RepeatTest]:
    """Of two-way tables without interaction: what runs explain beside configurations (and directions)."""
    from scipy import stats  # here: it takes half a second to load, which certification need not wait for

    names = {name: k for k, name in enumerate(dict.fromkeys(runs))}
    number = np.array([names[name] for name in runs])
    if len(names) < 2:
        return []
    values = values - _group_means(values, group)
    design = np.zeros((len(values), len(names) - 1))
    chosen = number < len(names) - 1
    design[np.flatnonzero(chosen), number[chosen]] = 1.0
    design -= _group_means(design, group)
    basis, sizes, _ = np.linalg.svd(design, full_matrices=False)
    basis = basis[:, sizes > 1e-9 * sizes[0]] if sizes[0] > 0.0 else basis[:, :0]
    between, rest = basis.shape[1], len(values) - (int(group.max()) + 1) - basis.shape[1]
    if between < 1 or rest < 1:
        return []
    explained, total = np.sum((basis.T @ values) ** 2, axis=0), np.sum(values**2, axis=0)
    tests = []
    for name, part, whole in zip(channels, explained, total, strict=True):
        left = whole - part
        if left > 1e-12 * whole:
            f = float((part / between) / (left / rest))
            p = float(stats.f.sf(f, between, rest))
            tests.append(RepeatTest(RUNS, name, f, p, p))
    return tests


def _variances(legs: Sequence[str], scaled: Floats, spread: Deviations) -> list[RepeatTest]:
    from scipy import stats

    several = np.flatnonzero(spread.repeats > 2)
    if len(several) < 2:
        return []
    tests = []
    for name, values in zip(legs, scaled.T, strict=True):
        groups = [values[spread.group == k] for k in several]
        if min(float(np.var(one)) for one in groups) > 0.0:
            found = stats.bartlett(*groups)
            p, size = float(found.pvalue), float(found.statistic) / (len(groups) - 1)
            tests.append(RepeatTest(VARIANCES, name, size, p, p))
    return tests


def _group_means(values: Floats, group: Ints) -> Floats:
    total = np.zeros((int(group.max()) + 1, values.shape[1]))
    np.add.at(total, group, values)
    return np.asarray((total / np.bincount(group)[:, None])[group])
