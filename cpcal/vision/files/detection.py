"""What was found in images, and the table of it: poses.csv."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.files.cells import file_cell, guarded

POSITION, QUATERNION, SIGMA, SHARED = slice(0, 3), slice(3, 7), slice(7, 13), slice(13, 19)
_AXES = ("x", "y", "z", "rx", "ry", "rz")
NUMBERS = (
    *("x", "y", "z", "qw", "qx", "qy", "qz"),
    *(f"s{axis}" for axis in _AXES),
    *(f"shared_s{axis}" for axis in _AXES),
    *("rms", "scale", "missing", "false", "margin"),
)
RMS, SCALE = NUMBERS.index("rms"), NUMBERS.index("scale")
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
    """

    file: str
    reason: str = ""
    dots: int = 0
    values: tuple[float, ...] = ()
    doubt: str = ""

    @property
    def found(self) -> bool:
        return not self.reason


def values_of(detections: Iterable[Detection]) -> npt.NDArray[np.float64]:
    """(m, 24): the numbers of those that have a pose."""
    rows = [d.values for d in detections if d.found]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(NUMBERS))


def detections_bytes(detections: Iterable[Detection]) -> bytes:
    """poses.csv, in the order of the files' names; the same detections give the same bytes."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for d in sorted(detections, key=lambda d: d.file):
        numbers = [repr(v) for v in d.values] if d.found else [""] * len(NUMBERS)
        writer.writerow([file_cell(d.file), str(d.dots), *numbers, guarded(d.doubt), guarded(d.reason)])
    return buffer.getvalue().encode()


def by_reason(rows: Iterable[Detection]) -> dict[str, list[str]]:
    """The files without a pose, by the reason; the most frequent first."""
    found: dict[str, list[str]] = {}
    for row in rows:
        if not row.found:
            found.setdefault(row.reason, []).append(row.file)
    return dict(sorted(found.items(), key=lambda item: -len(item[1])))
