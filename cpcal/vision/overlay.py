"""An image with what was found in it, for people to look at."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.robot import transformed
from cpcal.vision.camera import Camera
from cpcal.vision.measure import Measured
from cpcal.vision.opencv import opencv
from cpcal.vision.render import contours
from cpcal.vision.target import Target

_RING, _LINE, _X_AXIS, _Y_AXIS = (200, 120, 40), (60, 180, 250), (60, 60, 230), (90, 190, 60)  # blue, green, red
_AXIS = 0.3  # of the target's size
_QUALITY = 82


def overlay(image: npt.NDArray[np.integer], found: Measured, target: Target, camera: Camera, width: int) -> bytes:
    """JPEG of the image, `width` pixels wide: rings round the dots that were used, the target's rows and axes."""
    cv2 = opencv()
    scale = width / image.shape[1]
    small = cv2.resize(_grey8(image), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    picture = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
    pose = found.estimate.pose
    seen = camera.project(transformed(pose, target.points))
    for line in target.lines:
        _lines(picture, seen[list(line)], scale, _LINE)
    for ring in contours(target, camera, pose)[found.numbers]:
        _lines(picture, np.concatenate([ring, ring[:1]]), scale, _RING)
    size = _AXIS * np.ptp(target.dots, axis=0).max()
    for axis, colour in (((1.0, 0.0, 0.0), _X_AXIS), ((0.0, 1.0, 0.0), _Y_AXIS)):
        ends = np.array([np.zeros(3), size * np.array(axis)])
        _lines(picture, camera.project(transformed(pose, ends)), scale, colour, thick=2)
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes())


def _grey8(image: npt.NDArray[np.integer]) -> npt.NDArray[np.uint8]:
    grey = image if image.ndim == 2 else image[..., 1]
    return (grey // (257 if grey.dtype == np.uint16 else 1)).astype(np.uint8)


def _lines(
    picture: npt.NDArray[np.uint8],
    points: npt.NDArray[np.float64],
    scale: float,
    colour: tuple[int, ...],
    thick: int = 1,
) -> None:
    """A polyline through pixels (n, 2) of the whole image; drawn to a sixteenth of a pixel."""
    cv2 = opencv()
    at = np.rint(16.0 * ((points + 0.5) * scale - 0.5)).astype(np.int32)
    cv2.polylines(picture, [at], False, colour, thick, cv2.LINE_AA, 4)
