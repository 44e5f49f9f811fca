"""Campaigns from files (DESIGN section 8): all problems of both files at once, each with its line."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import YOUR_DATA, Problem, Problems
from cpcal.files.campaign_settings import Settings, read_settings
from cpcal.files.campaign_writer import CSV_NAME, TOML_NAME
from cpcal.files.documents import open_regular, small_file, unreadable
from cpcal.files.table import Table, read_table
from cpcal.robot import Campaign
from cpcal.robot.columns import half_widths

_ABSENT = "a campaign is a folder with the two files campaign.toml and measurements.csv"


def load_campaign(path: str | os.PathLike[str]) -> Campaign:
    """The campaign in the folder `path`.

    campaign.toml states the nominal robot and, in [uncertainty], half-widths: as `factor` times
    `position_sigma` (3, mm), `rotation_sigma` (3, rad) and `length_sigma` (n, mm), or directly as
    `position_half_width`, `rotation_half_width` and `length_half_width`; or it says `exact = true` there. [model]
    may name the leg model that is asked for, and `half_widths` of its extra parameters. measurements.csv has the
    columns pose,run,x,y,z,qw,qx,qy,qz,L1..Ln in any order, and any of dx,dy,dz,drx,dry,drz,dL1..dLn, whose cells
    replace those half-widths where they are not empty.

    Raises one InputError that lists every problem of both files.
    """
    folder = Path(path)
    problems = Problems()
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        problems.add(Problem(str(folder), what, _ABSENT))
        problems.raise_any(YOUR_DATA)
    of_settings, of_table = hashlib.sha256(), hashlib.sha256()
    settings = _settings(folder / TOML_NAME, problems, of_settings.update)
    table = _table(folder / CSV_NAME, settings, problems, of_table.update)
    problems.raise_any(YOUR_DATA)
    campaign = _assembled(settings, table)
    files = ((TOML_NAME, of_settings.hexdigest()), (CSV_NAME, of_table.hexdigest()))
    object.__setattr__(campaign, "files", files)
    return campaign


def load_settings(path: str | os.PathLike[str]) -> Settings:
    """What a campaign.toml, or that in a folder, says. Raises InputError with every problem of it."""
    file = Path(path) / TOML_NAME if Path(path).is_dir() else Path(path)
    problems = Problems()
    settings = _settings(file, problems, lambda _: None)
    problems.raise_any(YOUR_DATA)
    return settings


def _settings(path: Path, problems: Problems, saw: Callable[[bytes], object]) -> Settings:
    content = small_file(path, problems, _ABSENT)
    if content is None:
        return Settings(None, None, None, {})
    saw(content)
    return read_settings(content, str(path), problems)


def _table(path: Path, settings: Settings, problems: Problems, saw: Callable[[bytes], object]) -> Table:
    try:
        with open_regular(path) as file:
            return read_table(file, str(path), settings.legs, problems, saw)
    except OSError as error:
        problems.add(unreadable(path, error, _ABSENT))
        return Table()


def _assembled(settings: Settings, table: Table) -> Campaign:
    """The campaign of two files without problems."""
    robot, values = settings.robot, table.values
    assert robot is not None  # what keeps it from being read is a problem, and was raised
    legs = robot.legs
    stated = np.zeros(6 + legs) if settings.uncertainty is None else settings.uncertainty.half_widths
    radii = half_widths(stated, values, legs, len(table.pose))

    def columns(*names: str) -> npt.NDArray[np.float64]:
        return np.stack([values[name] for name in names], axis=1)

    return Campaign(
        robot,
        tuple(table.pose),
        tuple(table.run),
        columns("x", "y", "z"),
        columns("qw", "qx", "qy", "qz"),
        columns(*(f"L{i}" for i in range(1, legs + 1))),
        radii[:, :3],
        radii[:, 3:6],
        radii[:, 6:],
        settings.uncertainty,
        settings.provenance,
        settings.model,
    )
