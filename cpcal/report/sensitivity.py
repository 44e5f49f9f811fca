"""How far the residual of each measurement can move while its reading stays in its set."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.legs import PLAIN, LegModel, reading_sensitivities
from cpcal.robot import Campaign, rotation_matrix


def reading_sensitivity(campaign: Campaign, leg: int, parameters: npt.ArrayLike, model: LegModel = PLAIN) -> Floats:
    """Sensitivity of `g(x, M_k)` about its value at the centre of the reading set, (N,) mm; to first order.

    With v = P + R b - a and b' = R b: `sum p_i |v_i|/|v| + sum r_j |(b' x (P - a))_j|/|v| + lambda`
    (DESIGN section 5); of other models by their derivatives. Plain floating point, for drawing; no proof rests on it.
    0 for exact readings.
    """
    if model.name != PLAIN.name:
        return reading_sensitivities(campaign, leg, parameters, model)
    x = np.asarray(parameters, np.float64)
    arm = rotation_matrix(campaign.quaternion) @ x[3:6]
    base = campaign.position - x[:3]
    vector = base + arm
    distance = np.linalg.norm(vector, axis=1)
    moved = np.sum(campaign.position_radius * np.abs(vector), axis=1)
    turned = np.sum(campaign.rotation_radius * np.abs(np.cross(arm, base)), axis=1)
    safe = np.where(distance > 0.0, distance, 1.0)
    return np.asarray((moved + turned) / safe + campaign.length_radius[:, leg - 1])
