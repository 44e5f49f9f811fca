"""An image with what was found in it, for people to look at."""

from __future__ import annotations

import textwrap

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.robot import transformed
from cpcal.vision.camera import Camera
from cpcal.vision.dots import observe_dots
from cpcal.vision.measure import MeasuredImage
from cpcal.vision.opencv import opencv
from cpcal.vision.render import contours
from cpcal.vision.target import Target

# blue, green, red
_USED, _ROW, _X_AXIS, _Y_AXIS = (200, 120, 40), (60, 180, 250), (60, 60, 230), (90, 190, 60)
_MISSING, _FALSE, _OUTLIER, _TEXT = (60, 60, 230), (0, 200, 230), (200, 60, 200), (255, 255, 255)
_AXIS = 0.3  # of the target's size
_QUALITY = 82
_CROSS = 6.0  # pixels of the picture, half of a cross
_LETTERS, _LINE = 0.45, 18  # size of a letter, OpenCV's unit; pixels of the picture a line


def overlay(image: npt.NDArray[np.integer], found: MeasuredImage, target: Target, camera: Camera, width: int) -> bytes:
    """JPEG of the image, `width` pixels wide: blue rings round the dots that were used, red ones where dots of the
    target are missing, violet ones where a dot was screened; yellow crosses on dots that are none of the target's; the
    target's rows and axes, and what makes the pose doubtful."""
    scale = width / image.shape[1]
    picture = _reduced(image, scale)
    pose = found.estimate.pose
    seen = camera.project(transformed(pose, target.points))
    for line in target.lines:
        _lines(picture, seen[list(line)], scale, _ROW)
    rings = contours(target, camera, pose)
    screened = found.identification.numbers[found.estimate.outliers]
    for numbers, colour in ((found.numbers, _USED), (found.identification.missing, _MISSING), (screened, _OUTLIER)):
        for ring in rings[numbers]:
            _lines(picture, np.concatenate([ring, ring[:1]]), scale, colour)
    _crosses(picture, found.dots.centers[found.identification.false], scale, _FALSE)
    size = _AXIS * np.ptp(target.dots, axis=0).max()
    for axis, colour in (((1.0, 0.0, 0.0), _X_AXIS), ((0.0, 1.0, 0.0), _Y_AXIS)):
        ends = np.array([np.zeros(3), size * np.array(axis)])
        _lines(picture, camera.project(transformed(pose, ends)), scale, colour, thick=2)
    _text(picture, found.doubt)
    return _jpeg(picture)


def refusal(image: npt.NDArray[np.integer], reason: str, bright: bool, width: int) -> bytes:
    """JPEG of an image without a pose: yellow crosses on the dots that were found in it, and the reason."""
    scale = width / image.shape[1]
    picture = _reduced(image, scale)
    _crosses(picture, observe_dots(image, bright=bright).centers, scale, _FALSE)
    _text(picture, reason)
    return _jpeg(picture)


def _reduced(image: npt.NDArray[np.integer], scale: float) -> npt.NDArray[np.uint8]:
    """In three colours of 8 bits."""
    cv2 = opencv()
    grey = image if image.ndim == 2 else image[..., 1]
    grey = (grey // (257 if grey.dtype == np.uint16 else 1)).astype(np.uint8)
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _jpeg(picture: npt.NDArray[np.uint8]) -> bytes:
    cv2 = opencv()
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes())


def _crosses(picture: npt.NDArray[np.uint8], centers: Floats, scale: float, colour: tuple[int, ...]) -> None:
    arm = _CROSS / scale
    for center in centers:
        for step in ((arm, arm), (arm, -arm)):
            _lines(picture, np.array([center - step, center + step]), scale, colour)


def _text(picture: npt.NDArray[np.uint8], text: str) -> None:
    """At the foot, on a dark ground; nothing where there is nothing to say."""
    if not text:
        return
    cv2 = opencv()
    lines = textwrap.wrap(text.encode("ascii", "replace").decode(), max(picture.shape[1] // 8, 20))
    top = picture.shape[0] - _LINE * len(lines) - 6
    picture[max(top, 0) :] //= 4
    for k, line in enumerate(lines):
        at = (8, top + _LINE * (k + 1) - 4)
        cv2.putText(picture, line, at, cv2.FONT_HERSHEY_SIMPLEX, _LETTERS, _TEXT, 1, cv2.LINE_AA)


def _lines(
    picture: npt.NDArray[np.uint8], points: Floats, scale: float, colour: tuple[int, ...], thick: int = 1
) -> None:
    """A polyline through pixels (n, 2) of the whole image; drawn to a sixteenth of a pixel."""
    cv2 = opencv()
    at = np.rint(16.0 * ((points + 0.5) * scale - 0.5)).astype(np.int32)
    cv2.polylines(picture, [at], False, colour, thick, cv2.LINE_AA, 4)
