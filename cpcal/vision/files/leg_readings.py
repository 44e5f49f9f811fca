"""Leg readings by pose and run, in a table of their own: what sensors say while a camera takes images."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem, Problems
from cpcal.files.cells import csv_table
from cpcal.files.documents import open_regular
from cpcal.files.table import read_table
from cpcal.robot import PoseTable

Readings = dict[tuple[str, str], Floats]


def readings_of(table: PoseTable) -> Readings:
    """The leg readings (n,) mm of a table by pose and run."""
    return {(pose, run): row for pose, run, row in zip(table.pose, table.run, table.length, strict=True)}


def readings_bytes(readings: Readings) -> bytes:
    """The table pose,run,L1,...,Ln in mm; floats by repr, so that they are read back bit for bit."""
    header = _columns(len(next(iter(readings.values()), ())))
    return csv_table(header, ((key, row.tolist()) for key, row in readings.items()))


def load_readings(path: Path) -> Readings:
    """The table in a file. Raises InputError with every problem."""
    problems = Problems()
    try:
        with open_regular(path) as file:
            table = read_table(
                file, str(path), None, problems, lambda _: None, required=_columns, optional=lambda _: []
            )
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}"
        raise InputError([Problem(str(path), what, "give a table pose,run,L1,...,Ln in mm")]) from None
    problems.raise_any()
    values = np.stack([table.values[name] for name in table.values], axis=1)
    order = [list(table.values).index(f"L{k}") for k in range(1, values.shape[1] + 1)]
    return dict(zip(zip(table.pose, table.run, strict=True), values[:, order], strict=True))


def _columns(legs: int) -> list[str]:
    return ["pose", "run", *(f"L{k}" for k in range(1, max(legs, 1) + 1))]
