"""Interval vectors, matrices and quaternions: exact numbers go in, enclosures of exact results come out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cpcal.robot.rotation import rotation_numerators
from cpcal.solver.interval import IntervalArray, get_arithmetic

ENGINE = get_arithmetic("float64")

_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def exact(values: npt.ArrayLike) -> IntervalArray:
    """Floats as the numbers that they are."""
    return IntervalArray.point(values)


def stacked(parts: Sequence[IntervalArray], axis: int = -1) -> IntervalArray:
    return IntervalArray(np.stack([p.lo for p in parts], axis), np.stack([p.hi for p in parts], axis))


def joined(parts: Sequence[IntervalArray], axis: int = -1) -> IntervalArray:
    return IntervalArray(np.concatenate([p.lo for p in parts], axis), np.concatenate([p.hi for p in parts], axis))


def inner(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """The sum of products along the last axis; other axes broadcast."""
    return ENGINE.sum(ENGINE.mul(x, y), -1)


def cross(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Cross products (..., 3)."""
    e = ENGINE
    return e.sub(e.mul(x[..., _NEXT], y[..., _LAST]), e.mul(x[..., _LAST], y[..., _NEXT]))


def times(matrix: IntervalArray, vectors: IntervalArray) -> IntervalArray:
    """A v for one matrix (3, 3) and vectors (..., 3)."""
    return inner(matrix, vectors[..., None, :])


def transposed(matrix: IntervalArray) -> IntervalArray:
    return IntervalArray(matrix.lo.T, matrix.hi.T)


def rotation(quaternion: npt.ArrayLike) -> IntervalArray:
    """R(q) (3, 3), the rational matrix divided by |q|^2, of one exact quaternion, scalar first."""
    q = exact(np.asarray(quaternion, dtype=np.float64))
    rows, norm_squared = rotation_numerators((q[k] for k in range(4)), ENGINE)
    return ENGINE.div(stacked([stacked(row) for row in rows], axis=0), norm_squared)


def turned_by(s: IntervalArray) -> IntervalArray:
    """R(1, s) (3, 3) for all s of a box (3,)."""
    rows, norm_squared = rotation_numerators((exact(1.0), s[0], s[1], s[2]), ENGINE)
    unit = IntervalArray(np.full((3, 3), -1.0), np.ones((3, 3)))
    return ENGINE.div(stacked([stacked(row) for row in rows], axis=0), norm_squared).intersect(unit)


def half_vector(matrix: IntervalArray) -> IntervalArray | None:
    """s with R(1, s) in `matrix` (3, 3), for every rotation in it; None where it may be a half-turn."""
    e = ENGINE
    trace = e.sum(matrix[np.arange(3), np.arange(3)], 0)
    divisor = e.add(exact(1.0), trace)
    if not float(divisor.lo) > 0.0:
        return None
    return e.div(e.sub(matrix[_LAST, _NEXT], matrix[_NEXT, _LAST]), divisor)


def quaternion_product(left: IntervalArray, right: IntervalArray) -> IntervalArray:
    """The Hamilton product (4,) x (4,), scalar first."""
    e = ENGINE
    p, q = left[1:], right[1:]
    scalar = e.sub(e.mul(left[0], right[0]), inner(p, q))
    vector = e.add(e.add(e.mul(left[0], q), e.mul(right[0], p)), cross(p, q))
    return joined([scalar.reshape((1,)), vector])


def with_float_coefficients(
    coefficients: IntervalArray, constant: IntervalArray, largest: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Rows `coefficients @ z + constant <= 0`, (m, k) and (m,), as rows of floats that they imply where |z| <= largest.

    c z + d <= 0 with c within r of its midpoint gives mid(c) z + (d - r |z|) <= 0, whatever c and d are exactly.
    """
    e = ENGINE
    lost = e.sum(e.mul(exact(coefficients.rad), exact(largest)), 1)
    return coefficients.mid, e.sub(constant, lost).lo
