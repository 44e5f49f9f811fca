"""Outlines of regions as ellipses, compiled: area, centroid, second moments, and whether they look like dots."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Bools, Floats
from cpcal.solver.compiled import compiled

_SLIMMEST = 0.2  # ratio of the axes of a spot
_ELLIPTIC = 0.85  # least ratio of a spot's area to that of the ellipse of the same second moments


@compiled
def ellipses(
    points: npt.NDArray[np.int32],
    ends: npt.NDArray[np.int64],
    width: int,
    height: int,
    center: Floats,
    spread: Floats,
    keep: Bools,
) -> None:
    """Of outlines (n of them; the last begins where `ends` (n,) says the one before ended) in an image: the centres
    (n, 2) pixels, the second moments (n, 2, 2) px^2 of the regions, and which are elliptic and clear of the border.

    Moments are those of polygons by Green's formula; holes have negative areas, and are not kept.
    """
    first = 0
    for i in range(len(ends)):
        last = ends[i]
        keep[i] = False
        if last - first >= 4 and _clear(points, first, last, width, height):
            keep[i] = _ellipse(points, first, last, center[i], spread[i])
        first = last


@compiled
def _clear(points: npt.NDArray[np.int32], first: int, last: int, width: int, height: int) -> bool:
    """Whether an outline does not touch the image's border."""
    for k in range(first, last):
        x, y = points[k, 0], points[k, 1]
        if not (0 < x < width - 1 and 0 < y < height - 1):
            return False
    return True


@compiled
def _ellipse(points: npt.NDArray[np.int32], first: int, last: int, center: Floats, spread: Floats) -> bool:
    area, sum_x, sum_y, sum_xx, sum_xy, sum_yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x1, y1 = 0.0, 0.0  # from the outline's first point, and the way back
    for k in range(last - 1, first - 1, -1):
        x0, y0 = float(points[k, 0] - points[first, 0]), float(points[k, 1] - points[first, 1])
        cross = x1 * y0 - x0 * y1  # OpenCV goes round a region with y/x turned this way
        area += cross / 2.0
        sum_x += cross * (x0 + x1) / 6.0
        sum_y += cross * (y0 + y1) / 6.0
        sum_xx += cross * (x0 * x0 + x0 * x1 + x1 * x1) / 12.0
        sum_xy += cross * (2.0 * (x0 * y0 + x1 * y1) + x0 * y1 + x1 * y0) / 24.0
        sum_yy += cross * (y0 * y0 + y0 * y1 + y1 * y1) / 12.0
        x1, y1 = x0, y0
    if not area > 0.0:
        return False
    x, y = sum_x / area, sum_y / area
    xx, xy, yy = sum_xx / area - x * x, sum_xy / area - x * y, sum_yy / area - y * y
    half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    short, long = half - apart, half + apart
    if not area > _ELLIPTIC * 4.0 * np.pi * np.sqrt(max(short * long, 0.0)):
        return False
    # an outline runs through the centres of pixels: the region reaches half a pixel farther, in every direction
    short_growth = (0.25 + np.sqrt(max(short, 1e-4))) ** 2 - short
    long_growth = (0.25 + np.sqrt(max(long, 1e-4))) ** 2 - long
    growth = 0.5 * (short_growth + long_growth)
    center[0], center[1] = points[first, 0] + x, points[first, 1] + y
    spread[0, 0], spread[0, 1], spread[1, 0], spread[1, 1] = xx + growth, xy, xy, yy + growth
    return bool(short + short_growth > _SLIMMEST**2 * (long + long_growth))
