"""Some images of a batch, looked at once more: pictures of what was found, and where the residuals point.

A table of poses keeps no residuals. What they show (a lens or a plate that is not as stated) is the same in all images,
so that a few images tell; they are measured again, and cost at most about a second.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.robot import transformed
from cpcal.vision.batch.detect import ImageSource
from cpcal.vision.camera import Camera
from cpcal.vision.files.detection import SCALE, Detection, by_reason
from cpcal.vision.measure import MeasuredImage, measure_pose
from cpcal.vision.overlay import overlay, refusal
from cpcal.vision.residual_map import Residuals
from cpcal.vision.target import Target

MOST_MEASURED = 40  # images whose residuals are taken
MOST_PICTURES = 12
MOST_BYTES = 600_000  # of all pictures
_OF_A_KIND = 4  # refused images, and doubtful ones
_TRIED = 2  # images of each reason, where the first cannot be read
_WIDTH = 420  # pixels of a picture
_STEP = 1e-3  # mm on the plate, for derivatives


@dataclass(frozen=True)
class SeenImage:
    """The row of an image, and a JPEG of `size` (width, height) of what was found in it."""

    row: Detection
    jpeg: bytes
    size: tuple[int, int]


@dataclass(frozen=True)
class Sample:
    """Refused images first, one of each frequent reason, then the most doubtful poses, then others, evenly spread.

    `residuals` are those of `measured` images.
    """

    pictures: tuple[SeenImage, ...]
    residuals: Residuals
    measured: int


def look_again(
    rows: Sequence[Detection],
    source: ImageSource,
    target: Target,
    camera: Camera,
    camera_covariance: Floats | None = None,
) -> Sample:
    """A sample of what `detect` found with the same arguments. An image that cannot be read any more is left out."""
    pictures: list[SeenImage] = []
    room = MOST_BYTES

    def keep(row: Detection, jpeg: bytes, shape: tuple[int, ...]) -> bool:
        nonlocal room
        if len(pictures) == MOST_PICTURES or len(jpeg) > room:
            return False
        room -= len(jpeg)
        pictures.append(SeenImage(row, jpeg, (_width(shape), round(_width(shape) * shape[0] / shape[1]))))
        return True

    for files in list(by_reason(rows).values())[:_OF_A_KIND]:
        refused = [row for row in rows if row.file in files[:_TRIED]]
        any(keep(*seen) for seen in _refused(refused, source, target))
    worst = sorted((row for row in rows if row.doubt), key=lambda row: -row.values[SCALE])[:_OF_A_KIND]
    others = _spread([row for row in rows if row.found and row not in worst], MOST_MEASURED - len(worst))
    shown = {row.file for row in [*worst, *_spread(others, MOST_PICTURES - len(pictures) - len(worst))]}
    residuals = []
    for row, image, found in _measured([*worst, *others], source, target, camera, camera_covariance):
        if row.file in shown:
            keep(row, overlay(image, found, target, camera, _width(image.shape)), image.shape)
        residuals.append(residuals_of(found, target, camera))
    return Sample(tuple(pictures), Residuals.joined(residuals), len(residuals))


def residuals_of(found: MeasuredImage, target: Target, camera: Camera) -> Residuals:
    """Of the dots that the pose rests on: in the image, and as places on the plate."""
    used = ~found.estimate.outliers
    pixels = found.estimate.residuals[used]
    mine = found.identification.found[used]
    points = target.points[found.numbers]
    there = camera.project(transformed(found.pose, points))
    steps = [camera.project(transformed(found.pose, points + _STEP * axis)) - there for axis in np.eye(3)[:2]]
    onto_plate = np.linalg.inv(np.stack(steps, axis=-1) / _STEP)
    spread = found.dots.covariance[mine]
    return Residuals(
        found.centers,
        pixels,
        np.diagonal(spread, axis1=1, axis2=2),
        found.numbers,
        (onto_plate @ pixels[..., None])[..., 0],
        np.diagonal(onto_plate @ spread @ onto_plate.transpose(0, 2, 1), axis1=1, axis2=2),
    )


def _refused(
    rows: Iterable[Detection], source: ImageSource, target: Target
) -> Iterator[tuple[Detection, bytes, tuple[int, ...]]]:
    for row in rows:
        try:
            image = source.read(row.file)
            yield row, refusal(image, row.reason, target.bright, _width(image.shape)), image.shape
        except Exception:  # what was refused may be no image at all: its reason is in the table
            continue


def _measured(
    rows: Iterable[Detection], source: ImageSource, target: Target, camera: Camera, covariance: Floats | None
) -> Iterator[tuple[Detection, np.ndarray, MeasuredImage]]:
    for row in rows:
        try:
            image = source.read(row.file)
            found = measure_pose(image, target, camera, covariance)
        except Exception:  # it was there before; a page without it is better than none
            continue
        yield row, image, found


def _spread(rows: Sequence[Detection], most: int) -> list[Detection]:
    """At most so many of them, evenly spread."""
    count = min(max(most, 0), len(rows))
    return [rows[k] for k in np.linspace(0, len(rows) - 1, count).astype(int)]


def _width(shape: tuple[int, ...]) -> int:
    return min(_WIDTH, shape[1])
