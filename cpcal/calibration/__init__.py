"""From campaigns to fits and constraint networks: the leg model, its least squares, statistics and validation."""

from cpcal.calibration.equations import LegEquations
from cpcal.calibration.estimate import Fit
from cpcal.calibration.exact import solves_exactly
from cpcal.calibration.fit import fit
from cpcal.calibration.least_squares import least_squares
from cpcal.calibration.leg import PARAMETERS, leg_box, leg_network, residuals
from cpcal.calibration.statement import leg_statement
from cpcal.calibration.weights import Noise

__all__ = [
    "PARAMETERS",
    "Fit",
    "LegEquations",
    "Noise",
    "fit",
    "least_squares",
    "leg_box",
    "leg_network",
    "leg_statement",
    "residuals",
    "solves_exactly",
]
