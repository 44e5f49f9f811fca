"""Poses for thousands of images without a human: in parallel, resumable, the same table whatever the workers.

Nothing depends on the order: the pose of the image before is a guess that saves time and changes no answer. What is
done is kept in a journal as it comes; who writes a table sorts it.
"""

from __future__ import annotations

import csv
import hashlib
import json
import math
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from cpcal.common.codec import decoded, encoded
from cpcal.common.documents import csv_table
from cpcal.common.errors import unusable
from cpcal.common.files import small_file, write_file
from cpcal.common.values import Floats, Numbers, floats
from cpcal.common.version import __version__
from cpcal.robot import Pose
from cpcal.robot.units import AXES, POSE, SHARED_COLUMNS
from cpcal.solver.execution.executors import Processes, executor_for, linear_algebra_on_one_thread, outcomes, while_used
from cpcal.solver.execution.stopping import Reason, Stopped, asked, heard
from cpcal.vision.camera import Camera
from cpcal.vision.files.image_file import image_files, image_path, read_image
from cpcal.vision.files.plate_and_camera import CameraRecord, camera_bytes, target_bytes
from cpcal.vision.identify import SIDES
from cpcal.vision.measure import REFUSED, MeasuredImage, measure_pose, reason_of
from cpcal.vision.opencv import Grey, MissingExtraError, opencv
from cpcal.vision.target import Target

# ------------------------------------------------------------------------------------------------------------------
# OpenCV and the libraries of linear algebra on one thread: their own would change the last bits of sums.
#
# Their limits are the process's, not a thread's. So they are set when the first user of the process comes and restored
# when the last one leaves: a worker that ends must not set them free while others compute.


def _limited(undone: ExitStack) -> None:
    cv2 = opencv()
    undone.callback(cv2.setNumThreads, cv2.getNumThreads())
    cv2.setNumThreads(1)
    undone.enter_context(linear_algebra_on_one_thread())


one_thread = while_used(_limited)
"""One thread for each call of these libraries in this process, until the last of all users leaves.

Raises MissingExtraError.
"""


# ------------------------------------------------------------------------------------------------------------------
# The same work on many images, in as many processes as there are cores, or in any executor.

T = TypeVar("T")

_LOADS = ("cpcal.vision.batch.detect", "cpcal.solver.numba_begun")
_CHUNK = 8  # images that a worker is given at a time


def in_parallel(work: Callable[[Sequence[str]], T], names: Sequence[str], workers: int | None = None) -> Iterator[T]:
    """`work` on all names, a few at a time, each on one thread, in the order in which it is done; here, too, until the
    first of the processes has begun. `workers`: processes; left out: one a core. 1: none, the work is done here.

    Raises what the work raises, LostWorkerError, and Stopped after the last answer when the process is asked to stop.
    """
    workers = 1 if len(names) <= _CHUNK else workers or multiprocessing.cpu_count()
    done, alone = 0, partial(_on_one_thread, work)
    with one_thread(), executor_for(workers, loads=_LOADS) as (place, most):
        while done < len(names) and not asked() and isinstance(place, Processes) and not place.ready:
            yield alone(names[done : done + 1])  # while the first worker begins
            done += 1
        chunks = [names[k : k + _CHUNK] for k in range(done, len(names), _CHUNK)]
        for chunk, future in outcomes(place, most, alone, chunks):
            done += len(chunk)
            yield future.result()
    if done < len(names):
        raise Stopped(asked() or Reason.INTERRUPTED)


def _on_one_thread(work: Callable[[Sequence[str]], T], names: Sequence[str]) -> T:
    """Work without threads of its own, in whatever process or thread it runs."""
    with one_thread():
        return work(names)


# ------------------------------------------------------------------------------------------------------------------
# What `detect` has done so far, kept line by line: a restart redoes nothing.

FORMAT = "cpcal-detect-journal/4"
SIZE_MAX = 2**30  # bytes; a line of a million images each takes some 400


Rows = dict[str, tuple[str, "Detection"]]  # by the file's name, each with the stamp of the file that it is of


@contextmanager
def journal_of(
    path: Path | None, target: Target, camera: CameraRecord, first_row: str | Pose
) -> Iterator[tuple[Rows, Callable[[str, Detection], object]]]:
    """The rows in a journal, and what adds one. It is begun anew unless it is of this target, camera and version; a
    line that is none, as a crash leaves it, is dropped. Nothing is kept without a `path`. Raises InputError."""
    rows: Rows = {}
    if path is None:
        yield rows, lambda stamp, row: None
        return
    of = hashlib.sha256(target_bytes(target) + camera_bytes(camera) + repr(first_row).encode()).hexdigest()
    head = json.dumps({"format": FORMAT, "version": __version__, "of": of})
    content = small_file(path, "choose another file", most=SIZE_MAX) if os.path.exists(path) else b""
    first, *rest = content.decode(errors="surrogateescape").splitlines() or [""]
    if first and not first.startswith(head[: head.index("/")]):
        raise unusable(path, "is not a journal of `cpcal image detect`", "choose another file")
    for line in rest if first == head else ():
        try:
            data = json.loads(line)
            stamp, row = decoded(str, data.pop("stamp")), decoded(Detection, data)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            continue
        rows[row.file] = stamp, row
    write_file(path, f"{head}\n")
    with path.open("a", encoding="utf-8", errors="surrogateescape", buffering=1) as file:  # line by line

        def add(stamp: str, row: Detection) -> None:
            file.write(json.dumps({"stamp": stamp, **encoded(row)}) + "\n")

        for stamp, row in rows.values():
            add(stamp, row)
        yield rows, add


Progress = Callable[[int, int], None]
_UNEXPECTED = "failed unexpectedly"


@dataclass(frozen=True)
class ImageFolder:
    """Images by name: the files in a folder and below; of one size (width, height) only, where that is given. A value
    that pickles, since workers read their images themselves."""

    folder: Path
    size: tuple[int, int] | None = None

    @property
    def names(self) -> Sequence[str]:
        return image_files(self.folder)

    def stamp(self, name: str) -> str:
        """Another text when the image is another one."""
        try:
            stat = image_path(self.folder, name).stat()
        except OSError:  # a broken link, or a file that went: reading it gives the reason
            return "absent"
        return f"{stat.st_size}-{stat.st_mtime_ns}"

    def read(self, name: str) -> Grey:
        """Raises UnreadableImageError."""
        return read_image(image_path(self.folder, name), self.size)


class Detections(NamedTuple):
    """What `detect` found: rows in the order of the names, how many were measured now, and seconds of processor time
    that took, all workers together."""

    rows: tuple[Detection, ...]
    measured: int
    seconds: float


def detect(
    source: ImageFolder,
    target: Target,
    camera: Camera,
    camera_covariance: Floats | None = None,
    *,
    journal: Path | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    first_row: str | Pose = "",
) -> Detections:
    """The pose of the target in each image, or the reason why there is none: no image stops the others.

    camera_covariance  (9, 9) as a calibration states it; left out: the camera is exact
    journal   file that keeps what is done: the next call with the same target and camera does none of it again
    workers   processes; left out: one a core. 1: none, the work is done here
    progress  called with the numbers of images done and of all
    first_row how a target is turned that looks the same when it is (`measure_pose`)

    Ctrl-C leaves by a KeyboardInterrupt, with what is done in the journal. Raises MissingExtraError, LostWorkerError,
    InputError (the journal is no journal).
    """
    opencv()
    names = list(source.names)
    record = CameraRecord(camera, camera_covariance)
    with heard(), journal_of(journal, target, record, first_row) as (kept, keep):
        work = partial(_measured, source, target, camera, camera_covariance, first_row)
        stamps = {name: source.stamp(name) for name in names}
        done = {name: row for name, (of, row) in kept.items() if stamps.get(name) == of}  # still the same image
        todo = [name for name in names if name not in done]
        seconds = 0.0
        if progress is not None:
            progress(len(done), len(names))
        for rows, spent in in_parallel(work, todo, workers):
            for row in rows:
                if not row.reason.startswith(_UNEXPECTED):  # that is tried again
                    keep(stamps[row.file], row)
                done[row.file] = row
            seconds += spent
            if progress is not None:
                progress(len(done), len(names))
    return Detections(tuple(done[name] for name in sorted(done)), len(todo), seconds)


def _measured(
    source: ImageFolder,
    target: Target,
    camera: Camera,
    camera_covariance: Floats | None,
    first_row: str | Pose,
    names: Sequence[str],
) -> tuple[list[Detection], float]:
    """What a worker does: the rows of some images, and the seconds of processor time that they took."""
    start, near, rows = time.process_time(), None, []
    for name in names:
        try:
            given = source.read(name), target, camera, camera_covariance
            found = measure_pose(*given, near=near, first_row=first_row)
            row, near = detection(name, found), found.pose
        except REFUSED as error:
            row = Detection(name, reason_of(error))
        except MissingExtraError:
            raise
        except Exception as error:  # one image must never stop thousands
            row = Detection(name, f"{_UNEXPECTED}: {type(error).__name__}: {error}"[:200])
        rows.append(row)
    return rows, time.process_time() - start


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


# ------------------------------------------------------------------------------------------------------------------
# What was found in images, and the table of it: poses.csv.

POSITION, QUATERNION, SIGMA, SHARED = slice(0, 3), slice(3, 7), slice(7, 13), slice(13, 19)
NUMBERS = (*POSE, *(f"s{axis}" for axis in AXES), *SHARED_COLUMNS, "rms", "scale", "missing", "false", "margin")
RMS, SCALE, MISSING, FALSE = map(NUMBERS.index, ("rms", "scale", "missing", "false"))
COLUMNS = ("file", "dots", *NUMBERS, "doubt", "reason")


@dataclass(frozen=True)
class Detection:
    """One image: the pose of the target in the camera frame, or the reason why there is none.

    file    its name below the folder of images, with "/"
    reason  "" where a pose was found
    dots    how many dots it rests on
    values  x y z (mm), qw qx qy qz; their standard deviations sx sy sz (mm) and srx sry srz (rad, rotation vector in
            the camera frame); that part of them which errors of camera and target make, the same in all images; the
            RMS of the residuals in pixels per axis; their mean square over the stated one (1 unless it is surely
            larger); how many dots of the target are missing, and how many found ones are none; how many more such
            errors every other way to lay the target makes at least; empty without a pose
    doubt   "" or why the pose may be off by more than is stated

    Raises ValueError for another count of values, or some that are not finite.
    """

    file: str
    reason: str = ""
    dots: int = 0
    values: Numbers = ()
    doubt: str = ""

    def __post_init__(self) -> None:
        if len(self.values) != (0 if self.reason else len(NUMBERS)) or not all(map(math.isfinite, self.values)):
            raise ValueError("a detection has a finite number for each column, or a reason")

    @property
    def found(self) -> bool:
        return not self.reason


def values_of(detections: Iterable[Detection]) -> Floats:
    """(m, 24): the numbers of those that have a pose."""
    return floats([d.values for d in detections if d.found]).reshape(-1, len(NUMBERS))


def detections_bytes(detections: Iterable[Detection]) -> bytes:
    """poses.csv, in the order of the files' names; the same detections give the same bytes."""
    rows = (
        [d.file, d.dots, *(d.values if d.found else [None] * len(NUMBERS)), d.doubt, d.reason]
        for d in sorted(detections, key=lambda d: d.file)
    )
    return csv_table(COLUMNS, rows)


def hinted(text: str | None) -> str | Pose:
    """What --first-row says (`turned`): a side, or the first pose in a poses.csv. Raises InputError."""
    if text is None or text in SIDES:
        return text or ""
    try:
        with Path(text).open(newline="", encoding="utf-8") as file:
            row = next(row for row in csv.DictReader(file) if row["qw"])
        return Pose(*np.split(np.array([float(row[name]) for name in POSE]), [3]))
    except (OSError, ValueError, KeyError, StopIteration):
        remedy = f"give one of {', '.join(SIDES)}, or a poses.csv with a pose"
        raise unusable("option --first-row", f"is {text!r:.80}", remedy) from None


def by_reason(rows: Iterable[Detection]) -> dict[str, list[str]]:
    """The files without a pose, by the reason; the most frequent first."""
    found: dict[str, list[str]] = {}
    for row in rows:
        if not row.found:
            found.setdefault(row.reason, []).append(row.file)
    return dict(sorted(found.items(), key=lambda item: -len(item[1])))
