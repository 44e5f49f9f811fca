"""Rotation matrices (3, 3) as expressions: building blocks of networks, from quaternions, axes, vectors and angles.

A point p of the turned frame is `matrix @ p` in the fixed one. Angles in radians, quaternions scalar first.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.solver.network.expression import Expr, Operand, as_expr
from cpcal.solver.network.mathematics import cos, norm, sin, sqr

_CROSS = np.zeros((3, 3, 3))  # (i, j, k): the part of v_k in row i and column j of the matrix of `v x`
_CROSS[0, 1, 2] = _CROSS[1, 2, 0] = _CROSS[2, 0, 1] = -1.0
_CROSS[0, 2, 1] = _CROSS[1, 0, 2] = _CROSS[2, 1, 0] = 1.0


def rotation_from_quaternion(q: Operand) -> Expr:
    """Of a quaternion (4,), w first, of any length but 0: its rational matrix divided by |q|^2."""
    q = _vector(q, 4)
    w, v = q[0], q[1:]
    size = sqr(q).sum()
    square = sqr(w) - sqr(v).sum()
    return (_scaled_identity(square) + 2.0 * _outer(v) + 2.0 * w * _cross(v)) / size


def rotation_from_axis(axis: Operand, angle: Operand) -> Expr:
    """About a unit vector (3,) by an angle (Rodrigues). That the axis has length 1 is for the network to say."""
    n, t = _vector(axis, 3), as_expr(angle)
    return _scaled_identity(cos(t)) + sin(t) * _cross(n) + (1.0 - cos(t)) * _outer(n)


def rotation_from_vector(vector: Operand) -> Expr:
    """Of a rotation vector (3,), axis times angle; defined where it is not 0."""
    v = _vector(vector, 3)
    angle = norm(v)
    return rotation_from_axis(v / angle, angle)


def rotation_from_euler(sequence: str, angles: Operand) -> Expr:
    """Of three angles (3,) in the order of the letters: small ones turn about the fixed axes, capitals about the
    turned ones, as in scipy. Raises ModelError for other letters.
    """
    a = _vector(angles, 3)
    if len(sequence) != 3 or sequence not in (sequence.lower(), sequence.upper()) or set(sequence.lower()) - set("xyz"):
        raise ModelError(f"{sequence!r} is no sequence of axes: give three of x, y, z, all small or all capitals")
    one, two, three = (rotation_from_axis(np.eye(3)["xyz".index(s)], a[k]) for k, s in enumerate(sequence.lower()))
    return one @ two @ three if sequence.isupper() else three @ two @ one


def _vector(value: Operand, size: int) -> Expr:
    found = as_expr(value)
    if found.shape != (size,):
        raise ModelError(f"{size} numbers are needed here, not an array of shape {found.shape}")
    return found


def _scaled_identity(factor: Expr) -> Expr:
    return factor * as_expr(np.eye(3))


def _outer(v: Expr) -> Expr:
    return v[:, None] * v[None, :]


def _cross(v: Expr) -> Expr:
    """The matrix of `v x`."""
    return (v * _CROSS).sum(-1)
