"""What was found in images, and the table of it: poses.csv."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cpcal.errors import InputError, Problem, Problems, shown
from cpcal.files.cells import guarded, unguarded

POSITION, QUATERNION, SIGMA = slice(0, 3), slice(3, 7), slice(7, 13)
NUMBERS = ("x", "y", "z", "qw", "qx", "qy", "qz", "sx", "sy", "sz", "srx", "sry", "srz", "rms")
COLUMNS = ("file", "dots", *NUMBERS, "reason")


@dataclass(frozen=True)
class Detection:
    """One image: the pose of the target in the camera frame, or the reason why there is none.

    file    its name below the folder of images, with "/"
    reason  "" where a pose was found
    dots    how many dots it rests on
    values  x y z (mm), qw qx qy qz, their standard deviations sx sy sz (mm) and srx sry srz (rad, rotation vector in
            the camera frame), and the RMS of the residuals in pixels per axis; empty without a pose
    """

    file: str
    reason: str = ""
    dots: int = 0
    values: tuple[float, ...] = ()

    @property
    def found(self) -> bool:
        return not self.reason


def values_of(detections: Iterable[Detection]) -> npt.NDArray[np.float64]:
    """(m, 14): the numbers of those that have a pose."""
    rows = [d.values for d in detections if d.found]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(NUMBERS))


def detections_bytes(detections: Iterable[Detection]) -> bytes:
    """poses.csv, in the order of the files' names; the same detections give the same bytes."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for d in sorted(detections, key=lambda d: d.file):
        numbers = [repr(v) for v in d.values] if d.found else [""] * len(NUMBERS)
        writer.writerow([guarded(d.file), str(d.dots), *numbers, guarded(d.reason)])
    return buffer.getvalue().encode("utf-8", "surrogateescape")


def load_detections(path: Path) -> list[Detection]:
    """The rows of a poses.csv. Raises InputError with every problem."""
    problems, out = Problems(), []
    try:
        text = path.read_text(encoding="utf-8", errors="surrogateescape")
    except OSError as error:
        raise InputError([Problem(str(path), f"cannot be read: {error.strerror}", "see `cpcal detect`")]) from None
    rows = csv.reader(io.StringIO(text))
    if tuple(next(rows, ())) != COLUMNS:
        raise InputError([Problem(str(path), "is not a table of poses", "give a file that `cpcal detect` wrote", 1)])
    for row in rows:
        found = _row(row)
        if found is None:
            what = f"is no row of such a table: {shown(','.join(row))}"
            problems.add(Problem(str(path), what, "have `cpcal detect` write the file again", rows.line_num))
        else:
            out.append(found)
    problems.raise_any()
    return out


def _row(row: Sequence[str]) -> Detection | None:
    if len(row) != len(COLUMNS):
        return None
    file, dots, *cells, reason = row
    try:
        values = tuple(float(c) for c in cells) if not reason else ()
        return (
            Detection(unguarded(file), unguarded(reason), int(dots), values)
            if all(map(math.isfinite, values))
            else None
        )
    except ValueError:
        return None
