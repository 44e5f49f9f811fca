"""Where dots may be: spots that stand out from the mean of their neighbourhood, elliptic and about as large.

A first pass over the image at half its size, with a neighbourhood as wide as the largest dot, tells how large the dots
are and whether they are bright; the second uses a neighbourhood made for them, so that uneven light matters little.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cpcal.common.errors import unusable
from cpcal.common.values import AnyArray, Bools, Floats, Ints
from cpcal.solver.compiled import compiled
from cpcal.vision.opencv import Grey, Grey8, opencv
from cpcal.vision.projection import eigenvalues, median

# ------------------------------------------------------------------------------------------------------------------
# What counts as an image, and its grey levels.

_MEDIAN = 0.6745 * float(np.sqrt(6.0))  # of the second difference of pixels with a noise of 1
_ROUNDING = float(np.sqrt(1.0 / 12.0))
MOST_PIXELS = 150_000_000
_REMEDY = "give an array (height, width) or (height, width, 1, 3 or 4) of uint8 or uint16, as cv2.imread makes it"


def grey_levels(image: object) -> Grey:
    """An image's grey levels (height, width) in its own 8 or 16 bits; colours are OpenCV's BGR or BGRA.

    Raises InputError when it is no image, has no pixels or more than `MOST_PIXELS`.
    """
    problem = _problem(image)
    if problem is not None:
        raise unusable("image", problem, _REMEDY)
    assert isinstance(image, np.ndarray)
    pixels: AnyArray = image.astype(image.dtype.newbyteorder("="), copy=False)
    if pixels.ndim == 3 and pixels.shape[2] > 1:
        pixels = opencv().cvtColor(np.ascontiguousarray(pixels[..., :3]), opencv().COLOR_BGR2GRAY)
    elif pixels.ndim == 3:
        pixels = pixels[..., 0]
    return np.ascontiguousarray(pixels)


def _problem(image: object) -> str | None:
    if image is None:
        return "is None: the file was not there, or is no image"
    if not isinstance(image, np.ndarray):
        return f"is no array but a {type(image).__name__}"
    if image.dtype.newbyteorder("=") not in (np.dtype(np.uint8), np.dtype(np.uint16)):
        return f"has values of type {image.dtype}"
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
        return f"has the shape {image.shape}"
    if image.size == 0:
        return f"has no pixels, its shape is {image.shape}"
    if image.shape[0] * image.shape[1] > MOST_PIXELS or max(image.shape[:2]) >= 2**15:
        return f"is too large, {image.shape[1]} x {image.shape[0]}"
    return None


def eight_bits(grey: Grey) -> Grey8:
    """The same with 8 bits: 16 bits are stretched so that the darkest and the brightest 0.05 % saturate."""
    if isinstance(grey[0, 0], np.uint8):
        return grey.astype(np.uint8, copy=False)
    step = max(1, int(np.sqrt(grey.size / 50_000)))
    low, high = np.quantile(grey[::step, ::step], [0.0005, 0.9995])
    scale = 255.0 / max(float(high - low), 255.0)
    lifted = np.maximum(grey, np.uint16(low))
    out: Grey8 = opencv().convertScaleAbs(lifted, alpha=scale, beta=-float(low) * scale)
    return out


def noise_level(image: Grey) -> float:
    """The standard deviation of the pixels' noise (grey levels), at least that of rounding: from the median second
    difference along rows of pixels spread over the image. Equal differences, which are whole numbers, are spread evenly
    over one grey level."""
    step = max(1, int(np.sqrt(image.size / 10_000)))
    rows = image[::step]
    left, middle, right = (rows[:, k : rows.shape[1] - 2 + k : step].astype(np.int32) for k in range(3))
    counts = np.bincount(np.abs(left - 2 * middle + right).ravel())
    if not counts.size:
        return _ROUNDING
    upto = np.cumsum(counts)
    level = int(np.searchsorted(upto, 0.5 * upto[-1], side="right"))
    median_difference = level + 0.5 - (upto[level] - 0.5 * upto[-1]) / counts[level]
    return max(float(median_difference) / _MEDIAN, _ROUNDING)


# ------------------------------------------------------------------------------------------------------------------
# Outlines of regions as ellipses: area, centroid, second moments, and whether they look like dots.

_SLIMMEST = 0.2  # ratio of the axes of a spot
_ELLIPTIC = 0.85  # least ratio of a spot's area to that of the ellipse of the same second moments


def ellipses(outlines: Sequence[Any], width: int, height: int) -> tuple[Floats, Floats, Bools]:
    """Of OpenCV's outlines (n of them) in an image: the centres (n, 2) pixels, the second moments (n, 2, 2) px^2 of the
    regions, and which are elliptic and clear of the border; of the others nothing is told.

    Moments are those of polygons by Green's formula; holes have negative areas, and are not kept.
    """
    points, ends = np.concatenate(outlines)[:, 0], np.cumsum(np.fromiter(map(len, outlines), np.int64, len(outlines)))
    center, spread, keep = np.zeros((len(ends), 2)), np.zeros((len(ends), 2, 2)), np.zeros(len(ends), bool)
    _fill_ellipses(points, ends, width, height, center, spread, keep)
    return center, spread, keep


@compiled
def _fill_ellipses(
    points: npt.NDArray[np.int32], ends: Ints, width: int, height: int, center: Floats, spread: Floats, keep: Bools
) -> None:
    """Each outline's points reach up to its entry of `ends`."""
    first = 0
    for i in range(len(ends)):
        area, to_x, to_y, to_xx, to_xy, to_yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        keep[i], x1, y1 = ends[i] - first >= 4, 0.0, 0.0  # from the outline's first point
        for k in range(ends[i] - 1, first - 1, -1):  # OpenCV goes round a region with y/x turned this way
            keep[i] &= 0 < points[k, 0] < width - 1 and 0 < points[k, 1] < height - 1
            x0, y0 = float(points[k, 0] - points[first, 0]), float(points[k, 1] - points[first, 1])
            cross = x1 * y0 - x0 * y1
            area += cross / 2.0
            to_x += cross * (x0 + x1) / 6.0
            to_y += cross * (y0 + y1) / 6.0
            to_xx += cross * (x0 * x0 + x0 * x1 + x1 * x1) / 12.0
            to_xy += cross * (2.0 * (x0 * y0 + x1 * y1) + x0 * y1 + x1 * y0) / 24.0
            to_yy += cross * (y0 * y0 + y0 * y1 + y1 * y1) / 12.0
            x1, y1 = x0, y0
        keep[i] &= area > 0.0
        if keep[i]:
            x, y = to_x / area, to_y / area
            xx, xy, yy = to_xx / area - x * x, to_xy / area - x * y, to_yy / area - y * y
            half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
            short, long = np.sqrt(max(half - apart, 1e-4)), np.sqrt(max(half + apart, 1e-4))
            keep[i] = area > _ELLIPTIC * 4.0 * np.pi * short * long
            # an outline runs through the centres of pixels: the region reaches half a pixel farther in every direction
            keep[i] &= 0.25 + short > _SLIMMEST * (0.25 + long)
            more = 0.0625 + 0.25 * (short + long)
            center[i, 0], center[i, 1] = points[first, 0] + x, points[first, 1] + y
            spread[i, 0, 0], spread[i, 0, 1], spread[i, 1, 0], spread[i, 1, 1] = xx + more, xy, xy, yy + more
        first = ends[i]


Image = TypeVar("Image", bound=AnyArray)

_NEIGHBOURS = 5  # the nearest by their centres: one of them is the nearest by its edge
_WIDEST = 61  # neighbourhood in the half image, for dots of at most 45 pixels radius in the whole one
_NARROW = 31  # in the whole image, for small dots close together, where the first tells none apart
_LARGE = 4_000_000  # pixels of an image whose half is looked at first
_ENOUGH, _SMALL = 10, 3.5  # spots, and pixels of their radius, to do without the other
_NEIGHBOURHOOD = 6.0  # radii of a dot
_NOISE = 5.0  # standard deviations of noise that a spot must stand out by
_CONTRAST = 0.2  # of the usual contrast that it must stand out by
_LEAST = 4.0  # grey levels of 256 that it must stand out by
_ONE_SIZE = 1.8  # ratio of the largest to the smallest radius of an image's dots
_NEXT_SIZE = 1.25  # ratio between these and other spots that are looked at by themselves
_SIZES, _MANY = 3, 12  # so many sizes at most, of so many spots at least
_LARGEST = 60.0  # pixels of radius
_ALIKE = 2.5  # ratio of a spot's size to the usual one, or its inverse
_SMALLEST = 8  # pixels, sides of an image with dots
_MOST_SPOTS = 300_000


@dataclass(frozen=True, eq=False)
class Spots:
    """center (n, 2) pixels; spread (n, 2, 2) the second moments of the ellipse, a quarter of its squared semi-axes,
    px^2; bright: than around them."""

    center: Floats
    spread: Floats
    bright: bool

    def __len__(self) -> int:
        return len(self.center)

    @cached_property
    def radius(self) -> Floats:
        """(n,) of the circle of the same area, pixels."""
        return 2.0 * (self.spread[:, 0, 0] * self.spread[:, 1, 1] - self.spread[:, 0, 1] ** 2) ** 0.25

    def kept(self, keep: AnyArray) -> "Spots":
        return Spots(self.center[keep], self.spread[keep], self.bright)


def gaps(found: Spots) -> Floats:
    """The pixels (n,) between a spot and its neighbours; inf where none is."""
    apart, other = cKDTree(found.center).query(found.center, 1 + _NEIGHBOURS)  # the first is the spot itself
    long = np.append(2.0 * np.sqrt(eigenvalues(found.spread)[:, 1]), 0.0)
    return np.asarray((apart - long[other])[:, 1:].min(axis=1) - long[:-1])


class Survey(NamedTuple):
    """What a first look tells of the dots, if they are bright, or dark: their number, radius (pixels), and the contrast
    (grey levels) they must have."""

    bright: bool
    number: int
    radius: float
    contrast: float


def surveys(image: Grey8, half: Grey8, bright: bool) -> Iterator[Survey]:
    """First looks at an image's bright or dark dots, the likelier first: of each size that many spots have, because
    specks of a background may outnumber the dots. None without spots. `half` is the image at half its size. Of a large
    image those of its half come first, where it shows spots that are large enough for that."""
    least = max(_NOISE * noise_level(image), _LEAST)
    if image.size >= _LARGE:
        for one in surveys(half, halved(half), bright):
            if one.number >= _ENOUGH and 2.0 * _SMALL <= one.radius <= 0.5 * _LARGEST:
                yield one._replace(radius=2.0 * one.radius, contrast=max(least, one.contrast))
    if min(image.shape) >= _SMALLEST:
        mean = opencv().blur(half, (_WIDEST, _WIDEST))
        some = _standing_out(_excess(half, mean, bright), max(_NOISE * noise_level(half), _LEAST), bright)
        sizes = _by_size(Spots(2.0 * some.center + 0.5, 4.0 * some.spread, bright))
        if not sizes or len(sizes[0]) < _ENOUGH or median(sizes[0].radius) < _SMALL:
            near = _by_size(_standing_out(_excess(image, _mean(image, half, _NARROW), bright), least, bright))
            sizes = max(sizes, near, key=lambda found: len(found[0]) if found else 0)
        for found in sizes:
            at = np.minimum((0.5 * found.center).astype(np.int64), np.array(half.shape[::-1]) - 1)
            contrast = np.abs(half[at[:, 1], at[:, 0]].astype(np.float64) - mean[at[:, 1], at[:, 0]])
            yield Survey(bright, len(found), median(found.radius), max(least, _CONTRAST * median(contrast)))


def _by_size(found: Spots) -> list[Spots]:
    """Spots of about one size each, those that cover most of the image first; the others only if they are many."""
    out: list[Spots] = []
    while len(found) and len(out) < _SIZES and (not out or len(found) >= _MANY):
        rising = np.sort(found.radius)
        number = np.searchsorted(rising, _ONE_SIZE * rising, side="right") - np.arange(len(rising))
        least = float(rising[np.argmax(number * rising**2)])
        radius = found.radius
        own = found.kept((radius >= least) & (radius <= _ONE_SIZE * least))
        if not out or len(own) >= _MANY:
            out.append(own)
        found = found.kept((radius < least / _NEXT_SIZE) | (radius > _NEXT_SIZE * _ONE_SIZE * least))
    return out


def _mean(image: Grey8, half: Grey8, side: float) -> Grey8:
    """The mean over the square of a side around every pixel, by the image of half the size: smooth, so that it does."""
    odd = 2 * int(np.ceil(0.25 * side)) + 1
    cv2 = opencv()
    mean: Grey8 = cv2.resize(cv2.blur(half, (odd, odd)), image.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return mean


def spots(image: Grey8, half: Grey8, survey: Survey) -> Spots:
    """The candidates for dots in an image, of which `half` has half the size: all brighter or all darker than around
    them, clear of its border."""
    mean = _mean(image, half, _NEIGHBOURHOOD * survey.radius)
    return _standing_out(_excess(image, mean, survey.bright, out=mean), survey.contrast, survey.bright, survey.radius)


def halved(image: Image) -> Image:
    """The image at half its size: the means of four pixels each, without an odd last row or column."""
    height, width = (max(side // 2, 1) for side in image.shape)
    half: Image = opencv().resize(image[: 2 * height, : 2 * width], (width, height), interpolation=opencv().INTER_AREA)
    return half


def _excess(image: Grey8, mean: Grey8, bright: bool, out: Grey8 | None = None) -> Grey8:
    """By how much pixels are brighter (or darker) than the mean around, at least 0; `out` may be the mean."""
    cv2 = opencv()
    excess: Grey8 = cv2.subtract(image, mean, dst=out) if bright else cv2.subtract(mean, image, dst=out)
    return excess


def _standing_out(excess: Grey8, least: float, bright: bool, usual: float | None = None) -> Spots:
    """The elliptic regions of about the `usual` radius (left out: of any) that are at least `least` brighter
    (or darker) than around: of an excess that is used up, because fresh memory would take longer than the threshold."""
    cv2 = opencv()
    mask = cv2.threshold(excess, least, 255.0, cv2.THRESH_BINARY, dst=excess)[1]
    if _too_many(mask) or not (outlines := cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)[0]):
        return Spots(np.zeros((0, 2)), np.zeros((0, 2, 2)), bright)
    center, spread, keep = ellipses(outlines, mask.shape[1], mask.shape[0])
    found = Spots(center[keep], spread[keep], bright)
    radius = found.radius
    keep = radius < _LARGEST
    if usual is not None:
        keep &= (radius < _ALIKE * usual) & (_ALIKE * radius > usual)
    return found.kept(keep)


def _too_many(mask: Grey8) -> bool:
    """Whether a large image has more regions than any target, by the number of their upper left corners."""
    if mask.size < 16 * _MOST_SPOTS:
        return False
    corners = (mask[1:, 1:] > 0) & (mask[:-1, 1:] == 0) & (mask[1:, :-1] == 0)
    return int(np.count_nonzero(corners)) > _MOST_SPOTS
