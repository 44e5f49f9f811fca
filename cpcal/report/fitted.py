"""The least-squares fit of a leg, which stands beside what was proved. Plain floating point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.legs import LegModel, fit_model, model_jacobian, model_residuals
from cpcal.results import LegResult, Result
from cpcal.robot import Campaign


@dataclass(frozen=True, eq=False)
class Fitted:
    """Its parameters (n,), residuals (N,) in mm at the centres of the reading sets, and their Jacobian (N, n)."""

    x: Floats
    residuals: Floats
    jacobian: Floats

    @property
    def largest(self) -> float:
        return float(np.max(np.abs(self.residuals)))


def fitted(campaign: Campaign, result: Result, leg: LegResult, model: LegModel) -> Fitted:
    """The fit that was the center of the box, or else one made now."""
    known = result.options.center == "fit"
    x = np.array(leg.center) if known else fit_model(campaign, leg.leg, model)
    with np.errstate(all="ignore"):  # the center of a damaged result may be anywhere
        values, slopes = model_residuals(campaign, leg.leg, x, model), model_jacobian(campaign, leg.leg, x, model)
        return Fitted(x, np.nan_to_num(values), np.nan_to_num(slopes))
