"""A small symmetric positive definite system, compiled, for fits that solve one in every step."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled


@compiled
def solved(
    matrix: npt.NDArray[np.floating[Any]], size: int, damping: float, least: float, right: Floats, out: Floats
) -> bool:
    """out = (matrix + damping diag(matrix))^-1 right, of the first `size`, by the factor scaled to a unit diagonal.

    False where the diagonal is not above `least`, or the matrix is not positive definite.
    """
    factor, scale = np.empty((size, size)), np.empty(size)
    if not factored(matrix, size, damping, least, factor, scale):
        return False
    substituted(factor, scale, size, right, out)
    return True


@compiled
def factored(
    matrix: npt.NDArray[np.floating[Any]], size: int, damping: float, least: float, factor: Floats, scale: Floats
) -> bool:
    """The lower triangular factor (size, size), one over its diagonal in the diagonal's place, and the scale (size,)
    that makes a unit diagonal; False as `solved` says."""
    for i in range(size):
        if not matrix[i, i] > least:
            return False
        scale[i] = 1.0 / np.sqrt(matrix[i, i])
        for j in range(i):
            value = matrix[i, j] * scale[i] * scale[j]
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            factor[i, j] = value * factor[j, j]
        value = matrix[i, i] * scale[i] * scale[i] + damping
        for k in range(i):
            value -= factor[i, k] * factor[i, k]
        if not value > 0.0:
            return False
        factor[i, i] = 1.0 / np.sqrt(value)
    return True


@compiled
def substituted(factor: Floats, scale: Floats, size: int, right: Floats, out: Floats) -> None:
    """The solution for a right side, forward and backward."""
    for i in range(size):
        value = right[i] * scale[i]
        for k in range(i):
            value -= factor[i, k] * out[k]
        out[i] = value * factor[i, i]
    for i in range(size - 1, -1, -1):
        value = out[i]
        for k in range(i + 1, size):
            value -= factor[k, i] * out[k]
        out[i] = value * factor[i, i]
    for i in range(size):
        out[i] *= scale[i]
