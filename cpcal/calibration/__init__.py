"""From campaigns to constraint networks: the leg models and their least-squares fits."""

from cpcal.calibration.exact import solves_exactly
from cpcal.calibration.least_squares import least_squares
from cpcal.calibration.leg import exactly_read, leg_box, leg_network, residuals
from cpcal.calibration.model_fit import ModelResiduals, fit_model, model_residuals, reading_room_of
from cpcal.calibration.models import (
    PARAMETERS,
    PLAIN,
    LegModel,
    Measured,
    Parameter,
    half_width_problems,
    known_models,
    leg_model,
    register_model,
)
from cpcal.calibration.statement import leg_statement, model_statement

__all__ = [
    "PARAMETERS",
    "PLAIN",
    "LegModel",
    "Measured",
    "ModelResiduals",
    "Parameter",
    "exactly_read",
    "fit_model",
    "half_width_problems",
    "known_models",
    "least_squares",
    "leg_box",
    "leg_model",
    "leg_network",
    "leg_statement",
    "model_residuals",
    "model_statement",
    "reading_room_of",
    "register_model",
    "residuals",
    "solves_exactly",
]
