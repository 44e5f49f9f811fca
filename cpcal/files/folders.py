"""Campaigns from files (DESIGN section 8): all problems of both files at once, each with its line."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.errors import YOUR_DATA, InputError, Problem, Problems, unusable
from cpcal.common.files import small_file, write_file
from cpcal.common.values import Floats, fill
from cpcal.files.settings import (
    CALIBRATION_NAME,
    CSV_NAME,
    STUDY_NAME,
    TOML_NAME,
    VALIDATION_NAME,
    Settings,
    csv_bytes,
    read_settings,
    read_study_settings,
    toml_bytes,
)
from cpcal.files.tables import Table, read_table
from cpcal.robot import Campaign, PoseTable, Robot, Study
from cpcal.robot.campaign import ARRAYS
from cpcal.robot.robot import KINDS, Uncertainty
from cpcal.robot.units import SHARED_COLUMNS, ModelChoice, override_columns, reading_columns

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
    folder, problems = _existing(path, _ABSENT, YOUR_DATA), Problems()
    settings = read_settings(folder / TOML_NAME, problems, _ABSENT)
    table = read_table(folder / CSV_NAME, settings.legs, problems, _ABSENT)
    problems.raise_any(YOUR_DATA)
    campaign = campaign_of_table(table, settings)
    fill(campaign, files=((TOML_NAME, settings.sha256), (CSV_NAME, table.sha256)))
    return campaign


def campaign_of_table(table: Table, settings: Settings) -> Campaign:
    """Of a table as measurements.csv has it: override columns count where they are not NaN."""
    robot, stated = settings.robot, settings.uncertainty
    assert robot is not None  # what keeps it from being read is a problem, and was raised
    radii = np.zeros((len(table.names["pose"]), 6 + robot.legs))
    if stated is not None:
        radii[:] = stated.half_widths
    for column, name in enumerate(override_columns(robot.legs)):
        if name in table.values:
            own = ~np.isnan(table.values[name])
            radii[own, column] = table.values[name][own]
    numbers = np.concatenate([table.columns(*reading_columns(robot.legs)[2:]), radii], axis=1)
    return Campaign(
        robot,
        tuple(table.names["pose"]),
        tuple(table.names["run"]),
        **_arrays(numbers, robot.legs),
        uncertainty=stated,
        provenance=settings.provenance,
        model=settings.model,
    )


def _arrays(numbers: Floats, legs: int) -> dict[str, Any]:
    """`ARRAYS` of a campaign, which stand side by side in (N, 13 + 2 n) numbers."""
    return dict(zip(ARRAYS, np.split(numbers, np.cumsum([3, 4, legs, 3, 3]), axis=1), strict=True))


def _existing(path: str | os.PathLike[str], absent: str, see: str = "") -> Path:
    """The folder. Raises InputError where there is none."""
    folder = Path(path)
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        raise InputError([Problem(str(folder), what, absent)], see=see)
    return folder


def load_settings(path: str | os.PathLike[str]) -> Settings:
    """What a campaign.toml, or that in a folder, says. Raises InputError with every problem of it."""
    file = Path(path) / TOML_NAME if Path(path).is_dir() else Path(path)
    problems = Problems()
    settings = read_settings(file, problems, _ABSENT)
    problems.raise_any(YOUR_DATA)
    return settings


# ------------------------------------------------------------------------------------------------------------------
# A campaign in one file of exact numbers, `campaign.json`: what a run keeps, and what its certificates are tied to.
#
# docs/certificate-format.md has the format. A number is the float64 nearest to its decimal text, here as in
# campaign.toml and measurements.csv, so that reading the file gives the campaign back bit by bit.

NAME = "campaign.json"
JSON_FORMAT = "cpcal-campaign-exact/1"
_LARGEST = 32 << 20  # bytes: the checker reads no more
_REMEDY = "certify the campaign again"


def campaign_json(campaign: Campaign) -> bytes:
    """The file's bytes: of equal campaigns from equal files, the same."""
    stated, model, files = campaign.uncertainty, campaign.model, campaign.files
    if not files:  # made in memory: those that `save_campaign` writes
        contents = (TOML_NAME, toml_bytes(campaign)), (CSV_NAME, csv_bytes(campaign))
        files = tuple((name, hashlib.sha256(content).hexdigest()) for name, content in contents)
    head = {
        "format": JSON_FORMAT,
        "files": [{"name": name, "sha256": digest} for name, digest in files],
        "robot": vars(campaign.robot),
        "uncertainty": stated and {key: getattr(stated, key) for key in ("factor", *KINDS)},
        "model": model and {"name": model.name, "half_widths": model.half_widths},
        "provenance": campaign.provenance,
    }
    numbers = _texts(np.concatenate([getattr(campaign, name) for name in ARRAYS], axis=1))
    rows = [[pose, run, *row] for pose, run, row in zip(campaign.pose, campaign.run, numbers, strict=True)]
    lines = [f"{json.dumps(key)}: {json.dumps(_texts(value))}" for key, value in head.items()]
    table = ",\n  ".join(json.dumps(row, separators=(",", ":")) for row in rows)
    return ("{" + ",\n ".join([*lines, f'"measurements": [\n  {table}\n ]']) + "}\n").encode()


def campaign_sha256(campaign: Campaign) -> str:
    """SHA-256 of the bytes of campaign.json, in hex; computed once for each campaign."""
    kept = vars(campaign)
    if "_sha256" not in kept:
        kept["_sha256"] = hashlib.sha256(campaign_json(campaign)).hexdigest()
    return str(kept["_sha256"])


def save_campaign_json(campaign: Campaign, folder: str | os.PathLike[str]) -> Path:
    """Write it into a folder, all or nothing; its path. Raises InputError, also where the checker could not read it."""
    content, path = campaign_json(campaign), Path(folder) / NAME
    if len(content) > _LARGEST:
        what = f"takes {len(content):,} bytes as {NAME}, more than {_LARGEST:,}"
        raise unusable("campaign", what, "certify parts of it, or without certificates")
    write_file(path, content)
    return path


def keep_beside(campaign: Campaign, certificate: str | os.PathLike[str]) -> None:
    """Keep the campaign's file in the folder of a certificate. Raises InputError where another campaign's is there."""
    path = Path(certificate).parent / NAME
    if not path.exists():
        save_campaign_json(campaign, path.parent)
    elif path.read_bytes() != campaign_json(campaign):
        raise unusable(str(path), "is of another campaign", "choose another folder for the certificate")


def load_campaign_json(path: str | os.PathLike[str]) -> Campaign:
    """The campaign of a file, or of the `campaign.json` in a folder. Raises InputError."""
    file = Path(path) / NAME if Path(path).is_dir() else Path(path)
    content = small_file(file, "name the folder of a run", most=_LARGEST)
    try:
        data = json.loads(content.decode("utf-8"))
        if not isinstance(data, dict) or data.get("format") != JSON_FORMAT:
            raise ValueError(f"is not of format {JSON_FORMAT}")
        campaign = _campaign(data)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise unusable(str(file), f"cannot be used: {error!r}", _REMEDY) from None
    if campaign_json(campaign) != content:
        raise unusable(str(file), "is not as cpcal writes it", _REMEDY)
    return campaign


def _campaign(data: dict[str, Any]) -> Campaign:
    robot, stated, asked = Robot(**data["robot"]), data["uncertainty"], data["model"]
    rows: list[list[str]] = data["measurements"]
    numbers = np.array([[float(v) for v in row[2:]] for row in rows], dtype=np.float64).reshape(len(rows), -1)
    if stated is not None and stated["factor"] is not None:
        stated["factor"] = float(stated["factor"])
    campaign = Campaign(
        robot=robot,
        pose=tuple(row[0] for row in rows),
        run=tuple(row[1] for row in rows),
        uncertainty=stated and Uncertainty(**stated),
        provenance=data["provenance"],
        model=asked and ModelChoice(**asked),
        **_arrays(numbers, robot.legs),
    )
    fill(campaign, files=tuple((file["name"], file["sha256"]) for file in data["files"]))
    return campaign


def _texts(value: Any) -> Any:
    """Numbers by repr, in arrays, lists and tables; texts as they are."""
    if isinstance(value, Mapping):
        return {key: _texts(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | list):
        return [_texts(one) for one in (value.tolist() if isinstance(value, np.ndarray) else value)]
    return value if value is None or isinstance(value, str) else repr(float(value))


# ------------------------------------------------------------------------------------------------------------------
# Studies from files (docs/calibration.md): all problems of the three files at once, each with its line.

_NO_STUDY = "a study is a folder with the three files study.toml, calibration.csv and validation.csv"


def load_study(path: str | os.PathLike[str]) -> Study:
    """The study in the folder `path`.

    study.toml states the nominal robot and, of a simulated study, the truth; calibration.csv and validation.csv have
    the columns pose,run,x,y,z,qw,qx,qy,qz,L1..Ln in any order, and perhaps image and shared_sx..shared_srz:
    the target frame in the camera frame (mm, unit quaternion), the readings (mm), and the deviations of shared errors.

    Raises one InputError that lists every problem of the three files.
    """
    folder, problems = _existing(path, _NO_STUDY), Problems()
    settings = read_study_settings(folder / STUDY_NAME, problems, _NO_STUDY)
    tables = []
    for name in (CALIBRATION_NAME, VALIDATION_NAME):
        found = read_table(
            folder / name, settings.legs, problems, _NO_STUDY, optional=lambda _: ["image", *SHARED_COLUMNS]
        )
        missing = [column for column in SHARED_COLUMNS if column not in found.values]
        if found.values and 0 < len(missing) < len(SHARED_COLUMNS):
            what, remedy = f"the column {missing[0]!r} is missing", f"give all of {', '.join(SHARED_COLUMNS)}, or none"
            problems.add(Problem(str(folder / name), what, remedy, 1))
        tables.append(found)
    problems.raise_any()
    robot = settings.robot
    assert robot is not None  # what keeps it from being read is a problem, and was raised
    poses = []
    for found in tables:
        pose, run, *image = (tuple(found.names[name]) for name in ("pose", "run", "image") if name in found.names)
        shared = found.columns(*SHARED_COLUMNS) if SHARED_COLUMNS[0] in found.values else None
        position, quaternion, length = np.split(found.columns(*reading_columns(robot.legs)[2:]), [3, 7], axis=1)
        poses.append(PoseTable(pose, run, position, quaternion, length, image[0] if image else None, shared))
    return Study(robot, poses[0], poses[1], settings.truth, settings.provenance)
