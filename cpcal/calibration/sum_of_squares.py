"""Least squares by Gauss-Newton steps, damped where they do not reduce the sum (Levenberg and Marquardt)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpcal.common.arrays import Floats

_STEPS = 200
_RANK = 1e-13  # of the largest singular value: a direction below it stays as it is
_FIRST = 1e-4  # damping, of the square of the largest singular value
_MOST = 1e12


def sum_of_squares(
    values: Callable[[Floats], Floats], jacobian: Callable[[Floats], Floats], start: Floats, tolerance: float
) -> tuple[Floats, bool]:
    """x (n,) that minimises the sum of squares of `values` (m,), near `start`, and whether the search came to rest.

    At rest: a step changes the sum, or x, by less than `tolerance` of itself, or the gradient vanishes to that.
    Directions of x that change nothing stay as they are, so of many minima it is one near the start.
    """
    x, found = start, values(start)
    damping = 0.0
    for _ in range(_STEPS):
        cost = float(found @ found)
        left, s, right = np.linalg.svd(jacobian(x), full_matrices=False)
        slope = left.T @ found
        if not cost > 0.0 or float(np.max(np.abs(right.T @ (s * slope)))) < tolerance:
            return x, True
        seen = s > _RANK * s[0]
        while True:
            factors = np.where(seen, s / np.where(seen, s**2 + damping * s[0] ** 2, 1.0), 0.0)
            step = -(right.T @ (factors * slope))
            after = values(x + step)
            new = float(after @ after)
            small = float(np.linalg.norm(step)) < tolerance * (tolerance + float(np.linalg.norm(x)))
            if new < cost:
                break
            if small or damping > _MOST:
                return x, True
            damping = max(10.0 * damping, _FIRST)
        x, found, damping = x + step, after, damping / 30.0 if damping > _FIRST else 0.0
        if small or cost - new < tolerance * cost:
            return x, True
    return x, False
