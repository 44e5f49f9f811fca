"""The directions that count: a disc on which the lens does not turn back, whatever camera of the set it is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.solver.interval import IntervalArray
from cpcal.vision.pose_sets.bias import center_bias
from cpcal.vision.pose_sets.lens_bounds import lens_over
from cpcal.vision.pose_sets.uncertain import CameraSet

NEAREST = 40.0  # radii of a dot: no dot is nearer to the camera's plane
CELLS = 24  # squares that the disc is looked at by, each way
BIAS_CELLS = 24  # the same for the bias
BIAS_ROUNDS = 3  # in which the bias of a dot is narrowed from that
_MARGIN = 0.03  # of the field beyond the image's corners, as a share of their distance from the axis
_RAYS, _STEPS = 97, 400
_WIDEST = 4.0  # tangent of the largest angle to the axis
_TURNS = 0.01  # determinant of the distortion's derivative, 1 on the axis, at which a lens is said to turn back
_LEAST = 0.02  # of m on the disc
_NARROWER = 0.95  # disc, until m is that large and the bias is bounded
_SMALLEST = 20


@dataclass(frozen=True)
class Field:
    """The directions that count, r <= radius, for all cameras of a set.

    least_slope  m > 0, which no eigenvalue of a lens's Jacobian is below
    bias         pixels, the largest component of the bias of a dot that is seen there
    """

    radius: float
    least_slope: float
    bias: float


@lru_cache(maxsize=16)
def field_of_view(cameras: CameraSet) -> Field:
    """What the image shows and a little more, but no more than where the lens of some camera may turn back.

    Raises InputError for a lens that bends too much to be enclosed.
    """
    camera = cameras.camera
    radius = np.linspace(0.0, _WIDEST, _STEPS)
    angle = np.linspace(-np.pi, np.pi, _RAYS)
    rays = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    onward = np.all(np.linalg.det(camera.distortion_jacobian(rays)) > _TURNS, axis=1)
    pixels = camera.pixels(rays)
    held = (pixels >= -0.5) & (pixels <= [camera.width - 0.5, camera.height - 0.5])
    shown = np.any(np.all(held, axis=2), axis=1)
    good = np.logical_and.accumulate(onward)
    reach = radius[np.flatnonzero(good & shown)[-1]] if (good & shown).any() else 0.0
    edge = min((1.0 + _MARGIN) * float(reach), float(radius[good.sum() - 1]))
    for _ in range(_SMALLEST):
        least = _least_slope(edge, cameras)
        bias = _most_bias(edge, cameras) if least >= _LEAST else None
        if bias is not None:
            return Field(edge, least, bias)
        edge *= _NARROWER
    what = "has a lens that bends too much within the image"
    raise InputError([Problem("camera", what, "pose sets need a lens whose image does not turn back")])


def _least_slope(radius: float, cameras: CameraSet) -> float:
    """m on the disc."""
    return float(lens_over(_squares(radius, CELLS), cameras).least_slope.lo.min())


def _most_bias(radius: float, cameras: CameraSet) -> float | None:
    """The largest component of the bias of a dot anywhere; None where it is not bounded."""
    x = _squares(radius, BIAS_CELLS)
    depths = IntervalArray(np.zeros(len(x.lo)), np.full(len(x.lo), 1.0 / NEAREST))
    normals = IntervalArray(np.full((len(x.lo), 3), -1.0), np.ones((len(x.lo), 3)))
    bias = center_bias(x, depths, normals, cameras)
    return None if bias is None else float(bias.mag.max())


def _squares(radius: float, count: int) -> IntervalArray:
    """Those (c, 2) of count x count squares around the disc that meet it."""
    cuts = np.linspace(-radius, radius, count + 1)
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    lo, hi = np.stack([cuts[i], cuts[j]], axis=1), np.stack([cuts[i + 1], cuts[j + 1]], axis=1)
    nearest = np.where((lo <= 0.0) & (hi >= 0.0), 0.0, np.minimum(np.abs(lo), np.abs(hi)))
    meets = np.hypot(nearest[:, 0], nearest[:, 1]) <= radius * (1.0 + 1e-12)
    return IntervalArray(lo[meets], hi[meets])
