"""What `detect` has done so far, kept line by line: a restart redoes nothing."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO

from cpcal.errors import InputError, Problem
from cpcal.version import __version__
from cpcal.vision.camera import Camera
from cpcal.vision.files.detection import Detection
from cpcal.vision.target import Target

FORMAT = "cpcal-detect-journal/1"


@dataclass
class Journal:
    """Rows by the file's name, each with the stamp of the file that it is of; nothing is kept without a file."""

    file: IO[str] | None = None
    rows: dict[str, tuple[str, Detection]] = field(default_factory=dict)

    @classmethod
    def opened(cls, path: Path | None, target: Target, camera: Camera) -> Journal:
        """The journal in `path`, begun anew unless it is of this target, camera and version. Raises InputError."""
        if path is None:
            return cls()
        head = {"format": FORMAT, "version": __version__, "of": _digest(target, camera)}
        try:
            rows, lines = _kept(path, head)
            draft = path.with_name(f"{path.name}.tmp")
            text = "".join(f"{line}\n" for line in [json.dumps(head), *lines])
            draft.write_text(text, encoding="utf-8", errors="surrogateescape")
            os.replace(draft, path)
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
            line = {"file": row.file, "stamp": stamp, "reason": row.reason, "dots": row.dots, "values": row.values}
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
    """The rows of a journal with that head, and their lines; a line cut short by a crash is dropped."""
    rows: dict[str, tuple[str, Detection]] = {}
    lines: list[str] = []
    if not path.exists():
        return rows, lines
    first, *rest = path.read_text(encoding="utf-8", errors="surrogateescape").split("\n")
    try:
        if json.loads(first) != head:
            return rows, lines
    except ValueError:
        raise InputError([Problem(str(path), "is not a journal of `cpcal detect`", "choose another file")]) from None
    for line in rest:
        try:
            d = json.loads(line)
            row = Detection(d["file"], d["reason"], d["dots"], tuple(map(float, d["values"])))
        except (ValueError, KeyError, TypeError):
            continue
        rows[row.file] = (d["stamp"], row)
        lines.append(line)
    return rows, lines


def _digest(target: Target, camera: Camera) -> str:
    arrays = (target.dots, camera.focal, camera.center, camera.distortion)
    told = (target.radius, target.lines, target.bright, camera.width, camera.height, *(a.tolist() for a in arrays))
    return hashlib.sha256(repr(told).encode()).hexdigest()
