from .equation import (
    beyond_legs,
    exactly_read,
    leg_box,
    leg_network,
    residuals,
)
from .known import (
    leg_model,
)
from .leg_derivatives import (
    model_jacobian,
)
from .leg_statement import (
    leg_statement,
    model_statement,
)
from .model_fit import (
    ModelResiduals,
    fit_model,
    model_residuals,
    reading_sensitivities,
)
from .models import (
    BUILT_IN,
    PARAMETERS,
    PLAIN,
    Drawn,
    LegModel,
    Measured,
    Parameter,
    built_in,
    half_width_problems,
    model_name_problem,
)

__all__ = [
    "BUILT_IN",
    "PARAMETERS",
    "PLAIN",
    "Drawn",
    "LegModel",
    "Measured",
    "ModelResiduals",
    "Parameter",
    "beyond_legs",
    "built_in",
    "exactly_read",
    "fit_model",
    "half_width_problems",
    "leg_box",
    "leg_model",
    "leg_network",
    "leg_statement",
    "model_jacobian",
    "model_name_problem",
    "model_residuals",
    "model_statement",
    "reading_sensitivities",
    "residuals",
]
