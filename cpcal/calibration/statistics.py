"""Statistics of repeated measurements: centred distributions and their spread (the paper, tables 2, 3, figures 3, 4).

A configuration (a commanded pose) is measured r times; a reading's deviation is from its configuration's mean. With N
readings in K configurations the standard deviation is sqrt(sum of squares / (N - K)): one degree of freedom is spent on
each mean. What all readings of a configuration have in common (a bias, a backlash always taken up from one side) is
in the mean and cannot be seen here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.files import listed
from cpcal.common.values import Bools, Floats, Ints, frozen_array
from cpcal.robot import Campaign, Uncertainty, quaternion_conjugate, quaternion_product, rotation_vector

POSE_CHANNELS = ("x", "y", "z", "rx", "ry", "rz")  # mm and rad


@dataclass(frozen=True, eq=False)
class Deviations:
    """N readings of C channels, each less its configuration's mean.

    names     of the K configurations, in the order of their first reading
    group     (N,) which configuration each reading belongs to, from 0
    row_names N texts that identify the readings
    channels  C names
    values    (N, C) deviations, in each channel's unit
    """

    names: tuple[str, ...]
    group: Ints
    row_names: tuple[str, ...]
    channels: tuple[str, ...]
    values: Floats

    @cached_property
    def repeats(self) -> Ints:
        """(K,) readings of each configuration."""
        return np.bincount(self.group, minlength=len(self.names)).astype(np.int64)

    @property
    def freedom(self) -> int:
        """N - K."""
        return len(self.group) - len(self.names)

    @cached_property
    def sigma(self) -> Floats:
        """(C,) standard deviations of one reading, pooled over the configurations, divisor N - K."""
        return np.asarray(np.sqrt(np.sum(self.values**2, axis=0) / self.freedom))

    @cached_property
    def errors(self) -> Floats:
        """(N', C) deviations times sqrt(r / (r - 1)), of configurations with r >= 2.

        A deviation from the mean of r readings has (r - 1) / r of a reading's variance; these have all of it, and stand
        for the errors of single readings in what follows (they are nearly independent when r is large).
        """
        r = self.repeats[self.group]
        several = r > 1
        return np.asarray(self.values[several] * np.sqrt(r[several] / (r[several] - 1.0))[:, None])

    def without(self, rows: Sequence[int]) -> Deviations:
        """With these readings left out, and means and deviations formed again."""
        keep = np.setdiff1d(np.arange(len(self.group)), np.asarray(rows, dtype=np.int64))
        names = [self.names[k] for k in self.group[keep]]
        return deviations(names, self.values[keep], self.channels, [self.row_names[k] for k in keep])


def deviations(
    configuration: Sequence[Hashable],
    values: npt.ArrayLike,
    channels: Sequence[str] | None = None,
    row_names: Sequence[str] | None = None,
) -> Deviations:
    """Of a table of N readings: the configuration of each, and values (N, C) of C channels in any units.

    For rotations use `campaign_deviations`, which averages them as rotations. Raises InputError when the table is no
    table of finite numbers, or nothing is repeated.
    """
    try:
        table = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError([Problem("readings", str(error), "give numbers, (N, C)")]) from None
    if table.ndim != 2 or len(table) != len(configuration) or not table.size:
        what = f"have the shape {table.shape} for {len(configuration)} configurations"
        raise InputError([Problem("readings", what, "give one row for each reading, (N, C)")])
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(bad):
        raise InputError([Problem("readings", f"row {bad[0]} holds a NaN or an infinity", "give finite numbers")])
    titles = tuple(f"c{k}" for k in range(table.shape[1])) if channels is None else tuple(channels)
    labels = tuple(f"row {k}" for k in range(len(table))) if row_names is None else tuple(row_names)
    if len(titles) != table.shape[1] or len(labels) != len(table):
        raise InputError([Problem("readings", "names do not fit the table", "name each channel and each row once")])
    group, names = grouped(configuration)
    centred = table - group_means(table, group, len(names))[group]
    return Deviations(names, group, labels, titles, frozen_array(centred))


def campaign_deviations(campaign: Campaign) -> Deviations:
    """Of a campaign whose poses were measured in several runs: position (mm), rotation (rad) and leg readings (mm).

    Channels x y z rx ry rz L1 ... Ln. A rotation deviates from its configuration's mean rotation by the vector t with
    R = R(t) R_mean, in the base frame, as in the reading sets.
    """
    group, names = grouped(campaign.pose)
    mean = mean_rotations(campaign.quaternion, group, len(names))[group]
    turned = rotation_vector(quaternion_product(campaign.quaternion, quaternion_conjugate(mean)))
    channels = (*POSE_CHANNELS, *(f"L{leg}" for leg in range(1, campaign.legs + 1)))
    table = np.concatenate([campaign.position, turned, campaign.length], axis=1)
    return deviations(campaign.pose, table, channels, campaign.measurement_ids)


def mean_rotations(quaternion: Floats, group: Ints, count: int) -> Floats:
    """(count, 4) unit quaternions, scalar >= 0: of each group, that with the least sum of squared chords to all.

    The main eigenvector of sum q q' (Markley, Cheng, Crassidis and Oshman 2007), for which q and -q are the same.
    """
    outer = np.zeros((count, 4, 4))
    np.add.at(outer, group, quaternion[:, :, None] * quaternion[:, None, :])
    mean = np.linalg.eigh(outer)[1][:, :, -1]
    return np.asarray(np.where(mean[:, :1] < 0, -mean, mean))


def grouped(configuration: Sequence[Hashable], *, repeated: bool = True) -> tuple[Ints, tuple[str, ...]]:
    """The number of each row's configuration, and the configurations' names.

    Raises InputError if none is repeated, where that is asked for.
    """
    number: dict[Hashable, int] = {}
    group = np.array([number.setdefault(name, len(number)) for name in configuration], dtype=np.int64)
    if repeated and len(number) == len(group):
        what = f"holds each of its {len(group)} configurations once"
        remedy = "measure configurations several times: pose repeats, run differs"
        raise InputError([Problem("table of repeats", what, remedy)])
    return group, tuple(str(name) for name in number)


def group_means(table: Floats, group: Ints, count: int) -> Floats:
    """(count, C) means of each group's rows."""
    total = np.zeros((count, table.shape[1]))
    np.add.at(total, group, table)
    return np.asarray(total / np.bincount(group, minlength=count)[:, None])


# ------------------------------------------------------------------------------------------------------------------
# Half-widths of reading sets; among them distribution-free tolerance limits from order statistics (Wilks 1941).
#
# Sort n independent errors from any continuous distribution by their size. The values up to the one that leaves m of
# the
# n + 1 gaps above it hold a share of the distribution that is Beta(n + 1 - m, m) distributed, whatever the
# distribution.
# So they hold at least `coverage` of it with the probability I_{1 - coverage}(m, n + 1 - m): the confidence.

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


# ------------------------------------------------------------------------------------------------------------------
# From repeated measurements to a campaign of their means, with reading sets taken from their scatter.
#
# The centres are means of a configuration's readings: positions and leg readings as they are, rotations by
# `mean_rotations`. What the half-widths stand for is a choice that changes their size by sqrt(r):
#
#     of="single"   how far a single reading lies from its true value: the paper's choice (section 5.1.1)
#     of="mean"     how far the mean of r readings does: sigma / sqrt(r), and by the central limit theorem nearly normal
#
# For the standard errors of a fit to the means (`Noise.of`) only the second is right; the first overstates them.
#
# Neither knows of errors that all readings of a configuration share, and no mean is free of them: their deviations are
# given as `shared` and added in quadrature. Where the robot itself scatters, the repeats'
# deviations are not the readings' errors: give those as `sigma` (`Repeatability.noise_sigma`).

Of = Literal["single", "mean"]


def averaged(
    campaign: Campaign,
    method: Method = "sigma",
    *,
    of: Of = "single",
    factor: float = 3.0,
    coverage: float = 0.95,
    confidence: float = 0.95,
    keep: npt.ArrayLike | None = None,
    sigma: npt.ArrayLike | None = None,
    shared: npt.ArrayLike | None = None,
) -> Campaign:
    """One measurement for each pose of the campaign: means over its runs, in the order of the poses' first readings.

    method, factor, coverage, confidence   as of `half_widths`
    of      whose half-widths: of "single" readings, or of the "mean" (method "sigma" only: nothing distribution-free is
            known of means that is not known of single readings)
    keep    (N,) which measurements to use, as of `Screening.keep`; left out: all
    sigma   (6 + n,) standard deviations of a reading's channels, mm and rad, in place of those of the repeats (method
            "sigma" only); then nothing need be repeated
    shared  (N, 6) standard deviations of an error of the poses that all measurements share, mm and rad (method "sigma"
            only): repeats neither show it nor make it smaller, so it enters in full, whichever half-widths are asked

    The new campaign's `run` is "mean", and its provenance says how it was made. Raises InputError when nothing is
    repeated, or for options without a meaning.
    """
    if of not in ("single", "mean"):
        raise InputError([Problem("option of", f"has no meaning: {of!r}", "give 'single' or 'mean'")])
    if of == "mean" and method != "sigma":
        what = f"'mean' has no meaning with method {method!r}"
        raise InputError([Problem("option of", what, 'use method="sigma", or half-widths of "single" readings')])
    used = campaign if keep is None else kept(campaign, keep)
    if sigma is None:
        widths = half_widths(campaign_deviations(used), method, factor=factor, coverage=coverage, confidence=confidence)
    else:
        widths = factor * _sigmas(sigma, method, campaign.legs)
    group, names = grouped(used.pose, repeated=sigma is None)
    repeats = np.bincount(group)
    shrink = np.sqrt(repeats[:, None]) if of == "mean" else np.ones((len(names), 1))
    radii = widths / shrink
    if shared is not None:
        radii[:, :6] = np.hypot(radii[:, :6], factor * _shared(shared, method, campaign, keep, group))
    said = _said((len(group), len(names)), method, of, factor, coverage, confidence)
    said += "" if shared is None else "; errors of camera and target that all images share are counted in full"
    return Campaign.of(
        campaign.robot,
        group_means(used.position, group, len(names)),
        mean_rotations(used.quaternion, group, len(names)),
        group_means(used.length, group, len(names)),
        pose=names,
        run=["mean"] * len(names),
        uncertainty=_declared(radii.max(axis=0), factor if method == "sigma" else None),
        position_radius=radii[:, :3],
        rotation_radius=radii[:, 3:6],
        length_radius=radii[:, 6:],
        provenance={**campaign.provenance, "averaged": said},
    )


def _declared(widths: Floats, factor: float | None) -> Uncertainty:
    """What holds for all rows: the largest half-widths, as standard deviations when they are multiples of such."""
    values = widths if factor is None else widths / factor
    return Uncertainty(values[:3], values[3:6], values[6:], factor)


def _sigmas(sigma: npt.ArrayLike, method: Method, legs: int) -> Floats:
    values = np.asarray(sigma, dtype=np.float64)
    if method != "sigma" or values.shape != (6 + legs,) or not (np.isfinite(values) & (values >= 0.0)).all():
        what = f"has the shape {values.shape}, with method {method!r}"
        raise InputError([Problem("option sigma", what, f'give {6 + legs} numbers >= 0, with method="sigma"')])
    return values


def _shared(
    shared: npt.ArrayLike, method: Method, campaign: Campaign, keep: npt.ArrayLike | None, group: Ints
) -> Floats:
    """(K, 6) of each configuration: the root mean square of its rows'."""
    values = np.asarray(shared, dtype=np.float64)
    if method != "sigma" or values.shape != (len(campaign), 6) or not (np.isfinite(values) & (values >= 0.0)).all():
        what = f"has the shape {values.shape}, with method {method!r}"
        raise InputError([Problem("option shared", what, f'give ({len(campaign)}, 6) >= 0, with method="sigma"')])
    used = values if keep is None else values[np.asarray(keep)]
    return np.asarray(np.sqrt(group_means(used**2, group, int(group.max()) + 1)))


def kept(campaign: Campaign, keep: npt.ArrayLike) -> Campaign:
    """The measurements with a true value in `keep` (N,), declared exact: half-widths come from the scatter."""
    mask = np.asarray(keep)
    if mask.shape != (len(campaign),) or mask.dtype != np.bool_:
        what = f"has the shape {mask.shape} and the type {mask.dtype}"
        raise InputError([Problem("option keep", what, f"give {len(campaign)} truth values")])
    rows = np.flatnonzero(mask).tolist()
    return Campaign.of(
        campaign.robot,
        campaign.position[rows],
        campaign.quaternion[rows],
        campaign.length[rows],
        pose=[campaign.pose[k] for k in rows],
        run=[campaign.run[k] for k in rows],
        exact=True,
    )


def _said(counts: tuple[int, int], method: Method, of: Of, factor: float, coverage: float, confidence: float) -> str:
    sets = {
        "sigma": f"{factor:g} standard deviations",
        "extreme": "the largest error seen",
        "tolerance": f"{coverage:g} of the errors with confidence {confidence:g}, from order statistics",
    }[method]
    whose = "single readings" if of == "single" else "the means"
    return f"{counts[0]} readings of {counts[1]} configurations; half-widths of {whose}: {sets}"


# ------------------------------------------------------------------------------------------------------------------
# Readings that stand out from the repeats of their configuration: told by median and MAD, which they cannot hide from.
#
# A reading's score is its distance from its configuration's median, in robust standard deviations of its channel:
# distances are divided by their own median over the whole channel. In a group of r readings distances from the
# group's median are smaller than from the centre (with r = 3 every third is zero), so each is first divided by the
# median that it has for r normal readings. In a group of two both are as far off: which of them is wrong cannot be
# told, and both are named.

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


# ------------------------------------------------------------------------------------------------------------------
# What the errors of repeated readings look like: spread, extremes, normal or not.
#
# Tests are of the errors pooled over all configurations (figures 3 and 4 of the paper). A spread that differs between
# configurations makes a pooled distribution with heavy tails.

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
