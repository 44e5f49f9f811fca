"""The classical fit x_c of one leg: where certification looks around. It proves nothing."""

from __future__ import annotations

import numpy as np

from cpcal.calibration.fit import fit
from cpcal.common.arrays import Floats
from cpcal.robot import Campaign

_TOLERANCE = 1e-8  # a box of X0 is centred here, so closer adds nothing


def least_squares(campaign: Campaign, leg: int) -> Floats:
    """Parameters (7,) in mm that minimise the sum of squares of g (paper, eq. 15), from the nominal ones.

    Leg numbers count from 1. With fewer than 7 independent poses: one of the many minima, near the nominal.
    """
    return np.asarray(fit(campaign, legs=[leg], tolerance=_TOLERANCE).parameters[0])
