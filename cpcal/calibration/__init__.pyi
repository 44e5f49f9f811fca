from .alignment import (
    FittedFrame,
    nearest_motion,
    on_drawing,
)
from .budget import (
    Budget,
    Inputs,
    budget,
)
from .diagnosis import (
    Diagnosis,
)
from .fit import (
    Fit,
    fit,
    least_squares,
)
from .frames import (
    FrameCalibration,
    calibrate_frames,
    redefined,
)
from .leg_equations import (
    LegEquations,
    Noise,
)
from .repeatability import (
    Repeatability,
    RepeatTest,
    RepeatTests,
    repeat_tests,
    repeatability,
)
from .statistics import (
    ChannelStatistics,
    Deviations,
    Screening,
    averaged,
    campaign_deviations,
    describe,
    deviations,
    mean_rotations,
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
    ErrorSummary,
    NoiseFloor,
    PoseErrors,
    Validation,
    pose_errors,
    validate,
)

__all__ = [
    "RECORD_NAME",
    "Budget",
    "CalibrationRecord",
    "ChannelStatistics",
    "Deviations",
    "Diagnosis",
    "ErrorSummary",
    "Fit",
    "FittedFrame",
    "FrameCalibration",
    "Inputs",
    "LegEquations",
    "Noise",
    "NoiseFloor",
    "PoseErrors",
    "RepeatTest",
    "RepeatTests",
    "Repeatability",
    "Screening",
    "StudyCalibration",
    "Validation",
    "as_campaign",
    "averaged",
    "budget",
    "calibrate_frames",
    "calibrate_study",
    "campaign_deviations",
    "describe",
    "deviations",
    "fit",
    "least_squares",
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
