"""What `detect` has done so far, kept line by line: a restart redoes nothing."""

from __future__ import annotations

import hashlib
import json
import math
import stat
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO

import numpy as np
import numpy.typing as npt

from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, Problem
from cpcal.common.version import __version__
from cpcal.vision.camera import Camera
from cpcal.vision.files.detection import NUMBERS, Detection
from cpcal.vision.target import Target

FORMAT = "cpcal-detect-journal/3"
SIZE_MAX = 2**30  # bytes; a line of a million images each takes some 400


@dataclass
class Journal:
    """Rows by the file's name, each with the stamp of the file that it is of; nothing is kept without a file."""

    file: IO[str] | None = None
    rows: dict[str, tuple[str, Detection]] = field(default_factory=dict)

    @classmethod
    def opened(
        cls, path: Path | None, target: Target, camera: Camera, covariance: npt.NDArray[np.float64] | None = None
    ) -> Journal:
        """The journal in `path`, begun anew unless it is of this target, camera and version. Raises InputError."""
        if path is None:
            return cls()
        head = {"format": FORMAT, "version": __version__, "of": _digest(target, camera, covariance)}
        rows, lines = _kept(path, head)
        text = "".join(f"{line}\n" for line in [json.dumps(head), *lines])
        write_file(path, text.encode("utf-8", "surrogateescape"))
        try:
            file = path.open("a", encoding="utf-8", errors="surrogateescape")
        except OSError as error:
            what = f"cannot be written: {error.strerror or error}"
            raise InputError([Problem(str(path), what, "choose a folder that can be written to")]) from None
        return cls(file, rows)

    def get(self, name: str, stamp: str) -> Detection | None:
        """The row of that image, if it is still the same image."""
        known, row = self.rows.get(name, ("", None))
        return row if row is not None and known == stamp else None

    def add(self, row: Detection, stamp: str) -> None:
        if self.file is not None:
            told = {"reason": row.reason, "doubt": row.doubt, "dots": row.dots, "values": row.values}
            line = {"file": row.file, "stamp": stamp, **told}
            self.file.write(json.dumps(line) + "\n")
            self.file.flush()

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.file is not None:
            self.file.close()


def _kept(path: Path, head: dict[str, str]) -> tuple[dict[str, tuple[str, Detection]], list[str]]:
    """The rows of a journal with that head, and their lines; a line that is none, as a crash leaves it, is dropped."""
    rows: dict[str, tuple[str, Detection]] = {}
    lines: list[str] = []
    first, *rest = _text(path).split("\n")
    if not first:
        return rows, lines
    try:
        if json.loads(first) != head:
            return rows, lines
    except (ValueError, RecursionError):
        raise _no_journal(path) from None
    for line in rest:
        read = _row(line)
        if read is not None:
            rows[read[1].file] = read
            lines.append(line)
    return rows, lines


def _text(path: Path) -> str:
    """ "" where there is no journal yet. Raises InputError for what can be none, before it is read."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode) or status.st_size > SIZE_MAX:
            raise _no_journal(path)
        return path.read_text(encoding="utf-8", errors="surrogateescape")
    except FileNotFoundError:
        return ""
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}"
        raise InputError([Problem(str(path), what, "give a file that can be read")]) from None


def _no_journal(path: Path) -> InputError:
    return InputError([Problem(str(path), "is not a journal of `cpcal detect`", "choose another file")])


def _row(line: str) -> tuple[str, Detection] | None:
    """The stamp and the row that a line of a journal states, if it states one."""
    try:
        d = json.loads(line)
        file, stamp, reason, doubt, dots = d["file"], d["stamp"], d["reason"], d["doubt"], d["dots"]
        values = tuple(map(float, d["values"]))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    sound = all(isinstance(text, str) for text in (file, stamp, reason, doubt)) and type(dots) is int
    sound &= len(values) == (0 if reason else len(NUMBERS)) and all(map(math.isfinite, values))
    return (stamp, Detection(file, reason, dots, values, doubt)) if sound else None


def _digest(target: Target, camera: Camera, covariance: npt.NDArray[np.float64] | None) -> str:
    arrays = [
        target.dots,
        camera.focal,
        camera.center,
        camera.distortion,
        *([] if covariance is None else [covariance]),
    ]
    plate = (target.radius, target.lines, target.bright, target.scale_sigma, target.dot_sigma)
    told = (*plate, camera.model, camera.width, camera.height, *(a.tolist() for a in arrays))
    return hashlib.sha256(repr(told).encode()).hexdigest()
