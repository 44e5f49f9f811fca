"""The classical calibration of a study, step by step (the paper, sections 2.3 and 3). Nothing of it is proved.

    repeats -> screening -> statistics, whose scatter it is -> means and reading sets -> frames -> fits -> validation

The result's campaigns are in the frames of camera and target, with the drawing's joint centres moved there: a pose that
was measured stays as the camera gave it, and so does the shape of its reading set.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpcal.calibration.alignment import Alignment, SharedError, aligned
from cpcal.calibration.diagnosis import Diagnosis, Poses, diagnosis
from cpcal.calibration.fit import Fit, fit
from cpcal.calibration.frames import FrameCalibration, calibrate_frames, redefined
from cpcal.calibration.leg_equations import Noise
from cpcal.calibration.repeatability import Repeatability, RepeatTests, repeat_tests, repeatability
from cpcal.calibration.statistics import (
    THRESHOLD,
    ChannelStatistics,
    Deviations,
    Of,
    Screening,
    averaged,
    beyond,
    campaign_deviations,
    describe,
    group_means,
    grouped,
    kept,
    mean_rotations,
    scores,
    screen,
)
from cpcal.calibration.validation import PosePerformance, Validation, pose_performance, validate
from cpcal.common.values import Bools, Floats, Ints
from cpcal.robot import Campaign, Pose, PoseTable, Robot, Study, central_pose, forward_kinematics, forward_poses

# ------------------------------------------------------------------------------------------------------------------
# The rows of one of a study's tables: as measured, without outliers, and as means of the images of each run.


@dataclass(frozen=True, eq=False)
class StudyRows:
    """Measurements of a table, joint centres of the robot in any frames.

    all         every row
    screening   outliers among them; None where no pose is repeated, so that nothing tells them
    good        the rows without them
    runs        one measurement for each pose and run: means of the good rows' images. Where no pose has a second run,
                images count as runs; all_runs: with the outliers
    run_names   the runs of those
    run_shared      (N, 6) of those, and all_shared of all rows: deviations of the errors that all images share, mm and
                    rad; None where there are none
    """

    all: Campaign
    screening: Screening | None
    good: Campaign
    runs: Campaign
    all_runs: Campaign
    run_names: tuple[str, ...]
    run_shared: Floats | None
    all_shared: Floats | None

    @property
    def screened(self) -> Screening:
        """The screening of a table that has one."""
        assert self.screening is not None  # a table without repeats has no statistics, and was refused
        return self.screening

    @property
    def repeats(self) -> Ints:
        """(K,) runs of each pose, in the order of their first rows."""
        return np.bincount(grouped(self.runs.pose, repeated=False)[0]).astype(np.int64)

    def of(self, robot: Robot) -> StudyRows:
        """The same measurements of a robot whose joint centres stand elsewhere."""
        parts = {name: replace(getattr(self, name), robot=robot) for name in ("all", "good", "runs", "all_runs")}
        return replace(self, **parts)

    def single_sigma(self, repeats: Repeatability) -> Floats:
        """(6 + n,) standard deviations of single rows, less what the robot itself adds, mm and rad."""
        rows = np.concatenate([campaign_deviations(self.good).sigma[:6], repeats.total[6:]])
        own = rows**2 - (repeats.total**2 - repeats.noise_sigma**2)
        return np.asarray(np.sqrt(np.maximum(own, repeats.noise_sigma**2)))


def study_rows(table: PoseTable, robot: Robot) -> StudyRows:
    """The rows of a table, screened for outliers where poses are repeated."""
    rows = as_campaign(table, robot)
    found = _screened(rows, table)
    keep = np.ones(len(rows), dtype=np.bool_) if found is None else found.keep
    good = kept(rows, keep)
    runs = np.array(table.run if _has_runs(table) else rows.run)
    means, names = _run_means(good, tuple(runs[keep].tolist()))
    every = means if keep.all() else _run_means(rows, tuple(runs.tolist()))[0]
    return StudyRows(
        all=rows,
        screening=found,
        good=good,
        runs=means,
        all_runs=every,
        run_names=names,
        run_shared=None if table.shared is None else _run_shared(table.shared[keep], good, tuple(runs[keep].tolist())),
        all_shared=table.shared,
    )


def _run_shared(shared: Floats, rows: Campaign, runs: tuple[str, ...]) -> Floats:
    """Root mean squares over the images of each run: a mean of images has all of what they share."""
    group, _ = grouped(list(zip(rows.pose, runs, strict=True)), repeated=False)
    return np.asarray(np.sqrt(group_means(shared**2, group, int(group.max()) + 1)))


def _screened(rows: Campaign, table: PoseTable) -> Screening | None:
    """Poses row by row; leg readings run by run, as all images of a run hold the same ones."""
    if len(set(table.pose)) == len(table):
        return None
    spread = campaign_deviations(rows)
    if table.image is None or not _has_runs(table):
        return screen(spread)
    means, _ = _run_means(rows, table.run)
    run = grouped(list(zip(table.pose, table.run, strict=True)), repeated=False)[0]
    legs = scores(campaign_deviations(means))[run, 6:]
    return beyond(spread, np.concatenate([scores(spread)[:, :6], legs], axis=1), THRESHOLD)


def _has_runs(table: PoseTable) -> bool:
    """Whether some pose has a second run."""
    return len(set(zip(table.pose, table.run, strict=True))) > len(set(table.pose))


def as_campaign(table: PoseTable, robot: Robot) -> Campaign:
    """The rows of a table as measurements of a robot whose joint centres are in the frames of camera and target."""
    runs = table.run if table.image is None else [f"{r}:{i}" for r, i in zip(table.run, table.image, strict=True)]
    return Campaign.of(
        robot, table.position, table.quaternion, table.length, pose=list(table.pose), run=list(runs), exact=True
    )


def _run_means(rows: Campaign, runs: tuple[str, ...]) -> tuple[Campaign, tuple[str, ...]]:
    keys = list(zip(rows.pose, runs, strict=True))
    group, _ = grouped(keys, repeated=False)
    first = np.unique(group, return_index=True)[1]
    if len(first) == len(rows):
        return rows, runs
    names = tuple(runs[k] for k in first)
    means = Campaign.of(
        rows.robot,
        group_means(rows.position, group, len(first)),
        mean_rotations(rows.quaternion, group, len(first)),
        group_means(rows.length, group, len(first)),
        pose=[rows.pose[k] for k in first],
        run=list(names),
        exact=True,
    )
    return means, names


@dataclass(frozen=True, eq=False)
class StudyCalibration:
    """What a study's classical calibration found.

    screening, check_screening    outliers among calibration and validation rows, left out of all that follows; the
                  second is None where validation poses were measured once
    spreads       the calibration rows' deviations from their configurations' means without outliers, of the pose and of
                  the leg readings, which are the same for all images of a run
    statistics    of the calibration poses' repeats, channel by channel (tables 2 and 3, figures 3 and 4)
    statistics_all    the same with the outliers
    repeats       whose scatter that is: camera's, sensors', robot's
    shared        deviations of the part of a pose's error that camera and target make in all images alike; None where
                  the study states none
    tests         drift, play
    diagnosis     which mechanism is named, of repeats and of the means of calibration and validation poses together
    frames        camera in base, target in mobile, from pairs of poses: where the fits start
    base_frame, mobile_frame    the same from the calibrated joint centres (of x_c_sigma) laid on the drawing's
    campaign      one measurement a configuration: means; reading sets of `factor` standard deviations
    check         the same of the validation poses
    x_c, x_c_sigma        least squares of g: plain, and weighted by the noise of the means, all legs together
    x_c_f         plain least squares of the paper's f
    validation, validation_sigma    pose errors with x_c and x_c_sigma, against the drawing's (table 6, figure 5)
    validation_all    that of x_c with the validation's outliers; None where there are none
    performance   AP and RP of the validation poses (ISO 9283) with x_c_sigma; None where some have one run only
    """

    screening: Screening
    check_screening: Screening | None
    spreads: tuple[Deviations, Deviations]
    statistics: tuple[ChannelStatistics, ...]
    statistics_all: tuple[ChannelStatistics, ...]
    repeats: Repeatability
    shared: SharedError | None
    tests: RepeatTests
    diagnosis: Diagnosis
    frames: FrameCalibration
    base_frame: Alignment
    mobile_frame: Alignment
    campaign: Campaign
    check: Campaign
    x_c: Fit
    x_c_sigma: Fit
    x_c_f: Fit
    validation: Validation
    validation_sigma: Validation
    validation_all: Validation | None
    performance: PosePerformance | None


def calibrate_study(study: Study, *, method: str = "shah", factor: float = 3.0, of: Of = "mean") -> StudyCalibration:
    """Frames by `method` ("shah" or "andreff", refined), reading sets of `factor` standard deviations.

    of   whose standard deviations: of the "mean" of a configuration's repeats, about which the sets are; or of "single"
         readings, as in the paper, which are larger by the root of the number of repeats

    Raises InputError for data that do not determine what is asked, KinematicsError where the drawing cannot reach the
    leg readings.
    """
    rows, check_rows = study_rows(study.calibration, study.robot), study_rows(study.validation, study.robot)
    frames = _frames(rows.good, study.robot, method)
    robot = redefined(study.robot, frames.camera_in_base, frames.target_in_mobile)
    rows, check_rows = rows.of(robot), check_rows.of(robot)
    repeats = repeatability(rows.runs)
    spreads = campaign_deviations(rows.good), repeats.spread
    statistics = _described(*spreads)
    tests, statistics = repeat_tests(repeats, rows.run_names, statistics)
    sigma = repeats.noise_sigma if of == "mean" else rows.single_sigma(repeats)
    campaign = averaged(rows.runs, of=of, factor=factor, sigma=sigma, shared=rows.run_shared)
    check = averaged(check_rows.runs, of=of, factor=factor, sigma=sigma, shared=check_rows.run_shared)
    noise, check_noise = repeats.noise(rows.repeats), repeats.noise(check_rows.repeats)
    x_c = fit(campaign, noise=noise)
    x_c_sigma = fit(campaign, weights="joint", noise=noise)
    base, mobile = laid_on_drawing(x_c_sigma, study.robot)
    return StudyCalibration(
        screening=rows.screened,
        check_screening=check_rows.screening,
        spreads=spreads,
        statistics=statistics,
        statistics_all=statistics
        if rows.screened.keep.all()
        else _described(*map(campaign_deviations, (rows.all, rows.all_runs))),
        repeats=repeats,
        shared=None if rows.run_shared is None else SharedError.of(rows.run_shared, rows.runs.position),
        tests=tests,
        diagnosis=diagnosis(Poses.of((campaign, check), (noise, check_noise)), x_c_sigma.parameters, tests),
        frames=frames,
        base_frame=base,
        mobile_frame=mobile,
        campaign=campaign,
        check=check,
        x_c=x_c,
        x_c_sigma=x_c_sigma,
        x_c_f=fit(campaign, form="f", noise=noise),
        validation=validate(check, x_c.parameters, forward, noise=check_noise),
        validation_sigma=validate(check, x_c_sigma.parameters, forward, noise=check_noise),
        validation_all=_with_outliers(check_rows, x_c, check_noise, repeats.noise_sigma),
        performance=pose_performance(check_rows.runs, robot.parameters, x_c_sigma.parameters, forward),
    )


def laid_on_drawing(fit: Fit, drawing: Robot) -> tuple[Alignment, Alignment]:
    """The frames of the drawing's base and mobile joint centres, from the fitted ones. Raises InputError."""
    x, covariance = fit.parameters, fit.covariance
    covariance = np.where(np.isfinite(covariance), covariance, 0.0).reshape(len(x), 7, len(x), 7)
    parts = ((slice(0, 3), drawing.base), (slice(3, 6), drawing.mobile))
    size = 3 * len(x)
    base, mobile = (aligned(x[:, k], drawn, covariance[:, k, :, k].reshape(size, size)) for k, drawn in parts)
    return base, mobile


def _described(poses: Deviations, legs: Deviations) -> tuple[ChannelStatistics, ...]:
    return (*describe(poses, slice(6)), *describe(legs, slice(6, None)))


def _frames(rows: Campaign, drawing: Robot, method: str) -> FrameCalibration:
    """From the drawing's forward kinematics of the mean readings, against the mean poses."""
    means = averaged(rows)
    drawn = forward_kinematics(drawing, means.length, central_pose(drawing, means.length.mean(axis=0)))
    return calibrate_frames(drawn, Pose(means.position, means.quaternion), method=method)


def _with_outliers(rows: StudyRows, x_c: Fit, noise: Noise, sigma: Floats) -> Validation | None:
    if rows.screening is None or rows.screening.keep.all():
        return None
    return validate(averaged(rows.all, of="mean", sigma=sigma), x_c.parameters, forward, noise=noise)


def forward(parameters: Floats, lengths: Floats, guess: Pose) -> tuple[Floats, Floats, Bools]:
    """Forward kinematics of any parameters (n, 7), as `validate` asks for it."""
    found = forward_poses(Robot.from_parameters("", parameters), lengths, guess)
    return found.pose.position, found.pose.quaternion, found.converged
