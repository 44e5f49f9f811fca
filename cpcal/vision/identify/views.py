"""Found dots as a pinhole camera without distortion would see them, exactly or by guesses of the distortion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.vision.camera import Camera
from cpcal.vision.identify.nearest import nearest_squares
from cpcal.vision.median import median

_EXACT = 0.015  # of the spacing: how far a dot may be off when the camera is known
_GUESSED = (0.02, 0.06)  # the same along a line and in the plane when the distortion is guessed
_BENDS = (0.0, 0.03, 0.06, 0.09, 0.12, -0.03, 0.15, 0.18, -0.06, 0.22, 0.26, 0.3, -0.1)  # radial, at half the diagonal


@dataclass(frozen=True, eq=False)
class View:
    """Points (n, 2) in which straight lines are straight; y still points down.

    spacing    median distance between nearest neighbours; the unit of the two tolerances is that of the points
    fine       how far a dot may be off its line, and off its place on the line
    reach      how far a dot may be off its predicted place in the plane
    camera     when known; otherwise dots are expected in the rectangle around the points
    """

    points: Floats
    spacing: float
    fine: float
    reach: float
    camera: Camera | None = None

    def in_view(self, predicted: Floats, margin: Floats) -> Bools:
        """Which predicted points (..., 2) would be seen whole, `margin` (...) their radius."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        if self.camera is not None:
            low, high = _seen_rectangle(self.camera)
        inside = (
            np.isfinite(predicted).all(axis=-1) & (predicted >= low).all(axis=-1) & (predicted <= high).all(axis=-1)
        )
        if self.camera is None:
            return np.asarray(inside)
        pixels = self.camera.pixels(np.where(inside[..., None], predicted, 0.0))
        edge = (2.0 * margin * self.camera.focal.max())[..., None]  # whole, and some plate around it
        size = np.array([self.camera.width, self.camera.height])
        return np.asarray(inside & (pixels >= edge - 0.5).all(axis=-1) & (pixels <= size - 0.5 - edge).all(axis=-1))

    @property
    def area(self) -> float:
        width, height = np.ptp(self.points, axis=0)
        return float(width * height)


@lru_cache(maxsize=8)
def _seen_rectangle(camera: Camera) -> tuple[Floats, Floats]:
    """The rectangle around all directions that the image shows."""
    x, y = np.linspace(-0.5, camera.width - 0.5, 9), np.linspace(-0.5, camera.height - 0.5, 9)
    border = [np.stack([x, np.full(9, end)], axis=1) for end in (y[0], y[-1])]
    border += [np.stack([np.full(9, end), y], axis=1) for end in (x[0], x[-1])]
    rays = camera.normalised(np.concatenate(border))
    return np.nanmin(rays, axis=0), np.nanmax(rays, axis=0)


def seen_by(camera: Camera, pixels: Floats, tolerance: float | None) -> View:
    """The directions of pixels (n, 2); one that the camera cannot show stays nan."""
    rays = camera.normalised(pixels)
    spacing = _spacing(rays[np.isfinite(rays).all(axis=1)])
    reach = spacing * (tolerance or _EXACT)
    return View(rays, spacing, reach, reach, camera)


def guesses(pixels: Floats, size: tuple[int, int] | None, tolerance: float | None) -> Iterator[View]:
    """Pixels (n, 2) freed from a guessed radial distortion about the middle of the image (or of the dots)."""
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    middle = 0.5 * (low + high) if size is None else 0.5 * (np.array(size, dtype=np.float64) - 1.0)
    radius = float(np.linalg.norm(np.maximum(high - middle, middle - low)))
    for bend in _BENDS:
        yield bent_back(pixels, middle, bend / radius**2, tolerance)


def bent_back(pixels: Floats, middle: Floats, bend: float, tolerance: float | None = None) -> View:
    """middle + (pixels - middle) (1 + bend r^2)."""
    arm = pixels - middle
    points = middle + arm * (1.0 + bend * (arm * arm).sum(axis=1, keepdims=True))
    spacing = _spacing(points)
    fine, reach = (tolerance, tolerance) if tolerance else _GUESSED
    return View(points, spacing, fine * spacing, reach * spacing)


def _spacing(points: Floats) -> float:
    if len(points) < 2:
        return 0.0
    square = np.empty(len(points))
    nearest_squares(np.ascontiguousarray(points), square)
    return float(np.sqrt(median(square)))
