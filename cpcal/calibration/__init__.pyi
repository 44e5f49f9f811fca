from .alignment import (
    Alignment,
    aligned,
)
from .averaging import (
    averaged,
)
from .diagnosis import (
    Diagnosis,
)
from .distribution import (
    ChannelStatistics,
    describe,
)
from .estimate import (
    Fit,
)
from .fit import (
    fit,
)
from .frames import (
    FrameCalibration,
    HandEye,
    calibrate_frames,
    hand_eye,
    redefined,
)
from .identification import (
    leg_jacobian,
    robot_jacobian,
)
from .least_squares import (
    least_squares,
)
from .leg_equations import (
    LegEquations,
)
from .observability import (
    Observability,
    column_scale,
    observability,
)
from .own_frame import (
    in_own_frame,
    own_frame_covariance,
)
from .record import (
    CalibrationRecord,
)
from .record_file import (
    RECORD_NAME,
    load_record,
    save_record,
)
from .repeat_tests import (
    RepeatTest,
    RepeatTests,
    repeat_tests,
)
from .repeatability import (
    Repeatability,
    repeatability,
)
from .screening import (
    Screening,
    screen,
)
from .statistics import (
    Deviations,
    campaign_deviations,
    deviations,
    mean_rotations,
)
from .study_calibration import (
    StudyCalibration,
    calibrate_study,
)
from .study_record import (
    recorded,
)
from .study_rows import (
    as_campaign,
)
from .tolerance import (
    half_widths,
    readings_needed,
    tolerance_half_width,
)
from .validation import (
    ErrorSummary,
    NoiseFloor,
    PoseErrors,
    Validation,
    pose_errors,
    validate,
)
from .weights import (
    Noise,
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
