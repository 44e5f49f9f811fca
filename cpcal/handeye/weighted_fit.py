"""Least squares where the robot's poses have errors too: pixels and poses weighted by their deviations.

    sum |pixel residual|^2 / sigma^2 + sum (reading / its deviation)^2

over the frames and a reading of each pose. A pose's half-width h on an axis counts as the deviation h / sqrt(3) of a
uniform error; the pixels' deviation is what the poses of single images, which no robot error touches, leave. The
readings are eliminated image by image (Schur complement), so the cost grows with the number of images only.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.handeye.damped_steps import damped_step, descended
from cpcal.handeye.hand_eye_study import HandEyeFrames
from cpcal.handeye.pose_readings import ReadFrames, ReadingModel, by_images

_STEPS = 60
_LEAST = 1e-9  # of the deviation of a reading that is taken as exact, against dividing by zero


def weighted_fit(model: ReadingModel, frames: HandEyeFrames, pixel: float) -> tuple[ReadFrames, Floats]:
    """Frames and readings from a start, and the covariance (12, 12) of the frames; `pixel`: deviation in px."""
    study = model.study
    deviation = np.maximum(study.pose_half_width, _LEAST) / np.sqrt(3.0)
    places = by_images(study)

    def cost(tried: ReadFrames) -> float:
        return float(np.sum((model(tried) / pixel) ** 2) + np.sum((tried.readings / deviation) ** 2))

    def stepped(at: ReadFrames) -> Callable[[float], ReadFrames]:
        normal, right, solved = _reduced(model, at, pixel, deviation, places)

        def moved(damping: float) -> ReadFrames:
            step = damped_step(normal, right, damping)
            own = np.concatenate([shift - turned @ step for turned, shift in solved])
            return model.moved(at, np.concatenate([step, own]))

        return moved

    at = descended(ReadFrames.stated(frames, study), cost, stepped, steps=_STEPS, settled=1e-12)
    normal, _, _ = _reduced(model, at, pixel, deviation, places)
    scale = np.sqrt(np.diagonal(normal))
    return at, np.linalg.pinv(normal / np.outer(scale, scale)) / np.outer(scale, scale)


def _reduced(
    model: ReadingModel, at: ReadFrames, pixel: float, deviation: Floats, places: list[np.ndarray]
) -> tuple[Floats, Floats, list[tuple[Floats, Floats]]]:
    """Normal equations of the frames alone, and of each image what gives its reading from the frames' step."""
    frames, own = (block / pixel for block in model.blocks(at))
    residuals = model(at) / pixel
    normal, right = frames.T @ frames, -frames.T @ residuals
    solved = []
    for k, rows in enumerate(places):
        mixed = own[rows].T @ frames[rows]
        inner = own[rows].T @ own[rows] + np.diag(deviation[k] ** -2)
        towards = -own[rows].T @ residuals[rows] - at.readings[k] / deviation[k] ** 2
        both = np.linalg.solve(inner, np.concatenate([mixed, towards[:, None]], axis=1))
        normal -= mixed.T @ both[:, :-1]
        right -= mixed.T @ both[:, -1]
        solved.append((both[:, :-1], both[:, -1]))
    return normal, right, solved
