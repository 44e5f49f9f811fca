"""Poses to be reached, in a CSV table: pose,x,y,z,qw,qx,qy,qz."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from cpcal.common.errors import InputError, Problem, Problems
from cpcal.files.documents import open_regular, unreadable
from cpcal.files.table import read_table
from cpcal.robot import Pose

COLUMNS = ["pose", "x", "y", "z", "qw", "qx", "qy", "qz"]
_REMEDY = f"give a CSV file with the columns {','.join(COLUMNS)}, in mm"


def load_poses(path: str | os.PathLike[str]) -> tuple[tuple[str, ...], Pose]:
    """Names and poses (K) of a file; a column `run` may be there. Raises InputError with every problem."""
    problems, file = Problems(), Path(path)
    try:
        with open_regular(file) as stream:
            table = read_table(
                stream,
                str(file),
                0,
                problems,
                lambda _: None,
                required=lambda _: COLUMNS,
                optional=lambda _: ["run"],
            )
    except OSError as error:
        problems.add(unreadable(file, error, _REMEDY))
    problems.raise_any()
    if len(set(table.pose)) < len(table.pose):
        raise InputError([Problem(str(file), "gives a pose twice", "name each pose once")])
    columns = [table.values[name] for name in COLUMNS[1:]]
    return tuple(table.pose), Pose(np.stack(columns[:3], axis=1), np.stack(columns[3:], axis=1))
