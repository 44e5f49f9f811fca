"""From campaigns to fits and constraint networks: the leg model, its least squares, statistics and validation."""

from cpcal.calibration.averaging import averaged
from cpcal.calibration.dip import dip, dip_p_value
from cpcal.calibration.distribution import ChannelStatistics, describe
from cpcal.calibration.equations import LegEquations
from cpcal.calibration.estimate import Fit
from cpcal.calibration.exact import solves_exactly
from cpcal.calibration.fit import fit
from cpcal.calibration.least_squares import least_squares
from cpcal.calibration.leg import PARAMETERS, leg_box, leg_network, residuals
from cpcal.calibration.screening import Screening, screen
from cpcal.calibration.statement import leg_statement
from cpcal.calibration.statistics import Deviations, campaign_deviations, deviations, mean_rotations
from cpcal.calibration.tolerance import half_widths, readings_needed, tolerance_half_width, tolerance_interval
from cpcal.calibration.validation import ErrorSummary, PoseErrors, Validation, pose_errors, validate
from cpcal.calibration.weights import Noise

__all__ = [
    "PARAMETERS",
    "ChannelStatistics",
    "Deviations",
    "ErrorSummary",
    "Fit",
    "LegEquations",
    "Noise",
    "PoseErrors",
    "Screening",
    "Validation",
    "averaged",
    "campaign_deviations",
    "describe",
    "deviations",
    "dip",
    "dip_p_value",
    "fit",
    "half_widths",
    "least_squares",
    "leg_box",
    "leg_network",
    "leg_statement",
    "mean_rotations",
    "pose_errors",
    "readings_needed",
    "residuals",
    "screen",
    "solves_exactly",
    "tolerance_half_width",
    "tolerance_interval",
    "validate",
]
