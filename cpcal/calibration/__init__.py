"""From campaigns to constraint networks: the leg model and its least-squares fit."""

from cpcal.calibration.exact import solves_exactly
from cpcal.calibration.least_squares import least_squares
from cpcal.calibration.leg import PARAMETERS, leg_box, leg_network, residuals
from cpcal.calibration.statement import leg_statement

__all__ = ["PARAMETERS", "least_squares", "leg_box", "leg_network", "leg_statement", "residuals", "solves_exactly"]
