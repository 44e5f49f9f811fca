"""Images of a rig's cameras: a folder for each camera, and images of one moment under one name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cpcal.common.errors import InputError
from cpcal.vision.batch.parallel import in_parallel
from cpcal.vision.camera import Camera
from cpcal.vision.files.detection import Detection
from cpcal.vision.files.image_file import UnreadableImageError, image_files, read_image
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.pose import DOUBTFUL, PoseEstimate
from cpcal.vision.pose_fit import NoPose
from cpcal.vision.rig.joint_pose import joint_pose
from cpcal.vision.rig.rig import Rig, SeenPlate
from cpcal.vision.target import Target


@dataclass(frozen=True)
class RigImages:
    """The images below `folder`/NAME for each camera's name, by the name that they have there."""

    folder: Path
    cameras: Mapping[str, Camera]

    @property
    def names(self) -> Sequence[str]:
        """Of all moments that a camera has an image of."""
        every = {name for camera in self.cameras for name in image_files(self.folder / camera)}
        return sorted(every)


@dataclass(frozen=True)
class SeenMoment:
    """What the cameras see at one moment, and why others see nothing ("" for an image that is not there)."""

    name: str
    plates: tuple[SeenPlate, ...]
    reasons: dict[str, str]


def seen_moments(
    images: RigImages,
    target: Target,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[SeenMoment]:
    """All moments, in the order of their names. No image stops the others."""
    names = list(images.names)
    out: list[SeenMoment] = []
    for found in in_parallel(_Look(images, target), names, workers):
        out += found
        if progress is not None:
            progress(len(out), len(names))
    return sorted(out, key=lambda moment: moment.name)


@dataclass(frozen=True)
class _Look:
    images: RigImages
    target: Target

    def __call__(self, names: Sequence[str]) -> list[SeenMoment]:
        return [self._moment(name) for name in names]

    def _moment(self, name: str) -> SeenMoment:
        plates, reasons = [], {}
        for number, (camera_name, camera) in enumerate(self.images.cameras.items()):
            file = self.images.folder / camera_name / name
            if not file.exists():
                continue
            try:
                image = read_image(file, (camera.width, camera.height))
                found = measure_pose(image, self.target, camera)
            except (UnreadableImageError, NotMeasured) as reason:
                reasons[camera_name] = str(reason)
                continue
            mine = found.identification.found[~found.estimate.outliers]
            seen = found.centers, found.dots.covariance[mine], found.numbers, found.pose
            identified = found.identification
            told = len(identified.missing), len(identified.false), identified.margin
            plates.append(SeenPlate(number, *seen, *told))
        return SeenMoment(name, tuple(plates), reasons)


def rig_detections(moments: Sequence[SeenMoment], rig: Rig, target: Target) -> Iterator[Detection]:
    """A row of poses.csv for each moment: the plate in the first camera's frame, by all cameras that see it."""
    for moment in moments:
        try:
            found = joint_pose(moment.plates, rig, target)
        except (NoPose, InputError, np.linalg.LinAlgError) as reason:
            said = "; ".join(f"{camera}: {why}" for camera, why in moment.reasons.items())
            yield Detection(moment.name, said or str(reason))
            continue
        yield _row(moment, found)


def _row(moment: SeenMoment, found: PoseEstimate) -> Detection:
    sigma, shared = (np.sqrt(np.diagonal(matrix)) for matrix in (found.covariance, found.shared_part))
    missing, false = (sum(getattr(one, key) for one in moment.plates) for key in ("missing", "false"))
    margin = min(one.margin for one in moment.plates)
    numbers = [*found.pose.position, *found.pose.quaternion, *sigma, *shared, found.rms, found.scale]
    doubt = (
        ""
        if found.scale <= DOUBTFUL
        else (
            f"the residuals are {np.sqrt(found.scale):.1f} times as large as stated: "
            "check whether the cameras have moved, and were triggered together"
        )
    )
    count = sum(len(one.numbers) for one in moment.plates)
    return Detection(moment.name, "", count, tuple(float(v) for v in [*numbers, missing, false, margin]), doubt)
