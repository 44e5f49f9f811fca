"""The classical calibration of a study, step by step (the paper, sections 2.3 and 3). Nothing of it is proved.

    repeats -> statistics, screening -> means and reading sets -> frames -> x_c and x_c_sigma -> validation

The result's campaigns are in the frames of camera and target, with the drawing's joint centres moved there: a pose that
was measured stays as the camera gave it, and so does the shape of its reading set.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.calibration.averaging import averaged
from cpcal.calibration.distribution import ChannelStatistics, describe
from cpcal.calibration.estimate import Fit
from cpcal.calibration.fit import fit
from cpcal.calibration.frames import FrameCalibration, calibrate_frames, redefined
from cpcal.calibration.screening import Screening, screen
from cpcal.calibration.statistics import campaign_deviations
from cpcal.calibration.validation import Validation, validate
from cpcal.calibration.weights import Noise
from cpcal.common.arrays import Bools, Floats
from cpcal.robot import Campaign, Pose, PoseTable, Robot, Study, central_pose, forward_kinematics, forward_poses


@dataclass(frozen=True, eq=False)
class StudyCalibration:
    """What a study's classical calibration found.

    statistics    of the calibration poses' repeats, channel by channel (tables 2 and 3, figures 3 and 4)
    screening     outliers among them; they are left out
    frames        camera in base, target in mobile
    campaign      one measurement a configuration: means; reading sets of `factor` standard deviations of one reading
    check         the same of the validation poses
    x_c, x_c_sigma        least squares: plain, and weighted by the noise of the means, all legs together
    validation, validation_sigma    pose errors with each of them, against the drawing's (table 6, figure 5)
    """

    statistics: tuple[ChannelStatistics, ...]
    screening: Screening
    frames: FrameCalibration
    campaign: Campaign
    check: Campaign
    x_c: Fit
    x_c_sigma: Fit
    validation: Validation
    validation_sigma: Validation


def calibrate_study(study: Study, *, method: str = "shah", factor: float = 3.0) -> StudyCalibration:
    """Frames by `method` ("shah" or "andreff", refined), reading sets of `factor` standard deviations.

    Raises InputError for data that do not determine what is asked, KinematicsError where the drawing cannot reach the
    leg readings.
    """
    repeats = as_campaign(study.calibration, study.robot)
    spread = campaign_deviations(repeats)
    screening = screen(spread)
    keep = np.ones(len(repeats), dtype=np.bool_)
    keep[list(screening.rows)] = False
    means = averaged(repeats, keep=keep)
    drawn = forward_kinematics(study.robot, means.length, central_pose(study.robot, means.length.mean(axis=0)))
    frames = calibrate_frames(drawn, Pose(means.position, means.quaternion), method=method)
    robot = redefined(study.robot, frames.camera_in_base, frames.target_in_mobile)
    repeats, checks = as_campaign(study.calibration, robot), as_campaign(study.validation, robot)
    campaign, check = averaged(repeats, keep=keep, factor=factor), averaged(checks, factor=factor)
    noise = Noise.of(averaged(repeats, keep=keep, of="mean", factor=factor))
    x_c = fit(campaign, noise=noise)
    x_c_sigma = fit(campaign, weights="joint", noise=noise)
    return StudyCalibration(
        statistics=describe(spread),
        screening=screening,
        frames=frames,
        campaign=campaign,
        check=check,
        x_c=x_c,
        x_c_sigma=x_c_sigma,
        validation=validate(check, x_c.parameters, forward),
        validation_sigma=validate(check, x_c_sigma.parameters, forward),
    )


def as_campaign(table: PoseTable, robot: Robot) -> Campaign:
    """The rows of a table as measurements of a robot whose joint centres are in the frames of camera and target."""
    runs = table.run if table.image is None else [f"{r}:{i}" for r, i in zip(table.run, table.image, strict=True)]
    return Campaign.of(
        robot, table.position, table.quaternion, table.length, pose=list(table.pose), run=list(runs), exact=True
    )


def forward(parameters: Floats, lengths: Floats, guess: Pose) -> tuple[Floats, Floats, Bools]:
    """Forward kinematics of any parameters (n, 7), as `validate` asks for it."""
    found = forward_poses(Robot.from_parameters("", parameters), lengths, guess)
    return found.pose.position, found.pose.quaternion, found.converged
