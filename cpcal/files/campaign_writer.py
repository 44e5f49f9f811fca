"""Campaigns to files: canonical bytes, their digest, and writing that never leaves anything half-written."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from cpcal.common.atomic import write_folder
from cpcal.files.cells import csv_table
from cpcal.robot.columns import override_columns, reading_columns

if TYPE_CHECKING:
    from cpcal.robot import Campaign, ModelChoice, Robot, Uncertainty

FORMAT = "cpcal-campaign/1"
TOML_NAME = "campaign.toml"
CSV_NAME = "measurements.csv"


def toml_bytes(campaign: Campaign) -> bytes:
    """The canonical campaign.toml; floats by repr, so that they are read back bit for bit."""
    lines = [f"format = {quoted(FORMAT)}", "", *robot_lines(campaign.robot)]
    lines += _uncertainty_lines(campaign.uncertainty)
    if campaign.model is not None:
        lines += _model_lines(campaign.model)
    lines += provenance_lines(campaign.provenance)
    return ("\n".join(lines) + "\n").encode()


def robot_lines(robot: Robot) -> list[str]:
    """The section [robot]."""
    return [
        "[robot]",
        f"name = {quoted(robot.name)}",
        f"base = {matrix(robot.base)}",
        f"mobile = {matrix(robot.mobile)}",
        f"offset = {vector(robot.offset)}",
    ]


def provenance_lines(provenance: Mapping[str, str]) -> list[str]:
    """The section [provenance] and an empty line before it; nothing where there is none."""
    if not provenance:
        return []
    return ["", "[provenance]", *(f"{quoted(key)} = {quoted(text)}" for key, text in provenance.items())]


def _uncertainty_lines(uncertainty: Uncertainty | None) -> list[str]:
    lines = ["", "[uncertainty]"]
    if uncertainty is None:
        return [*lines, "exact = true"]
    suffix = "half_width"
    if uncertainty.factor is not None:
        lines.append(f"factor = {float(uncertainty.factor)!r}")
        suffix = "sigma"
    names = ("position", "rotation", "length")
    return lines + [f"{name}_{suffix} = {vector(getattr(uncertainty, name))}" for name in names]


def _model_lines(model: ModelChoice) -> list[str]:
    lines = ["", "[model]", f"name = {quoted(model.name)}"]
    if model.half_widths:
        widths = ", ".join(f"{name} = {float(value)!r}" for name, value in model.half_widths.items())
        lines.append(f"half_widths = {{ {widths} }}")
    return lines


def csv_bytes(campaign: Campaign) -> bytes:
    """The canonical measurements.csv; an override column is there only where some row needs it."""
    values = np.concatenate([campaign.position, campaign.quaternion, campaign.length], axis=1)
    radii = np.concatenate([campaign.position_radius, campaign.rotation_radius, campaign.length_radius], axis=1)
    stated = np.zeros(6 + campaign.legs) if campaign.uncertainty is None else campaign.uncertainty.half_widths
    differs = radii != stated
    used = np.flatnonzero(differs.any(axis=0))
    header = reading_columns(campaign.legs) + [override_columns(campaign.legs)[column] for column in used]
    own: Iterable[list[float | None]] = ([] for _ in range(len(values)))
    if len(used):
        own = (
            [value if differ else None for value, differ in zip(row, rows, strict=True)]
            for row, rows in zip(radii[:, used].tolist(), differs[:, used].tolist(), strict=True)
        )
    names = zip(campaign.pose, campaign.run, strict=True)
    return csv_table(
        header, ((ids, [*row, *extra]) for ids, row, extra in zip(names, values.tolist(), own, strict=True))
    )


def save_campaign(campaign: Campaign, path: str | os.PathLike[str]) -> None:
    """Write the campaign's two files into the folder `path`, which is made if need be.

    A new folder appears complete or not at all. In an existing folder other files stay, and campaign.toml is
    taken away first and put back last: an interruption leaves a folder that is refused, never a mixture.
    """
    write_folder(Path(path), {CSV_NAME: csv_bytes(campaign), TOML_NAME: toml_bytes(campaign)}, head=TOML_NAME)


def quoted(text: str) -> str:
    """A TOML basic string, or quoted key."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007F")


def vector(values: npt.NDArray[np.float64]) -> str:
    """A TOML array; floats by repr."""
    return "[" + ", ".join(map(repr, values.tolist())) + "]"


def matrix(rows: npt.NDArray[np.float64]) -> str:
    """A TOML array of arrays, one a line."""
    return "[\n" + "".join(f"    {vector(row)},\n" for row in rows) + "]"
