"""The camera from images of a target: dots, identification without a camera, calibration."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, printable
from cpcal.vision.calibration.calibrate_camera import (
    CalibratedView,
    Calibration,
    NotCalibratedError,
    TargetView,
    calibrate_camera,
)
from cpcal.vision.camera import Camera
from cpcal.vision.dots import Dots, observe_dots, refitted
from cpcal.vision.files.image_file import UnreadableImageError, read_image
from cpcal.vision.identify import Unidentified, identify
from cpcal.vision.target import Target

Size = tuple[int, int]

_FIRST = 4  # images that a rough camera is calibrated from


@dataclass(frozen=True)
class _Seen:
    """An image's dots, or the reason why there are none."""

    name: str
    reason: str = ""
    size: Size | None = None
    dots: Dots | None = None


def calibrate_from_images(
    images: Sequence[str | os.PathLike[str] | npt.NDArray[Any]],
    target: Target,
    *,
    refine_dots: bool = False,
    fixed: Sequence[str] = (),
) -> Calibration:
    """The camera that took `images` of the target: files (PNG, JPEG, TIFF), or arrays as `observe_dots` takes them.

    See `calibrate_camera`. A few images are identified without a camera, all of them with the rough one that they give,
    and once more with the one that all give. The result has a view for each image; one that cannot be used is left out,
    and its view says why.

    Raises InputError for a `fixed` that cannot be, NotCalibratedError where the usable images do not determine the
    camera.
    """
    seen = _of_one_size([_seen(image, target, f"image {i}") for i, image in enumerate(images, start=1)])
    rough = _Job(seen, target, fixed).rough()
    seen = [_refitted(image, one, target, rough.camera) for image, one in zip(images, seen, strict=True)]
    job = _Job(seen, target, fixed)
    first = job.calibrated(job.identified(range(len(seen)), rough.camera), refine_dots)
    return job.calibrated(job.identified(range(len(seen)), first.camera), refine_dots)


def _seen(image: str | os.PathLike[str] | npt.NDArray[Any], target: Target, name: str) -> _Seen:
    try:
        if isinstance(image, (str, os.PathLike)):
            name = printable(image)
        pixels = _pixels(image)
        dots = observe_dots(pixels, bright=target.bright)
    except UnreadableImageError as error:
        return _Seen(name, str(error))
    except InputError as error:
        return _Seen(name, "; ".join(problem.what for problem in error.problems))
    return _Seen(name, size=(pixels.shape[1], pixels.shape[0]), dots=dots)


def _pixels(image: str | os.PathLike[str] | npt.NDArray[Any]) -> npt.NDArray[Any]:
    return read_image(Path(image)) if isinstance(image, (str, os.PathLike)) else image


def _refitted(image: str | os.PathLike[str] | npt.NDArray[Any], seen: _Seen, target: Target, camera: Camera) -> _Seen:
    """With the target's dots under their own light (see `refitted`), where they are identified."""
    if seen.reason or seen.dots is None:
        return seen
    try:
        pairs = identify(seen.dots.centers, target, camera)
        return replace(seen, dots=refitted(_pixels(image), seen.dots, pairs.found))
    except (Unidentified, UnreadableImageError):
        return seen


def _of_one_size(seen: list[_Seen]) -> list[_Seen]:
    """Those of another size than most are left out: a camera's numbers belong to a size."""
    sizes = Counter(image.size for image in seen if image.size is not None)
    if not sizes:
        said = "".join(f"\n  {image.name}: {image.reason}" for image in seen)
        raise NotCalibratedError(f"there is no image that can be used{said}")
    (usual, _), *_ = sizes.most_common(1)
    return [
        replace(image, reason="has {} x {} pixels, most have {} x {}".format(*image.size, *usual), size=usual)
        if image.size is not None and image.size != usual
        else image
        for image in seen
    ]


@dataclass(frozen=True)
class _Identified:
    """Views by the rows of their images, and why other images have none."""

    views: dict[int, TargetView]
    reasons: dict[int, str]


class _Job:
    """Identification and calibration of images of one size."""

    def __init__(self, seen: list[_Seen], target: Target, fixed: Sequence[str]) -> None:
        self.seen, self.target, self.fixed = seen, target, fixed
        self.size: Size = next(image.size for image in seen if image.size is not None)

    def rough(self) -> Calibration:
        """From the first images that give one: without a camera identification takes its time."""
        got = _Identified({}, {})
        enough = _FIRST
        for row in range(len(self.seen)):
            more = self.identified([row], None)
            got.views.update(more.views)
            got.reasons.update(more.reasons)
            if more.views and len(got.views) == enough and row + 1 < len(self.seen):
                try:
                    return self.calibrated(got, False)
                except NotCalibratedError:
                    enough *= 2
        return self.calibrated(got, False)

    def identified(self, rows: Iterable[int], camera: Camera | None) -> _Identified:
        got = _Identified({}, {})
        for row in rows:
            image = self.seen[row]
            if image.reason or image.dots is None:
                got.reasons[row] = image.reason
                continue
            try:
                pairs = identify(image.dots.centers, self.target, camera, size=self.size)
            except Unidentified as error:
                got.reasons[row] = str(error)
                continue
            of_dot = image.dots.centers[pairs.found], image.dots.covariance[pairs.found]
            got.views[row] = TargetView(*of_dot, pairs.numbers.astype(np.intp), image.name)
        return got

    def calibrated(self, got: _Identified, refine_dots: bool) -> Calibration:
        views = list(got.views.values())
        try:
            result = calibrate_camera(views, self.target, self.size, refine_dots=refine_dots, fixed=self.fixed)
        except NotCalibratedError as error:
            said = "".join(f"\n  {self.seen[row].name}: {reason}" for row, reason in sorted(got.reasons.items()))
            raise NotCalibratedError(f"{error}{said}") from None
        used = dict(zip(got.views, result.views, strict=True))
        nothing = np.zeros((0, 2))
        every = (
            used[row] if row in used else CalibratedView(image.name, got.reasons.get(row, ""), None, nothing)
            for row, image in enumerate(self.seen)
        )
        return replace(result, views=tuple(every))
