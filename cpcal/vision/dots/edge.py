"""Blurred ellipses fitted to the grey levels round dots: the likeliest centre for pixels' noise.

The model of a pixel at signed distance d inside the ellipse is light (back + contrast Phi(d / blur)): the edge spread
of a Gaussian blur (the pixel's own square is part of it), which may be wider in one direction (motion), under light
that grows linearly, or by a cubic. The ellipse is where the grey is half-way between back and dot; the
centre is freed of what a blur makes of steep light (`edge_fit._moves`). Gauss-Newton steps
on all pixels use every bit of information on the edge that the image holds, so errors are close to the Cramer-Rao
bound, and the inverse normal matrix is their covariance. What the model leaves out and is symmetric about the centre
moves the ellipse but not its centre; what is not symmetric, light, is tested for.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.vision.dots.dot_pixels import OUTSIDE
from cpcal.vision.dots.edge_fit import ODD, RESULTS, fit_dots
from cpcal.vision.dots.edge_model import CUBIC, LINEAR, PLAIN
from cpcal.vision.dots.grey import Grey
from cpcal.vision.two_by_two import eigenvalues

__all__ = ["CUBIC", "LINEAR", "OUTSIDE", "PLAIN", "Edges", "fitted_edges"]


@dataclass(frozen=True, eq=False)
class Edges:
    """The fits of n dots, nan where one failed.

    center      (n, 2) pixels
    conic       (n, 2, 2): the edge is (p - center)^T conic (p - center) = 1
    covariance  (n, 2, 2) px^2 of the centre, by the residuals
    back, contrast  (n,) grey levels around the dot, and how much brighter it is
    blur        (n,) standard deviation of the edge's spread, pixels
    noise       (n,) standard deviation of the residuals, grey levels
    variance    (n,) of the grey levels that took part
    odd         (n, 6, 9): light's growth (2) and its cubic (4), per dot's radius, had they been fitted as well: their
                inverse covariance, times that their values, and how far (pixels, x and y) each moves the centre; zero
                for those that were fitted
    """

    center: Floats
    conic: Floats
    covariance: Floats
    back: Floats
    contrast: Floats
    blur: Floats
    noise: Floats
    variance: Floats
    odd: Floats

    def kept(self, members: npt.NDArray[Any]) -> Edges:
        return Edges(*(getattr(self, field.name)[members] for field in fields(self)))

    def replaced(self, members: npt.NDArray[Any], others: Edges) -> Edges:
        """With `others` in the place of its `members`."""
        arrays = [getattr(self, field.name).copy() for field in fields(self)]
        for array, field in zip(arrays, fields(self), strict=True):
            array[members] = getattr(others, field.name)
        return Edges(*arrays)

    @cached_property
    def axes(self) -> Floats:
        """(n, 2) semi-axes, pixels, the longer first."""
        conic = np.where(np.isfinite(self.conic), self.conic, np.eye(2))
        axes = 1.0 / np.sqrt(np.maximum(eigenvalues(conic), 1e-12))
        axes[np.isnan(self.blur)] = np.nan
        return axes

    @property
    def fullness(self) -> Floats:
        """(n,) the share of the contrast that a dot's middle reaches, for circles."""
        return np.asarray(1.0 - np.exp(-0.5 * self.axes.prod(axis=1) / self.blur**2))

    @property
    def extent(self) -> Floats:
        """(n, 2) half the sides of the upright box around the ellipse, pixels."""
        xx, xy, yy = self.conic[:, 0, 0], self.conic[:, 0, 1], self.conic[:, 1, 1]
        return np.sqrt(np.stack([yy, xx], axis=1) / (xx * yy - xy * xy)[:, None])


def fitted_edges(grey: Grey, center: Floats, spread: Floats, room: Floats, light: Floats, used: int = PLAIN) -> Edges:
    """The blurred ellipses next to those of `center` (n, 2) and second moments `spread` (n, 2, 2), pixels; `room` (n,)
    pixels beyond the edge are the dot's own; `light` (n, 2) the share by which it grows per pixel. With `used` LINEAR
    or CUBIC each dot tells the light's growth, or also its cubic, itself. Where the fit fails the numbers are nan."""
    out, odd = np.full((len(center), RESULTS), np.nan), np.zeros((len(center), ODD, ODD + 3))
    fit_dots(grey, center, spread, room, light, used, out, odd)
    conic, covariance = out[:, [[2, 3], [3, 4]]], out[:, [[8, 9], [9, 10]]]
    back, contrast, blur, noise, variance = out[:, [5, 6, 7, 11, 12]].T
    return Edges(out[:, :2], conic, covariance, back, contrast, blur, noise, variance, odd)
