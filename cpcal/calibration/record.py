"""What a study's classical calibration found, as plain values: what `calibration.json` holds and reports show.

Lengths in mm, angles in rad. Joint centres, base and mobile, are in the frames of camera and target, where the campaign
beside the record has them. Nothing of it is proved.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cpcal.calibration.alignment import Alignment, SharedError, in_own_frame, own_frame_covariance
from cpcal.calibration.budget import Budget, MonteCarlo
from cpcal.calibration.diagnosis import Diagnosis
from cpcal.calibration.fit import Fit
from cpcal.calibration.repeatability import RepeatTests
from cpcal.calibration.statistics import ChannelStatistics, Deviations, Of
from cpcal.calibration.study_calibration import StudyCalibration
from cpcal.calibration.validation import NoiseFloor, PoseErrors, PosePerformance, Validation
from cpcal.common.errors import InputError
from cpcal.common.values import Floats
from cpcal.files import campaign_sha256
from cpcal.files.codec import load, save
from cpcal.robot import Pose, Study, transformed

Numbers = tuple[float, ...]
Rows = tuple[Numbers, ...]


@dataclass(frozen=True)
class Histogram:
    """Errors of repeats counted in bins of equal width from -reach to reach; the outermost hold what is beyond."""

    reach: float
    counts: tuple[int, ...]


@dataclass(frozen=True)
class Channel:
    """One channel of the repeats (tables 2 and 3, figures 3 and 4), outliers left out: `unit` is "mm" or "rad".

    noise      standard deviation of a run by the noise of camera or sensors alone
    with_outliers  the standard deviation with them
    """

    unit: str
    statistics: ChannelStatistics
    histogram: Histogram
    noise: float
    with_outliers: float


@dataclass(frozen=True)
class FittedFrame:
    """A frame in another: position (mm), quaternion, and standard deviations (6,) of position and rotation vector.

    sigma          of the frame that the robot's own joint centres define, errors that all images share included
    drawing_sigma  of the drawing's, from which those centres deviate by `drawing_error` mm a coordinate; 95 % of it
                   takes the `coverage_factor`
    """

    position: Numbers
    quaternion: Numbers
    sigma: Numbers
    drawing_sigma: Numbers
    drawing_error: float
    coverage_factor: float


@dataclass(frozen=True)
class FittedFrames:
    """The frames by the joint centres of x_c_sigma, and how they were started: from pairs of poses, whose residuals are
    root mean squares of the components, mm and rad."""

    method: str
    camera_in_base: FittedFrame
    target_in_mobile: FittedFrame
    position_residual: float
    rotation_residual: float
    unit_weight: float
    remarks: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """Method, residuals (angles in degrees), what is doubtful, and how well the frames are known."""
        said = (
            f"Frames by the method of {self.method.capitalize()}, refined, to start with: the two ways to the target "
            f"differ by {self.position_residual:.3g} mm and {np.degrees(self.rotation_residual):.3g} degrees a "
            "component (rms), which holds the drawing's errors and the legs' imperfections too."
        )
        return " ".join([said, *self.remarks, *(self._said(*pair) for pair in self.both)])

    @property
    def both(self) -> tuple[tuple[str, FittedFrame], ...]:
        """With what each is called."""
        return ("camera in base", self.camera_in_base), ("target in mobile", self.target_in_mobile)

    @staticmethod
    def _said(name: str, frame: FittedFrame) -> str:
        own, drawn = (np.array(sigma)[:3].max() for sigma in (frame.sigma, frame.drawing_sigma))
        return (
            f"{name.capitalize()}: the calibrated joint centres are {frame.drawing_error:.2g} mm a coordinate off the "
            f"drawing's; the frame that they define is known to U = {2.0 * own:.2g} mm (k = 2), the drawing's to "
            f"{frame.coverage_factor * drawn:.2g} mm (k = {frame.coverage_factor:.2g}, 95 %)."
        )


@dataclass(frozen=True)
class OwnFrame:
    """Parameters and standard errors (n, 7), mm, in frames of the joint centres themselves (alignment.py)."""

    values: Rows
    standard_errors: Rows


@dataclass(frozen=True)
class Parameters:
    """A fit: parameters and standard errors (n, 7), mm, and what it says of itself. An error is inf where unknown.

    source   what the errors are from: "noise" or "residuals"
    explained  whether the noise explains the residuals: if not, no error knows what the model lacks
    own      the same in the joint centres' own frames; None where they define none
    """

    values: Rows
    standard_errors: Rows
    form: str
    weights: str
    converged: bool
    source: str
    explained: bool
    own: OwnFrame | None
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
    """Of N poses before and after calibration, mm and rad; nan where the forward kinematics did not converge. `floor`:
    what the readings' noise alone shows."""

    names: tuple[str, ...]
    position_before: Numbers
    orientation_before: Numbers
    position_after: Numbers
    orientation_after: Numbers
    floor: NoiseFloor | None

    def __post_init__(self) -> None:
        """Raises ValueError for columns that differ in length."""
        columns = (self.position_before, self.orientation_before, self.position_after, self.orientation_after)
        if any(len(column) != len(self.names) for column in columns):
            raise ValueError("a validation has not one error for each name")

    @property
    def validation(self) -> Validation:
        """With means, deviations and improvements."""
        before, after = (self.position_before, self.orientation_before), (self.position_after, self.orientation_after)
        return Validation(self.names, _pose_errors(*before), _pose_errors(*after), self.floor)


@dataclass(frozen=True)
class CalibrationRecord:
    """The calibration of a study.

    drawing          (n, 7) nominal parameters in the drawing's own frames; the campaign's robot has them moved
    campaign_sha256  of the campaign that the fits are of; check_sha256 of the one that they were validated with
    readings         of the calibration poses, before outliers were left out
    factor           half-width of the reading sets, in standard deviations
    of               whose: of the "mean" of the repeats about which a set is, or of "single" readings
    left_out         rows of the calibration, and check_left_out of the validation, that are outliers
    shared           of the poses' errors, by camera and target; None where the study states none
    equation_sigma   (n,) mm: scatter of g between repeats
    robot_sigma      (n,) mm: scatter of the legs themselves, seen by camera and sensors alike; 0 where none is seen
    validation_all   that of x_c with the validation's outliers; None where there are none
    performance      AP and RP of the validation poses (ISO 9283); None where some have one run only
    budget, monte_carlo    uncertainty budget (GUM) and its check, where they were asked for
    """

    robot: str
    drawing: Rows
    campaign_sha256: str
    check_sha256: str
    readings: int
    configurations: int
    factor: float
    of: str
    channels: tuple[Channel, ...]
    screening: str
    check_screening: str
    left_out: tuple[str, ...]
    check_left_out: tuple[str, ...]
    repeats: str
    shared: SharedError | None
    equation_sigma: Numbers
    robot_sigma: Numbers
    tests: RepeatTests
    diagnosis: Diagnosis
    frames: FittedFrames
    x_c: Parameters
    x_c_sigma: Parameters
    x_c_f: Parameters
    validation: Errors
    validation_sigma: Errors
    validation_all: Errors | None
    performance: PosePerformance | None
    budget: Budget | None
    monte_carlo: MonteCarlo | None

    def __post_init__(self) -> None:
        """Raises ValueError when the parts are not of the same number of legs."""
        legs = len(self.drawing)
        if not legs or any(len(row) != 7 for row in self.drawing):
            raise ValueError("the drawing is not seven numbers a leg")
        if any(len(fit.values) != legs for fit in self.fits.values()):
            raise ValueError(f"a fit (x_c, x_c_sigma, x_c_f) is not of the drawing's {legs} legs")

    @property
    def fits(self) -> dict[str, Parameters]:
        """By name."""
        return {"x_c": self.x_c, "x_c_sigma": self.x_c_sigma, "x_c_f": self.x_c_f}

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
            self.repeats,
            *(() if self.shared is None else (self.shared.sentence,)),
            *self.tests.sentences,
            self.sets_sentence,
            self.frames.sentence,
            *(f"{name}: {fit.sentence}" for name, fit in self.fits.items()),
            f"Validation poses: {self.check_screening}",
            f"Validation of x_c: {self.validation.validation.sentence}",
            f"Validation of x_c_sigma: {self.validation_sigma.validation.sentence}",
            *self._with_outliers(),
            *self._standards(),
            self.diagnosis.sentence,
        )

    @property
    def sets_sentence(self) -> str:
        """What the reading sets are, in words."""
        whose = (
            "of the mean of its repeats, about which they are"
            if self.of == "mean"
            else "of a single reading, though they are about the mean of its repeats (the paper's choice)"
        )
        shared = "" if self.shared is None else " and by the errors that all images share"
        return (
            f"Reading sets: ±{self.factor:g} standard deviations {whose}, by the noise of camera and sensors{shared}."
        )

    def _with_outliers(self) -> tuple[str, ...]:
        if self.validation_all is None:
            return ()
        return (f"Validation of x_c with the outliers: {self.validation_all.validation.sentence}",)

    def _standards(self) -> Iterator[str]:
        """What the standards of the trade ask for."""
        if self.performance is not None:
            yield self.performance.sentence
        yield from (part.sentence for part in (self.budget, self.monte_carlo) if part is not None)


def _pose_errors(position: Numbers, orientation: Numbers) -> PoseErrors:
    return PoseErrors(np.array(position), np.array(orientation), np.isfinite(position))


# ------------------------------------------------------------------------------------------------------------------
# The record of a study's calibration, from what `calibrate_study` found.

_BINS = 31  # of a histogram
_REACH = 4.0  # standard deviations to each side; the outermost bins hold what is beyond


def recorded(
    study: Study,
    found: StudyCalibration,
    *,
    factor: float,
    of: Of = "mean",
    budget: Budget | None = None,
    monte_carlo: MonteCarlo | None = None,
) -> CalibrationRecord:
    """The record of what `calibrate_study` found with that factor, and sets of that width; and of its budget."""
    check = found.check_screening
    return CalibrationRecord(
        robot=study.robot.name,
        drawing=_rows(study.robot.parameters),
        campaign_sha256=campaign_sha256(found.campaign),
        check_sha256=campaign_sha256(found.check),
        readings=len(study.calibration),
        configurations=len(found.spreads[0].names),
        factor=factor,
        of=of,
        channels=tuple(_channel(found.spreads[k > 5], found, k) for k in range(len(found.statistics))),
        screening=found.screening.sentence,
        check_screening="measured once each, so that nothing tells outliers." if check is None else check.sentence,
        left_out=found.screening.left_out,
        check_left_out=() if check is None else check.left_out,
        repeats=found.repeats.sentence,
        shared=found.shared,
        equation_sigma=_numbers(found.repeats.equation_sigma),
        robot_sigma=_numbers(found.repeats.robot_sigma),
        tests=found.tests,
        diagnosis=found.diagnosis,
        frames=_frames(found),
        x_c=_parameters(found.x_c),
        x_c_sigma=_parameters(found.x_c_sigma),
        x_c_f=_parameters(found.x_c_f),
        validation=_errors(found.validation),
        validation_sigma=_errors(found.validation_sigma),
        validation_all=None if found.validation_all is None else _errors(found.validation_all),
        performance=found.performance,
        budget=budget,
        monte_carlo=monte_carlo,
    )


def _channel(spread: Deviations, found: StudyCalibration, k: int) -> Channel:
    statistics = found.statistics[k]
    errors = spread.errors[:, k]
    reach = _REACH * statistics.sigma or 1.0  # a channel without any scatter: one bin has it all
    counts, _ = np.histogram(np.clip(errors, -reach, reach), bins=_BINS, range=(-reach, reach))
    unit = "rad" if statistics.name.startswith("r") else "mm"
    histogram = Histogram(reach, tuple(counts.tolist()))
    return Channel(unit, statistics, histogram, float(found.repeats.noise_sigma[k]), found.statistics_all[k].sigma)


def _frames(found: StudyCalibration) -> FittedFrames:
    start = found.frames
    return FittedFrames(
        method=start.method,
        camera_in_base=_frame(found.base_frame, None if found.shared is None else found.shared.camera_in_base),
        target_in_mobile=_frame(found.mobile_frame, None if found.shared is None else found.shared.target_in_mobile),
        position_residual=float(np.sqrt(np.mean(start.position_residual**2))),
        rotation_residual=float(np.sqrt(np.mean(start.rotation_residual**2))),
        unit_weight=start.unit_weight,
        remarks=start.remarks,
    )


def _frame(found: Alignment, shared: Floats | None) -> FittedFrame:
    more = np.zeros(6) if shared is None else shared
    return FittedFrame(
        position=_numbers(found.motion.position),
        quaternion=_numbers(found.motion.quaternion),
        sigma=_numbers(np.hypot(found.sigma, more)),
        drawing_sigma=_numbers(np.hypot(found.drawing_sigma, more)),
        drawing_error=found.drawing_error,
        coverage_factor=found.coverage_factor,
    )


def _parameters(fit: Fit) -> Parameters:
    return Parameters(
        values=_rows(fit.parameters),
        standard_errors=_rows(fit.standard_errors),
        form=fit.form,
        weights=fit.weights,
        converged=bool(fit.converged),
        source=fit.source,
        explained=fit.explained,
        own=_own(fit),
        sentence=fit.sentence,
    )


def _own(fit: Fit) -> OwnFrame | None:
    """None where the centres of the first three legs define no frame."""
    try:
        values = in_own_frame(fit.parameters)
        variance = np.diagonal(own_frame_covariance(fit.parameters, fit.covariance))
    except InputError:
        return None
    errors = np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.inf)).reshape(-1, 7)
    return OwnFrame(_rows(values), _rows(errors))


def _errors(found: Validation) -> Errors:
    return Errors(
        names=found.names,
        position_before=_numbers(found.before.position),
        orientation_before=_numbers(found.before.orientation),
        position_after=_numbers(found.after.position),
        orientation_after=_numbers(found.after.orientation),
        floor=found.floor,
    )


def _rows(values: Floats) -> Rows:
    return tuple(tuple(row) for row in values.tolist())


def _numbers(values: Floats) -> Numbers:
    return tuple(map(float, np.ravel(values)))


# ------------------------------------------------------------------------------------------------------------------
# `calibration.json`: a record as JSON, and back, every field checked.

FORMAT = "cpcal-calibration/5"
RECORD_NAME = "calibration.json"


def save_record(record: CalibrationRecord, folder: str | os.PathLike[str]) -> Path:
    """Write `calibration.json` into `folder` (made if missing), all or nothing; its path. Raises InputError."""
    return save(record, Path(folder) / RECORD_NAME, FORMAT)


def load_record(folder: str | os.PathLike[str]) -> CalibrationRecord:
    """Read `calibration.json` in `folder`. Raises InputError."""
    remedy = "name a folder that cpcal calibrate wrote, or run it again"
    return load(CalibrationRecord, Path(folder) / RECORD_NAME, FORMAT, remedy=remedy)
