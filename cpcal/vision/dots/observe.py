"""Dots in an image: sub-pixel centres, with covariance and quality.

The centre of a dot is that of the ellipse on which the grey level is half-way between the dot and the plate; it is not
the image of the dot's centre, which the pose step accounts for. Dots are told from all else by their shape (a blurred
ellipse explains their grey levels), their size and their contrast, both compared with those of the others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.values import frozen_array
from cpcal.vision.dots.edge import OUTSIDE, Edges
from cpcal.vision.dots.grey import Grey, eight_bits, grey_levels, noise_level
from cpcal.vision.dots.light import light_gradient
from cpcal.vision.dots.neighbours import gaps
from cpcal.vision.dots.own_light import fitted_under
from cpcal.vision.dots.segmentation import Spots, halved, spots, surveys
from cpcal.vision.median import median
from cpcal.vision.two_by_two import eigenvalues

FLOOR = 5e-4  # pixels: what the model of the edge leaves out, whatever the noise
_QUALITY = 0.22  # at least: that of a square of 8 pixels behind an ordinary blur is 0.19
_TOLERATED = 0.01  # share of the grey levels' variance that is neither noise nor explained: a quality of one half
_MOVED = 0.35  # of the radius, from the segmentation's centre, at most
_RATIO = 2.0  # of a dot's radius to the usual one, or its inverse
_CONTRAST = 0.25  # of the usual one, at least
_SMALLEST = 1.5  # pixels of radius
_SLIMMEST = 0.25  # ratio of axes
_SHARPEST = 0.12  # pixels of blur: a pixel's own square makes 0.29
_NOISE = 8.0  # contrast that a dot's middle reaches at least, in standard deviations of the noise
_CLEAR = 6.0  # blurs between the edge of a dot and the border: the whole edge and as much of the plate beside it
_SAME_LIGHT = 2e-5  # its growth per pixel: less than that moves a dot by less than 1e-4 pixels
_ROOM = 0.6  # share of the gap to its neighbours that belongs to a dot
_LEAST_ROOM = 1.0  # pixels around a dot that do at least


@dataclass(frozen=True, eq=False)
class Dots:
    """What was found, in no order.

    centers     (n, 2) pixels, x right and y down from the centre of the top-left pixel
    covariance  (n, 2, 2) px^2 of the centres
    quality     (n,) in [0, 1]: 1 where a blurred ellipse and noise explain every grey level round the dot, one half
                where a hundredth of their variance is left
    axes        (n, 2) semi-axes, pixels, the longer first
    bright      whether the dots are brighter than around them
    spots       where they were looked for, to fit them again
    gap         (n,) pixels between them and the next spots
    light       (n, 2) the share per pixel by which the light of all spots grows
    strangers   whether there were spots that are none of these dots, and told of the light as well
    """

    centers: Floats
    covariance: Floats
    quality: Floats
    axes: Floats
    bright: bool
    spots: Spots
    gap: Floats
    light: Floats
    strangers: bool = True

    def __post_init__(self) -> None:
        for name in ("centers", "covariance", "quality", "axes", "gap", "light"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.centers)


def find_dots(image: object, *, bright: bool | None = None) -> Floats:
    """The centres (n, 2) of an image's dots, pixels: see `observe_dots`."""
    return observe_dots(image, bright=bright).centers


def observe_dots(image: object, *, bright: bool | None = None) -> Dots:
    """The dots of an image (height, width) or (height, width, colours), 8 or 16 bits, that are clear of its border.

    `bright` states whether they are brighter than around them; None finds out. Raises InputError when `image` is none;
    an image without dots has none.
    """
    found = populations(image, bright=bright)
    return max(found, key=lambda dots: float(dots.quality.sum()), default=_none(bool(bright)))


def populations(image: object, *, bright: bool | None = None) -> Iterator[Dots]:
    """The dots of an image of each kind and size that they may be of, the likelier first, one by one as they are asked
    for. What they have in common cannot tell a target's dots from a background's specks; identification can."""
    grey = grey_levels(image)
    eight = eight_bits(grey)
    half = halved(eight)
    for survey in surveys(eight, half, bright):
        yield _observed(grey, spots(eight, half, survey), survey.radius)


def refitted(image: object, dots: Dots, members: npt.NDArray[Any]) -> Dots:
    """The dots with those `members` fitted again under the light that they alone tell; the others stay.

    The light of a background's spots is not that of the plate, and would shift all dots of the target together. Where
    it makes no difference all stay. Raises InputError when `image` is none.
    """
    if len(members) == len(dots) and not dots.strangers:
        return dots
    grey = grey_levels(image)
    spots, gap = dots.spots.kept(members), dots.gap[members]
    light = light_gradient(grey, spots, gap)
    change = np.abs(light - dots.light[members])
    if not len(members) or np.isnan(light).any() or (change < _SAME_LIGHT).all():
        return dots
    edges = fitted_under(grey, spots, _room(gap), light)
    fine = members[~np.isnan(edges.noise)]
    edges = edges.kept(~np.isnan(edges.noise))
    centers, covariance = dots.centers.copy(), dots.covariance.copy()
    quality, axes = dots.quality.copy(), dots.axes.copy()
    centers[fine], axes[fine] = edges.center, edges.axes
    covariance[fine] = edges.covariance + FLOOR**2 * np.eye(2)
    quality[fine] = _quality(edges, noise_level(grey))
    return replace(dots, centers=centers, covariance=covariance, quality=quality, axes=axes)


def _observed(grey: Grey, found: Spots, usual: float) -> Dots:
    """The dots among spots, of about the `usual` radius."""
    if not len(found):
        return _none(found.bright)
    gap = _gap(found)
    light = light_gradient(grey, found, gap)
    edges = fitted_under(grey, found, _room(gap), light)
    noise = noise_level(grey)
    quality = _quality(edges, noise)
    keep = np.flatnonzero(_dot_like(found, edges, quality, noise, grey.shape))
    keep = keep[_alike(edges, keep, usual)]
    covariance = edges.covariance[keep] + FLOOR**2 * np.eye(2)
    told = edges.center[keep], covariance, quality[keep], edges.axes[keep], found.bright
    return Dots(*told, found.kept(keep), gap[keep], light[keep], len(keep) < len(found))


def _none(bright: bool) -> Dots:
    pairs, matrices, numbers = np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0)
    return Dots(pairs, matrices, numbers, pairs, bright, Spots(pairs, matrices, bright), numbers, pairs)


def _room(gap: Floats) -> Floats:
    """How many pixels beyond its edge are a dot's own."""
    return np.asarray(np.clip(_ROOM * gap, _LEAST_ROOM, OUTSIDE))


def _gap(found: Spots) -> Floats:
    """How many pixels (n,) lie between a dot and its neighbours."""
    out = np.empty(len(found))
    gaps(found.center, 2.0 * np.sqrt(eigenvalues(found.spread)[:, 1]), np.argsort(found.center[:, 0]), out)
    return out


def _quality(edges: Edges, noise: float) -> Floats:
    """1 / (1 + strange / tolerated) (n,) of the share of the grey levels' variance that is strange: neither explained
    by a blurred ellipse nor the image's noise (grey levels)."""
    with np.errstate(invalid="ignore"):
        strange = np.maximum(edges.noise**2 - noise**2, 0.0) / np.maximum(edges.variance, 1e-12)
    return np.nan_to_num(1.0 / (1.0 + strange / _TOLERATED))


def _dot_like(
    found: Spots, edges: Edges, quality: Floats, noise: float, shape: tuple[int, ...]
) -> npt.NDArray[np.bool_]:
    """Which (n,) of the fits are dots for themselves."""
    axes, radius = edges.axes, found.radius
    sign = 1.0 if found.bright else -1.0
    extent = edges.extent
    with np.errstate(invalid="ignore"):
        keep = quality >= _QUALITY
        keep &= np.linalg.norm(edges.center - found.center, axis=1) < _MOVED * radius
        keep &= axes[:, 1] > _SLIMMEST * axes[:, 0]
        keep &= (edges.blur > _SHARPEST) & (edges.blur < axes[:, 1])
        keep &= sign * edges.contrast * edges.fullness > _NOISE * np.maximum(edges.noise, noise)
        around = _CLEAR * edges.blur[:, None]
        keep &= (edges.center - extent > around).all(axis=1)
        keep &= (edges.center + extent + around < np.array(shape[1::-1]) - 1.0).all(axis=1)
        size = np.sqrt(axes.prod(axis=1))
        keep &= (size > 0.5 * radius) & (size < 1.5 * radius) & (size > _SMALLEST)
    return np.asarray(keep)


def _alike(edges: Edges, members: npt.NDArray[Any], usual: float) -> npt.NDArray[np.bool_]:
    """Which (m,) of the members have about the usual radius, and contrast."""
    if not len(members):
        return np.zeros(0, dtype=bool)
    size = np.sqrt(edges.axes[members].prod(axis=1))
    contrast = np.abs(edges.contrast[members])
    alike = (size < _RATIO * usual) & (_RATIO * size > usual) & (contrast > _CONTRAST * median(contrast))
    return np.asarray(alike)
