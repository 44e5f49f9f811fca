"""Symmetric 2 x 2 matrices, many at once, in closed form: several times faster than LAPACK on each."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats


def determinants(matrices: Floats) -> Floats:
    """(..., 2, 2) -> (...)."""
    return np.asarray(matrices[..., 0, 0] * matrices[..., 1, 1] - matrices[..., 0, 1] * matrices[..., 1, 0])


def eigenvalues(matrices: Floats) -> Floats:
    """(..., 2, 2) -> (..., 2), rising; exact to rounding of the larger one. That of a nan is nan."""
    xx, xy, yy = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    out = np.empty((*half.shape, 2))
    np.subtract(half, apart, out=out[..., 0])
    np.add(half, apart, out=out[..., 1])
    return out


def inverses(matrices: Floats) -> Floats:
    """(..., 2, 2) -> (..., 2, 2), of regular ones."""
    out = np.empty_like(matrices)
    out[..., 0, 0], out[..., 1, 1] = matrices[..., 1, 1], matrices[..., 0, 0]
    out[..., 0, 1], out[..., 1, 0] = -matrices[..., 0, 1], -matrices[..., 1, 0]
    out /= determinants(matrices)[..., None, None]
    return out
