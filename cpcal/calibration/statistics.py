"""Repeated measurements: their spread, means, outliers, and whose scatter it is (the paper, tables 2 and 3).

A configuration (a commanded pose) is measured r times; a reading's deviation is from its configuration's mean. With N
readings in K configurations the standard deviation is sqrt(sum of squares / (N - K)): one degree of freedom is spent on
each mean. What all readings of a configuration have in common (a bias, a backlash always taken up from one side) is
in the mean and cannot be seen here.
"""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from cpcal.calibration.fit import Noise
from cpcal.common.errors import refuse, unusable
from cpcal.common.files import listed
from cpcal.common.values import ArrayLike, ArrayPair, Bools, Floats, Ints, Names, Places, Texts, floats, frozen_array
from cpcal.robot import Campaign, LegEquations, PoseTable, Robot, Uncertainty, turn_between
from cpcal.robot.units import AXES, leg_columns


class Deviations(NamedTuple):
    """N readings of C channels, each less its configuration's mean.

    names     of the K configurations, in the order of their first reading
    group     (N,) which configuration each reading belongs to, from 0
    row_names N texts that identify the readings
    channels  C names
    values    (N, C) deviations, in each channel's unit
    repeats   (K,) readings of each configuration
    freedom   N - K
    sigma     (C,) standard deviations of one reading, pooled over the configurations, divisor N - K
    """

    names: Names
    group: Ints
    row_names: Names
    channels: Names
    values: Floats
    repeats: Ints
    freedom: int
    sigma: Floats


def deviations(
    configuration: Sequence[Hashable], values: Floats, channels: Sequence[str], row_names: Sequence[str]
) -> Deviations:
    """Of a table of N readings: the configuration of each, and finite values (N, C) of C channels in any units.

    For rotations use `campaign_deviations`, which averages them as rotations. Raises InputError when nothing is
    repeated.
    """
    group, names = grouped(configuration)
    centred = values - group_means(values, group, len(names))[group]
    repeats, freedom = np.bincount(group, minlength=len(names)).astype(np.int64), len(group) - len(names)
    sigma = np.sqrt(np.sum(centred**2, axis=0) / freedom)
    identified = names, group, tuple(row_names), tuple(channels)
    return Deviations(*identified, frozen_array(centred), repeats, freedom, sigma)


def campaign_deviations(campaign: Campaign) -> Deviations:
    """Of a campaign whose poses were measured in several runs: position (mm), rotation (rad) and leg readings (mm).

    Channels x y z rx ry rz L1 ... Ln. A rotation deviates from its configuration's mean rotation by the vector t with
    R = R(t) R_mean, in the base frame, as in the reading sets.
    """
    group, names = grouped(campaign.pose)
    mean = mean_rotations(campaign.quaternion, group, len(names))[group]
    turned = turn_between(campaign.quaternion, mean)
    channels = (*AXES, *leg_columns(campaign.legs))
    table = np.hstack([campaign.position, turned, campaign.length])
    return deviations(campaign.pose, table, channels, campaign.measurement_ids)


def mean_rotations(quaternion: Floats, group: Ints, count: int) -> Floats:
    """(count, 4) unit quaternions, scalar >= 0: of each group, that with the least sum of squared chords to all.

    The main eigenvector of sum q q' (Markley, Cheng, Crassidis and Oshman 2007), for which q and -q are the same.
    """
    outer = np.zeros((count, 4, 4))
    np.add.at(outer, group, quaternion[:, :, None] * quaternion[:, None, :])
    mean = np.linalg.eigh(outer)[1][:, :, -1]
    return np.where(mean[:, :1] < 0, -mean, mean)


def means(campaign: Campaign, group: Ints, count: int) -> tuple[Floats, Floats, Floats]:
    """Position, quaternion and length of the means of a campaign's groups, as `Campaign.of` takes them."""
    position, length = (group_means(table, group, count) for table in (campaign.position, campaign.length))
    return position, mean_rotations(campaign.quaternion, group, count), length


def grouped(configuration: Sequence[Hashable], *, repeated: bool = True) -> tuple[Ints, Names]:
    """The number of each row's configuration, and the configurations' names.

    Raises InputError if none is repeated, where that is asked for.
    """
    number: dict[Hashable, int] = {}
    group = np.array([number.setdefault(name, len(number)) for name in configuration], np.int64)
    if repeated and len(number) == len(group):
        what = f"holds each of its {len(group)} configurations once"
        raise unusable("table of repeats", what, "measure configurations several times: pose repeats, run differs")
    return group, tuple(str(name) for name in number)


def group_means(table: Floats, group: Ints, count: int) -> Floats:
    """(count, C) means of each group's rows."""
    total = np.zeros((count, table.shape[1]))
    np.add.at(total, group, table)
    return total / np.bincount(group, minlength=count)[:, None]


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
    *,
    of: Of = "single",
    factor: float = 3.0,
    sigma: ArrayLike | None = None,
    shared: ArrayLike | None = None,
) -> Campaign:
    """One measurement for each pose of the campaign: means over its runs, in the order of the poses' first readings.

    of      whose half-widths: of "single" readings, or of the "mean"
    factor  of the standard deviations (the paper's 3: 99.7 % of normal errors)
    sigma   (6 + n,) standard deviations of a reading's channels, mm and rad, in place of those of the repeats; then
            nothing need be repeated
    shared  (N, 6) standard deviations of an error of the poses that all measurements share, mm and rad: repeats neither
            show it nor make it smaller, so it enters in full, whichever half-widths are asked

    The new campaign's `run` is "mean", and its provenance says how it was made. Raises InputError when nothing is
    repeated, or for options without a meaning.
    """
    refuse(
        (of not in ("single", "mean"), "option of", f"has no meaning: {of!r}", "give 'single' or 'mean'"),
        (not 0 < factor < np.inf, "option factor", f"has no meaning: {factor!r}", "give a number > 0"),
    )
    given = None if sigma is None else floats(sigma)
    group, names = grouped(campaign.pose, repeated=given is None)
    widths = np.tile(factor * (campaign_deviations(campaign).sigma if given is None else given), (len(names), 1))
    if of == "mean":
        widths /= np.sqrt(np.bincount(group))[:, None]
    said = f"{len(group)} readings of {len(names)} configurations; half-widths of "
    said += f"{'single readings' if of == 'single' else 'the means'}: {factor:g} standard deviations"
    if shared is not None:
        square = group_means(floats(shared) ** 2, group, len(names))
        widths[:, :6] = np.hypot(widths[:, :6], factor * np.sqrt(square))
        said += "; errors of camera and target that all images share are counted in full"
    largest = widths.max(axis=0) / factor  # what holds for all rows
    return Campaign.of(
        campaign.robot,
        *means(campaign, group, len(names)),
        pose=names,
        run=["mean"] * len(names),
        uncertainty=Uncertainty(largest[:3], largest[3:6], largest[6:], factor),
        position_radius=widths[:, :3],
        rotation_radius=widths[:, 3:6],
        length_radius=widths[:, 6:],
        provenance={**campaign.provenance, "averaged": said},
    )


# ------------------------------------------------------------------------------------------------------------------
# Readings that stand out from the repeats of their configuration: told by median and MAD, which they cannot hide from.
#
# A reading's score is its distance from its configuration's median, in robust standard deviations of its channel, which
# the median of differences between its repeats tells. In a group of two both are as far off: which of them is wrong
# cannot be told, and both are named.

THRESHOLD = 5.0  # robust standard deviations

_DIFFERENCE = 0.9538725524175594  # median of the difference of two normal numbers, in their standard deviations
_OUTLIERS_MAX = 0.1  # share of the readings


class Screening(NamedTuple):
    """Scores (N, C) in robust standard deviations, and the readings with one beyond `THRESHOLD`.

    channels   C names; untested: those where more than half of the readings agree exactly, whose MAD is zero
    rows       numbers of the outlying readings, from 0; names: what they are called
    too_many   whether so many are beyond that they are no outliers, but how the readings are distributed
    keep       (N,) which readings are within the threshold in every channel; all where too many are not
    left_out   the names of the outliers; none where they are too many to be such
    """

    channels: Names
    scores: Floats
    rows: Places
    names: Names
    untested: Names
    too_many: bool
    keep: Bools
    left_out: Names

    @property
    def sentence(self) -> str:
        """How many, which, in which channel most."""
        beyond = f"beyond {THRESHOLD:g} robust standard deviations of their configuration's median"
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


def screen(deviations: Deviations, values: Floats | None = None) -> Screening:
    """Which readings lie beyond 5 robust standard deviations in some channel; `values` (N, C) in place of `scores`.

    Chance alone names one of about 1.7 million normal readings; fewer than half of a configuration's readings, and a
    quarter of a channel's, must be wrong.
    """
    found = scores(deviations) if values is None else values
    silent = np.asarray(np.isnan(found).all(axis=0))
    known = np.where(np.isnan(found), 0.0, found)
    beyond = np.asarray((np.abs(known) > THRESHOLD).any(axis=1))
    rows, too_many = tuple(np.flatnonzero(beyond).tolist()), beyond.sum() > _OUTLIERS_MAX * len(beyond)
    untested = tuple(name for name, quiet in zip(deviations.channels, silent, strict=True) if quiet)
    names = tuple(deviations.row_names[row] for row in rows)
    keep, left_out = (np.ones_like(beyond), ()) if too_many else (~beyond, names)
    return Screening(deviations.channels, known, rows, names, untested, bool(too_many), keep, left_out)


def scores(deviations: Deviations) -> Floats:
    """(N, C) distances from the medians in robust standard deviations; nan in channels that cannot be tested."""
    distance, apart = np.empty_like(deviations.values), np.empty_like(deviations.values)
    for rows in np.split(np.argsort(deviations.group, kind="stable"), np.cumsum(deviations.repeats)[:-1]):
        own = deviations.values[rows]
        distance[rows], apart[rows] = own - np.median(own, axis=0), own - np.roll(own, len(own) // 2, axis=0)
    scale = np.median(np.abs(apart[deviations.repeats[deviations.group] > 1]), axis=0) / _DIFFERENCE
    return distance / np.where(scale > 0, scale, np.nan)


# ------------------------------------------------------------------------------------------------------------------
# Whose scatter is it: the camera's, the leg sensors', or the robot's own? Estimated from repeated configurations.
#
# A robot that does not come back to the same place moves the platform and its legs together. Camera and leg sensors
# both see that motion, and the calibration equations hold all the same: it is no noise of theirs. With the legs' motion
# m, the camera's noise c and the sensors' noise s, a repeat of configuration k deviates from the mean of its repeats by
#
#     pose     c + J_k^-1 m             J_k: derivative of the leg lengths by the pose (n, 6)
#     lengths  s + m                    so that   J_k (pose) - (lengths) = J_k c - s     is free of the motion
#
# so the products of J_k (pose) and (lengths) tell the variances of m alone, and those of their difference are linear in
# the covariances of the other two, J_k C J_k' + S: by weighted least squares over all configurations. What camera and
# sensors see differently and noise does not explain, such as backlash, ends up in C and S.

_FEWEST = 40  # degrees of freedom of the repeats from which three sources are told apart
_ROUNDS = 3  # of weights
_FLOOR = 1e-3  # of a channel's variance, below which its noise is not said to be
_SEEN = 3.0  # standard errors from which the robot's own scatter is said to be seen


class Repeatability(NamedTuple):
    """Covariances of single repeats, and what they were estimated from.

    camera     (6, 6) of position (mm) and rotation vector (rad) in the camera frame
    told       whether the repeats are enough to tell the sources apart; if not, all scatter counts as noise
    noise_sigma     (6 + n,) standard deviations of camera and sensors alone; sensors are independent of one another
    robot_sigma     (n,) mm: how far the legs scatter between repeats themselves; zero where none is seen beyond three
                    of its standard errors
    equation_sigma  (n,) mm: pooled standard deviation of g between repeats, leg by leg
    equations  (N, n) mm: deviations of g between the repeats of a configuration, J (pose) - (lengths)
    expected   (N, n) mm: their standard deviations by camera and sensors
    spread     what all of it is taken from
    """

    camera: Floats
    told: bool
    noise_sigma: Floats
    robot_sigma: Floats
    equation_sigma: Floats
    equations: Floats
    expected: Floats
    spread: Deviations

    def noise(self, repeats: Ints) -> Noise:
        """Of the means of so many repeats (N,): what the calibration equations are off by."""
        share = 1.0 / floats(repeats)
        length = np.sqrt(share)[:, None] * self.noise_sigma[6:]
        return Noise(self.camera * share[:, None, None], length, float(self.spread.freedom))

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
    # the scatter itself tells the noise best, unless the robot is seen to add to it
    camera, sensors = spread.values[:, :6].T @ spread.values[:, :6] / spread.freedom, spread.sigma[6:] ** 2
    robot, legs = np.zeros(campaign.legs), spread.values[:, 6:]
    told = bool(spread.freedom >= _FEWEST and len(spread.names) > 6 and (spread.sigma > 0.0).all())
    if told:
        moved = legs + equations
        common = np.sum(moved * legs, axis=0) / spread.freedom
        error = np.sqrt(np.sum(moved**2, axis=0) * np.sum(legs**2, axis=0) / spread.freedom**3)
        if (common > _SEEN * error).any():
            robot = np.maximum(common, 0.0)
            camera, sensors = _camera_and_sensors(middle, equations, spread)
    of_mean = np.einsum("kij,jl,kil->ki", middle, camera, middle) + sensors
    return Repeatability(
        camera=camera,
        told=told,
        noise_sigma=np.sqrt(np.concatenate([np.diagonal(camera), sensors])),
        robot_sigma=np.sqrt(robot),
        equation_sigma=np.sqrt(np.sum(equations**2, axis=0) / spread.freedom),
        equations=equations,
        expected=np.sqrt(of_mean)[spread.group],
        spread=spread,
    )


def _camera_and_sensors(by_pose: Floats, equations: Floats, spread: Deviations) -> ArrayPair:
    """The camera's covariance (6, 6) and the variances (n,) of the sensors, of what is free of the robot's motion."""
    scale, (rows, columns), still = spread.sigma, np.triu_indices(6), np.eye(by_pose.shape[1])
    scatter = np.zeros((len(by_pose), *still.shape))
    np.add.at(scatter, spread.group, equations[:, :, None] * equations[:, None, :])
    # what each unknown adds to the covariance of a configuration, in units of its channels' scatter
    seen = by_pose * scale[:6]
    both = seen[:, :, None, rows] * seen[:, None, :, columns]
    own = np.broadcast_to(still[:, None] * still * scale[6:] ** 2, (len(seen), *still.shape, len(still)))
    basis = np.concatenate([both + both.swapaxes(1, 2), own], axis=3)
    weight = np.linalg.inv(scatter.sum(axis=0) / spread.freedom) + 0.0 * scatter
    for _ in range(_ROUNDS):
        part = np.einsum("kab,kbcp,kcd->kadp", weight, basis, weight, optimize=True)
        information = np.einsum("k,kabp,kabq->pq", spread.repeats - 1.0, part, basis, optimize=True)
        found = np.linalg.lstsq(information, np.einsum("kabp,kab->p", part, scatter), rcond=None)[0]
        half = np.zeros((6, 6))
        half[rows, columns] = found[:21]
        values, axes = np.linalg.eigh(half + half.T)
        camera = (axes * np.maximum(values, _FLOOR)) @ axes.T
        sensors = np.maximum(found[21:], _FLOOR)
        weight = np.linalg.inv(seen @ camera @ seen.swapaxes(1, 2) + np.diag(sensors * scale[6:] ** 2))
    return camera * np.outer(scale[:6], scale[:6]), sensors * scale[6:] ** 2


# ------------------------------------------------------------------------------------------------------------------
# Do repeats scatter as independent noise does? Drift and play.
#
# All tests of a study are corrected for their number (Bonferroni), so that a good study has one false alarm among all
# of them in a hundred at level 0.01:
#
#     runs         analysis of variance: do runs have means of their own, over all configurations? (drift, warming up)
#     variances    Bartlett's test: do configurations scatter alike? (play that only some loads take up)
#
# Channels are the readings themselves and, leg by leg, g between repeats (`Repeatability.equations`) in standard
# deviations that camera and sensors explain. There the robot's own scatter is no disturbance, and play is plain, which
# the length sensors of the legs do not see and the camera does.

LEVEL = 0.01  # probability of a word in capitals for a study in which all is well
RUNS, VARIANCES = "runs", "variances"
KINDS = {  # what is said where a test says no, where all say yes, and what may be the cause
    RUNS: ("RUNS DIFFER", "Runs do not differ", "drift, or something changed between them"),
    VARIANCES: ("CONFIGURATIONS SCATTER DIFFERENTLY", "Configurations scatter alike", "play or stick-slip"),
}
Tests = tuple[tuple[bool, str], ...]


def repeat_tests(found: Repeatability, runs: Sequence[str]) -> Tests:
    """Of repeats whose rows have these runs: for each kind of test whether some channel says no, and a sentence."""
    from scipy import linalg, stats  # here: it takes half a second to load, which certification need not wait for

    spread, made = found.spread, dict[str, list[tuple[float, str]]]({RUNS: [], VARIANCES: []})
    scaled = found.equations / np.where(found.expected > 0.0, found.expected, 1.0)
    legs = [f"g of leg {k}" for k in range(1, scaled.shape[1] + 1)]
    # a two-way table without interaction: what runs explain beside configurations
    names, number = np.unique(np.array(runs), return_inverse=True)
    count = len(spread.names)
    design = np.eye(len(names))[number, 1:]
    if len(names) > 1 and (design := design - group_means(design, spread.group, count)[spread.group]).any():
        basis, values = linalg.orth(design), np.hstack([spread.values, scaled])
        between = basis.shape[1]
        rest = len(values) - count - between
        values -= group_means(values, spread.group, count)[spread.group]
        explained, total = np.sum((basis.T @ values) ** 2, axis=0), np.sum(values**2, axis=0)
        for name, part, whole in zip((*spread.channels, *legs), explained, total, strict=True):
            if rest > 0 and whole - part > 1e-12 * whole:
                f = (part / between) / ((whole - part) / rest)
                made[RUNS].append((float(stats.f.sf(f, between, rest)), name))
    several = np.flatnonzero(spread.repeats > 2)
    for name, column in zip(legs, scaled.T, strict=True):
        groups = [column[spread.group == k] for k in several]
        if len(groups) > 1 and min(np.var(one) for one in groups) > 0.0:
            made[VARIANCES].append((float(stats.bartlett(*groups).pvalue), name))
    tests, said = sum(map(len, made.values())), []
    for kind, (bad, good, cause) in KINDS.items():
        ordered = sorted((min(1.0, tests * p), name) for p, name in made[kind])
        wrong = [name for p, name in ordered if p < LEVEL]
        least = f"p {ordered[0][0]:.2g}, corrected for {tests} tests" if ordered else ""
        if wrong:
            said.append((True, f"{bad}: {cause}? {listed(wrong, 6)} ({least})."))
        elif ordered:
            said.append((False, f"{good}: of {len(ordered)} channels none beyond chance (least {least})."))
    return tuple(said)


# ------------------------------------------------------------------------------------------------------------------
# The rows of one of a study's tables: as measured, without outliers, and as means of the images of each run.


class StudyRows(NamedTuple):
    """Measurements of a table.

    screening   outliers among them; None where no pose is repeated, so that nothing tells them
    good        the rows without them
    runs        one measurement for each pose and run: means of the good rows' images. Where no pose has a second run,
                images count as runs
    shared      (N, 6) of those: deviations of the errors that all images share, mm and rad; None where there are none
    """

    screening: Screening | None
    good: Campaign
    runs: Campaign
    shared: Floats | None

    @property
    def repeats(self) -> Ints:
        """(K,) runs of each pose, in the order of their first rows."""
        return np.bincount(grouped(self.runs.pose, repeated=False)[0]).astype(np.int64)


def study_rows(table: PoseTable, robot: Robot, provenance: Texts | None = None) -> StudyRows:
    """The rows of a table, screened for outliers where poses are repeated; joint centres of the robot in any frames."""
    rows = as_campaign(table, robot, provenance)
    has_runs = len(set(zip(table.pose, table.run, strict=True))) > len(set(table.pose))
    runs = np.array(table.run if has_runs else rows.run)
    screening = None
    if len(set(table.pose)) < len(table):
        spread = campaign_deviations(rows)
        if table.image is None or not has_runs:
            screening = screen(spread)
        else:  # poses row by row; leg readings run by run, as all images of a run hold the same ones
            of_runs, group = _run_means(rows, runs)
            legs = scores(campaign_deviations(of_runs))[group][:, 6:]
            screening = screen(spread, np.hstack([scores(spread)[:, :6], legs]))
    keep = np.ones(len(rows), np.bool_) if screening is None else screening.keep
    good = rows.rows(keep)
    averages, group = _run_means(good, runs[keep])
    shared = None
    if table.shared is not None:  # a mean of images has all of what they share: root mean squares over each run
        shared = np.sqrt(group_means(table.shared[keep] ** 2, group, len(averages)))
    return StudyRows(screening, good, averages, shared)


def as_campaign(table: PoseTable, robot: Robot, provenance: Texts | None = None) -> Campaign:
    """The rows of a table as measurements of a robot whose joint centres are in the frames of camera and target."""
    runs = table.run if table.image is None else [f"{r}:{i}" for r, i in zip(table.run, table.image, strict=True)]
    return Campaign.of(
        robot,
        table.position,
        table.quaternion,
        table.length,
        pose=table.pose,
        run=runs,
        exact=True,
        provenance=provenance,
    )


def _run_means(rows: Campaign, runs: npt.NDArray[np.str_]) -> tuple[Campaign, Ints]:
    """The means over each pose and run, in the order of their first rows; and (N,) which of them each row is of."""
    group, _ = grouped(list(zip(rows.pose, runs.tolist(), strict=True)), repeated=False)
    first = np.unique(group, return_index=True)[1]
    names = tuple(runs[first].tolist())
    if len(first) == len(rows):
        return replace(rows, run=names), group
    pose, of_means = [rows.pose[k] for k in first], means(rows, group, len(first))
    return Campaign.of(rows.robot, *of_means, pose=pose, run=names, exact=True, provenance=rows.provenance), group
