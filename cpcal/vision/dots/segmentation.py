"""Where dots may be: spots that stand out from the mean of their neighbourhood, elliptic and about as large.

A first pass over the image at half its size, with a neighbourhood as wide as the largest dot, tells how large the dots
are and whether they are bright; the second uses a neighbourhood made for them, so that uneven light matters little.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from cpcal.common.errors import unusable
from cpcal.common.values import AnyArray, Floats
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
# Regions of a mask as ellipses: area, centroid, second moments, and whether they look like dots; compiled.

_SLIMMEST = 0.2  # ratio of the axes of a spot
_ELLIPTIC = 0.85  # least ratio of a spot's area to that of the ellipse of the same second moments: a triangle's is 0.83
_LARGEST = 60.0  # pixels of radius
_LONGEST = int(40.0 * _LARGEST)  # steps around a region: the largest and slimmest ellipse takes a quarter of them
# x and y of the steps to a pixel's neighbours, right, up, left and down, three times around
_STEPS = np.array([[1, 0], [1, -1], [0, -1], [-1, -1], [-1, 0], [-1, 1], [0, 1], [1, 1]] * 3)
_TURN, _ALONE = 8, 20  # steps of one time around; of a pixel without neighbours the last that is looked at


@compiled
def ellipses(mask: Grey8, out: Floats) -> int:
    """The regions of a mask that are elliptic and clear of its border, how many: their centres x and y, pixels, and
    second moments xx, xy, xy, yy, px^2, into the rows of `out`. None where more walks begin than there are rows.

    A region is followed around from its first pixel, the leftmost of the uppermost row. The walk begins at each pixel
    with none above and none to the left, and ends where it comes upon an earlier one, upon the border, or after
    `_LONGEST` steps. So nothing need be marked or kept.
    """
    count, begun, first = 0, 0, np.zeros(mask.shape[1] // 8 * 8 + 8, np.bool_)
    for y in range(1, len(mask) - 1):
        row, above = mask[y], mask[y - 1]
        for x in range(1, len(row) - 1):
            first[x] = row[x] > (row[x - 1] | above[x - 1] | above[x] | above[x + 1])
        for word in np.flatnonzero(first.view(np.int64)):
            for x in range(8 * word, 8 * word + 8):
                begun += first[x]
                if first[x] and begun <= len(out) and _followed(mask, x, y, out[count]):
                    count += 1
    return count if begun <= len(out) else 0


@compiled
def _followed(mask: Grey8, x: int, y: int, out: Floats) -> bool:
    """Of the region whose first pixel is (x, y) its row of `ellipses`; False where there is none. Moments are those of
    the polygon through the outermost pixels, by Green's formula."""
    (height, width), step, end, x0, y0 = mask.shape, _TURN // 2, x, 0, 0
    while mask[y, end]:  # to the right: the walk would come last upon what is above
        if end == width - 1 or mask[y - 1, end + 1]:
            return False
        end += 1
    area, to_x, to_y, to_xx, to_xy, to_yy = 0, 0, 0, 0, 0, 0
    for _ in range(_LONGEST):
        step += 1
        while step < _ALONE and not mask[y + y0 + _STEPS[step, 1], x + x0 + _STEPS[step, 0]]:
            step += 1
        if x0 == 0 and y0 == 0 and step > _TURN:
            break  # around
        x1, y1, step = x0 + _STEPS[step, 0], y0 + _STEPS[step, 1], step % _TURN + _TURN // 2
        if y1 < 0 or (y1 == 0 and x1 < 0) or not (0 < x + x1 < width - 1 and y + y1 < height - 1):
            return False
        cross, u, v = x1 * y0 - x0 * y1, x0 + x1, y0 + y1
        area, to_x, to_y = area + cross, to_x + cross * u, to_y + cross * v
        to_xx, to_yy = to_xx + cross * (u * u - x0 * x1), to_yy + cross * (v * v - y0 * y1)
        to_xy, x0, y0 = to_xy + cross * (u * v + x0 * y0 + x1 * y1), x1, y1
    else:
        return False
    if area <= 0:
        return False
    u, v = to_x / (3 * area), to_y / (3 * area)
    xx, xy, yy = to_xx / (6 * area) - u * u, to_xy / (12 * area) - u * v, to_yy / (6 * area) - v * v
    half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    short, long = np.sqrt(max(half - apart, 1e-4)), np.sqrt(max(half + apart, 1e-4))
    # the polygon runs through the centres of pixels: the region reaches half a pixel farther in every direction
    more = 0.0625 + 0.25 * (short + long)
    out[0], out[1], out[2], out[3], out[4], out[5] = x + u, y + v, xx + more, xy, xy, yy + more
    return bool(area > _ELLIPTIC * 8.0 * np.pi * short * long and 0.25 + short > _SLIMMEST * (0.25 + long))


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
_ALIKE = 2.5  # ratio of a spot's size to the usual one, or its inverse
_SMALLEST = 8  # pixels, sides of an image with dots
_MOST_SPOTS = 300_000  # places where regions may begin: no target has more


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
        some = _standing_out(half, mean.copy(), max(_NOISE * noise_level(half), _LEAST), bright)
        sizes = _by_size(Spots(2.0 * some.center + 0.5, 4.0 * some.spread, bright))
        if not sizes or len(sizes[0]) < _ENOUGH or median(sizes[0].radius) < _SMALL:
            near = _by_size(_standing_out(image, _mean(image, half, _NARROW), least, bright))
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
    return _standing_out(image, mean, survey.contrast, survey.bright, survey.radius)


def halved(image: Image) -> Image:
    """The image at half its size: the means of four pixels each, without an odd last row or column."""
    height, width = (max(side // 2, 1) for side in image.shape)
    half: Image = opencv().resize(image[: 2 * height, : 2 * width], (width, height), interpolation=opencv().INTER_AREA)
    return half


def _standing_out(image: Grey8, mean: Grey8, least: float, bright: bool, usual: float | None = None) -> Spots:
    """The elliptic regions of about the `usual` radius (left out: of any) that are at least `least` brighter
    (or darker) than the mean around. The mean is used up: fresh memory would take longer than the threshold."""
    cv2, found, pair = opencv(), np.empty((_MOST_SPOTS, 6)), (image, mean) if bright else (mean, image)
    mask = cv2.threshold(cv2.subtract(*pair, dst=mean), least, 1.0, cv2.THRESH_BINARY, dst=mean)[1]
    found = found[: ellipses(mask, found)]
    every = Spots(found[:, :2], found[:, 2:].reshape(-1, 2, 2), bright)
    keep = every.radius < _LARGEST
    if usual is not None:
        keep &= (every.radius < _ALIKE * usual) & (_ALIKE * every.radius > usual)
    return every.kept(keep)
