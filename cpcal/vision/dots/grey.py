"""What counts as an image, and its grey levels."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.solver.compiled import compiled
from cpcal.vision.opencv import opencv

Grey = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

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
        raise InputError([Problem("image", problem, _REMEDY)])
    assert isinstance(image, np.ndarray)
    pixels: npt.NDArray[Any] = image.astype(image.dtype.newbyteorder("="), copy=False)
    if pixels.ndim == 3:
        cv2 = opencv()
        pixels = pixels[..., 0] if pixels.shape[2] == 1 else pixels[..., :3]
        pixels = np.ascontiguousarray(pixels)
        if pixels.ndim == 3:
            pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
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


def eight_bits(grey: Grey) -> npt.NDArray[np.uint8]:
    """The same with 8 bits: 16 bits are stretched so that the darkest and the brightest 0.05 % saturate."""
    if isinstance(grey[0, 0], np.uint8):
        return grey.astype(np.uint8, copy=False)
    step = max(1, int(np.sqrt(grey.size / 50_000)))
    low, high = np.quantile(grey[::step, ::step], [0.0005, 0.9995])
    scale = 255.0 / max(float(high - low), 255.0)
    lifted = np.maximum(grey, np.uint16(low))
    out: npt.NDArray[np.uint8] = opencv().convertScaleAbs(lifted, alpha=scale, beta=-float(low) * scale)
    return out


def noise_level(image: Grey) -> float:
    """The standard deviation of the pixels' noise (grey levels), from the median second difference along rows of
    pixels spread over the image; at least that of rounding."""
    return max(_median_second(image, max(1, int(np.sqrt(image.size / 10_000)))) / _MEDIAN, _ROUNDING)


@compiled
def _median_second(image: Grey, step: int) -> float:
    """The median of absolute second differences along rows, of one row and of one column in so many. Between whole
    numbers: those that are equal are spread evenly over one grey level."""
    height, width = image.shape
    counts, total = np.zeros(2 << (8 * image.itemsize), np.int64), 0
    for row in range(0, height, step):
        for column in range(0, width - 2, step):
            second = int(image[row, column + 2]) - 2 * int(image[row, column + 1]) + int(image[row, column])
            counts[abs(second)] += 1
            total += 1
    below = 0
    for level in range(len(counts)):
        if below + counts[level] > 0.5 * total:
            middle: float = level - 0.5 + (0.5 * total - below) / counts[level]
            return max(middle, 0.0)
        below += counts[level]
    return 0.0
