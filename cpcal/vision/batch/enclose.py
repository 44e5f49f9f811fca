"""Guaranteed pose sets of many images: measured dots, boxes about the centres of their images, certificates."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from cpcal.common.errors import InputError
from cpcal.vision.batch.detect import ImageSource
from cpcal.vision.files.image_file import UnreadableImageError
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.pose_sets import CameraSet, PixelBoxes, PoseSet, TargetSet, enclose_pose


@dataclass(frozen=True)
class Enclosed:
    """Of one image: its pose set, or the reason why there is none."""

    file: str
    found: PoseSet | None = None
    reason: str = ""


@dataclass(frozen=True)
class Enclosing:
    """What a worker does: pose sets of some images, with certificates in `folder`.

    half_width  pixels: the centre of each dot's image is stated to be so near to where it was found
    outliers    dots of an image that may be farther off, at most
    sources     the bytes of the files of camera and target, by name
    """

    source: ImageSource
    target: TargetSet
    camera: CameraSet
    half_width: float
    outliers: int
    folder: Path
    sources: Mapping[str, bytes]

    def __call__(self, names: Sequence[str]) -> list[Enclosed]:
        return [self.one(name) for name in names]

    def one(self, name: str) -> Enclosed:
        target, camera = self.target.target, self.camera.camera
        try:
            image = self.source.read(name)
            measured = measure_pose(image, target, camera)
        except (UnreadableImageError, NotMeasured) as reason:
            return Enclosed(name, reason=str(reason))
        except InputError as error:
            return Enclosed(name, reason="; ".join(problem.what for problem in error.problems))
        boxes = PixelBoxes.around(measured.numbers, measured.centers, self.half_width, of_images=True)
        sources, stem = {**self.sources, name: np.ascontiguousarray(image).tobytes()}, self.folder / stem_of(name)
        try:
            found = enclose_pose(
                boxes, self.target, self.camera, outliers=self.outliers, certificate=stem, sources=sources
            )
        except InputError as error:
            return Enclosed(name, reason="; ".join(problem.what for problem in error.problems))
        return Enclosed(name, found)


def stem_of(name: str) -> str:
    """What the files of an image are called: "e00/1/3.png" is e00-1-3; in letters, digits and "_.-"."""
    stem = re.sub(r"[^\w.-]", "_", PurePosixPath(name).with_suffix("").as_posix().replace("/", "-"))
    return f"_{stem}" if stem.startswith(".") else stem
