"""From campaigns to fits and constraint networks: frames, leg models, least squares, statistics, validation."""

from cpcal.calibration.averaging import (
    averaged,
)
from cpcal.calibration.dip import (
    dip,
    dip_p_value,
)
from cpcal.calibration.distribution import (
    ChannelStatistics,
    describe,
)
from cpcal.calibration.equations import (
    LegEquations,
)
from cpcal.calibration.estimate import (
    Fit,
)
from cpcal.calibration.exact import (
    solves_exactly,
)
from cpcal.calibration.fit import (
    fit,
)
from cpcal.calibration.frames import (
    FrameCalibration,
    HandEye,
    calibrate_frames,
    hand_eye,
    redefined,
)
from cpcal.calibration.identification import (
    leg_jacobian,
    robot_jacobian,
)
from cpcal.calibration.least_squares import (
    least_squares,
)
from cpcal.calibration.observability import (
    Observability,
    column_scale,
    observability,
)
from cpcal.calibration.record import (
    CalibrationRecord,
    recorded,
)
from cpcal.calibration.record_file import (
    RECORD_NAME,
    load_record,
    save_record,
)
from cpcal.calibration.screening import (
    Screening,
    screen,
)
from cpcal.calibration.selection import (
    Selection,
    select_poses,
)
from cpcal.calibration.statistics import (
    Deviations,
    campaign_deviations,
    deviations,
    mean_rotations,
)
from cpcal.calibration.study import (
    StudyCalibration,
    as_campaign,
    calibrate_study,
)
from cpcal.calibration.tolerance import (
    half_widths,
    readings_needed,
    tolerance_half_width,
    tolerance_interval,
)
from cpcal.calibration.validation import (
    ErrorSummary,
    PoseErrors,
    Validation,
    pose_errors,
    validate,
)
from cpcal.calibration.weights import (
    Noise,
)

__all__ = [
    "RECORD_NAME",
    "CalibrationRecord",
    "ChannelStatistics",
    "Deviations",
    "ErrorSummary",
    "Fit",
    "FrameCalibration",
    "HandEye",
    "LegEquations",
    "Noise",
    "Observability",
    "PoseErrors",
    "Screening",
    "Selection",
    "StudyCalibration",
    "Validation",
    "as_campaign",
    "averaged",
    "calibrate_frames",
    "calibrate_study",
    "campaign_deviations",
    "column_scale",
    "describe",
    "deviations",
    "dip",
    "dip_p_value",
    "fit",
    "half_widths",
    "hand_eye",
    "least_squares",
    "leg_jacobian",
    "load_record",
    "mean_rotations",
    "observability",
    "pose_errors",
    "readings_needed",
    "recorded",
    "redefined",
    "robot_jacobian",
    "save_record",
    "screen",
    "select_poses",
    "solves_exactly",
    "tolerance_half_width",
    "tolerance_interval",
    "validate",
]
