"""What a study's classical calibration found, as plain values: what `calibration.json` holds and reports show.

Lengths in mm, angles in rad. Joint centres, base and mobile, are in the frames of camera and target, where the campaign
beside the record has them. Nothing of it is proved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.calibration.distribution import ChannelStatistics
from cpcal.calibration.estimate import Fit
from cpcal.calibration.frames import FrameCalibration
from cpcal.calibration.statistics import Deviations, campaign_deviations
from cpcal.calibration.study import StudyCalibration, as_campaign
from cpcal.calibration.validation import PoseErrors, Validation
from cpcal.files import campaign_sha256
from cpcal.robot import Pose, Study, transformed

Numbers = tuple[float, ...]
Rows = tuple[Numbers, ...]

_BINS = 31  # of a histogram
_REACH = 4.0  # standard deviations to each side; the outermost bins hold what is beyond


@dataclass(frozen=True)
class Histogram:
    """Errors of repeats counted in bins of equal width from -reach to reach; the outermost hold what is beyond."""

    reach: float
    counts: tuple[int, ...]


@dataclass(frozen=True)
class Channel:
    """One channel of the repeats (tables 2 and 3, figures 3 and 4): `unit` is "mm" or "rad"."""

    unit: str
    statistics: ChannelStatistics
    histogram: Histogram


@dataclass(frozen=True)
class Frame:
    """A frame in another: position (mm), quaternion, and standard deviations of position and rotation vector."""

    position: Numbers
    quaternion: Numbers
    position_sigma: Numbers
    rotation_sigma: Numbers


@dataclass(frozen=True)
class Frames:
    """`FrameCalibration` in short: residuals as root mean squares of the components, mm and rad."""

    method: str
    camera_in_base: Frame
    target_in_mobile: Frame
    position_residual: float
    rotation_residual: float
    unit_weight: float
    remarks: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """Method, residuals (angles in degrees), what is doubtful."""
        said = (
            f"Frames by the method of {self.method.capitalize()}, refined: the two ways to the target differ by "
            f"{self.position_residual:.3g} mm and {np.degrees(self.rotation_residual):.3g} degrees a component (rms), "
            "which holds the drawing's errors and the legs' imperfections too."
        )
        return " ".join([said, *self.remarks])


@dataclass(frozen=True)
class Parameters:
    """A fit: parameters and standard errors (n, 7), mm, and what it says of itself. An error is inf where unknown."""

    values: Rows
    standard_errors: Rows
    form: str
    weights: str
    converged: bool
    sentence: str

    def __post_init__(self) -> None:
        """Raises ValueError for what is not seven finite numbers a leg, each with its error."""
        rows = (*self.values, *self.standard_errors)
        if len(self.values) != len(self.standard_errors) or any(len(row) != 7 for row in rows):
            raise ValueError("a fit is not seven numbers a leg, each with its standard error")
        if not all(math.isfinite(value) for row in self.values for value in row):
            raise ValueError("a fit is not finite")

    @property
    def array(self) -> npt.NDArray[np.float64]:
        """(n, 7) mm."""
        return np.array(self.values)


@dataclass(frozen=True)
class Errors:
    """Of N poses before and after calibration, mm and rad; nan where the forward kinematics did not converge."""

    names: tuple[str, ...]
    position_before: Numbers
    orientation_before: Numbers
    position_after: Numbers
    orientation_after: Numbers

    def __post_init__(self) -> None:
        """Raises ValueError for columns that differ in length."""
        columns = (self.position_before, self.orientation_before, self.position_after, self.orientation_after)
        if any(len(column) != len(self.names) for column in columns):
            raise ValueError("a validation has not one error for each name")

    @property
    def validation(self) -> Validation:
        """With means, deviations and improvements."""
        before, after = (self.position_before, self.orientation_before), (self.position_after, self.orientation_after)
        return Validation(self.names, _pose_errors(*before), _pose_errors(*after))


@dataclass(frozen=True)
class CalibrationRecord:
    """The calibration of a study.

    drawing          (n, 7) nominal parameters in the drawing's own frames; the campaign's robot has them moved
    campaign_sha256  of the campaign that the fits are of; check_sha256 of the one that they were validated with
    readings         of the calibration poses, before outliers were left out
    factor           half-width of the reading sets, in standard deviations of one reading
    """

    robot: str
    drawing: Rows
    campaign_sha256: str
    check_sha256: str
    readings: int
    configurations: int
    factor: float
    channels: tuple[Channel, ...]
    screening: str
    frames: Frames
    x_c: Parameters
    x_c_sigma: Parameters
    validation: Errors
    validation_sigma: Errors

    def __post_init__(self) -> None:
        """Raises ValueError when the parts are not of the same number of legs."""
        legs = len(self.drawing)
        if not legs or any(len(row) != 7 for row in self.drawing):
            raise ValueError("the drawing is not seven numbers a leg")
        if any(len(fit.values) != legs for fit in (self.x_c, self.x_c_sigma)):
            raise ValueError(f"a fit (x_c, x_c_sigma) is not of the drawing's {legs} legs")

    def in_drawing(self, fit: Parameters) -> npt.NDArray[np.float64]:
        """A fit's parameters (n, 7), mm, moved rigidly to the drawing's frames by the frames that were found."""
        x = fit.array
        camera, target = (
            Pose(np.array(frame.position), np.array(frame.quaternion))
            for frame in (self.frames.camera_in_base, self.frames.target_in_mobile)
        )
        return np.concatenate([transformed(camera, x[:, :3]), transformed(target, x[:, 3:6]), x[:, 6:]], axis=1)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What the steps say of themselves, in their order."""
        return (
            self.screening,
            *(channel.statistics.sentence() for channel in self.channels),
            self.frames.sentence,
            f"x_c: {self.x_c.sentence}",
            f"x_c_sigma: {self.x_c_sigma.sentence}",
            f"Validation of x_c: {self.validation.validation.sentence}",
            f"Validation of x_c_sigma: {self.validation_sigma.validation.sentence}",
        )


def recorded(study: Study, found: StudyCalibration, *, factor: float) -> CalibrationRecord:
    """The record of what `calibrate_study` found with that factor."""
    spread = campaign_deviations(as_campaign(study.calibration, study.robot))
    return CalibrationRecord(
        robot=study.robot.name,
        drawing=_rows(study.robot.parameters),
        campaign_sha256=campaign_sha256(found.campaign),
        check_sha256=campaign_sha256(found.check),
        readings=len(study.calibration),
        configurations=len(spread.names),
        factor=factor,
        channels=tuple(_channel(spread, k, statistics) for k, statistics in enumerate(found.statistics)),
        screening=found.screening.sentence,
        frames=_frames(found.frames),
        x_c=_parameters(found.x_c),
        x_c_sigma=_parameters(found.x_c_sigma),
        validation=_errors(found.validation),
        validation_sigma=_errors(found.validation_sigma),
    )


def _channel(spread: Deviations, k: int, statistics: ChannelStatistics) -> Channel:
    errors = spread.errors[:, k]
    reach = _REACH * statistics.sigma or 1.0  # a channel without any scatter: one bin has it all
    counts, _ = np.histogram(np.clip(errors, -reach, reach), bins=_BINS, range=(-reach, reach))
    unit = "rad" if statistics.name.startswith("r") else "mm"
    return Channel(unit, statistics, Histogram(reach, tuple(counts.tolist())))


def _frames(found: FrameCalibration) -> Frames:
    sigma = found.standard_deviations
    return Frames(
        method=found.method,
        camera_in_base=_frame(found.camera_in_base, sigma[:6]),
        target_in_mobile=_frame(found.target_in_mobile, sigma[6:]),
        position_residual=float(np.sqrt(np.mean(found.position_residual**2))),
        rotation_residual=float(np.sqrt(np.mean(found.rotation_residual**2))),
        unit_weight=found.unit_weight,
        remarks=found.remarks,
    )


def _frame(pose: Pose, sigma: npt.NDArray[np.float64]) -> Frame:
    parts = (pose.position, pose.quaternion, sigma[:3], sigma[3:])
    return Frame(*(tuple(map(float, np.ravel(part))) for part in parts))


def _parameters(fit: Fit) -> Parameters:
    values = (_rows(fit.parameters), _rows(fit.standard_errors))
    return Parameters(*values, fit.form, fit.weights, bool(fit.converged), fit.sentence)


def _errors(found: Validation) -> Errors:
    columns = (found.before.position, found.before.orientation, found.after.position, found.after.orientation)
    return Errors(found.names, *(tuple(column.tolist()) for column in columns))


def _rows(values: npt.NDArray[np.float64]) -> Rows:
    return tuple(tuple(row) for row in values.tolist())


def _pose_errors(position: Numbers, orientation: Numbers) -> PoseErrors:
    return PoseErrors(np.array(position), np.array(orientation), np.isfinite(position))
