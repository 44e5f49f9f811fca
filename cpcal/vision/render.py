"""Rendered images of a target, for tests and the demo: exact geometry, then blur, light and noise.

Each dot is drawn from the exact image of its circle (256 points through pose, perspective and distortion): along lines
through the fine pixels, finer than the image by `_FINE`, the share of each fine pixel between the two sides of the
contour is taken exactly; the lines lie at Gauss-Legendre nodes between the contour's top and bottom. Centres are right
to 2e-4 pixels. The optics' blur is a Gaussian on fine pixels; an image's pixel is the mean of its fine ones.
"""

import textwrap
from dataclasses import dataclass

import numpy as np

from cpcal.common.values import ArrayPair, Floats, Pair, Places
from cpcal.robot import Pose, transformed
from cpcal.vision.camera import Camera
from cpcal.vision.dots import observe_dots
from cpcal.vision.dots.edge import Single
from cpcal.vision.measure import MeasuredImage
from cpcal.vision.opencv import Grey, Grey8, opencv
from cpcal.vision.projection import predicted_centers
from cpcal.vision.target import Target

_FINE = 4  # fine pixels in a pixel, each way
_LINES = 3  # through a fine pixel
_CONTOUR = 256  # points
_REACH = 5.0  # of the blur, in its standard deviations
BRIGHT, DARK = 200.0, 30.0  # grey levels of the surfaces, of 256, in the middle of the image


@dataclass(frozen=True)
class Scene:
    """What the image looks like beside its geometry.

    blur      standard deviation of the optics' blur, pixels
    noise     standard deviation of each pixel's noise, grey levels of 256
    gradient  (2,) by which share the light grows from the left border to the right one, and from top to bottom
    bits      8 or 16
    """

    blur: float = 0.8
    noise: float = 2.0
    gradient: Pair = (0.0, 0.0)
    bits: int = 8


def render(
    target: Target,
    camera: Camera,
    pose: Pose,
    scene: Scene | None = None,
    *,
    seed: int = 0,
    hidden: Places = (),
) -> Grey:
    """The image (height, width) of the target at `pose` (target in camera frame, mm), but for its `hidden` dots.

    Dots behind the camera or out of sight are left out; those on the border are cut.
    """
    scene = scene or Scene()
    return exposed(_covered(target, camera, pose, scene.blur, hidden), scene, bright=bool(target.bright), seed=seed)


def exposed(share: Single, scene: Scene, *, bright: bool = True, seed: int) -> Grey:
    """The image of a surface, (height, width): light, noise and quantisation. Light falls on the surface before the
    optics blur it: where it grows, an edge seems to move (exactly so for light that grows linearly).

    `share`, (height, width), is how much of each pixel's light comes from the drawing, which is brighter than its
    ground when `bright`. The optics' blur is already in it.
    """
    inside, outside = (BRIGHT, DARK) if bright else (DARK, BRIGHT)
    grey = outside + (inside - outside) * share
    if any(scene.gradient):
        height, width = grey.shape
        x = np.linspace(-0.5, 0.5, width, dtype=np.float32)
        y = np.linspace(-0.5, 0.5, height, dtype=np.float32)
        light = 1.0 + np.float32(scene.gradient[0]) * x + np.float32(scene.gradient[1]) * y[:, None]
        growth = (scene.blur**2 + 1.0 / 12.0) * np.array(scene.gradient, np.float32) / (width, height)
        down, right = np.gradient(grey)
        grey = (light * grey + growth[0] * right + growth[1] * down).astype(np.float32)
    if scene.noise > 0.0:
        rng = np.random.default_rng(seed)
        grey += np.float32(scene.noise) * rng.standard_normal(grey.shape, dtype=np.float32)
    kind, scale = (np.uint8, 1.0) if scene.bits == 8 else (np.uint16, 257.0)
    image: Grey = np.clip(np.rint(grey * np.float32(scale)), 0.0, 255.0 * scale).astype(kind)
    return image


def contours(target: Target, camera: Camera, pose: Pose) -> Floats:
    """The images (n, 256, 2) of the dots' circles, pixels, counted along the circle; nan behind the camera."""
    angle = np.linspace(0.0, 2.0 * np.pi, _CONTOUR, endpoint=False)
    circle = target.radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    points = transformed(pose, (target.points[:, None, :] + circle).reshape(-1, 3)).reshape(-1, _CONTOUR, 3)
    points[(points[..., 2] <= 0.0).any(axis=1)] = np.nan
    return camera.project(points)


def _covered(target: Target, camera: Camera, pose: Pose, blur: float, hidden: Places) -> Single:
    """Which share of each pixel's light comes from dots, blurred: (height, width)."""
    cv2 = opencv()
    edge = contours(target, camera, pose)[np.setdiff1d(np.arange(len(target.dots)), hidden)]
    margin = int(np.ceil(_REACH * blur)) + 1
    low, high = edge.min(axis=1), edge.max(axis=1)
    seen = ((high > -margin) & (low < [camera.width + margin, camera.height + margin])).all(axis=1)
    image = np.zeros((camera.height, camera.width), np.float32)
    if not seen.any():
        return image
    edge, low, high = edge[seen], low[seen], high[seen]
    corner = np.floor(low).astype(np.int64) - margin
    size = int(np.ceil((high - low).max())) + 2 * margin + 2
    fine = _fine_share(edge - corner[:, None, :], size).reshape(-1, size * _FINE)
    if blur > 0.0:
        width = 2 * int(np.ceil(_REACH * blur * _FINE)) + 1
        fine = cv2.GaussianBlur(fine, (width, width), blur * _FINE, borderType=cv2.BORDER_CONSTANT)
    patches = fine.reshape(len(edge), size, _FINE, size, _FINE).mean(axis=(2, 4))
    for (left, top), patch in zip(corner, patches, strict=True):
        y0, y1, x0, x1 = max(top, 0), min(top + size, camera.height), max(left, 0), min(left + size, camera.width)
        if y0 < y1 and x0 < x1:
            image[y0:y1, x0:x1] += patch[y0 - top : y1 - top, x0 - left : x1 - left]
    return image


def _fine_share(edge: Floats, size: int) -> Single:
    """The share of each fine pixel inside convex contours (m, points, 2), in pixels of patches: (m, fine, fine)."""
    out = np.empty((len(edge), size * _FINE, size * _FINE), np.float32)
    sides = np.arange(size * _FINE + 1) / _FINE - 0.5  # a patch's first pixel reaches from -0.5 to 0.5
    nodes, weights = np.polynomial.legendre.leggauss(_LINES)
    for share, points in zip(out, edge, strict=True):
        # lines between the contour's top and bottom only, or the caps' square roots would spoil the quadrature
        clipped = np.clip(sides, points[:, 1].min(), points[:, 1].max())
        part = 0.5 * np.diff(clipped)[:, None]
        begin, end = _sides(points, (clipped[:-1, None] + part * (1.0 + nodes)).ravel())
        run = np.minimum(end[:, None], sides[1:]) - np.maximum(begin[:, None], sides[:-1])
        runs = np.clip(run, 0.0, None).reshape(-1, _LINES, size * _FINE)
        share[...] = _FINE**2 * np.einsum("rl,rlc->rc", part * weights, runs)
    return out


def _sides(points: Floats, at: Floats) -> ArrayPair:
    """Where a convex contour begins and ends on the lines y = at; an empty run where they miss it."""
    points = np.roll(points, -int(points[:, 1].argmin()), axis=0)
    closed = np.concatenate([points, points[:1]])
    bottom = int(closed[:, 1].argmax())
    one = np.interp(at, closed[: bottom + 1, 1], closed[: bottom + 1, 0])
    other = np.interp(at, closed[: bottom - 1 : -1, 1], closed[: bottom - 1 : -1, 0])
    hit = (at > closed[0, 1]) & (at < closed[bottom, 1])
    return np.where(hit, np.minimum(one, other), 0.0), np.where(hit, np.maximum(one, other), 0.0)


# ------------------------------------------------------------------------------------------------------------------
# An image with what was found in it, for people to look at.

# blue, green, red
_USED, _X_AXIS, _Y_AXIS = (200, 120, 40), (60, 60, 230), (90, 190, 60)
_MISSING, _FALSE, _OUTLIER, _TEXT = (60, 60, 230), (0, 200, 230), (200, 60, 200), (255, 255, 255)
_AXIS = 0.3  # of the target's size
_QUALITY = 82
_SIZE = 6.0  # pixels of the picture: radius of a ring, half of a cross
_LETTERS, _LINE = 0.45, 18  # size of a letter, OpenCV's unit; pixels of the picture a line


def overlay(image: Grey, found: MeasuredImage, target: Target, camera: Camera, width: int) -> bytes:
    """JPEG of the image, `width` pixels wide: blue rings round the dots that were used, red ones where dots of the
    target are missing, violet ones where a dot was screened; yellow crosses on dots that are none of the target's; the
    target's axes, and what makes the pose doubtful."""
    cv2, scale = opencv(), width / image.shape[1]
    picture = _reduced(image, scale)
    places = predicted_centers(target, camera, found.pose)
    screened = found.identification.numbers[found.estimate.outliers]
    for numbers, colour in ((found.numbers, _USED), (found.identification.missing, _MISSING), (screened, _OUTLIER)):
        for place in _fine(places[numbers], scale):
            cv2.circle(picture, place, int(16 * _SIZE), colour, 1, cv2.LINE_AA, 4)
    _crosses(picture, found.dots.centers[found.identification.false], scale)
    ends = _AXIS * np.ptp(target.dots, axis=0).max() * np.eye(3)[[2, 0, 1]] * [1.0, 1.0, 0.0]
    origin, *tips = _fine(camera.project(transformed(found.pose, ends)), scale)
    for tip, colour in zip(tips, (_X_AXIS, _Y_AXIS), strict=True):
        cv2.line(picture, origin, tip, colour, 2, cv2.LINE_AA, 4)
    return _jpeg(picture, found.doubt)


def refusal(image: Grey, reason: str, bright: bool | None, width: int) -> bytes:
    """JPEG of an image without a pose: yellow crosses on the dots that were found in it, and the reason."""
    scale = width / image.shape[1]
    picture = _reduced(image, scale)
    _crosses(picture, observe_dots(image, bright=bright).centers, scale)
    return _jpeg(picture, reason)


def _reduced(image: Grey, scale: float) -> Grey8:
    """In three colours of 8 bits."""
    cv2 = opencv()
    grey = image if image.ndim == 2 else image[..., 1]
    grey = (grey // (257 if grey.dtype == np.uint16 else 1)).astype(np.uint8)
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), np.uint8)


def _jpeg(picture: Grey8, text: str) -> bytes:
    """With the text at its foot, on a dark ground."""
    cv2 = opencv()
    lines = textwrap.wrap(text.encode("ascii", "replace").decode(), max(picture.shape[1] // 8, 20))
    if lines:
        top = picture.shape[0] - _LINE * len(lines) - 6
        picture[max(top, 0) :] //= 4
        for k, line in enumerate(lines, start=1):
            at = (8, top + _LINE * k - 4)
            cv2.putText(picture, line, at, cv2.FONT_HERSHEY_SIMPLEX, _LETTERS, _TEXT, 1, cv2.LINE_AA)
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes())


def _crosses(picture: Grey8, centers: Floats, scale: float) -> None:
    for x, y in _fine(centers, scale):
        for way in (int(16 * _SIZE), -int(16 * _SIZE)):
            ends = (x - way, y - abs(way)), (x + way, y + abs(way))
            opencv().line(picture, *ends, _FALSE, 1, opencv().LINE_AA, 4)


def _fine(pixels: Floats, scale: float) -> list[list[int]]:
    """Pixels (n, 2) of the whole image in sixteenths of the picture's."""
    fine: list[list[int]] = np.rint(16.0 * ((pixels + 0.5) * scale - 0.5)).astype(np.int64).tolist()
    return fine
