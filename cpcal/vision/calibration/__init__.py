"""The camera from views of a target: a first one from homographies, then everything adjusted together."""

from cpcal.vision.calibration.calibrate_camera import (
    CalibratedView,
    Calibration,
    NotCalibratedError,
    TargetView,
    calibrate_camera,
    calibrate_from_images,
)

__all__ = [
    "CalibratedView",
    "Calibration",
    "NotCalibratedError",
    "TargetView",
    "calibrate_camera",
    "calibrate_from_images",
]
