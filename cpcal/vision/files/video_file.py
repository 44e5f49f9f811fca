"""Frames of a video file as images. Lossy codecs shift grey values: poses from them are as good as the codec."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.vision.files.image_file import UnreadableImageError
from cpcal.vision.opencv import opencv

SUFFIXES = (".avi", ".mp4", ".mov", ".mkv", ".m4v", ".webm")


@dataclass(frozen=True)
class VideoFrames:
    """Every so many frames of a file, named FILE/000120.png by their number from 0: a source for `detect`.

    size  (width, height) of the camera's images. Raises InputError for a file that is no video, or of another size.
    """

    file: Path
    size: tuple[int, int]
    every: int = 1
    stage = "reading"

    def __post_init__(self) -> None:
        if self.every < 1:
            raise InputError([Problem("every", f"is {self.every}", "give a whole number from 1")])
        film = _opened(self.file)
        if not film.count:
            raise InputError([Problem(str(self.file), "holds no video that can be read", "give an .avi or .mp4 file")])
        if film.size != self.size:
            what = "has frames of {} x {} pixels, the camera's images are {} x {}".format(*film.size, *self.size)
            raise InputError([Problem(str(self.file), what, "give the camera that took it")])

    @property
    def names(self) -> list[str]:
        return [f"{self.file.name}/{k:06d}.png" for k in range(0, _opened(self.file).count, self.every)]

    def stamp(self, name: str) -> str:
        stat = self.file.stat()
        return f"{stat.st_size}-{stat.st_mtime_ns}"

    def read(self, name: str) -> npt.NDArray[np.uint8]:
        """The frame (height, width, 3). Raises UnreadableImageError."""
        return _opened(self.file).frame(int(Path(name).stem))


class _Film:
    """A video that is read forward; a step back begins it anew, for seeking is exact with few codecs."""

    def __init__(self, file: Path) -> None:
        self.file = file
        cv2 = opencv()
        self.capture: Any = cv2.VideoCapture(str(file))
        self.next = 0
        self.count = max(int(self.capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0) if self.capture.isOpened() else 0
        self.size = tuple(int(self.capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))

    def frame(self, number: int) -> npt.NDArray[np.uint8]:
        if number < self.next:
            self.capture.release()
            self.capture, self.next = opencv().VideoCapture(str(self.file)), 0
        while self.next < number and self.capture.grab():
            self.next += 1
        found, image = self.capture.read() if self.next == number else (False, None)
        if not found:
            raise UnreadableImageError("the video ends, or is damaged, before this frame")
        self.next += 1
        return np.asarray(image, dtype=np.uint8)


@lru_cache(maxsize=1)
def _opened(file: Path) -> _Film:
    """One open file in each process: its frames are asked for in their order."""
    return _Film(file)
