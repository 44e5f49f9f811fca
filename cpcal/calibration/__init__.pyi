from .budget import (
    Budget,
    Inputs,
    budget,
)
from .fit import (
    LegEquations,
    Noise,
    fit,
    least_squares,
)
from .frames import (
    calibrate_frames,
    load_log,
    nearest_motion,
    on_drawing,
    redefined,
)
from .statistics import (
    averaged,
    campaign_deviations,
    deviations,
    mean_rotations,
    repeat_tests,
    repeatability,
    screen,
)
from .study_calibration import (
    RECORD_NAME,
    CalibrationRecord,
    StudyCalibration,
    as_campaign,
    calibrate_study,
    load_record,
    save_record,
)
from .validation import (
    Validation,
    pose_errors,
    validate,
)

__all__ = [
    "RECORD_NAME",
    "Budget",
    "CalibrationRecord",
    "Inputs",
    "LegEquations",
    "Noise",
    "StudyCalibration",
    "Validation",
    "as_campaign",
    "averaged",
    "budget",
    "calibrate_frames",
    "calibrate_study",
    "campaign_deviations",
    "deviations",
    "fit",
    "least_squares",
    "load_log",
    "load_record",
    "mean_rotations",
    "nearest_motion",
    "on_drawing",
    "pose_errors",
    "redefined",
    "repeat_tests",
    "repeatability",
    "save_record",
    "screen",
    "validate",
]
