"""The record of a study's calibration, from what `calibrate_study` found."""

from __future__ import annotations

import numpy as np

from cpcal.calibration.alignment import Alignment
from cpcal.calibration.averaging import Of
from cpcal.calibration.budget import Budget, MonteCarlo
from cpcal.calibration.estimate import Fit
from cpcal.calibration.own_frame import in_own_frame, own_frame_covariance
from cpcal.calibration.record import (
    CalibrationRecord,
    Channel,
    Errors,
    FittedFrame,
    FittedFrames,
    Histogram,
    Numbers,
    OwnFrame,
    Parameters,
    Rows,
)
from cpcal.calibration.statistics import Deviations
from cpcal.calibration.study_calibration import StudyCalibration
from cpcal.calibration.validation import Validation
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError
from cpcal.files import campaign_sha256
from cpcal.robot import Study

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
