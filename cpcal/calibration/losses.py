"""Robust losses as scipy.optimize.least_squares defines them, and what a fit with one is worth (Huber's theory).

A loss rho is a function of z = (r / c)^2 for a residual r and a scale c; r counts as if it were psi(r) = rho'(z) r.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from cpcal.common.arrays import Floats

Loss = Literal["linear", "soft_l1", "huber", "cauchy", "arctan"]
LOSSES: tuple[Loss, ...] = get_args(Loss)

_GAUSS = 1.482602218505602  # 1 / the standard normal law's upper quartile: from a MAD to a standard deviation

# rho'(z) and rho''(z)
_DERIVATIVES: dict[Loss, Callable[[Floats], tuple[Floats, Floats]]] = {
    "linear": lambda z: (np.ones_like(z), np.zeros_like(z)),
    "soft_l1": lambda z: ((1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5),
    "huber": lambda z: (np.maximum(z, 1.0) ** -0.5, np.where(z > 1, -0.5 * np.maximum(z, 1.0) ** -1.5, 0.0)),
    "cauchy": lambda z: (1 / (1 + z), -1 / (1 + z) ** 2),
    "arctan": lambda z: (1 / (1 + z**2), -2 * z / (1 + z**2) ** 2),
}


def robust_scale(residuals: Floats) -> float:
    """1.4826 times the median of |r|: the standard deviation of normal residuals, whatever a minority of them does."""
    return _GAUSS * float(np.median(np.abs(residuals)))


def pseudo_residuals(residuals: Floats, loss: Loss, scale: Floats) -> Floats:
    """psi(r) / mean psi'(r), mean over rows: residuals (N, n) of the linear fit that errs as the robust one does.

    scale (n,). The covariance of these, in place of the residuals', gives that of the estimate (Huber, Robust
    Statistics, section 7.6: psi' replaced by its mean).
    """
    if loss == "linear":
        return residuals
    z = (residuals / scale) ** 2
    first, second = _DERIVATIVES[loss](z)
    return np.asarray(first * residuals / np.mean(first + 2 * z * second, axis=0))
