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

from cpcal.common.values import Bools, Floats, Ints, frozen_array
from cpcal.solver.compiled import compiled
from cpcal.vision.dots.edge import CUBIC, LINEAR, OUTSIDE, PLAIN, Edges, fitted_edges
from cpcal.vision.dots.segmentation import (
    Grey,
    Spots,
    eight_bits,
    gaps,
    grey_levels,
    halved,
    noise_level,
    spots,
    surveys,
)
from cpcal.vision.projection import eigenvalues, median

# ------------------------------------------------------------------------------------------------------------------
# How the light grows over the image, from the grey levels of dots or of the plate beside them.
#
# A dot under light that grows to one side seems to lie on that side: by some thousandths of a pixel. Estimated dot by
# dot the light would cost half of the centre's accuracy; light is smooth, so that all dots together tell it well
# enough.

_MOST_DEGREE = 4
_EACH = 6  # dots for each coefficient
_BESIDE = 4.5  # pixels beyond the edge of a dark dot, at most
_OUTLYING = 4.0  # robust standard deviations


def light_gradient(grey: Grey, found: Spots, gap: Floats) -> Floats:
    """By which share the light grows per pixel to the right and down, at each dot: (n, 2); nan with too few dots.
    `gap` (n,) pixels lie between a dot and its neighbours.

    A polynomial of the place is fitted to the levels, twice: the second time without outliers.
    """
    slope = _polynomial(grey, found, gap)
    return np.full((len(found), 2), np.nan) if slope is None else slope[0]


def light_misfit(grey: Grey, found: Spots, gap: Floats) -> float:
    """The median of what that polynomial leaves of the grey levels at the dots; 0 with too few dots for one."""
    slope = _polynomial(grey, found, gap)
    return 0.0 if slope is None else slope[1]


def _polynomial(grey: Grey, found: Spots, gap: Floats) -> tuple[Floats, float] | None:
    """The growth of the fitted polynomial, relative to it, and the median of what it leaves; None with too few dots."""
    degree = _MOST_DEGREE
    while degree > 0 and len(found) < _EACH * (degree + 1) * (degree + 2) // 2:
        degree -= 1
    if degree == 0:
        return None
    level = _levels(grey, found, gap)
    half = 0.5 * np.array(grey.shape[::-1])
    values, to_right, to_bottom = _terms(found.center / half - 1.0, degree)
    good = np.ones(len(level), dtype=bool)
    coefficients: Floats = np.zeros(values.shape[1])
    left = 0.0
    for _ in range(2):
        some = values[good]
        normal = some.T @ some
        normal += 1e-9 * len(some) * np.eye(len(normal))  # in case dots lie on few lines
        coefficients = np.asarray(np.linalg.solve(normal, some.T @ level[good]), dtype=np.float64)
        off = np.abs(level - values @ coefficients)
        left = median(off)
        good = off <= _OUTLYING * 1.4826 * left + 1e-12
    slope = np.stack([to_right @ coefficients, to_bottom @ coefficients], axis=1)
    return np.asarray(slope / (np.maximum(values @ coefficients, 1.0)[:, None] * half)), left


def _levels(grey: Grey, found: Spots, gap: Floats) -> Floats:
    """Grey levels (n,) of the bright surface: in the middle of bright dots, beside dark ones."""
    out = np.empty(len(found))
    if found.bright:
        _middles(grey, found.center, out)
    else:
        _surroundings(grey, found.center, found.spread, np.clip(0.5 * gap, 1.5, _BESIDE), out)
    return out


@compiled
def _middles(grey: Grey, center: Floats, out: Floats) -> None:
    """The mean of the nine pixels about each centre."""
    height, width = grey.shape
    for i in range(len(center)):
        total = 0.0
        for k in range(9):
            x, y = int(np.rint(center[i, 0] + k % 3 - 1)), int(np.rint(center[i, 1] + k // 3 - 1))
            total += grey[min(max(y, 0), height - 1), min(max(x, 0), width - 1)]
        out[i] = total / 9.0


@compiled
def _surroundings(grey: Grey, center: Floats, spread: Floats, beside: Floats, out: Floats) -> None:
    """The mean of sixteen pixels round each ellipse, so many beyond its edge."""
    height, width = grey.shape
    for i in range(len(center)):
        total = 0.0
        xx, xy, yy = spread[i, 0, 0], spread[i, 0, 1], spread[i, 1, 1]
        for k in range(16):
            right, down = np.cos(np.pi / 8.0 * k), np.sin(np.pi / 8.0 * k)
            square = (yy * right * right - 2.0 * xy * right * down + xx * down * down) / (xx * yy - xy * xy)
            reach = 2.0 / np.sqrt(square) + beside[i]
            x, y = int(np.rint(center[i, 0] + reach * right)), int(np.rint(center[i, 1] + reach * down))
            total += grey[min(max(y, 0), height - 1), min(max(x, 0), width - 1)]
        out[i] = total / 16.0


def _terms(at: Floats, degree: int) -> tuple[Floats, Floats, Floats]:
    """The monomials of x and y up to a degree and their derivatives, each (n, terms)."""
    terms = (degree + 1) * (degree + 2) // 2
    out = np.zeros((3, len(at), terms))
    _monomials(at, degree, out)
    return out[0], out[1], out[2]


@compiled
def _monomials(at: Floats, degree: int, out: Floats) -> None:
    for n in range(len(at)):
        term, by_x = 0, 1.0  # x^i
        for i in range(degree + 1):
            by_y = by_x
            for j in range(degree + 1 - i):
                out[0, n, term] = by_y
                if i > 0:
                    out[1, n, term] = i * at[n, 1] ** j * at[n, 0] ** (i - 1)
                if j > 0:
                    out[2, n, term] = j * by_x * at[n, 1] ** (j - 1)
                by_y *= at[n, 1]
                term += 1
            by_x *= at[n, 0]


# ------------------------------------------------------------------------------------------------------------------
# What light that is not symmetric about a dot would make of it, compiled: see `cpcal.vision.dots.observe`.

TERMS = 6  # of the light: its growth, and its cubic
_HOPELESS = 9.0  # variance of such a move, relative to the centre's: the dot is too small to tell its light
_WORTH = 0.004  # pixels: a smaller move is not worth the accuracy that light of a dot's own costs


@compiled
def term_values(odd: Floats, first: int, last: int, values: Floats, inverse: Floats) -> None:
    """The values (n, last - first) of the terms from `first` to `last` had they been fitted, and their covariances
    (n, last - first, last - first); 0 where nothing tells.

    odd  (n, TERMS, TERMS + 3): inverse covariance of the terms, times that their values, how each moves the dot
    """
    size = last - first
    information = np.empty((size, size))
    for i in range(len(odd)):
        for a in range(size):
            for b in range(size):
                information[a, b] = odd[i, first + a, first + b]
        if not _inverted(information, inverse[i]):
            inverse[i] = 0.0
        for a in range(size):
            values[i, a] = 0.0
            for b in range(size):
                values[i, a] += inverse[i, a, b] * odd[i, first + b, TERMS]


@compiled
def excesses(
    odd: Floats,
    values: Floats,
    inverse: Floats,
    sharpness: Floats,
    variance: Floats,
    common: Floats,
    shapes: Floats,
    moves: Floats,
    worth: Bools,
) -> None:
    """The chi-squares (n,) of the last terms, `values` and `inverse` as `term_values` tells them, against those in
    `common` (TERMS,), and of the moves of the centre that they make; zero where there is nothing to tell. And where
    (n,) such a move is worth to be known.

    sharpness  (n,) share of a dot's information that is believed; variance (n,) px^2 of its centre, of both axes
    """
    size = values.shape[1]
    first = TERMS - size
    for i in range(len(odd)):
        shape, x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for a in range(size):
            right, down = odd[i, first + a, TERMS + 1], odd[i, first + a, TERMS + 2]
            value, by_x, by_y, off = values[i, a] - common[first + a], 0.0, 0.0, 0.0
            for b in range(size):
                off += odd[i, first + a, first + b] * (values[i, b] - common[first + b])
                by_x += inverse[i, a, b] * odd[i, first + b, TERMS + 1]
                by_y += inverse[i, a, b] * odd[i, first + b, TERMS + 2]
            shape += sharpness[i] * off * value
            x, y = x + value * right, y + value * down
            xx, xy, yy = xx + right * by_x, xy + right * by_y, yy + down * by_y
        shapes[i], moves[i], worth[i] = 0.0, 0.0, False
        if not (inverse[i, 0, 0] > 0.0 and sharpness[i] > 0.0):
            continue
        xx, xy, yy = xx / sharpness[i], xy / sharpness[i], yy / sharpness[i]
        worth[i] = xx + yy < _HOPELESS * variance[i] and x * x + y * y > _WORTH**2
        more = 1e-9 * (xx + yy) + 1e-30
        xx, yy = xx + more, yy + more
        shapes[i], moves[i] = shape, (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)


@compiled
def _inverted(matrix: Floats, out: Floats) -> bool:
    """The inverse of a matrix, a billionth of its trace added to its diagonal, by elimination."""
    size, trace = len(matrix), 0.0
    for a in range(size):
        trace += matrix[a, a]
    out[:] = 0.0
    if not (trace > 0.0 and np.isfinite(trace)):
        return False
    for a in range(size):
        matrix[a, a] += 1e-9 * trace
        out[a, a] = 1.0
    for k in range(size):  # positive definite: without pivoting
        pivot = matrix[k, k]
        if not pivot > 0.0:
            return False
        for b in range(size):
            matrix[k, b] /= pivot
            out[k, b] /= pivot
        for a in range(size):
            share = matrix[a, k]
            if a != k:
                for b in range(size):
                    matrix[a, b] -= share * matrix[k, b]
                    out[a, b] -= share * out[k, b]
    return True


# ------------------------------------------------------------------------------------------------------------------
# Dots that the light of all does not explain, a shadow's edge or a smudge: under light of their own.
#
# What moves a dot's centre and no residual shows is light that is not symmetric about it. So each fit tells what
# further terms of the light (its growth, and its cubic) would be, had they been fitted, and with which covariance:
# where they differ from the other dots' by more than the other dots differ among themselves, and move the centre,
# they are fitted as well. A lens's asymmetry passes for light, too, and moves all dots alike; what it makes of a dot
# with light of its own is taken off, so that this dot is moved as the others.

_STRANGE = 1.5  # residuals, relative to the usual ones, that ask for light of the dot's own
_BETTER = 0.95  # residuals with it relative to those without, then
_RARE = {6: 22.5, 4: 18.5, 2: 13.8}  # chi-square by degrees of freedom: what one ordinary dot of a thousand exceeds
_FREQUENT = {4: 9.5, 2: 6.0}  # one of twenty: where the light of all is wrong, more dots are doubted
_MEDIAN = {6: 5.35, 4: 3.36, 2: 1.39}
_ALL_WRONG = 6.0  # times what noise makes of the centres' moves: then the light of all is wrong, and of no use
_BENT, _LEFT = (
    2.5,
    1.2,
)  # so it is from this on where it leaves as much of the levels, as a share of the noise: usual is 0.3
_IMPERFECT = (
    0.006  # of the contrast: what the model of an edge leaves out, symmetric, and seems not to be by the pixels' places
)
_ENOUGH = 20  # dots that tell what is common to all


def fitted_under(grey: Grey, found: Spots, room: Floats, light: Floats) -> Edges:
    """The fits of spots under a light (n, 2), its growth per pixel, or under one of their own; `room` (n,) pixels
    beyond its edge are a dot's own. Where `light` is nan, each has to tell it itself."""
    if np.isnan(light).any():
        return _all_alone(grey, found, room)
    edges = fitted_edges(grey, found.center, found.spread, room, light)
    fitted = ~np.isnan(edges.noise)
    if not fitted.any():
        return edges
    excess = _excess(edges, 0)
    moved = median(np.where(excess.worth, excess.moves, 0.0)[fitted]) / _MEDIAN[2]
    bent = moved > _BENT and light_misfit(grey, found, 2.0 * room) > _LEFT * median(edges.noise[fitted])
    if moved > _ALL_WRONG or bent:
        return _all_alone(grey, found, room)
    usual = np.maximum(median(edges.noise[fitted]), _IMPERFECT * np.abs(edges.contrast))
    noisy = ~(edges.noise < _STRANGE * usual)
    again = np.flatnonzero(_beyond(excess, 6) | noisy)
    if not len(again):
        return edges
    common = _medians(edges, _told(edges, 0, LINEAR - PLAIN)[0], 0)
    own = fitted_edges(grey, found.center[again], found.spread[again], room[again], light[again], LINEAR)
    own.center[:] -= common @ edges.odd[again, :, TERMS + 1 :]
    better = ~(noisy[again] & (own.noise > _BETTER * edges.noise[again]))
    return _cubic(grey, found, room, light, edges.replaced(again[better], own.kept(better)), again[better])


def _all_alone(grey: Grey, found: Spots, room: Floats) -> Edges:
    flat = np.zeros((len(found), 2))
    edges = fitted_edges(grey, found.center, found.spread, room, flat, LINEAR)
    return _cubic(grey, found, room, flat, edges, np.arange(len(found)), _FREQUENT)


def _cubic(
    grey: Grey, found: Spots, room: Floats, light: Floats, edges: Edges, members: Ints, rare: dict[int, float] = _RARE
) -> Edges:
    """With the light's cubic for those members that ask for it and are explained by it. What it moves them by is in
    doubt as a whole, either way: light that has a cubic has more."""
    still = members[_beyond(_excess(edges, LINEAR - PLAIN), 4, rare)[members]]
    if not len(still):
        return edges
    cubic = fitted_edges(grey, found.center[still], found.spread[still], room[still], light[still], CUBIC)
    moved = cubic.center - edges.center[still]
    doubt = moved[:, :, None] * moved[:, None, :]
    usual = median(edges.noise[~np.isnan(edges.noise)])
    explained = cubic.noise < _STRANGE * usual
    cubic.covariance[:] += doubt
    edges.covariance[still] += np.nan_to_num(doubt)
    return edges.replaced(still[explained], cubic.kept(explained))


@dataclass(frozen=True, eq=False)
class _Excess:
    """Chi-squares (n,) of terms of the light against those that dots have in common, and of the moves of the centre
    that they would make, 0 where there is nothing to tell; whether such a move is worth to be known."""

    shapes: Floats
    moves: Floats
    worth: Bools


def _excess(edges: Edges, first: int) -> _Excess:
    """Of the terms from `first` on."""
    sharpness = edges.noise**2 / (edges.noise**2 + (_IMPERFECT * edges.contrast) ** 2)
    variance = edges.covariance[:, 0, 0] + edges.covariance[:, 1, 1]
    values, inverse = _told(edges, first, TERMS)
    common, count = _medians(edges, values, first), len(variance)
    out = _Excess(np.empty(count), np.empty(count), np.empty(count, dtype=bool))
    excesses(edges.odd, values, inverse, sharpness, variance, common, out.shapes, out.moves, out.worth)
    return out


def _beyond(excess: _Excess, degrees: int, rare: dict[int, float] = _RARE) -> Bools:
    """Which (n,) terms are no noise, and move the centre; where all dots differ by more than noise says (a lens's
    asymmetry, a camera's processing) that is the measure. All dots, not those alone that light has moved: a wide
    shadow's edge would be its own measure."""
    out = excess.worth.copy()
    for square, freedom in ((excess.shapes, degrees), (excess.moves, 2)):
        told = square[square > 0.0]
        usual = median(told) / _MEDIAN[freedom] if len(told) >= _ENOUGH else 1.0
        out &= square > rare[freedom] * max(1.0, usual)
    return out


def _told(edges: Edges, first: int, last: int) -> tuple[Floats, Floats]:
    """The terms (n, last - first) had they been fitted, and their covariances."""
    count, size = len(edges.odd), last - first
    values, inverse = np.empty((count, size)), np.empty((count, size, size))
    term_values(edges.odd, first, last, values, inverse)
    return values, inverse


def _medians(edges: Edges, values: Floats, first: int) -> Floats:
    """The medians (6,) over dots of their terms from `first` on, zero for the others."""
    out = np.zeros(TERMS)
    fitted = values[~np.isnan(edges.noise)]
    if len(fitted) >= _ENOUGH:
        out[first : first + values.shape[1]] = [median(column) for column in fitted.T]
    return out


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
        fullness = 1.0 - np.exp(-0.5 * axes.prod(axis=1) / edges.blur**2)  # of the contrast, in a dot's middle
        keep &= sign * edges.contrast * fullness > _NOISE * np.maximum(edges.noise, noise)
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
