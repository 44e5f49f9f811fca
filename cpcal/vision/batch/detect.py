"""Poses for thousands of images without a human: in parallel, resumable, the same table whatever the workers.

Nothing depends on the order: the pose of the image before is a guess that saves time and changes no answer. What is
done is kept in a journal as it comes; who writes a table sorts it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError
from cpcal.execution.stopping import heard
from cpcal.robot import Pose
from cpcal.vision.batch.journal import Journal
from cpcal.vision.batch.parallel import in_parallel
from cpcal.vision.camera import Camera
from cpcal.vision.files.detection import Detection
from cpcal.vision.files.image_file import UnreadableImageError, image_files, image_path, read_image
from cpcal.vision.measure import MeasuredImage, NotMeasured, measure_pose
from cpcal.vision.opencv import MissingExtraError, opencv
from cpcal.vision.overlay import overlay, refusal
from cpcal.vision.target import Target

Progress = Callable[[int, int], None]
_UNEXPECTED = "failed unexpectedly"
_WIDEST = 1024  # pixels of a picture


class ImageSource(Protocol):
    """Images by name. A value that pickles, since workers read their images themselves."""

    @property
    def names(self) -> Sequence[str]: ...

    @property
    def stage(self) -> str:
        """What it takes to have an image: "reading", "rendering"."""
        ...

    def stamp(self, name: str) -> str:
        """Another text when the image is another one."""
        ...

    def read(self, name: str) -> np.ndarray[Any, np.dtype[Any]]:
        """Raises UnreadableImageError."""
        ...


@dataclass(frozen=True)
class ImageFolder:
    """The image files in a folder and below; of one size (width, height) only, where that is given."""

    folder: Path
    size: tuple[int, int] | None = None
    stage = "reading"

    @property
    def names(self) -> Sequence[str]:
        return image_files(self.folder)

    def stamp(self, name: str) -> str:
        try:
            stat = image_path(self.folder, name).stat()
        except OSError:  # a broken link, or a file that went: reading it gives the reason
            return "absent"
        return f"{stat.st_size}-{stat.st_mtime_ns}"

    def read(self, name: str) -> np.ndarray[Any, np.dtype[Any]]:
        return read_image(image_path(self.folder, name), self.size)


@dataclass(frozen=True)
class Detections:
    """What `detect` found: rows in the order of the names, how many were measured now, and seconds of work by stage
    (all workers together): processor time, divided among the stages as time was waited for them."""

    rows: tuple[Detection, ...]
    measured: int
    seconds: dict[str, float]


def detect(
    source: ImageSource,
    target: Target,
    camera: Camera,
    camera_covariance: Floats | None = None,
    *,
    journal: Path | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    overlays: Path | None = None,
) -> Detections:
    """The pose of the target in each image, or the reason why there is none: no image stops the others.

    camera_covariance  (9, 9) as a calibration states it; left out: the camera is exact
    journal   file that keeps what is done: the next call with the same target and camera does none of it again
    workers   processes; left out: one a core. 1: none, the work is done here
    executor  any `concurrent.futures.Executor` to use instead; it is not shut down
    scheduler address of a Dask scheduler to use instead, whose workers can read the images
    progress  called with the numbers of images done and of all
    overlays  folder for a picture NAME.jpg of each image, with what was found in it and what was not; an image without
              its picture is measured again

    Ctrl-C leaves by a KeyboardInterrupt, with what is done in the journal. Raises MissingExtraError, LostWorkerError,
    InputError (the journal is no journal).
    """
    opencv()
    names = list(source.names)
    with heard(), Journal.opened(journal, target, camera, camera_covariance) as kept:
        work = _Work(source, target, camera, camera_covariance, overlays)
        known = {name: row for name in names if (row := kept.get(name, source.stamp(name))) is not None}
        done = {name: row for name, row in known.items() if work.pictured(name)}
        todo = [name for name in names if name not in done]
        seconds: dict[str, float] = {}
        if progress is not None:
            progress(len(done), len(names))
        for rows, spent in in_parallel(work, todo, workers, executor, scheduler):
            for row in rows:
                if not row.reason.startswith(_UNEXPECTED):  # that is tried again
                    kept.add(row, source.stamp(row.file))
                done[row.file] = row
            _add(seconds, spent)
            if progress is not None:
                progress(len(done), len(names))
    return Detections(tuple(done[name] for name in sorted(done)), len(todo), seconds)


@dataclass(frozen=True)
class _Work:
    """What a worker does: measures some images."""

    source: ImageSource
    target: Target
    camera: Camera
    camera_covariance: Floats | None
    overlays: Path | None

    def pictured(self, name: str) -> bool:
        """Whether there is nothing left to draw."""
        return self.overlays is None or self._picture(self.overlays, name).exists()

    def __call__(self, names: Sequence[str]) -> tuple[list[Detection], dict[str, float]]:
        waited: dict[str, float] = {}
        start = time.process_time()
        rows, near = [], None
        for name in names:
            row, near = self._one(name, waited, near)
            rows.append(row)
        share = (time.process_time() - start) / max(sum(waited.values()), 1e-9)
        return rows, {stage: share * seconds for stage, seconds in waited.items()}

    def _one(self, name: str, waited: dict[str, float], near: Pose | None) -> tuple[Detection, Pose | None]:
        """The row of an image, and the pose to look for first in the next."""
        start = time.perf_counter()
        try:
            image = self.source.read(name)
            _add(waited, {self.source.stage: time.perf_counter() - start})
            return self._measured(name, image, waited, near)
        except UnreadableImageError as error:
            return Detection(name, str(error)), near
        except InputError as error:
            return Detection(name, "; ".join(problem.what for problem in error.problems)), near
        except MissingExtraError:
            raise
        except Exception as error:  # one image must never stop thousands
            return Detection(name, f"{_UNEXPECTED}: {type(error).__name__}: {error}"[:200]), near

    def _measured(
        self, name: str, image: np.ndarray[Any, np.dtype[Any]], waited: dict[str, float], near: Pose | None
    ) -> tuple[Detection, Pose | None]:
        width = min(image.shape[1], _WIDEST)
        try:
            found = measure_pose(image, self.target, self.camera, self.camera_covariance, near=near)
        except NotMeasured as reason:
            if self.overlays is not None:
                write_file(self._picture(self.overlays, name), refusal(image, str(reason), self.target.bright, width))
            return Detection(name, str(reason)), near
        _add(waited, found.seconds)
        if self.overlays is not None:
            write_file(self._picture(self.overlays, name), overlay(image, found, self.target, self.camera, width))
        return detection(name, found), found.pose

    @staticmethod
    def _picture(folder: Path, name: str) -> Path:
        file = folder / f"{name}.jpg"
        file.parent.mkdir(parents=True, exist_ok=True)
        return file


def _add(total: dict[str, float], more: dict[str, float]) -> None:
    for stage, value in more.items():
        total[stage] = total.get(stage, 0.0) + value


def detection(name: str, found: MeasuredImage) -> Detection:
    """The row of a pose that was measured."""
    pose = found.estimate.pose
    sigma = np.sqrt(np.diagonal(found.estimate.covariance))
    shared = np.sqrt(np.diagonal(found.estimate.shared_part))
    identified = found.identification
    fit = found.estimate.rms, found.estimate.scale
    dots = len(identified.missing), len(identified.false), identified.margin
    numbers = [*pose.position, *pose.quaternion, *sigma, *shared, *fit, *dots]
    return Detection(name, "", len(found.numbers), tuple(float(v) for v in numbers), found.doubt)
