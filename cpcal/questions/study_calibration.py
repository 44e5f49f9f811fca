"""The classical calibration of a study, step by step (the paper, sections 2.3 and 3). Nothing of it is proved.

    repeats -> screening -> statistics, whose scatter it is -> means and reading sets -> frames -> fits -> validation

The result's campaigns are in the frames of camera and target, with the drawing's joint centres moved there: a pose that
was measured stays as the camera gave it, and so does the shape of its reading set.
"""

import json
import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from cpcal.calibration.fit import Fit, Noise, Validation, fit, validate
from cpcal.calibration.frames import FittedFrame, first_frames, fitted_frames, on_drawing, on_drawing_errors, redefined
from cpcal.calibration.statistics import (
    Of,
    Tests,
    averaged,
    campaign_deviations,
    repeat_tests,
    repeatability,
    study_rows,
)
from cpcal.common.codec import Document
from cpcal.common.errors import refuse
from cpcal.common.numbers import about
from cpcal.common.values import Floats, Names, Numbers, all_finite
from cpcal.files import campaign_sha256
from cpcal.robot import Campaign, Robot, Study, inverse

# ------------------------------------------------------------------------------------------------------------------
# The uncertainty budget of a calibration (GUM).
#
# Repeats show noise. What all of them share they cannot show: a wrong scale of the camera or of its target, a lens
# whose distortion is not quite known, thermal expansion, a wrong scale of the leg sensors. `Inputs` holds the
# standard uncertainties of these, which the user knows from certificates and from the room. Each is propagated to the
# joint parameters, laid on the drawing, by fitting the readings that it would have made, and the squares of all
# contributions add up.
#
# A set-up with a single camera has no length of its own: scale of camera, of target and of the leg sensors are one
# and the same to it, and the only length that it knows is the target's.

_EXPANSION = 1.2e-5  # 1/K, of steel


@dataclass(frozen=True)
class Inputs:
    """Standard uncertainties of what all readings share; 0: none, or not known.

    camera_scale   relative, of the distances that the camera gives (its focal length)
    target_scale   relative, of the target's dots
    lens           mm: of a position by the rest of the distortion, from configuration to configuration
    sensor_scale   relative, of each leg's sensor
    temperature    K: between target and robot, or robot and drawing; with the expansion of steel
    """

    camera_scale: float = 0.0
    target_scale: float = 0.0
    lens: float = 0.0
    sensor_scale: float = 0.0
    temperature: float = 0.0

    def __post_init__(self) -> None:
        """Raises InputError for what is no standard uncertainty."""
        remedy = "give a standard uncertainty >= 0"
        refuse(*((not 0.0 <= u < math.inf, f"budget {name}", f"is {u}", remedy) for name, u in vars(self).items()))


@dataclass(frozen=True)
class Contribution:
    """Of one source to the joint parameters laid on the drawing, mm: root mean square over all, and the largest."""

    source: str
    uncertainty: float
    rms: float
    largest: float


@dataclass(frozen=True)
class Budget:
    """Contributions, and what they come to: combined standard uncertainties u_c; U = 2 u_c.

    inputs       what was stated
    expanded     (n, 7) mm: U of each parameter, laid on the drawing
    """

    inputs: Inputs
    contributions: tuple[Contribution, ...]
    expanded: tuple[Numbers, ...]
    rms: float
    largest: float

    @property
    def sentence(self) -> str:
        """The expanded uncertainty, and what is not in it."""
        absent = [one.source for one in self.contributions[1:] if one.uncertainty == 0.0]
        missing = f" Not in it, as nothing was stated: {', '.join(absent)}." if absent else ""
        return (
            f"Uncertainty budget: the parameters, laid on the drawing, are known to U = {2.0 * self.largest:.2g} mm at "
            f"most and {2.0 * self.rms:.2g} mm on average (k = 2).{missing} A single camera has no length of its own: "
            "its scale, the target's and the sensors' cannot be told apart by these readings."
        )


def budget(best: Fit, campaign: Campaign, drawing: Robot, inputs: Inputs) -> Budget:
    """Of x_c_sigma of a campaign, with what the fit itself states of noise or residuals."""
    laid, nothing = on_drawing(best.parameters, drawing), np.zeros_like(best.parameters)

    def moved(**readings: Any) -> Floats:
        """(n, 7) how far other readings move the parameters, laid on the drawing."""
        other = replace(campaign, **readings)
        again = fit(other, weighted=True, noise=best.noise, start=best.parameters, covariance="noise")
        return np.abs(on_drawing(again.parameters, drawing) - laid)

    def scaled(share: float) -> Floats:
        return moved(position=campaign.position * (1.0 + share)) if share else nothing

    def sensors(share: float) -> Floats:
        """Each leg by itself: squares add up."""
        legs = np.eye(campaign.legs)[: campaign.legs if share else 0]
        each = (moved(length=campaign.length * (1.0 + share * leg)) for leg in legs)
        return np.sqrt(sum((change**2 for change in each), nothing))

    def lens(size: float) -> Floats:
        if not size:
            return nothing
        only = Noise.from_sigmas([size] * 3, [0.0] * 3, np.zeros(campaign.legs), count=len(campaign))
        return on_drawing_errors(replace(best, noise=only, source="noise"), drawing)

    columns = {
        "repeats and residuals": on_drawing_errors(best, drawing),
        "camera_scale": scaled(inputs.camera_scale),
        "target_scale": scaled(inputs.target_scale),
        "lens": lens(inputs.lens),
        "sensor_scale": sensors(inputs.sensor_scale),
        "temperature": scaled(_EXPANSION * inputs.temperature),
    }
    statistical, *stated = columns.values()
    total = columns["combined"] = np.sqrt(sum((values**2 for values in (*stated, statistical)), nothing))
    *each, combined = (
        Contribution(name, getattr(inputs, name, math.nan), float(np.sqrt(np.mean(values**2))), float(values.max()))
        for name, values in columns.items()
    )
    return Budget(inputs, tuple(each), _rows(2.0 * total), combined.rms, combined.largest)


# ------------------------------------------------------------------------------------------------------------------
# What a study's classical calibration found, as plain values: what `calibration.json` holds and reports show.
#
# Lengths in mm, angles in rad. Joint centres, base and mobile, are in the frames of camera and target, where the
# campaign beside the record has them.

Rows = tuple[Numbers, ...]


@dataclass(frozen=True)
class Channel:
    """One channel of the repeats (tables 2 and 3), outliers left out: `unit` is "mm" or "rad".

    sigma      standard deviation of one reading
    noise      standard deviation of a run by the noise of camera or sensors alone
    """

    name: str
    unit: str
    sigma: float
    noise: float


@dataclass(frozen=True)
class RepeatRecord:
    """What the repeats of the calibration poses say.

    readings         before outliers were left out; `left_out` names these
    equation_sigma   (n,) mm: scatter of g between repeats
    robot_sigma      (n,) mm: scatter of the legs themselves, seen by camera and sensors alike; 0 where none is seen
    scatter          whose scatter it is, in words
    tests            on drift and play: whether one says no, and a sentence
    shared           (6,) mm and rad, of the poses' errors, by camera and target: root mean squares of the deviations
                     over the runs; None where the study states none
    """

    readings: int
    configurations: int
    screening: str
    left_out: Names
    channels: tuple[Channel, ...]
    equation_sigma: Numbers
    robot_sigma: Numbers
    scatter: str
    tests: Tests
    shared: Numbers | None

    @property
    def shared_sentence(self) -> str:
        """What all images share, and where it is counted; empty where nothing is stated."""
        if self.shared is None:
            return ""
        moved, turned = about(max(self.shared[:3]), 2), about(float(np.degrees(max(self.shared[3:]))), 2)
        return (
            f"Errors of camera and target that all images share: up to {moved} mm and {turned} degrees (standard "
            "deviations) of a pose. No repeat shows them and no mean makes them smaller: reading sets and the frames' "
            "U hold them in full; the table of repeats, standard errors of the fits and what validation expects do not."
        )


@dataclass(frozen=True)
class Parameters:
    """A fit: parameters and standard errors (n, 7), mm, and what it says of itself. An error is inf where unknown.

    drawn, drawn_errors  the same laid on the drawing, in its frames
    source     what the errors are from: "noise" or "residuals"
    explained  whether the noise explains the residuals: if not, no error knows what the model lacks
    """

    values: Rows
    standard_errors: Rows
    drawn: Rows
    drawn_errors: Rows
    converged: bool
    source: str
    explained: bool
    sentence: str

    def __post_init__(self) -> None:
        """Raises ValueError for what is not seven finite numbers a leg, each with its error."""
        parts = (self.values, self.standard_errors, self.drawn, self.drawn_errors)
        if any(len(part) != len(self.values) or any(len(row) != 7 for row in part) for part in parts):
            raise ValueError("a fit is not seven numbers a leg, each with its standard error")
        if not all_finite((self.values, self.drawn)):
            raise ValueError("a fit is not finite")

    @classmethod
    def of(cls, fit: Fit, drawing: Robot) -> "Parameters":
        return cls(
            values=_rows(fit.parameters),
            standard_errors=_rows(fit.standard_errors),
            drawn=_rows(on_drawing(fit.parameters, drawing)),
            drawn_errors=_rows(on_drawing_errors(fit, drawing)),
            converged=fit.converged,
            source=fit.source,
            explained=fit.explained,
            sentence=fit.sentence,
        )


@dataclass(frozen=True)
class ValidationRecord:
    """Pose errors (table 6, figure 5) with x_c and x_c_sigma. `left_out` names outliers, `screening` says how they were
    told."""

    screening: str
    left_out: Names
    x_c: Validation
    x_c_sigma: Validation


@dataclass(frozen=True)
class CalibrationRecord:
    """The calibration of a study.

    drawing          (n, 7) nominal parameters in the drawing's own frames; the campaign's robot has them moved
    campaign_sha256  of the campaign that the fits are of
    factor, of       of the reading sets: half-widths of so many standard deviations of the "mean" of the repeats about
                     which a set is, or of "single" readings
    camera_in_base, target_in_mobile    the frames by the joint centres of x_c_sigma
    budget           uncertainty budget (GUM), where it was asked for
    """

    robot: str
    drawing: Rows
    campaign_sha256: str
    factor: float
    of: str
    repeats: RepeatRecord
    camera_in_base: FittedFrame
    target_in_mobile: FittedFrame
    x_c: Parameters
    x_c_sigma: Parameters
    validation: ValidationRecord
    budget: Budget | None

    def __post_init__(self) -> None:
        """Raises ValueError when the parts are not of the same number of legs."""
        legs = len(self.drawing)
        if not legs or any(len(row) != 7 for row in self.drawing):
            raise ValueError("the drawing is not seven numbers a leg")
        if any(len(fit.values) != legs for fit in (self.x_c, self.x_c_sigma)):
            raise ValueError(f"a fit (x_c, x_c_sigma) is not of the drawing's {legs} legs")

    @property
    def sets(self) -> str:
        """How large the reading sets are, in words."""
        whose = (
            "of the mean of its repeats, about which they are"
            if self.of == "mean"
            else "of a single reading, though they are about the mean of its repeats (the paper's choice)"
        )
        shared = " and by the errors that all images share" if self.repeats.shared else ""
        return (
            f"Reading sets: ±{self.factor:g} standard deviations {whose}, by the noise of camera and sensors{shared}."
        )

    @property
    def frames(self) -> str:
        """How well the frames are known, in words."""
        camera = self.camera_in_base.sentence("Camera in base")
        return f"{camera} {self.target_in_mobile.sentence('Target in mobile')}"


RECORD_NAME = "calibration.json"
_REMEDY = "name a folder that cpcal calibrate wrote, or run it again"
_DOCUMENT = Document(CalibrationRecord, RECORD_NAME, "cpcal-calibration/13", _REMEDY)
save_record, load_record = _DOCUMENT.save, _DOCUMENT.load


# ------------------------------------------------------------------------------------------------------------------
# The steps.


class StudyCalibration(NamedTuple):
    """What a study's classical calibration found.

    drawing       the study's robot
    campaign      one measurement a configuration: means; reading sets of `factor` standard deviations
    check         the same of the validation poses
    x_c, x_c_sigma  least squares of g: plain, and weighted by the noise of the means, all legs together
    record        all of it as plain values, with statistics and validation
    """

    drawing: Robot
    campaign: Campaign
    check: Campaign
    x_c: Fit
    x_c_sigma: Fit
    record: CalibrationRecord


def calibrate_study(study: Study, *, factor: float = 3.0, of: Of = "mean") -> StudyCalibration:
    """Frames, fits, reading sets of `factor` standard deviations, validation.

    of   whose standard deviations: of the "mean" of a configuration's repeats, about which the sets are; or of "single"
         readings, as in the paper, which are larger by the root of the number of repeats

    Raises InputError for data that do not determine what is asked, KinematicsError where the drawing cannot reach the
    leg readings.
    """
    drawing, truth = study.robot, study.truth
    # options of a study are not those of a simulated campaign, and its true parameters are where those have the joints
    told = {"study" if key == "options" else key: text for key, text in study.provenance.items()}
    if truth is not None:
        true = redefined(truth.robot, inverse(truth.camera), truth.target)
        told["true_parameters"] = json.dumps(true.parameters.tolist())
    centres = averaged(study_rows(study.calibration, drawing).good)
    # the drawing's forward kinematics of the mean readings, against the mean poses
    frames = first_frames(drawing, centres.length, centres.poses)
    robot = redefined(drawing, *frames)
    rows, check_rows = (study_rows(table, robot, told) for table in (study.calibration, study.validation))
    repeats, of_rows = repeatability(rows.runs), campaign_deviations(rows.good)
    sigma = repeats.noise_sigma
    if of == "single":  # of a row, less what the robot itself adds
        total = repeats.spread.sigma
        single = np.concatenate([of_rows.sigma[:6], total[6:]])
        own = single**2 - (total**2 - repeats.noise_sigma**2)
        sigma = np.sqrt(np.maximum(own, repeats.noise_sigma**2))
    campaign = averaged(rows.runs, of=of, factor=factor, sigma=sigma, shared=rows.shared)
    check = averaged(check_rows.runs, of=of, factor=factor, sigma=sigma, shared=check_rows.shared)
    noise, check_noise = repeats.noise(rows.repeats), repeats.noise(check_rows.repeats)
    x_c, x_c_sigma = fit(campaign, noise=noise), fit(campaign, weighted=True, noise=noise)
    channels = []
    for k, name in enumerate(of_rows.channels):  # of the pose by rows, of the legs by runs, whose images hold the same
        spread = of_rows if k < 6 else repeats.spread
        unit = "rad" if 3 <= k < 6 else "mm"
        channels.append(Channel(name, unit, float(spread.sigma[k]), float(repeats.noise_sigma[k])))
    shared = of_frames = None
    if rows.shared is not None:
        # If every pose is off by the same (dp, dr), a fit puts that into the frames: camera in base is off by dr and by
        # dp + dr x d, d the way from the target to the camera; or target in mobile by dr and dp. The shared errors of
        # different poses are not the same, so that each frame is off by less: an upper estimate, in all directions.
        shared = np.sqrt(np.mean(rows.shared**2, axis=0))
        distance = np.sqrt(np.mean(np.sum(rows.runs.position**2, axis=1)))
        moved, turned = shared[:3].max(), shared[3:].max()
        of_frames = np.array([np.repeat([np.hypot(moved, arm * turned), turned], 3) for arm in (distance, 0.0)])
    screening, outliers = rows.screening, check_rows.screening
    assert screening is not None  # a table without repeats has no statistics, and was refused
    camera_in_base, target_in_mobile = fitted_frames(x_c_sigma, drawing, of_frames)
    record = CalibrationRecord(
        robot=campaign.title,
        drawing=_rows(drawing.parameters),
        campaign_sha256=campaign_sha256(campaign),
        factor=factor,
        of=of,
        repeats=RepeatRecord(
            readings=len(study.calibration),
            configurations=len(of_rows.names),
            screening=screening.sentence,
            left_out=screening.left_out,
            channels=tuple(channels),
            equation_sigma=tuple(repeats.equation_sigma.tolist()),
            robot_sigma=tuple(repeats.robot_sigma.tolist()),
            scatter=repeats.sentence,
            tests=repeat_tests(repeats, rows.runs.run),
            shared=None if shared is None else tuple(shared.tolist()),
        ),
        camera_in_base=camera_in_base,
        target_in_mobile=target_in_mobile,
        x_c=Parameters.of(x_c, drawing),
        x_c_sigma=Parameters.of(x_c_sigma, drawing),
        validation=ValidationRecord(
            "measured once each, so that nothing tells outliers." if outliers is None else outliers.sentence,
            () if outliers is None else outliers.left_out,
            validate(check, x_c.parameters, noise=check_noise),
            validate(check, x_c_sigma.parameters, noise=check_noise),
        ),
        budget=None,
    )
    return StudyCalibration(drawing, campaign, check, x_c, x_c_sigma, record)


def _rows(values: Floats) -> Rows:
    return tuple(tuple(row) for row in values.tolist())
