"""Measurements that do not fit the others: residuals of a robust fit that are far beyond the rest. No proof."""

from __future__ import annotations

import numpy as np

from cpcal.calibration import LegEquations, fit
from cpcal.calibration.leg_equations import robust_scale
from cpcal.certify.outlook import slack
from cpcal.common.arrays import Bools, Floats
from cpcal.common.numbers import about
from cpcal.robot import Campaign

_FAR = 10.0  # robust standard deviations; the largest of 10,000 normal numbers is at 4
_LEAST = 12  # measurements: fewer can be fitted one and all
_ROUNDING = 1e-9  # of the leg length: residuals below it are none
_NAMED = 5  # measurements in a list


def robust_parameters(campaign: Campaign) -> Floats:
    """(n, 7) mm, of a fit that a few gross errors do not move."""
    return np.asarray(fit(campaign, loss="soft_l1", tolerance=1e-8).parameters)


def odd_rows(campaign: Campaign, x: Floats) -> list[str]:
    """One sentence for each measurement that is far off at parameters x (n, 7), worst first; the last counts the rest.

    Residuals are judged beside what each measurement's reading sets allow, and inside of it nothing is odd.
    """
    if len(campaign) < _LEAST:
        return []
    residuals, far = _far(campaign, x)
    rows = np.flatnonzero(far.any(axis=1))
    rows = rows[np.argsort(-np.abs(residuals[rows] * far[rows]).max(axis=1))]
    ids = campaign.measurement_ids
    said = [f"{ids[row]}: {_where(residuals[row], far[row])}." for row in rows[:_NAMED]]
    return said + ([f"{len(rows) - _NAMED} more measurements are as far off."] if len(rows) > _NAMED else [])


def _far(campaign: Campaign, x: Floats) -> tuple[Floats, Bools]:
    """Residuals (N, n) mm, and which are far beyond the others of their leg."""
    legs = range(1, campaign.legs + 1)
    residuals = LegEquations.of(campaign, list(legs)).values(x)
    far = np.zeros(residuals.shape, dtype=np.bool_)
    for leg in legs:
        allowed, off = slack(campaign, leg, x[leg - 1]), np.abs(residuals[:, leg - 1])
        unit = allowed if (allowed > 0.0).all() else np.ones_like(allowed)
        least = _ROUNDING * float(np.abs(campaign.length[:, leg - 1] + x[leg - 1, 6]).max())
        far[:, leg - 1] = (off / unit > _FAR * robust_scale(off / unit)) & (off > allowed + least)
    return residuals, far


def _where(residual: Floats, far: Bools) -> str:
    legs = np.flatnonzero(far) + 1
    worst = about(float(np.abs(residual[far]).max()))
    if len(legs) > 1:
        listed = ", ".join(map(str, legs))
        return f"its pose does not fit the readings of legs {listed} (off by up to {worst} mm)"
    return f"leg {legs[0]} reads {worst} mm off what the others let expect"
