"""Frames that the joint centres themselves define, so that parameters of two fits or two robots can be compared.

For base and mobile centres each: origin at the centroid of the centres, z normal to the plane of the first three, x
along the first two. In these the paper prints its tables 4 and 5 (to 2e-5 mm). A frame that hangs on three centres
turns with their errors: z and y of the others then hold the errors of those three, enlarged where the three are close
to a line.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem

_STEP = 1e-3  # mm, of the difference quotients; the map is smooth over millimetres


def in_own_frame(parameters: Floats) -> Floats:
    """Parameters (..., n, 7), mm, with base and mobile centres each in their own frame.

    Raises InputError for fewer than three legs, and for first three centres on a line.
    """
    base, mobile = (_moved(parameters[..., part]) for part in (slice(0, 3), slice(3, 6)))
    return np.concatenate([base, mobile, parameters[..., 6:]], axis=-1)


def own_frame_covariance(parameters: Floats, covariance: Floats) -> Floats:
    """(7 n, 7 n) mm^2 of `in_own_frame`, to first order, from that of the parameters (n, 7), leg by leg."""
    size = parameters.size
    steps = _STEP * np.eye(size).reshape(size, *parameters.shape)
    ahead, back = (in_own_frame(parameters + sign * steps).reshape(size, size) for sign in (1.0, -1.0))
    slopes = ((ahead - back) / (2.0 * _STEP)).T
    return np.asarray(slopes @ covariance @ slopes.T)


def _moved(points: Floats) -> Floats:
    """Points (..., n, 3) in the frame that they define."""
    if points.shape[-2] < 3:
        what = f"are {points.shape[-2]}: no frame follows from them"
        raise InputError([Problem("joint centres", what, "give three that are not on a line")])
    first, second, third = (points[..., k, :] for k in range(3))
    along, across = second - first, third - first
    normal = np.cross(along, across)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    length = np.linalg.norm(along, axis=-1, keepdims=True)
    if not (size > 1e-9 * length * np.linalg.norm(across, axis=-1, keepdims=True)).all():
        raise InputError([Problem("joint centres", "of legs 1 to 3 are on a line", "choose another frame")])
    x, z = along / length, normal / size
    axes = np.stack([x, np.cross(z, x), z], axis=-2)
    return np.asarray((points - points.mean(axis=-2, keepdims=True)) @ np.swapaxes(axes, -1, -2))
