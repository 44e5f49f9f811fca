"""Blurred ellipses fitted to the grey levels round dots, all dots at once: the likeliest centre for pixels' noise.

The model of a pixel at signed distance d inside the ellipse is (1 + g . p) (back + contrast Phi(d / blur)): the edge
spread of a Gaussian blur (the pixel's own square is part of it), under light that grows linearly (g). The ellipse is
where the grey is half-way between back and dot. Gauss-Newton steps on all pixels use every bit of information on the
edge that the image holds, so errors are close to the Cramer-Rao bound, and the inverse normal matrix is their
covariance. What the model leaves out is symmetric about the centre and so moves the ellipse but not its centre.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.vision.dots.edge_model import PARAMETERS, depths, monomials, normal_equations
from cpcal.vision.dots.grey import Grey
from cpcal.vision.two_by_two import determinants, eigenvalues, inverses

Single = npt.NDArray[np.float32]

OUTSIDE = 3.0  # pixels beyond the edge that take part
INSIDE = 3.5  # pixels inside the edge that take part, at least
_ROUGH_STEPS = 4
_FINE_STEPS = 3
_ROUGH = 0.05  # pixels: the change of the centre that ends the rough steps
_FINE = 0.08  # and the fine ones, of which each leaves less than a twentieth of its change
_FEW = 150  # pixels, of which the rough steps take them all
_SAMPLES = 80_000  # in one go, so that they stay near the processor
_SIZES = 1.6  # the ratio of sizes in one go, at most
_LIMIT = np.array([0.3, 0.3, 0.5, 0.5, 0.5, np.inf, np.inf, 0.7, 0.2, 0.2])  # of a step


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
    """

    center: Floats
    conic: Floats
    covariance: Floats
    back: Floats
    contrast: Floats
    blur: Floats
    noise: Floats
    variance: Floats

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


def fitted_edges(grey: Grey, center: Floats, spread: Floats, room: Floats, light: Floats) -> Edges:
    """The blurred ellipses next to those of `center` (n, 2) and second moments `spread` (n, 2, 2), pixels; `room` (n,)
    pixels beyond the edge are the dot's own; `light` (n, 2) the share by which it grows per pixel, nan where each dot
    has to tell itself. Where the fit fails the numbers are nan."""
    axes = 2.0 * np.sqrt(eigenvalues(spread))
    out = np.full((len(center), 13), np.nan)
    for part in _parts(axes[:, 1]):
        out[part] = _Fit(grey, _stencil(axes[part]), center[part], spread[part], room[part], light[part]).run()
    conic, covariance = out[:, [[2, 3], [3, 4]]], out[:, [[8, 9], [9, 10]]]
    return Edges(out[:, :2], conic, covariance, *out[:, [5, 6, 7, 11, 12]].T)


def _parts(long: Floats) -> list[npt.NDArray[np.int64]]:
    """The dots of one go each: of about one size, and not too many."""
    order = np.argsort(long, kind="stable")
    parts = []
    while len(order):
        reach = int(np.searchsorted(long[order], _SIZES * long[order[0]], side="right"))
        pixels = np.pi * (long[order[reach - 1]] + OUTSIDE + 0.7) ** 2
        goes = -(-reach * int(pixels) // _SAMPLES)
        parts += np.array_split(order[:reach], min(goes, reach))
        order = order[reach:]
    return parts


def _stencil(axes: Floats) -> npt.NDArray[np.int64]:
    """The pixels (k, 2) relative to the centre's that some of these ellipses need; every third one comes first."""
    far, near = axes[:, 1].max() + OUTSIDE + 0.7, axes[:, 0].min() - INSIDE - 0.7
    ticks = np.arange(-int(far) - 1, int(far) + 2)
    x, y = (a.ravel() for a in np.meshgrid(ticks, ticks))
    distance = np.hypot(x, y)
    keep = np.flatnonzero((distance <= far) & (distance >= near))
    keep = keep[np.argsort((x - y)[keep] % 3 > 0, kind="stable")]
    return np.stack([x[keep], y[keep]], axis=1)


class _Fit:
    """One go: n dots, k pixels each. Lengths are in units of the dots' mean radius, places from the pixel next to each
    dot's first centre."""

    def __init__(
        self, grey: Grey, stencil: npt.NDArray[np.int64], center: Floats, spread: Floats, room: Floats, light: Floats
    ) -> None:
        self.at = np.rint(center).astype(np.int64)
        self.level, inside = _levels(grey, self.at, stencil)
        self.unit = float(np.mean(2.0 * determinants(spread) ** 0.25))
        self.table = monomials(*(stencil / self.unit).T)
        conic = 0.25 * self.unit**2 * inverses(spread)
        self.p = np.zeros((len(center), PARAMETERS))
        self.p[:, :2] = (center - self.at) / self.unit
        self.p[:, 2:5] = conic[:, [0, 0, 1], [0, 1, 1]]
        known = bool(np.isfinite(light).all())
        self.used = PARAMETERS - 2 if known else PARAMETERS
        if known:
            self.p[:, 8:] = light * self.unit
        third = int(np.count_nonzero((stencil[:, 0] - stencil[:, 1]) % 3 == 0))
        self.rough = third if len(stencil) >= _FEW else len(stencil)
        self.alive = np.ones(len(center), dtype=bool)
        pixels = depths(self.p, self.table)
        pixels *= np.float32(self.unit)
        own = (pixels > -_column(room)) & (pixels < np.float32(INSIDE))
        self.weight: Single = (own if inside is None else own & inside).astype(np.float32)
        self._start(pixels[:, : self.rough])
        self.level *= self.weight  # once, where every step would do it

    def _start(self, pixels: Single) -> None:
        """Back, contrast and blur to begin with."""
        level, weight = self.level[:, : self.rough], self.weight[:, : self.rough]
        outer = weight * (pixels < np.float32(-1.5))
        inner = weight * (pixels > np.minimum(np.float32(1.5), np.float32(0.4) * pixels.max(axis=1, keepdims=True)))
        back = np.einsum("nk,nk->n", outer, level) / np.maximum(outer.sum(axis=1), 1.0)
        front = np.einsum("nk,nk->n", inner, level) / np.maximum(inner.sum(axis=1), 1.0)
        self.p[:, 5], self.p[:, 6] = back, front - back
        self.p[:, 7] = -np.log(self.unit)  # one pixel
        off = weight * (level - _column(back))
        count = np.maximum(weight.sum(axis=1), 1.0)
        self.variance = np.einsum("nk,nk->n", off, off) / count - (off.sum(axis=1) / count) ** 2

    def run(self) -> Floats:
        for _ in range(_ROUGH_STEPS):
            moved, *_ = self._step(self.rough)
            if not (moved > _ROUGH).any():
                break
        for _ in range(_FINE_STEPS):
            moved, normal, squares = self._step(self.table.shape[1])
            if not (moved > _FINE).any():
                break
        self.alive &= moved <= _FINE
        return self._result(normal, squares)

    def _step(self, count: int) -> tuple[Floats, Floats, Floats]:
        """A Gauss-Newton step on the first `count` pixels: how far (n,) pixels the centres of those alive moved, the
        normal matrix, and the sum (n,) of squared residuals after the step, to first order."""
        table, level, weight = self.table[:, :count], self.level[:, :count], self.weight[:, :count]
        normal, right, squares = normal_equations(self.p, table, level, weight, self.used)
        step, fine = _solved(normal, right)
        self.alive &= fine
        self._take(step)
        moved = np.where(self.alive, np.abs(step[:, :2]).max(axis=1) * self.unit, 0.0)
        return moved, normal, squares - (right * step).sum(axis=1)

    def _take(self, step: Floats) -> None:
        limit = _LIMIT[: self.used]
        self.p[:, : self.used] += np.where(self.alive[:, None], np.clip(step, -limit, limit), 0.0)
        p = self.p
        sound = (p[:, 2] * p[:, 4] - p[:, 3] ** 2 > 1e-3) & (p[:, 2] > 0.0) & (np.abs(p[:, 2:5]) < 20.0).all(axis=1)
        sound &= (np.abs(p[:, :2]) < 1.0).all(axis=1) & (np.abs(p[:, 7]) < 6.0)
        self.alive &= sound
        p[~self.alive] = [0, 0, 1, 0, 1, 0, 0, 0, 0, 0]

    def _result(self, normal: Floats, squares: Floats) -> Floats:
        count = self.weight.sum(axis=1, dtype=np.float64)
        variance = np.maximum(squares, 0.0) / np.maximum(count - self.used, 1.0)
        self.alive &= count > 2 * PARAMETERS
        inverse, fine = _inverse(normal)
        self.alive &= fine
        covariance = (variance * self.unit**2)[:, None, None] * inverse[:, :2]
        parts = [
            self.at + self.p[:, :2] * self.unit,
            self.p[:, 2:5] / self.unit**2,
            self.p[:, 5:7],
            (np.exp(self.p[:, 7]) * self.unit)[:, None],
            covariance[:, [0, 0, 1], [0, 1, 1]],
            np.sqrt(variance)[:, None],
            self.variance[:, None],
        ]
        out = np.concatenate(parts, axis=1)
        out[~self.alive] = np.nan
        return out


def _levels(
    grey: Grey, at: npt.NDArray[np.int64], stencil: npt.NDArray[np.int64]
) -> tuple[Single, npt.NDArray[np.bool_] | None]:
    """The grey levels (n, k) of a stencil's pixels around others (n, 2), and which are in the image; None: all."""
    height, width = grey.shape
    low, high = at.min(axis=0) + stencil.min(axis=0), at.max(axis=0) + stencil.max(axis=0)
    if (low >= 0).all() and (high < [width, height]).all():
        index = (at[:, 1:] * width + at[:, :1]) + (stencil[:, 1] * width + stencil[:, 0])
        return grey.ravel()[index].astype(np.float32), None
    column, row = at[:, :1] + stencil[:, 0], at[:, 1:] + stencil[:, 1]
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    index = np.clip(row, 0, height - 1) * width + np.clip(column, 0, width - 1)
    return grey.ravel()[index].astype(np.float32), inside


def _column(values: Floats) -> Single:
    return values[:, None].astype(np.float32)


def _scaled(normal: Floats) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
    """Normal matrices with a unit diagonal, the scale, and where they are regular."""
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
    unit = normal / (scale[:, :, None] * scale[:, None, :])
    fine = np.isfinite(unit).all(axis=(1, 2)) & (scale > 1e-12).all(axis=1)
    unit[~fine] = np.eye(unit.shape[1])
    unit += 1e-7 * np.eye(unit.shape[1])
    return unit, scale, fine


def _inverse(normal: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """The inverse matrices' first two columns (n, m, 2), and where they are regular."""
    unit, scale, fine = _scaled(normal)
    first = np.broadcast_to(np.eye(unit.shape[1])[:, :2], (*unit.shape[:2], 2))
    columns = np.linalg.solve(unit, first)
    return columns / (scale[:, :, None] * scale[:, None, :2]), fine


def _solved(normal: Floats, right: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
    unit, scale, fine = _scaled(normal)
    step = np.linalg.solve(unit, (right / scale)[..., None])[..., 0] / scale
    fine &= np.isfinite(step).all(axis=1)
    return np.where(fine[:, None], step, 0.0), fine
