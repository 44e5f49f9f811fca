from .fit import Noise, Validation, fit, pose_errors, validate
from .frames import nearest_motion, on_drawing, redefined
from .statistics import (
    as_campaign,
    averaged,
    campaign_deviations,
    deviations,
    mean_rotations,
    repeat_tests,
    repeatability,
    screen,
)

__all__ = [
    "Noise",
    "Validation",
    "as_campaign",
    "averaged",
    "campaign_deviations",
    "deviations",
    "fit",
    "mean_rotations",
    "nearest_motion",
    "on_drawing",
    "pose_errors",
    "redefined",
    "repeat_tests",
    "repeatability",
    "screen",
    "validate",
]
