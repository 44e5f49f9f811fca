"""Derivatives of a leg's equation by its parameters, in plain floating point."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.calibration.leg_equations import LegEquations
from cpcal.common.arrays import Floats
from cpcal.legs.models import PLAIN, LegModel
from cpcal.robot import Campaign


def model_jacobian(campaign: Campaign, leg: int, x: npt.ArrayLike, model: LegModel = PLAIN) -> Floats:
    """dg/dx (N, n) at the centres of the reading sets; of the plain model from its formula."""
    point = np.asarray(x, np.float64)
    if model.name == PLAIN.name:
        return LegEquations.of(campaign, [leg]).by_parameters(point[None])[:, 0]
    from cpcal.legs.model_fit import ModelResiduals  # here: who checks a run of plain legs needs no networks

    return ModelResiduals(campaign, leg, model).jacobian(point)
