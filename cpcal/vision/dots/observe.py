"""Dots in an image: sub-pixel centres, with covariance and quality.

The centre of a dot is that of the ellipse on which the grey level is half-way between the dot and the plate; it is not
the image of the dot's centre, which the pose step accounts for. Dots are told from all else by their shape (a blurred
ellipse explains their grey levels), their size and their contrast, both compared with those of the others.
"""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cpcal.common.values import AnyArray, Bools, Floats, Shape, freeze, norms
from cpcal.vision.dots.edge import LINEAR, OUTSIDE, PLAIN, Edges, fitted_edges
from cpcal.vision.dots.segmentation import (
    Spots,
    Survey,
    eight_bits,
    gaps,
    grey_levels,
    halved,
    noise_level,
    spots,
    surveys,
)
from cpcal.vision.opencv import Grey
from cpcal.vision.projection import median

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


def light_growth(grey: Grey, found: Spots, gap: Floats, dim: Floats | float = 0.0) -> tuple[Floats, float]:
    """By which share the light grows per pixel to the right and down at each dot, (n, 2), and the median of what a
    polynomial of the place leaves of the grey levels; nan and 0 where the dots are too few for one. `gap` (n,) pixels
    lie between a dot and its neighbours; `dim` (n,) grey levels are what blur takes from the middle of a dot.

    The polynomial is fitted twice, the second time without outliers.
    """
    degrees = [d for d in range(1, _MOST_DEGREE + 1) if len(found) >= _EACH * (d + 1) * (d + 2) // 2]
    if not degrees:
        return np.full((len(found), 2), np.nan), 0.0
    degree, half = degrees[-1], 0.5 * np.array(grey.shape[::-1])
    level, (x, y) = _levels(grey, found, gap) + dim, (found.center / half - 1.0).T
    i, j = np.nonzero(np.add.outer(np.arange(degree + 1), np.arange(degree + 1)) <= degree)  # powers of x and y
    of_x, of_y = (np.vander(along, degree + 1, increasing=True) for along in (x, y))
    values = of_x[:, i] * of_y[:, j]
    coefficients, left, good = np.zeros(len(i)), 0.0, np.ones(len(level), bool)
    for _ in range(2):
        some = values[good]
        normal = some.T @ some + 1e-9 * len(some) * np.eye(len(i))  # in case dots lie on few lines
        coefficients = np.linalg.solve(normal, some.T @ level[good])
        off = np.abs(level - values @ coefficients)
        left = median(off)
        good = off <= _OUTLYING * 1.4826 * left + 1e-12
    slope = [(i * of_x[:, i - 1] * of_y[:, j]) @ coefficients, (j * of_x[:, i] * of_y[:, j - 1]) @ coefficients]
    light = np.maximum(values @ coefficients, 1.0)
    return np.stack(slope, axis=1) / (light[:, None] * half), left


def _levels(grey: Grey, found: Spots, gap: Floats) -> Floats:
    """Grey levels (n,) of the bright surface: the mean of nine pixels in the middle of bright dots, of sixteen beside
    dark ones."""
    if found.bright:
        steps = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), axis=-1).reshape(-1, 2)
    else:
        angle = np.pi / 8.0 * np.arange(16)
        ways = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        square = np.einsum("ki,nij,kj->nk", ways, np.linalg.inv(found.spread), ways)
        reach = 2.0 / np.sqrt(square) + np.clip(0.5 * gap, 1.5, _BESIDE)[:, None]
        steps = reach[..., None] * ways
    at = np.rint(found.center[:, None] + steps).astype(np.intp)
    x, y = np.clip(at, 0, np.array(grey.shape[::-1]) - 1).T
    return np.asarray(grey[y, x].mean(axis=0))


# ------------------------------------------------------------------------------------------------------------------
# Dots that the light of all does not explain, a shadow's edge or a smudge: under light of their own.
#
# What moves a dot's centre and no residual shows is light that is not symmetric about it. So each fit tells what the
# light's growth would be, had it been fitted, and with which covariance: where it differs from the other dots' by more
# than the other dots differ among themselves, and moves the centre, it is fitted as well. A lens's asymmetry passes for
# light, too, and moves all dots alike; what it makes of a dot with light of its own is taken off, so that this dot is
# moved as the others.

TERMS = LINEAR - PLAIN  # of the light's growth
_HOPELESS = 9.0  # variance of such a move, relative to the centre's: the dot is too small to tell its light
_WORTH = 0.004  # pixels: a smaller move is not worth the accuracy that light of a dot's own costs
_STRANGE = 1.5  # residuals, relative to the usual ones, that ask for light of the dot's own
_BETTER = 0.95  # residuals with it relative to those without, then
_RARE = 13.8  # chi-square of two degrees of freedom that one ordinary dot of a thousand exceeds
_MEDIAN = 1.39
_ALL_WRONG = 6.0  # times what noise makes of the centres' moves: then the light of all is wrong, and of no use
_BENT = 2.5  # so it is from here on, where it also leaves _LEFT of the noise of the levels; 0.3 is usual
_LEFT = 1.2
_IMPERFECT = 0.006  # of the contrast: what the model of an edge leaves out; pixels' places make it seem asymmetric
_DIM = 1e-3  # of the contrast: a smaller difference in the middles of dots moves none by 2e-4 pixels
_ENOUGH = 20  # dots that tell what is common to all


def fitted_under(grey: Grey, found: Spots, gap: Floats, light: Floats, left: float) -> Edges:
    """The fits of spots under the light of all, or under one of their own; `light` and what it leaves are those of
    `light_growth`."""
    room = np.clip(_ROOM * gap, _LEAST_ROOM, OUTSIDE)  # pixels beyond its edge that are a dot's own
    fitted_with = partial(fitted_edges, grey, found.center, found.spread, room)
    each_alone = partial(fitted_with, np.zeros((len(found), 2)), LINEAR)
    if np.isnan(light).any():
        return each_alone()
    edges = fitted_with(light)
    fitted = ~np.isnan(edges.noise)
    if not fitted.any():
        return edges
    if found.bright:  # a blur reaches the middle of dots, and of small (distant) ones most: that is no light
        square, wide = edges.axes.prod(axis=1), edges.blur**2
        dim = edges.contrast * np.exp(-0.5 * square / wide) * (1.0 + (square / wide - 2.0) / (3.0 * wide))
        if np.ptp(dim[fitted]) > _DIM * median(edges.contrast[fitted]):
            light, left = light_growth(grey, found, gap, np.nan_to_num(dim))
            edges = fitted_with(light)
            fitted = ~np.isnan(edges.noise)
            if not fitted.any():
                return edges
    (squares, worth, common), noise = _excess(edges), median(edges.noise[fitted])
    moved = median(np.where(worth, squares, 0.0)[fitted]) / _MEDIAN
    if moved > _ALL_WRONG or (moved > _BENT and left > _LEFT * noise):
        return each_alone()
    noisy = ~(edges.noise < _STRANGE * np.maximum(noise, _IMPERFECT * np.abs(edges.contrast)))
    # where all dots differ by more than noise says (a lens's asymmetry, a camera's processing) that is the measure. All
    # dots, not those alone that light has moved: a wide shadow's edge would be its own measure
    told = squares[squares > 0.0]
    usual = max(1.0, median(told) / _MEDIAN) if len(told) >= _ENOUGH else 1.0
    again = np.flatnonzero((worth & (squares > _RARE * usual)) | noisy)
    if not len(again):
        return edges
    own = fitted_edges(grey, found.center[again], found.spread[again], room[again], light[again], LINEAR)
    own.center[:] -= common @ edges.odd[again, :, TERMS + 1 :]
    better = ~(noisy[again] & (own.noise > _BETTER * edges.noise[again]))
    return edges.replaced(again[better], own.kept(better))


def _excess(edges: Edges) -> tuple[Floats, Bools, Floats]:
    """Chi-squares (n,) of the light's growth against what dots have in common, 0 where there is nothing to tell;
    whether the move of the centre that it would make is worth to be known; and what is common to all."""
    information, moves = edges.odd[:, :, :TERMS], edges.odd[:, :, TERMS + 1 :]
    trace = np.trace(information, axis1=1, axis2=2)
    known = (trace > 0.0) & np.isfinite(trace)
    inverse = np.zeros_like(information)
    inverse[known] = np.linalg.inv(information[known] + 1e-9 * trace[known, None, None] * np.eye(TERMS))
    inverse[~(np.diagonal(inverse, axis1=1, axis2=2) > 0.0).all(axis=1)] = 0.0  # rounding: no covariance
    believed = edges.noise**2 / (edges.noise**2 + (_IMPERFECT * edges.contrast) ** 2)  # share of a dot's information
    told = (inverse[:, 0, 0] > 0.0) & (believed > 0.0)
    believed = np.where(told, believed, 1.0)
    values, fitted = (inverse @ edges.odd[:, :, TERMS, None])[..., 0], ~np.isnan(edges.noise)
    common = np.median(values[fitted], axis=0) if fitted.sum() >= _ENOUGH else np.zeros(TERMS)
    off = values - common
    move = (off[:, None] @ moves)[:, 0]
    spread = np.trace(np.swapaxes(moves, 1, 2) @ inverse @ moves, axis1=1, axis2=2) / believed
    worth = told & (spread < _HOPELESS * np.trace(edges.covariance, axis1=1, axis2=2))
    worth &= (move * move).sum(axis=1) > _WORTH**2
    squares = believed * (off[:, None] @ information @ off[..., None])[:, 0, 0]
    return np.where(told, squares, 0.0), worth, common


FLOOR = 5e-4  # pixels: what the model of the edge leaves out, whatever the noise
_QUALITY = 0.22  # at least: that of a square of 8 pixels behind an ordinary blur is 0.19
_TOLERATED = 0.01  # share of the grey levels' variance that is neither noise nor explained: a quality of one half
_MOVED = 0.35  # of the radius, from the segmentation's centre, at most
_RATIO = 2.0  # of a dot's radius to the usual one, or its inverse
_CONTRAST = 0.25  # of the usual one, at least
_SMALLEST = 1.5  # pixels of radius
_HALVINGS = 2  # of an image in which fewer than `_MOSTLY` of `_MANY` spots are dots
_MOSTLY, _MANY = 0.8, 30
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
    halvings    how many times the image was halved before; spots, gap and light are of that image
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
    halvings: int = 0

    def __post_init__(self) -> None:
        freeze(self, "centers", "covariance", "quality", "axes", "gap", "light")

    def __len__(self) -> int:
        return len(self.centers)


def observe_dots(image: object, *, bright: bool | None = None) -> Dots:
    """The dots of an image (height, width) or (height, width, colours), 8 or 16 bits, that are clear of its border.

    `bright` states whether they are brighter than around them; None finds out. Raises InputError when `image` is none;
    an image without dots has none.
    """
    found = populations(image, bright=bright)
    return max(found, key=lambda dots: float(dots.quality.sum()), default=nothing(bool(bright)))


def populations(image: object, *, bright: bool | None) -> Iterator[Dots]:
    """The dots of an image of each kind and size that they may be of, the likelier first, one by one as they are asked
    for. What they have in common cannot tell a target's dots from a background's specks; identification can. Where most
    spots are no dots, the image may be softer than its pixels (a wide lens, a camera that smooths): it is halved."""
    grey = grey_levels(image)
    for halvings in range(_HALVINGS + 1):
        eight, expected, most = eight_bits(grey), 0, 0
        half = halved(eight)
        if bright is None:
            both = itertools.chain(surveys(eight, half, True), surveys(eight, half, False))
            looks: Iterable[Survey] = sorted(both, key=lambda survey: -survey.number)
        else:
            looks = surveys(eight, half, bright)
        for survey in looks:
            dots = _observed(grey, spots(eight, half, survey), survey.radius, halvings)
            yield dots
            expected, most = max(expected, survey.number), max(most, len(dots))
        if most >= _MOSTLY * expected or expected < _MANY:
            return
        grey = halved(grey)


def refitted(image: object, dots: Dots, members: AnyArray) -> Dots:
    """The dots with those `members` fitted again under the light that they alone tell; the others stay.

    The light of a background's spots is not that of the plate, and would shift all dots of the target together. Where
    it makes no difference all stay. Raises InputError when `image` is none.
    """
    if len(members) == len(dots) and not dots.strangers:
        return dots
    grey, found, gap = grey_levels(image), dots.spots.kept(members), dots.gap[members]
    for _ in range(dots.halvings):
        grey = halved(grey)
    light, left = light_growth(grey, found, gap)
    change = np.abs(light - dots.light[members])
    if np.isnan(light).any() or (change < _SAME_LIGHT).all():
        return dots
    edges = fitted_under(grey, found, gap, light, left)
    fine = ~np.isnan(edges.noise)
    measured = _measured(edges.kept(fine), noise_level(grey), dots.halvings)
    parts = {name: getattr(dots, name).copy() for name in measured}
    for name, values in measured.items():
        parts[name][members[fine]] = values
    return replace(dots, **parts)


def _observed(grey: Grey, found: Spots, usual: float, halvings: int) -> Dots:
    """The dots among spots, of about the `usual` radius, in an image that was halved so many times."""
    if not len(found):
        return nothing(found.bright)
    gap = gaps(found)
    light, left = light_growth(grey, found, gap)
    edges, noise = fitted_under(grey, found, gap, light, left), noise_level(grey)
    keep = np.flatnonzero(_dot_like(found, edges, noise, grey.shape))
    if len(keep):
        size, contrast = np.sqrt(edges.axes[keep].prod(axis=1)), np.abs(edges.contrast[keep])
        keep = keep[(size < _RATIO * usual) & (_RATIO * size > usual) & (contrast > _CONTRAST * median(contrast))]
    parts, strangers = _measured(edges.kept(keep), noise, halvings), len(keep) < len(found)
    return Dots(
        **parts,
        bright=found.bright,
        spots=found.kept(keep),
        gap=gap[keep],
        light=light[keep],
        strangers=strangers,
        halvings=halvings,
    )


def nothing(bright: bool) -> Dots:
    """No dots."""
    pairs, matrices, numbers = np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0)
    return Dots(pairs, matrices, numbers, pairs, bright, Spots(pairs, matrices, bright), numbers, pairs)


def _measured(edges: Edges, noise: float, halvings: int) -> dict[str, Floats]:
    """What `Dots` say of fits in an image with so much noise (grey levels) that was halved so many times."""
    unit = 2.0**halvings
    return {
        "centers": unit * edges.center + 0.5 * (unit - 1.0),
        "covariance": unit**2 * (edges.covariance + FLOOR**2 * np.eye(2)),
        "quality": _quality(edges, noise),
        "axes": unit * edges.axes,
    }


def _quality(edges: Edges, noise: float) -> Floats:
    """1 / (1 + strange / tolerated) (n,) of the share of the grey levels' variance that is strange: neither explained
    by a blurred ellipse nor the image's noise (grey levels)."""
    strange = np.maximum(edges.noise**2 - noise**2, 0.0) / np.maximum(edges.variance, 1e-12)
    return np.nan_to_num(1.0 / (1.0 + strange / _TOLERATED))


def _dot_like(found: Spots, edges: Edges, noise: float, shape: Shape) -> Bools:
    """Which (n,) of the fits are dots for themselves."""
    axes, radius, contrast = edges.axes, found.radius, edges.contrast if found.bright else -edges.contrast
    size, (xx, xy, yy) = np.sqrt(axes.prod(axis=1)), edges.conic[:, [0, 0, 1], [0, 1, 1]].T
    half = np.sqrt(np.stack([yy, xx], axis=1) / (xx * yy - xy * xy)[:, None])  # sides of the box around the ellipse
    around = _CLEAR * edges.blur[:, None] + half
    with np.errstate(invalid="ignore"):
        fullness = 1.0 - np.exp(-0.5 * (size / edges.blur) ** 2)  # of the contrast, in a dot's middle
        tests = (
            _quality(edges, noise) >= _QUALITY,
            norms(edges.center - found.center) < _MOVED * radius,
            axes[:, 1] > _SLIMMEST * axes[:, 0],
            (edges.blur > _SHARPEST) & (edges.blur < axes[:, 1]),
            contrast * fullness > _NOISE * np.maximum(edges.noise, noise),
            (edges.center > around).all(axis=1),
            (edges.center + around < np.array(shape[1::-1]) - 1.0).all(axis=1),
            (size > 0.5 * radius) & (size < 1.5 * radius) & (size > _SMALLEST),
        )
    return np.asarray(np.logical_and.reduce(tests))
