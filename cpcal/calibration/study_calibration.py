"""The classical calibration of a study, step by step (the paper, sections 2.3 and 3). Nothing of it is proved.

    repeats -> screening -> statistics, whose scatter it is -> means and reading sets -> frames -> fits -> validation

The result's campaigns are in the frames of camera and target, with the drawing's joint centres moved there: a pose that
was measured stays as the camera gave it, and so does the shape of its reading set.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.calibration.alignment import Alignment, aligned
from cpcal.calibration.averaging import Of, averaged
from cpcal.calibration.corrections import Poses
from cpcal.calibration.diagnosis import Diagnosis, diagnosis
from cpcal.calibration.distribution import ChannelStatistics, describe
from cpcal.calibration.estimate import Fit
from cpcal.calibration.fit import fit
from cpcal.calibration.frames import FrameCalibration, calibrate_frames, redefined
from cpcal.calibration.pose_performance import PosePerformance, pose_performance
from cpcal.calibration.repeat_tests import RepeatTests, repeat_tests
from cpcal.calibration.repeatability import Repeatability, repeatability
from cpcal.calibration.screening import Screening
from cpcal.calibration.shared_error import SharedError
from cpcal.calibration.statistics import Deviations, campaign_deviations
from cpcal.calibration.study_rows import StudyRows, study_rows
from cpcal.calibration.validation import Validation, validate
from cpcal.calibration.weights import Noise
from cpcal.common.arrays import Bools, Floats
from cpcal.robot import Campaign, Pose, Robot, Study, central_pose, forward_kinematics, forward_poses


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
