"""Studies from files (docs/study-format.md): all problems of the three files at once, each with its line."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from cpcal.common.errors import Problem, Problems
from cpcal.files.documents import open_regular, small_file, unreadable
from cpcal.files.study_settings import StudySettings, read_study_settings
from cpcal.files.study_writer import CALIBRATION_NAME, STUDY_NAME, VALIDATION_NAME
from cpcal.files.table import Table, read_table
from cpcal.robot import PoseTable, Study
from cpcal.robot.columns import SHARED_COLUMNS

_ABSENT = "a study is a folder with the three files study.toml, calibration.csv and validation.csv"


def load_study(path: str | os.PathLike[str]) -> Study:
    """The study in the folder `path`.

    study.toml states the nominal robot and, of a simulated study, the truth; calibration.csv and validation.csv have
    the columns pose,run,x,y,z,qw,qx,qy,qz,L1..Ln in any order, and perhaps image and shared_sx..shared_srz:
    the target frame in the camera frame (mm, unit quaternion), the readings (mm), and the deviations of shared errors.

    Raises one InputError that lists every problem of the three files.
    """
    folder = Path(path)
    problems = Problems()
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        problems.add(Problem(str(folder), what, _ABSENT))
        problems.raise_any()
    content = small_file(folder / STUDY_NAME, problems, _ABSENT)
    settings = StudySettings(None, None, None, {})
    if content is not None:
        settings = read_study_settings(content, str(folder / STUDY_NAME), problems)
    tables = [_table(folder / name, settings.legs, problems) for name in (CALIBRATION_NAME, VALIDATION_NAME)]
    problems.raise_any()
    robot = settings.robot
    assert robot is not None  # what keeps it from being read is a problem, and was raised
    calibration, validation = (_pose_table(table, robot.legs) for table in tables)
    return Study(robot, calibration, validation, settings.truth, settings.provenance)


def _table(path: Path, legs: int | None, problems: Problems) -> Table:
    try:
        with open_regular(path) as file:
            table = read_table(file, str(path), legs, problems, lambda _: None, optional=_optional)
    except OSError as error:
        problems.add(unreadable(path, error, _ABSENT))
        return Table()
    _all_or_none(table, path, problems)
    return table


def _optional(_: int) -> list[str]:
    return ["image", *SHARED_COLUMNS]


def _all_or_none(table: Table, path: Path, problems: Problems) -> None:
    missing = [name for name in SHARED_COLUMNS if name not in table.values]
    if table.values and 0 < len(missing) < len(SHARED_COLUMNS):
        remedy = f"give all of {', '.join(SHARED_COLUMNS)}, or none"
        problems.add(Problem(str(path), f"the column {missing[0]!r} is missing", remedy, 1))


def _pose_table(table: Table, legs: int) -> PoseTable:
    def columns(*names: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return np.stack([table.values[name] for name in names], axis=1)

    return PoseTable(
        tuple(table.pose),
        tuple(table.run),
        columns("x", "y", "z"),
        columns("qw", "qx", "qy", "qz"),
        columns(*(f"L{i}" for i in range(1, legs + 1))),
        tuple(table.image) or None,
        columns(*SHARED_COLUMNS) if SHARED_COLUMNS[0] in table.values else None,
    )
