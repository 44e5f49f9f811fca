"""The images that a study's camera would have taken, and the way back: from detections to the study's tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from cpcal.common.errors import Problems, unusable
from cpcal.common.values import ArrayLike, Names
from cpcal.robot import Pose, PoseTable, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.batch.detect import (
    POSITION,
    QUATERNION,
    SCALE,
    SHARED,
    Detection,
    ImageFolder,
    by_reason,
    in_parallel,
    values_of,
)
from cpcal.vision.camera import Camera
from cpcal.vision.files.image_file import UnreadableImageError
from cpcal.vision.files.plate_and_camera import CameraRecord
from cpcal.vision.measure import measure_pose
from cpcal.vision.opencv import Grey, opencv
from cpcal.vision.render import Scene, overlay, refusal, render
from cpcal.vision.target import Target

MEAN = "mean"  # the name of an image that is the mean of a run's others
_AIM = (0.0, 0.0, 350.0)  # mm, base frame: where the DeltaLab platform is, in the middle of its strokes
_ABOVE = 780.0  # mm above there: from where a camera looks down


def camera_above(*, seed: int) -> Pose:
    """The base frame seen by a camera above the middle of the platform's workspace, aimed by eye.

    From there the target is 690 to 860 mm away, and wholly in sight but for a few dots at the farthest poses.
    """
    rng = np.random.default_rng(seed)
    turn = quaternion_from_rotation_vector([0.0, 0.0, rng.uniform(-0.2, 0.2)])
    tilt = quaternion_from_rotation_vector([*rng.normal(0.0, math.radians(1.5), 2), 0.0])
    quaternion = quaternion_product(tilt, quaternion_product(np.array([0.0, 1.0, 0.0, 0.0]), turn))
    aimed = Pose(np.array([*rng.normal(0.0, 5.0, 2), _ABOVE]), quaternion)
    return Pose(aimed.position - aimed.rotation @ np.array(_AIM), quaternion)


@dataclass(frozen=True)
class RenderedImages:
    """Images by name, rendered when they are read: the target at the poses (N) of the rows.

    names  (N) such as "e00/1/3.png": pose, run and image; an image "mean" has the noise of a mean of ten images
    """

    names: Names
    poses: Pose
    target: Target
    camera: Camera
    scene: Scene
    seed: int

    @classmethod
    def of(cls, table: PoseTable, target: Target, camera: Camera, scene: Scene, *, seed: int) -> RenderedImages:
        """Of a table with images whose poses are exact (`simulate_study(pose_noise=0, images=...)`); an eleventh image
        of a run is the mean of its ten, as in the paper (section 2.3.2)."""
        rows = zip(table.pose, table.run, table.image or (), strict=True)
        names = tuple(f"{pose}/{run}/{MEAN if image == '11' else image}.png" for pose, run, image in rows)
        return cls(names, table.poses, target, camera, scene, seed)

    def stamp(self, name: str) -> str:
        return f"{self.seed}-{self.scene}"

    def read(self, name: str) -> Grey:
        scene = self.scene
        if PurePosixPath(name).stem == MEAN:
            scene = replace(scene, noise=scene.noise / math.sqrt(10.0))
        # of one image: it does not depend on which others there are
        seed = int(np.random.SeedSequence([self.seed, *name.encode()]).generate_state(1, np.uint64)[0])
        pose = self.poses.rows(self.names.index(name))
        return render(self.target, self.camera, pose, scene, seed=seed)

    def write(
        self, folder: Path, *, workers: int | None = None, progress: Callable[[int, int], None] | None = None
    ) -> None:
        """All images as PNG files below `folder`; `progress` is called with how many are written, and of how many.
        Raises OSError."""
        done = 0
        for count in in_parallel(partial(_written, self, folder), self.names, workers):
            done += count
            if progress is not None:
                progress(done, len(self.names))


def _written(images: RenderedImages, folder: Path, names: Sequence[str]) -> int:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        done, content = opencv().imencode(".png", images.read(name))
        if not done:
            raise UnreadableImageError(f"{name} cannot be encoded")
        path.write_bytes(content.tobytes())
    return len(names)


def study_table(detections: Sequence[Detection], readings: Mapping[tuple[str, str], ArrayLike]) -> PoseTable:
    """Poses from images and leg readings (n,) mm by pose and run, joined: one row for each image with a pose, and the
    deviations of the errors that all of them share, where camera or target have a covariance.

    The last three parts of a file's name tell pose, run and image: "e00/1/3.png". Raises InputError that names every
    file without readings, and for names that tell nothing.
    """
    found = [d for d in detections if d.found]
    problems = Problems()
    ids = [("", "", *PurePosixPath(d.file).with_suffix("").parts)[-3:] for d in found]
    for d, (pose, run, _) in zip(found, ids, strict=True):
        if (pose, run) not in readings:
            what = f"no leg readings are given for pose {pose!r}, run {run!r}"
            problems.wrong(d.file, what, "name images POSE/RUN/IMAGE.png, as in the table of readings")
    problems.raise_any()
    if not found:
        raise unusable("images", "none shows the target", "see the reasons in the table of poses")
    values = values_of(found)
    length = np.array([readings[pose, run] for pose, run, _ in ids], np.float64)
    poses, runs, images = (tuple(part[k] for part in ids) for k in range(3))
    shared = values[:, SHARED]
    position, quaternion = values[:, POSITION], values[:, QUATERNION]
    return PoseTable(poses, runs, position, quaternion, length, images, shared if shared.any() else None)


# ------------------------------------------------------------------------------------------------------------------
# Some images of a batch, looked at once more: pictures of what was found.

MOST_PICTURES = 12
MOST_BYTES = 600_000  # of all pictures
_OF_A_KIND = 4  # refused images, and doubtful ones
_TRIED = 2  # images of each reason, where the first cannot be read
_WIDTH = 420  # pixels of a picture


class SeenImage(NamedTuple):
    """The row of an image, and a JPEG of `size` (width, height) of what was found in it."""

    row: Detection
    jpeg: bytes
    size: tuple[int, int]


def look_again(
    rows: Sequence[Detection],
    source: ImageFolder,
    target: Target,
    lens: CameraRecord,
    first_row: str | Pose,
) -> tuple[SeenImage, ...]:
    """A sample of what `detect` found with the same arguments: refused images first, one of each frequent reason, then
    the most doubtful poses, then others, evenly spread. An image that cannot be read any more is left out."""
    pictures: list[SeenImage] = []

    def drawn(row: Detection) -> bool:
        """Whether it was. The image was there before; a page without it is better than none."""
        try:
            image = source.read(row.file)
            given = image, target, lens.camera, lens.covariance
            found = measure_pose(*given, first_row=first_row) if row.found else None
        except Exception:  # what was refused may be no image at all: its reason is in the table
            return False
        height, width = image.shape[:2]
        size = min(_WIDTH, width), round(min(_WIDTH, width) * height / width)
        if found is None:
            jpeg = refusal(image, row.reason, target.bright, size[0])
        else:
            jpeg = overlay(image, found, target, lens.camera, size[0])
        if sum(len(seen.jpeg) for seen in pictures) + len(jpeg) > MOST_BYTES:
            return False
        pictures.append(SeenImage(row, jpeg, size))
        return True

    for files in list(by_reason(rows).values())[:_OF_A_KIND]:
        any(drawn(row) for row in rows if row.file in files[:_TRIED])
    worst = sorted((row for row in rows if row.doubt), key=lambda row: -row.values[SCALE])[:_OF_A_KIND]
    others = [row for row in rows if row.found and row not in worst]
    count = min(max(MOST_PICTURES - len(pictures) - len(worst), 0), len(others))
    for row in [*worst, *(others[k] for k in np.linspace(0, len(others) - 1, count).astype(int))]:
        drawn(row)
    return tuple(pictures)
