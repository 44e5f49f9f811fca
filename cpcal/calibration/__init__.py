"""From campaigns to constraint networks: the leg model and its least-squares fit; frames; which poses to measure."""

from cpcal.calibration.exact import solves_exactly
from cpcal.calibration.frames import FrameCalibration, HandEye, calibrate_frames, hand_eye, redefined
from cpcal.calibration.identification import leg_jacobian, robot_jacobian
from cpcal.calibration.least_squares import least_squares
from cpcal.calibration.leg import PARAMETERS, leg_box, leg_network, residuals
from cpcal.calibration.observability import Observability, column_scale, observability
from cpcal.calibration.selection import Selection, select_poses
from cpcal.calibration.statement import leg_statement

__all__ = [
    "PARAMETERS",
    "FrameCalibration",
    "HandEye",
    "Observability",
    "Selection",
    "calibrate_frames",
    "column_scale",
    "hand_eye",
    "least_squares",
    "leg_box",
    "leg_jacobian",
    "leg_network",
    "leg_statement",
    "observability",
    "redefined",
    "residuals",
    "robot_jacobian",
    "select_poses",
    "solves_exactly",
]
