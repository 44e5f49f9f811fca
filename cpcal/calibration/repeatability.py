"""Whose scatter is it: the camera's, the leg sensors', or the robot's own? Estimated from repeated configurations.

A robot that does not come back to the same place moves the platform and its legs together. Camera and leg sensors
both see that motion, and the calibration equations hold all the same: it is no noise of theirs. With the legs' motion
m, the camera's noise c and the sensors' noise s, a repeat of configuration k deviates from the mean of its repeats by

    pose     c + J_k^-1 m             J_k: derivative of the leg lengths by the pose (n, 6)
    lengths  s + m                    so that   J_k (pose) - (lengths) = J_k c - s     is free of the motion

and their covariance is linear in those of the three sources,

    Sigma_k = [C 0; 0 S] + [J_k^-1; 1] M [J_k^-1; 1]'

which are estimated by maximum likelihood (Fisher scoring) from the scatter of all configurations. What camera and
sensors see differently and noise does not explain, such as backlash, ends up in C and S.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpcal.calibration.fit import LegEquations, Noise
from cpcal.calibration.statistics import LEVEL, ChannelStatistics, Deviations, campaign_deviations, group_means
from cpcal.common.files import listed
from cpcal.common.values import Floats, Ints
from cpcal.robot import Campaign

_ROUNDS = 6  # of Fisher scoring: the last one changes standard deviations by well below a percent
_FEWEST = 40  # degrees of freedom of the repeats from which three sources are told apart
_FLOOR = 1e-3  # of a channel's variance, below which scoring does not let its noise fall
_SEEN = 3.0  # standard errors from which the robot's own scatter is said to be seen


@dataclass(frozen=True, eq=False)
class Repeatability:
    """Covariances of single repeats, and what they were estimated from.

    camera     (6, 6) of position (mm) and rotation vector (rad) in the camera frame
    sensors    (n, n) mm^2 of the leg readings
    robot      (n, n) mm^2 of the legs' own motion; zero where none is seen beyond three of its standard errors
    told       whether the repeats are enough to tell the sources apart; if not, all scatter counts as noise
    noise_sigma     (6 + n,) standard deviations of camera and sensors alone
    robot_sigma     (n,) mm: how far the legs scatter between repeats themselves
    equation_sigma  (n,) mm: pooled standard deviation of g between repeats, leg by leg
    equations  (N, n) mm: deviations of g between the repeats of a configuration, J (pose) - (lengths)
    expected   (N, n) mm: their standard deviations by camera and sensors
    spread     what all of it is taken from
    """

    camera: Floats
    sensors: Floats
    robot: Floats
    told: bool
    noise_sigma: Floats
    robot_sigma: Floats
    equation_sigma: Floats
    equations: Floats
    expected: Floats
    spread: Deviations

    def noise(self, repeats: Ints) -> Noise:
        """Of the means of so many repeats (N,): what the calibration equations are off by."""
        sigma, share = self.noise_sigma[6:], 1.0 / np.asarray(repeats, dtype=np.float64)
        safe = np.where(sigma > 0.0, sigma, 1.0)
        correlation = np.where(np.eye(len(sigma)) == 1.0, 1.0, self.sensors / np.outer(safe, safe))
        length = np.sqrt(share)[:, None] * sigma
        return Noise(self.camera * share[:, None, None], length, correlation, float(self.spread.freedom))

    @property
    def sentence(self) -> str:
        """What scatters, in words."""
        legs, robot = self.equation_sigma, self.robot_sigma
        said = f"Between repeats the calibration equations scatter by {legs.min():.3g} to {legs.max():.3g} mm, by leg"
        if not self.told:
            return f"{said}; the repeats are too few to tell the robot's own scatter from that of camera and sensors."
        if not robot.any():
            return f"{said}. The robot itself comes back: no scatter of its own is seen beside camera's and sensors'."
        return (
            f"{said}. The ROBOT ITSELF SCATTERS by {robot.min():.2g} to {robot.max():.2g} mm, by leg, which camera and "
            "sensors both see: it is no noise of theirs, and counts neither in standard errors nor in reading sets."
        )


def repeatability(campaign: Campaign) -> Repeatability:
    """Of a campaign with several runs of its poses, at the joint centres of its robot (the drawing's will do).

    Raises InputError when nothing is repeated.
    """
    spread = campaign_deviations(campaign)
    by_pose = LegEquations.of(campaign).by_pose(campaign.robot.parameters)
    equations = np.einsum("kij,kj->ki", by_pose, spread.values[:, :6]) - spread.values[:, 6:]
    # the mean derivative of each configuration's repeats
    middle = group_means(by_pose.reshape(len(by_pose), -1), spread.group, len(spread.names))
    middle = middle.reshape(-1, *by_pose.shape[1:])
    parts = _told_apart(middle, spread)
    told = parts is not None
    if parts is None or not parts[2].any():  # the scatter itself tells the noise best
        all_of_it = spread.values.T @ spread.values / spread.freedom
        parts = all_of_it[:6, :6], all_of_it[6:, 6:], np.zeros_like(all_of_it[6:, 6:])
    camera, sensors, robot = parts
    of_mean = np.einsum("kij,jl,kml->kim", middle, camera, middle) + sensors
    return Repeatability(
        camera=camera,
        sensors=sensors,
        robot=robot,
        told=told,
        noise_sigma=np.sqrt(np.concatenate([np.diagonal(camera), np.diagonal(sensors)])),
        robot_sigma=np.sqrt(np.diagonal(robot)),
        equation_sigma=np.sqrt(np.sum(equations**2, axis=0) / spread.freedom),
        equations=equations,
        expected=np.sqrt(np.diagonal(of_mean, axis1=1, axis2=2))[spread.group],
        spread=spread,
    )


def _told_apart(by_pose: Floats, spread: Deviations) -> tuple[Floats, Floats, Floats] | None:
    """Camera, sensors and robot, the latter zero where it is not seen; None where there is too little."""
    scale = spread.sigma
    if spread.freedom < _FEWEST or not (scale > 0.0).all() or len(spread.names) < 7:
        return None
    count, legs = by_pose.shape[:2]
    # channels in units of their own scatter, so that nothing depends on mm against rad
    unit = float(np.median(scale[6:]))
    motion = np.concatenate(
        [np.linalg.pinv(by_pose * scale[:6]), np.broadcast_to(np.eye(legs), (count, legs, legs))], 1
    )
    motion[:, 6:] /= scale[6:, None]
    motion *= unit
    # what each unknown adds to the covariance of a configuration: 21 of the camera, then those of sensors and robot
    camera, leg = _symmetric(6), _symmetric(legs)
    sensors = slice(21, 21 + len(leg))
    basis = np.zeros((count, 21 + 2 * len(leg), 6 + legs, 6 + legs))
    basis[:, :21, :6, :6], basis[:, sensors, 6:, 6:] = camera, leg
    basis[:, sensors.stop :] = np.einsum("kai,pij,kbj->kpab", motion, leg, motion, optimize=True)
    scatter = np.zeros((count, 6 + legs, 6 + legs))
    values = spread.values / scale
    np.add.at(scatter, spread.group, values[:, :, None] * values[:, None, :])
    freedom = np.asarray(spread.repeats - 1.0, dtype=np.float64)
    size = 6 + legs
    covariance = np.broadcast_to(np.eye(size), (count, size, size))
    for _ in range(_ROUNDS):  # Fisher scoring of sums of squares with so many degrees of freedom each
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))[:, None]
        seen = (whiten @ basis @ np.swapaxes(whiten, -1, -2)).reshape(count, -1, size * size)
        given = (whiten[:, 0] @ scatter @ np.swapaxes(whiten[:, 0], -1, -2)).reshape(count, size * size)
        information = 0.5 * np.einsum("k,kpa,kqa->pq", freedom, seen, seen, optimize=True)
        found = np.linalg.lstsq(information, 0.5 * np.einsum("kpa,ka->p", seen, given), rcond=None)[0]
        parts = [
            _positive(np.einsum("p,pij->ij", found[which], unknowns))
            for which, unknowns in ((slice(21), camera), (sensors, leg), (slice(sensors.stop, None), leg))
        ]
        safe = [part + floor * np.eye(len(part)) for part, floor in zip(parts, (_FLOOR, _FLOOR, 0.0), strict=True)]
        flat = np.concatenate([part[np.triu_indices(len(part))] for part in safe])
        covariance = np.einsum("p,kpab->kab", flat, basis)
    error = np.sqrt(np.diagonal(np.linalg.inv(information)))[sensors.stop :]
    seen_legs = np.diagonal(parts[2]) > _SEEN * error[np.flatnonzero(np.equal(*np.triu_indices(legs)))]
    return (
        parts[0] * np.outer(scale[:6], scale[:6]),
        parts[1] * np.outer(scale[6:], scale[6:]),
        parts[2] * unit**2 * seen_legs.any(),
    )


def _symmetric(size: int) -> Floats:
    """(size (size + 1) / 2, size, size): the unit symmetric matrices, row by row of the upper triangle."""
    rows, columns = np.triu_indices(size)
    out = np.zeros((len(rows), size, size))
    each = np.arange(len(rows))
    out[each, rows, columns] = out[each, columns, rows] = 1.0
    return out


def _positive(matrix: Floats) -> Floats:
    """The nearest positive semidefinite matrix."""
    values, axes = np.linalg.eigh(matrix)
    return np.asarray((axes * np.maximum(values, 0.0)) @ axes.T)


# ------------------------------------------------------------------------------------------------------------------
# Do repeats scatter as independent noise does? Drift, play, and shapes that are not normal.
#
# All tests of a study are corrected for their number (Bonferroni), so that a good study has one false alarm among all
# of them in a hundred at level 0.01:
#
#     runs         analysis of variance: do runs have means of their own, over all configurations? (drift, warming up)
#     variances    Bartlett's test: do configurations scatter alike? (play that only some loads take up)
#     normality    Shapiro and Wilk's
#
# Channels are the readings themselves and, leg by leg, g between repeats (`Repeatability.equations`) in standard
# deviations that camera and sensors explain. There the robot's own scatter is no disturbance, and play is plain, which
# the length sensors of the legs do not see and the camera does.

RUNS, VARIANCES = "runs", "variances"
KINDS = {  # what is said where a test says no, where all say yes, and what may be the cause
    RUNS: ("RUNS DIFFER", "Runs do not differ", "drift, or something changed between them"),
    VARIANCES: ("CONFIGURATIONS SCATTER DIFFERENTLY", "Configurations scatter alike", "play or stick-slip"),
}


@dataclass(frozen=True)
class RepeatTest:
    """One test of one channel: `statistic` F of "runs", chi-square over its degrees of freedom of "variances"; `p` is
    corrected for the number of tests."""

    kind: str
    channel: str
    statistic: float
    p: float


@dataclass(frozen=True)
class RepeatTests:
    """All that a study's repeats were tested for, and how many tests they were with those of the channels' shapes."""

    tests: tuple[RepeatTest, ...]
    count: int

    def __post_init__(self) -> None:
        """Raises ValueError where p-values are none."""
        if any(not 0.0 <= test.p <= 1.0 for test in self.tests):
            raise ValueError("a test's p is not between 0 and 1")

    def found(self, kind: str, level: float = LEVEL) -> tuple[RepeatTest, ...]:
        """Tests of that kind that say no, the clearest first."""
        bad = [test for test in self.tests if test.kind == kind and test.p < level]
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
            least = min(test.p for test in self.tests if test.kind == kind)
            return f"{good}: of {made} channels none beyond chance (least p {least:.2g}, {about})."
        names = listed([test.channel for test in found], 6)
        return f"{bad}: {cause}? {names} (p {found[0].p:.2g}, {about})."


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
    tests = tuple(replace(test, p=min(1.0, count * test.p)) for test in made)
    return RepeatTests(tests, count), tuple(replace(one, tests=count) for one in statistics)


def _runs(channels: Sequence[str], values: Floats, group: Ints, runs: Sequence[str]) -> list[RepeatTest]:
    """Of two-way tables without interaction: what runs explain beside configurations (and directions)."""
    from scipy import stats  # here: it takes half a second to load, which certification need not wait for

    names, number = np.unique(np.array(runs), return_inverse=True)
    if len(names) < 2:
        return []
    count = int(group.max()) + 1
    values = values - group_means(values, group, count)[group]
    design = np.eye(len(names))[number, 1:]
    design -= group_means(design, group, count)[group]
    basis, sizes, _ = np.linalg.svd(design, full_matrices=False)
    basis = basis[:, sizes > 1e-9 * sizes[0]] if sizes[0] > 0.0 else basis[:, :0]
    between, rest = basis.shape[1], len(values) - count - basis.shape[1]
    if between < 1 or rest < 1:
        return []
    explained, total = np.sum((basis.T @ values) ** 2, axis=0), np.sum(values**2, axis=0)
    tests = []
    for name, part, whole in zip(channels, explained, total, strict=True):
        left = whole - part
        if left > 1e-12 * whole:
            f = float((part / between) / (left / rest))
            p = float(stats.f.sf(f, between, rest))
            tests.append(RepeatTest(RUNS, name, f, p))
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
            size = float(found.statistic) / (len(groups) - 1)
            tests.append(RepeatTest(VARIANCES, name, size, float(found.pvalue)))
    return tests
