"""A campaign in one file of exact numbers, `campaign.json`: what a run keeps, and what its certificates are tied to.

docs/certificate-format.md has the format. A number is the float64 nearest to its decimal text, here as in campaign.toml
and measurements.csv, so that reading the file gives the campaign back bit by bit.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, Problem
from cpcal.files.campaign_writer import CSV_NAME, TOML_NAME, csv_bytes, toml_bytes
from cpcal.robot import Campaign, Robot
from cpcal.robot.model_choice import ModelChoice
from cpcal.robot.uncertainty import Uncertainty

NAME = "campaign.json"
FORMAT = "cpcal-campaign-exact/1"
_LARGEST = 64 << 20  # bytes: the checker reads no more
_ARRAYS = ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius")
_REMEDY = "certify the campaign again"


def campaign_json(campaign: Campaign) -> bytes:
    """The file's bytes: of equal campaigns from equal files, the same."""
    uncertainty, model, robot = campaign.uncertainty, campaign.model, campaign.robot
    head: dict[str, Any] = {
        "format": FORMAT,
        "files": [{"name": name, "sha256": digest} for name, digest in _files(campaign)],
        "robot": {
            "name": robot.name,
            "base": _texts(robot.base),
            "mobile": _texts(robot.mobile),
            "offset": _texts(robot.offset),
        },
        "uncertainty": None
        if uncertainty is None
        else {
            "factor": None if uncertainty.factor is None else repr(float(uncertainty.factor)),
            "position": _texts(uncertainty.position),
            "rotation": _texts(uncertainty.rotation),
            "length": _texts(uncertainty.length),
        },
        "model": None
        if model is None
        else {"name": model.name, "half_widths": {k: repr(float(v)) for k, v in model.half_widths.items()}},
        "provenance": dict(campaign.provenance),
    }
    numbers = _texts(np.concatenate([getattr(campaign, name) for name in _ARRAYS], axis=1))
    rows = [[pose, run, *row] for pose, run, row in zip(campaign.pose, campaign.run, numbers, strict=True)]
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
    table = ",\n  ".join(json.dumps(row, separators=(",", ":")) for row in rows)
    return ("{" + ",\n ".join([*lines, f'"measurements": [\n  {table}\n ]']) + "}\n").encode()


def campaign_sha256(campaign: Campaign) -> str:
    """SHA-256 of the bytes of campaign.json, in hex; computed once for each campaign."""
    kept = vars(campaign)
    if "_sha256" not in kept:
        kept["_sha256"] = hashlib.sha256(campaign_json(campaign)).hexdigest()
    return str(kept["_sha256"])


def save_campaign_json(campaign: Campaign, folder: str | os.PathLike[str], name: str = NAME) -> Path:
    """Write it into a folder, all or nothing; its path. Raises InputError, also where the checker could not read it."""
    content, path = campaign_json(campaign), Path(folder) / name
    if len(content) > _LARGEST:
        what = f"takes {len(content):,} bytes as {NAME}, more than {_LARGEST:,}"
        raise InputError([Problem("campaign", what, "certify parts of it, or without certificates")])
    write_file(path, content)
    return path


def keep_beside(campaign: Campaign, certificate: str | os.PathLike[str]) -> Path:
    """The campaign's file in the folder of a certificate; written where it is not there yet, beside another's."""
    folder, content = Path(certificate).parent, campaign_json(campaign)
    name = NAME
    if (folder / NAME).exists() and (folder / NAME).read_bytes() != content:
        name = f"{campaign_sha256(campaign)[:12]}.{NAME}"
    path = folder / name
    return path if path.exists() else save_campaign_json(campaign, folder, name)


def load_campaign_json(path: str | os.PathLike[str]) -> Campaign:
    """The campaign of a file, or of the `campaign.json` in a folder. Raises InputError."""
    file = Path(path) / NAME if Path(path).is_dir() else Path(path)
    try:
        with file.open("rb") as stream:
            content = stream.read(_LARGEST + 1)
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}"
        raise InputError([Problem(str(file), what, "name the folder of a run")]) from None
    try:
        if len(content) > _LARGEST:
            raise ValueError(f"is larger than {_LARGEST:,} bytes")
        data = json.loads(content.decode("utf-8"))
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise ValueError(f"is not of format {FORMAT}")
        campaign = _campaign(data)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise InputError([Problem(str(file), f"cannot be used: {error!r}", _REMEDY)]) from None
    if campaign_json(campaign) != content:
        raise InputError([Problem(str(file), "is not as cpcal writes it", _REMEDY)])
    return campaign


def _campaign(data: dict[str, Any]) -> Campaign:
    robot, stated, asked = data["robot"], data["uncertainty"], data["model"]
    rows: list[list[str]] = data["measurements"]
    legs = len(robot["offset"])
    numbers = np.array([[float(v) for v in row[2:]] for row in rows], dtype=np.float64).reshape(len(rows), -1)
    ends = np.cumsum([3, 4, legs, 3, 3])
    arrays = dict(zip(_ARRAYS, np.split(numbers, ends, axis=1), strict=True))
    campaign = Campaign(
        robot=Robot(robot["name"], *(_floats(robot[key]) for key in ("base", "mobile", "offset"))),
        pose=tuple(row[0] for row in rows),
        run=tuple(row[1] for row in rows),
        uncertainty=None if stated is None else _uncertainty(stated),
        provenance=data["provenance"],
        model=None if asked is None else _model(asked),
        **arrays,
    )
    object.__setattr__(campaign, "files", tuple((file["name"], file["sha256"]) for file in data["files"]))
    return campaign


def _uncertainty(stated: dict[str, Any]) -> Uncertainty:
    position, rotation, length = (_floats(stated[kind]) for kind in ("position", "rotation", "length"))
    factor = stated["factor"]
    return Uncertainty(position, rotation, length, None if factor is None else float(factor))


def _model(asked: dict[str, Any]) -> ModelChoice:
    return ModelChoice(asked["name"], {k: float(v) for k, v in asked["half_widths"].items()})


def _files(campaign: Campaign) -> tuple[tuple[str, str], ...]:
    """Names and digests of the files it was read from; of one made in memory, of those that `save_campaign` writes."""
    if campaign.files:
        return campaign.files
    contents = (TOML_NAME, toml_bytes(campaign)), (CSV_NAME, csv_bytes(campaign))
    return tuple((name, hashlib.sha256(content).hexdigest()) for name, content in contents)


def _texts(values: Any) -> Any:
    """Floats of an array, or of nested lists, by repr."""
    plain = values.tolist() if isinstance(values, np.ndarray) else values
    return [_texts(v) for v in plain] if isinstance(plain, list) else repr(plain)


def _floats(values: Any) -> Any:
    return np.array(values, dtype=str).astype(np.float64)
