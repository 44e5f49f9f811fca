"""The classical fit x_c of one leg: where certification looks around. It proves nothing."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import optimize

from cpcal.calibration.leg import residuals
from cpcal.robot import Campaign, rotation_matrix

Floats = npt.NDArray[np.float64]


def least_squares(campaign: Campaign, leg: int) -> Floats:
    """Parameters (7,) in mm that minimise the sum of squares of g (paper, eq. 15), from the nominal ones.

    Leg numbers count from 1. With fewer than 7 independent poses: one of the many minima, near the nominal.
    """
    robot = campaign.robot
    start = np.concatenate([robot.base[leg - 1], robot.mobile[leg - 1], [robot.offset[leg - 1]]])
    rotations = rotation_matrix(campaign.quaternion)

    def values(x: Floats) -> Floats:
        return residuals(campaign, leg, x)

    def jacobian(x: Floats) -> Floats:
        vector = campaign.position + rotations @ x[3:6] - x[:3]
        unit = vector / np.maximum(np.linalg.norm(vector, axis=1), 1e-300)[:, None]
        along = np.einsum("ki,kij->kj", unit, rotations)
        return np.concatenate([-unit, along, -np.ones((len(unit), 1))], axis=1)

    found = optimize.least_squares(values, start, jac=jacobian, method="trf")
    return np.asarray(found.x, dtype=np.float64)
