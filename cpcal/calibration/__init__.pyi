from .alignment import (
    Alignment,
    aligned,
    in_own_frame,
    own_frame_covariance,
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
    HandEye,
    calibrate_frames,
    hand_eye,
    redefined,
)
from .identification import (
    Observability,
    column_scale,
    leg_jacobian,
    observability,
    robot_jacobian,
)
from .leg_equations import (
    LegEquations,
    Noise,
)
from .record import (
    RECORD_NAME,
    CalibrationRecord,
    load_record,
    recorded,
    save_record,
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
    half_widths,
    mean_rotations,
    readings_needed,
    screen,
    tolerance_half_width,
)
from .study_calibration import (
    StudyCalibration,
    as_campaign,
    calibrate_study,
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
    "Alignment",
    "CalibrationRecord",
    "ChannelStatistics",
    "Deviations",
    "Diagnosis",
    "ErrorSummary",
    "Fit",
    "FrameCalibration",
    "HandEye",
    "LegEquations",
    "Noise",
    "NoiseFloor",
    "Observability",
    "PoseErrors",
    "RepeatTest",
    "RepeatTests",
    "Repeatability",
    "Screening",
    "StudyCalibration",
    "Validation",
    "aligned",
    "as_campaign",
    "averaged",
    "calibrate_frames",
    "calibrate_study",
    "campaign_deviations",
    "column_scale",
    "describe",
    "deviations",
    "fit",
    "half_widths",
    "hand_eye",
    "in_own_frame",
    "least_squares",
    "leg_jacobian",
    "load_record",
    "mean_rotations",
    "observability",
    "own_frame_covariance",
    "pose_errors",
    "readings_needed",
    "recorded",
    "redefined",
    "repeat_tests",
    "repeatability",
    "robot_jacobian",
    "save_record",
    "screen",
    "tolerance_half_width",
    "validate",
]
