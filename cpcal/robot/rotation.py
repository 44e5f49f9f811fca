"""Rotations as quaternions, scalar first: (w, x, y, z). Every function is vectorised over leading axes.

`rotation_matrix(q)` divides by |q|^2, so it is the same rational function of q everywhere in cpcal, in floats
and in exact arithmetic, whether q has unit norm or not (DESIGN section 1).
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats


class Ring(Protocol):
    """How numbers of some kind are added, subtracted and multiplied: module `operator`, or an interval arithmetic."""

    @property
    def add(self) -> Callable[[Any, Any], Any]: ...
    @property
    def sub(self) -> Callable[[Any, Any], Any]: ...
    @property
    def mul(self) -> Callable[[Any, Any], Any]: ...


def rotation_numerators(quaternion: Iterable[Any], ring: Ring = operator) -> tuple[list[list[Any]], Any]:
    """The nine entries of |q|^2 R(q), row by row, and |q|^2, over any ring: arrays, fractions, expressions, intervals.

    Every product is formed once. What R(q) is stands here alone; the checker has its own.
    """
    w, x, y, z = quaternion
    add, sub, mul = ring.add, ring.sub, ring.mul
    ww, xx, yy, zz = mul(w, w), mul(x, x), mul(y, y), mul(z, z)
    xy, xz, yz, wx, wy, wz = mul(x, y), mul(x, z), mul(y, z), mul(w, x), mul(w, y), mul(w, z)

    def twice(value: Any) -> Any:
        return add(value, value)

    rows = [
        [sub(sub(add(ww, xx), yy), zz), twice(sub(xy, wz)), twice(add(xz, wy))],
        [twice(add(xy, wz)), sub(add(sub(ww, xx), yy), zz), twice(sub(yz, wx))],
        [twice(sub(xz, wy)), twice(add(yz, wx)), add(sub(sub(ww, xx), yy), zz)],
    ]
    return rows, add(add(add(ww, xx), yy), zz)


def rotation_matrix(quaternion: npt.ArrayLike) -> Floats:
    """R(q), (..., 4) -> (..., 3, 3): the rotation of any non-zero quaternion, without a square root."""
    q = np.asarray(quaternion, dtype=np.float64)
    # plain floats are several times faster for one quaternion, and give the same bits
    entries, norm_squared = rotation_numerators(q.tolist() if q.ndim == 1 else np.moveaxis(q, -1, 0))
    if q.ndim == 1:
        return np.array(entries) / np.float64(norm_squared)
    matrix = np.stack([np.stack(row, axis=-1) for row in entries], axis=-2)
    return np.asarray(matrix / norm_squared[..., None, None])


def quaternion_product(left: npt.ArrayLike, right: npt.ArrayLike) -> Floats:
    """The Hamilton product, (..., 4) x (..., 4) -> (..., 4): R(left * right) = R(left) R(right)."""
    p, q = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
    scalar = p[..., 0] * q[..., 0] - np.sum(p[..., 1:] * q[..., 1:], axis=-1)
    vector = p[..., :1] * q[..., 1:] + q[..., :1] * p[..., 1:] + np.cross(p[..., 1:], q[..., 1:])
    return np.concatenate([scalar[..., None], vector], axis=-1)


def quaternion_conjugate(quaternion: npt.ArrayLike) -> Floats:
    """(w, -x, -y, -z), (..., 4) -> (..., 4): the inverse rotation."""
    q = np.asarray(quaternion, dtype=np.float64)
    return np.concatenate([q[..., :1], -q[..., 1:]], axis=-1)


def normalised(quaternion: npt.ArrayLike) -> Floats:
    """The unit quaternion of the same rotation with a scalar part >= 0, (..., 4) -> (..., 4)."""
    q = np.asarray(quaternion, dtype=np.float64)
    sign = np.where(q[..., :1] < 0, -1.0, 1.0)
    return np.asarray(q * sign / np.linalg.norm(q, axis=-1, keepdims=True))


def small_rotation(vector: npt.ArrayLike) -> Floats:
    """The quaternion (1, s) with 2 s = vector, not normalised, (..., 3) -> (..., 4).

    This is how the reading sets write a rotation error (DESIGN section 1): its inverse is exactly (1, -s),
    and 2 s is the rotation vector up to a relative error of angle^2 / 12.
    """
    s = 0.5 * np.asarray(vector, dtype=np.float64)
    return np.concatenate([np.ones((*s.shape[:-1], 1)), s], axis=-1)


def quaternion_from_rotation_vector(vector: npt.ArrayLike) -> Floats:
    """The unit quaternion that turns by |vector| rad about it, (..., 3) -> (..., 4)."""
    v = np.asarray(vector, dtype=np.float64)
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * v * np.sinc(half / np.pi)], axis=-1)


def rotation_vector(quaternion: npt.ArrayLike) -> Floats:
    """The rotation vector, rad, of norm at most pi, (..., 4) -> (..., 3)."""
    q = normalised(quaternion)
    half = np.arctan2(np.linalg.norm(q[..., 1:], axis=-1, keepdims=True), q[..., :1])
    return np.asarray(2.0 * q[..., 1:] / np.sinc(half / np.pi))


def quaternion_from_matrix(matrix: npt.ArrayLike) -> Floats:
    """The unit quaternion (scalar part >= 0) of a rotation matrix, (..., 3, 3) -> (..., 4).

    Each of the four rows below is a multiple of the quaternion; that with the largest pivot is accurate.
    """
    m = np.asarray(matrix, dtype=np.float64)
    (xx, m01, m02), (m10, yy, m12), (m20, m21, zz) = m.tolist() if m.ndim == 2 else np.moveaxis(m, (-2, -1), (0, 1))
    wx, wy, wz = m21 - m12, m02 - m20, m10 - m01
    xy, xz, yz = m01 + m10, m02 + m20, m12 + m21
    rows = [
        [1 + xx + yy + zz, wx, wy, wz],
        [wx, 1 + xx - yy - zz, xy, xz],
        [wy, xy, 1 - xx + yy - zz, yz],
        [wz, xz, yz, 1 - xx - yy + zz],
    ]
    if m.ndim == 2:
        return normalised(rows[max(range(4), key=lambda k: rows[k][k])])
    multiples = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    pivot = np.argmax(np.diagonal(multiples, axis1=-2, axis2=-1), axis=-1)
    best = np.take_along_axis(multiples, pivot[..., None, None], axis=-2)[..., 0, :]
    return normalised(best)
