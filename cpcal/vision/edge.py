"""Blurred ellipses fitted to the grey levels round dots, all dots at once: the likeliest centre for pixels' noise.

The model of a pixel at signed distance d inside the ellipse is (1 + g . p) (back + contrast Phi(d / blur)): the edge
spread of a Gaussian blur (the pixel's own square is part of it), under light that grows linearly (g). The ellipse is
where the grey is half-way between back and dot. Gauss-Newton steps on all pixels use every bit of information on the
edge that the image holds, so errors are close to the Cramer-Rao bound, and the inverse normal matrix is their
covariance. What the model leaves out is symmetric about the centre and so moves the ellipse but not its centre.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.vision.grey import Grey

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]

OUTSIDE = 3.5  # pixels beyond the edge that take part
INSIDE = 4.5  # pixels inside the edge that take part, at least
_STEPS = 6
_STILL = 2e-4  # pixels: the change of the centre that ends the steps
_SAMPLES = 40_000  # in one go, so that they stay in the processor's cache
_SIZES = 1.25  # the ratio of sizes in one go
_PARAMETERS = 10  # centre, 3 of the ellipse, back, contrast, log blur, 2 of the light


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

    center: Array
    conic: Array
    covariance: Array
    back: Array
    contrast: Array
    blur: Array
    noise: Array
    variance: Array

    def kept(self, members: npt.NDArray[Any]) -> Edges:
        return Edges(*(getattr(self, field.name)[members] for field in fields(self)))

    def replaced(self, members: npt.NDArray[Any], others: Edges) -> Edges:
        """With `others` in the place of its `members`."""
        arrays = [getattr(self, field.name).copy() for field in fields(self)]
        for array, field in zip(arrays, fields(self), strict=True):
            array[members] = getattr(others, field.name)
        return Edges(*arrays)

    @property
    def axes(self) -> Array:
        """(n, 2) semi-axes, pixels, the longer first."""
        conic = np.where(np.isfinite(self.conic), self.conic, np.eye(2))
        axes = 1.0 / np.sqrt(np.maximum(np.linalg.eigvalsh(conic), 1e-12))
        axes[np.isnan(self.blur)] = np.nan
        return axes

    @property
    def extent(self) -> Array:
        """(n, 2) half the sides of the upright box around the ellipse, pixels."""
        xx, xy, yy = self.conic[:, 0, 0], self.conic[:, 0, 1], self.conic[:, 1, 1]
        return np.sqrt(np.stack([yy, xx], axis=1) / (xx * yy - xy * xy)[:, None])


def fitted_edges(grey: Grey, center: Array, spread: Array, room: Array, light: Array) -> Edges:
    """The blurred ellipses next to those of `center` (n, 2) and second moments `spread` (n, 2, 2), pixels; `room` (n,)
    pixels beyond the edge are the dot's own; `light` (n, 2) the share by which it grows per pixel, nan where each dot has
    to tell itself. Where the fit fails the numbers are nan."""
    axes = 2.0 * np.sqrt(np.linalg.eigvalsh(spread))
    size = np.floor(np.log(axes[:, 1]) / np.log(_SIZES)).astype(np.int64)
    out = np.full((len(center), 13), np.nan)
    for group in np.unique(size):
        members = np.flatnonzero(size == group)
        stencil = _stencil(axes[members])
        each = max(1, _SAMPLES // len(stencil))
        for part in np.array_split(members, -(-len(members) // each)):
            out[part] = _Fit(grey, stencil, center[part], spread[part], room[part], light[part]).run()
    conic, covariance = out[:, [[2, 3], [3, 4]]], out[:, [[8, 9], [9, 10]]]
    return Edges(out[:, :2], conic, covariance, *out[:, [5, 6, 7, 11, 12]].T)


def _stencil(axes: Array) -> npt.NDArray[np.int64]:
    """The pixels (k, 2) relative to the centre's that some of these ellipses need."""
    far, near = axes[:, 1].max() + OUTSIDE + 1.0, axes[:, 0].min() - INSIDE - 1.0
    ticks = np.arange(-int(far) - 1, int(far) + 2)
    x, y = (a.ravel() for a in np.meshgrid(ticks, ticks))
    distance = np.hypot(x, y)
    keep = (distance <= far) & (distance >= near)
    return np.stack([x[keep], y[keep]], axis=1)


class _Fit:
    """One go: n dots, k pixels each. Coordinates are in units of each dot's mean radius, from its first centre."""

    def __init__(
        self, grey: Grey, stencil: npt.NDArray[np.int64], center: Array, spread: Array, room: Array, light: Array
    ) -> None:
        height, width = grey.shape
        at = np.rint(center).astype(np.int64)
        column, row = at[:, :1] + stencil[:, 0], at[:, 1:] + stencil[:, 1]
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        if inside.all():
            index = row * width + column
        else:
            index = np.clip(row, 0, height - 1) * width + np.clip(column, 0, width - 1)
        self.level: Single = grey.ravel()[index].astype(np.float32)
        self.radius = 2.0 * np.linalg.det(spread) ** 0.25
        self.first = center
        scale = (1.0 / self.radius)[:, None]
        self.x: Single = ((stencil[:, 0] - (center - at)[:, :1]) * scale).astype(np.float32)
        self.y: Single = ((stencil[:, 1] - (center - at)[:, 1:]) * scale).astype(np.float32)
        conic = 0.25 * np.linalg.inv(spread) * (self.radius**2)[:, None, None]
        n = len(center)
        self.p = np.zeros((n, _PARAMETERS))
        self.p[:, 2], self.p[:, 3], self.p[:, 4] = conic[:, 0, 0], conic[:, 0, 1], conic[:, 1, 1]
        known = bool(np.isfinite(light).all())
        self.used = _PARAMETERS - 2 if known else _PARAMETERS
        if known:
            self.p[:, 8:] = light * self.radius[:, None]
        depth, _, _ = self._depth()
        pixels = depth * _column(self.radius)
        self.weight: Single = (inside & (pixels > -_column(room)) & (pixels < INSIDE)).astype(np.float32)
        self._start(pixels)

    def _start(self, pixels: Single) -> None:
        """Back, contrast and blur to begin with."""
        outer = self.weight * (pixels < -1.5)
        inner = self.weight * (pixels > np.minimum(1.5, 0.4 * pixels.max(axis=1, keepdims=True)))
        back = (outer * self.level).sum(axis=1) / np.maximum(outer.sum(axis=1), 1.0)
        front = (inner * self.level).sum(axis=1) / np.maximum(inner.sum(axis=1), 1.0)
        self.p[:, 5], self.p[:, 6] = back, front - back
        self.p[:, 7] = -np.log(self.radius)  # one pixel

    def _depth(self) -> tuple[Single, Single, Single]:
        """The signed distance inside the ellipse, to first order, and the outward unit normal of its level curves."""
        p = self.p.astype(np.float32)
        x, y = self.x - p[:, :1], self.y - p[:, 1:2]
        u = p[:, 2:3] * x + p[:, 3:4] * y
        v = p[:, 3:4] * x + p[:, 4:5] * y
        root = np.sqrt(np.maximum(x * u + y * v, 1e-12))
        slope = 1.0 / np.sqrt(np.maximum(u * u + v * v, 1e-12))
        self.shifted = x, y, slope
        return (1.0 - root) * root * slope, u * slope, v * slope

    def _model(self) -> tuple[Single, Single]:
        """The grey levels and their derivatives (n, 10, k) by the parameters, without the weight."""
        depth, normal_x, normal_y = self._depth()
        x, y, slope = self.shifted
        p = self.p.astype(np.float32)
        blur = np.exp(p[:, 7:8])
        back, contrast, light_x, light_y = p[:, 5:6], p[:, 6:7], p[:, 8:9], p[:, 9:10]
        z = depth / blur
        density = np.exp(-0.5 * z * z)
        share = _normal_share(z, density)
        density *= np.float32(1.0 / np.sqrt(2.0 * np.pi)) * contrast / blur
        light = 1.0 + light_x * x + light_y * y
        plain = back + contrast * share
        level = light * plain
        out = np.empty((len(p), self.used, self.x.shape[1]), dtype=np.float32)
        density *= light
        np.multiply(density, normal_x, out=out[:, 0])
        np.multiply(density, normal_y, out=out[:, 1])
        bend = -0.5 * density * slope
        np.multiply(bend, x * x, out=out[:, 2])
        np.multiply(2.0 * bend, x * y, out=out[:, 3])
        np.multiply(bend, y * y, out=out[:, 4])
        out[:, 5] = light
        np.multiply(light, share, out=out[:, 6])
        np.multiply(-density, depth, out=out[:, 7])
        if self.used == _PARAMETERS:
            np.multiply(plain, x, out=out[:, 8])
            np.multiply(plain, y, out=out[:, 9])
        return level, out

    def run(self) -> Array:
        n = len(self.p)
        alive = np.ones(n, dtype=bool)
        normal = np.tile(np.eye(self.used), (n, 1, 1))
        for _ in range(_STEPS):
            level, slopes = self._model()
            slopes *= self.weight[:, None, :]
            residual = self.weight * (self.level - level)
            normal = (slopes @ slopes.transpose(0, 2, 1)).astype(np.float64)
            right = (slopes @ residual[:, :, None])[..., 0].astype(np.float64)
            step, fine = _solved(normal, right)
            alive &= fine
            self._take(step, alive)
            if not (np.abs(step[alive, :2]).max(axis=1, initial=0.0) * self.radius[alive] > _STILL).any():
                break
        return self._result(normal, alive)

    def _take(self, step: Array, alive: npt.NDArray[np.bool_]) -> None:
        step = np.where(alive[:, None], step, 0.0)
        limit = np.array([0.3, 0.3, 0.5, 0.5, 0.5, np.inf, np.inf, 0.7, 0.2, 0.2])
        self.p[:, : self.used] += np.clip(step, -limit[: self.used], limit[: self.used])
        determinant = self.p[:, 2] * self.p[:, 4] - self.p[:, 3] ** 2
        alive &= (determinant > 1e-3) & (np.abs(self.p[:, :2]) < 1.0).all(axis=1) & (self.p[:, 2] > 0.0)
        alive &= (np.abs(self.p[:, 7]) < 6.0) & (np.abs(self.p[:, 2:5]) < 20.0).all(axis=1)
        self.p[~alive] = [0, 0, 1, 0, 1, 0, 0, 0, 0, 0]

    def _result(self, normal: Array, alive: npt.NDArray[np.bool_]) -> Array:
        level, _ = self._model()
        residual = self.weight * (self.level - level)
        count = self.weight.sum(axis=1, dtype=np.float64)
        variance = (residual**2).sum(axis=1, dtype=np.float64) / np.maximum(count - self.used, 1.0)
        alive &= count > 2 * _PARAMETERS
        inverse, fine = _inverse(normal)
        alive &= fine
        covariance = (variance * self.radius**2)[:, None, None] * inverse[:, :2, :2]
        conic = self.p[:, 2:5] / (self.radius**2)[:, None]
        blur = np.exp(self.p[:, 7]) * self.radius
        parts = [
            self.first + self.p[:, :2] * self.radius[:, None],
            conic,
            self.p[:, 5:7],
            blur[:, None],
            covariance[:, [0, 0, 1], [0, 1, 1]],
            np.sqrt(variance)[:, None],
            self._variance(count)[:, None],
        ]
        out = np.concatenate(parts, axis=1)
        out[~alive] = np.nan
        return out


    def _variance(self, count: Array) -> Array:
        count = np.maximum(count, 1.0)
        mean = (self.weight * self.level).sum(axis=1, dtype=np.float64) / count
        off = self.weight * (self.level - _column(mean))
        return np.asarray((off**2).sum(axis=1, dtype=np.float64) / count)


def _column(values: Array) -> Single:
    return values[:, None].astype(np.float32)


def _scaled(normal: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Normal matrices with a unit diagonal, the scale, and where they are regular."""
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
    unit = normal / (scale[:, :, None] * scale[:, None, :])
    fine = np.isfinite(unit).all(axis=(1, 2)) & (scale > 1e-12).all(axis=1)
    unit[~fine] = np.eye(unit.shape[1])
    unit += 1e-7 * np.eye(unit.shape[1])
    return unit, scale, fine


def _inverse(normal: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
    unit, scale, fine = _scaled(normal)
    return np.linalg.inv(unit) / (scale[:, :, None] * scale[:, None, :]), fine


def _solved(normal: Array, right: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
    unit, scale, fine = _scaled(normal)
    step = np.linalg.solve(unit, (right / scale)[..., None])[..., 0] / scale
    fine &= np.isfinite(step).all(axis=1)
    return np.where(fine[:, None], step, 0.0), fine


def _normal_share(z: Single, bell: Single) -> Single:
    """The normal distribution's function at z, given exp(-z^2 / 2), to 8e-8 (Abramowitz and Stegun 26.2.17)."""
    t = 1.0 / (1.0 + np.float32(0.2316419) * np.abs(z))
    tail = np.float32(1.330274429)
    series: Any = tail
    for coefficient in (-1.821255978, 1.781477937, -0.356563782, 0.319381530):
        series = series * t + np.float32(coefficient)
    series *= t
    series *= bell
    series *= np.float32(1.0 / np.sqrt(2.0 * np.pi))
    return np.where(z > 0.0, 1.0 - series, series).astype(np.float32)
