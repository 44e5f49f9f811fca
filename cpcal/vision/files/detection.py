"""What was found in images, and the table of it: poses.csv."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import Problems
from cpcal.common.values import Floats
from cpcal.files.tables import csv_table, read_table
from cpcal.robot import PoseTable

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

    Raises ValueError for another count of values, or some that are not finite.
    """

    file: str
    reason: str = ""
    dots: int = 0
    values: tuple[float, ...] = ()
    doubt: str = ""

    def __post_init__(self) -> None:
        if len(self.values) != (0 if self.reason else len(NUMBERS)) or not all(map(math.isfinite, self.values)):
            raise ValueError("a detection has a finite number for each column, or a reason")

    @property
    def found(self) -> bool:
        return not self.reason


def values_of(detections: Iterable[Detection]) -> npt.NDArray[np.float64]:
    """(m, 24): the numbers of those that have a pose."""
    rows = [d.values for d in detections if d.found]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(NUMBERS))


def detections_bytes(detections: Iterable[Detection]) -> bytes:
    """poses.csv, in the order of the files' names; the same detections give the same bytes."""
    rows = (
        [d.file, d.dots, *(d.values if d.found else [None] * len(NUMBERS)), d.doubt, d.reason]
        for d in sorted(detections, key=lambda d: d.file)
    )
    return csv_table(COLUMNS, rows, files=True)


def by_reason(rows: Iterable[Detection]) -> dict[str, list[str]]:
    """The files without a pose, by the reason; the most frequent first."""
    found: dict[str, list[str]] = {}
    for row in rows:
        if not row.found:
            found.setdefault(row.reason, []).append(row.file)
    return dict(sorted(found.items(), key=lambda item: -len(item[1])))


# ------------------------------------------------------------------------------------------------------------------
# Leg readings by pose and run, in a table of their own: what sensors say while a camera takes images.

Readings = dict[tuple[str, str], Floats]


def readings_of(table: PoseTable) -> Readings:
    """The leg readings (n,) mm of a table by pose and run."""
    return {(pose, run): row for pose, run, row in zip(table.pose, table.run, table.length, strict=True)}


def readings_bytes(readings: Readings) -> bytes:
    """The table pose,run,L1,...,Ln in mm; floats by repr, so that they are read back bit for bit."""
    header = _columns(len(next(iter(readings.values()), ())))
    return csv_table(header, ([*key, *row.tolist()] for key, row in readings.items()))


def load_readings(path: Path) -> Readings:
    """The table in a file. Raises InputError with every problem."""
    problems = Problems()
    remedy = "give a table pose,run,L1,...,Ln in mm"
    table = read_table(path, None, problems, remedy, required=_columns, optional=lambda _: [])
    problems.raise_any()
    values = table.columns(*(f"L{k}" for k in range(1, len(table.values) + 1)))
    return dict(zip(zip(table.pose, table.run, strict=True), values, strict=True))


def _columns(legs: int) -> list[str]:
    return ["pose", "run", *(f"L{k}" for k in range(1, max(legs, 1) + 1))]
