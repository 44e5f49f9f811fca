"""What may be behind a target: discs, a checkerboard, text, texture, or something like a photograph."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.vision.opencv import opencv

Single = npt.NDArray[np.float32]

cv2: Any = opencv()


def background(
    size: tuple[int, int], kind: str, amount: int, fine: int, dark: float, bright: float, rng: np.random.Generator
) -> Single:
    """Grey levels (height, width) before light and optics; `fine` of these places are a pixel, each way."""
    height, width = size
    grey = np.full((height, width), dark, dtype=np.float32)
    if kind == "discs":
        for _ in range(amount):
            place = (int(rng.integers(width)), int(rng.integers(height)))
            cv2.circle(grey, place, int(fine * rng.uniform(5.0, 9.0)), bright, -1)
    elif kind == "checkerboard":
        side = int(fine * rng.uniform(18.0, 30.0))
        odd = (np.arange(height)[:, None] // side + np.arange(width) // side) % 2
        grey += (bright - dark) * odd.astype(np.float32)
    elif kind == "text":
        letters = np.zeros((height, width), dtype=np.uint8)
        for row in range(0, height, 22 * fine):
            words = "".join(rng.choice(list("abcdefgo089 OQ.:;%&  "), width // 40))
            cv2.putText(letters, words, (0, row), cv2.FONT_HERSHEY_SIMPLEX, 0.5 * fine, 255, fine)
        grey += (bright - dark) / 255.0 * letters.astype(np.float32)
    elif kind == "texture":
        for _ in range(amount):
            place = (int(rng.integers(width)), int(rng.integers(height)))
            cv2.circle(grey, place, int(fine * rng.uniform(1.5, 2.3)), bright, -1)
    elif kind == "photograph":
        grey = _like_a_photograph(height, width, fine, dark, bright, rng)
    return grey


def _like_a_photograph(
    height: int, width: int, fine: int, dark: float, bright: float, rng: np.random.Generator
) -> Single:
    """Detail of all sizes (amplitudes fall with the frequency), and things with edges."""
    y, x = np.fft.fftfreq(height // 4)[:, None], np.fft.rfftfreq(width // 4)
    amplitude = 1.0 / np.maximum(np.hypot(x, y), 1.0 / width)
    field = np.fft.irfft2(amplitude * np.exp(2j * np.pi * rng.random(amplitude.shape)), (height // 4, width // 4))
    field = (field - field.mean()) / field.std()
    small = (0.5 * (dark + bright) + 0.25 * (bright - dark) * field).astype(np.float32)
    grey: Single = np.clip(cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC), 5.0, 250.0)
    for _ in range(60):
        corner = rng.uniform([0.0, 0.0], [width, height])
        shape = corner + rng.normal(0.0, fine * rng.uniform(5.0, 60.0), (int(rng.integers(3, 7)), 2))
        cv2.fillPoly(grey, [shape.astype(np.int32)], float(rng.uniform(dark, bright)))
    return grey
