"""Interval vectors and matrices, many at a time: the last axes count components, those before broadcast."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cpcal.robot.rotation import rotation_numerators
from cpcal.solver.interval import IntervalArray, get_arithmetic

ENGINE = get_arithmetic("float64")
_FORTH, _BACK = [1, 2, 0], [2, 0, 1]


def point(values: npt.ArrayLike) -> IntervalArray:
    """Exact numbers."""
    return IntervalArray.point(np.asarray(values, np.float64))


def total(x: IntervalArray, axis: int = -1) -> IntervalArray:
    """The sum along an axis, which may count from the end."""
    return ENGINE.sum(x, axis % x.ndim)


def dot(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Of vectors (..., m) and (..., m)."""
    return total(ENGINE.mul(x, y))


def cross(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Of vectors (..., 3) and (..., 3)."""
    forth = ENGINE.mul(x[..., _FORTH], y[..., _BACK])
    return ENGINE.sub(forth, ENGINE.mul(x[..., _BACK], y[..., _FORTH]))


def applied(matrix: IntervalArray, x: IntervalArray) -> IntervalArray:
    """M x, for matrices (..., m, n) and vectors (..., n)."""
    return total(ENGINE.mul(matrix, x[..., None, :]))


def transposed(matrix: IntervalArray) -> IntervalArray:
    """Of matrices (..., m, n)."""
    return IntervalArray(np.swapaxes(matrix.lo, -1, -2), np.swapaxes(matrix.hi, -1, -2))


def product(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Of matrices (..., m, k) and (..., k, n)."""
    return total(ENGINE.mul(x[..., :, :, None], y[..., None, :, :]), -2)


def norm(x: IntervalArray) -> IntervalArray:
    """Of vectors (..., m)."""
    return ENGINE.sqrt(total(ENGINE.sqr(x)))


def joined(parts: Sequence[IntervalArray], axis: int = -1) -> IntervalArray:
    """One after the other along an axis."""
    return IntervalArray(np.concatenate([p.lo for p in parts], axis), np.concatenate([p.hi for p in parts], axis))


def rotation(quaternion: IntervalArray) -> IntervalArray:
    """R(q) (..., 3, 3), divided by |q|^2, of quaternions (..., 4), scalar first."""
    rows, norm_squared = rotation_numerators([quaternion[..., k] for k in range(4)], ENGINE)
    entries = [ENGINE.div(entry, norm_squared) for row in rows for entry in row]
    shape = (*quaternion.shape[:-1], 3, 3)
    return IntervalArray(
        np.stack([e.lo for e in entries], axis=-1).reshape(shape),
        np.stack([e.hi for e in entries], axis=-1).reshape(shape),
    )


def turned(s: IntervalArray) -> IntervalArray:
    """R(1, s) (..., 3, 3) of s (..., 3)."""
    one = np.ones((*s.shape[:-1], 1))
    return rotation(joined([point(one), s]))


def along_turn(s: IntervalArray, m: IntervalArray) -> IntervalArray:
    """The gradient in s, (..., 3), of what changes by m.omega under a small turn omega of R(1, s).

    R(1, s + ds) turns R(1, s) by omega = 2 (ds + s x ds) / (1 + s.s), hence 2 (m - s x m) / (1 + s.s).
    """
    two = ENGINE.div(point(2.0), ENGINE.add(point(1.0), total(ENGINE.sqr(s))))
    return ENGINE.mul(two[..., None], ENGINE.sub(m, cross(s, m)))
