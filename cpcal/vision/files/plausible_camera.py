"""Numbers that are a camera's by their form but cannot be one's: a slip of a decimal, another unit, another model."""

from __future__ import annotations

import numpy as np

from cpcal.vision.camera import Camera

PIXELS_MAX = 1_000_000  # of an image's side
_FOCAL = (0.05, 1000.0)  # of the image's longer side: from a fisheye to a telescope
_ASPECT = 4.0  # of fx and fy
_CENTER = 10.0  # image sides away from the image, which may be a part of a larger one
_STRETCH = 4.0  # of a direction by the distortion, and its inverse
_SHARE = 0.5  # of the image that must show directions: lenses are calibrated where something was seen
_GRID = 9  # pixels looked at, each way


def implausible(camera: Camera) -> list[tuple[str, str, str]]:
    """What no camera has: the key, what is wrong with it, and the remedy."""
    side = max(camera.width, camera.height)
    low, high = (f * side for f in _FOCAL)
    fx, fy = camera.focal.tolist()
    out = []
    if not (low <= min(fx, fy) and max(fx, fy) <= high):
        what = f"focal {fx:g}, {fy:g} is not from {low:g} to {high:g} pixels"
        out.append(("focal", what, "give the focal length in pixels: that in mm over the size of a pixel in mm"))
    elif max(fx, fy) > _ASPECT * min(fx, fy):
        out.append(("focal", f"fx is {fx:g} and fy {fy:g}: no pixel is so long", "correct the slip"))
    away = np.abs(camera.center - 0.5 * np.array([camera.width, camera.height]))
    if (away > (_CENTER + 0.5) * side).any():
        what = "center {:g}, {:g} is far from the image".format(*camera.center)
        out.append(("center", what, "give cx and cy in pixels from the centre of the top-left pixel"))
    if not out and _seen(camera) < _SHARE:
        what = "distortion bends most of the image beyond measure"
        out.append(("distortion", what, "give k1, k2, p1, p2, k3 of OpenCV's model for directions x / z, y / z"))
    return out


def _seen(camera: Camera) -> float:
    """The share of the image's pixels that show a direction not far from where a camera without distortion sees it."""
    x, y = (np.linspace(0.0, side - 1.0, _GRID) for side in (camera.width, camera.height))
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    plain = np.linalg.norm((pixels - camera.center) / camera.focal, axis=1)
    seen = np.linalg.norm(camera.normalised(pixels), axis=1)
    with np.errstate(invalid="ignore"):
        return float(((seen <= _STRETCH * plain) & (plain <= _STRETCH * seen)).mean())
