"""Studies to files: canonical bytes, so that the same study is always the same files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from cpcal.common.atomic import write_folder
from cpcal.files.campaign_writer import (
    matrix,
    provenance_lines,
    quoted,
    robot_lines,
    vector,
)
from cpcal.files.cells import csv_table
from cpcal.robot import Pose, PoseTable, Study, Truth
from cpcal.robot.columns import SHARED_COLUMNS, reading_columns
from cpcal.robot.mechanisms import FIELDS

STUDY_FORMAT = "cpcal-study/1"
STUDY_NAME = "study.toml"
CALIBRATION_NAME = "calibration.csv"
VALIDATION_NAME = "validation.csv"


def save_study(study: Study, path: str | os.PathLike[str]) -> None:
    """Write the study's three files into the folder `path`, which is made if need be.

    A new folder appears complete or not at all; in an existing one other files stay, and study.toml comes last.
    Raises InputError when the folder cannot be written.
    """
    contents = {
        CALIBRATION_NAME: table_bytes(study.calibration),
        VALIDATION_NAME: table_bytes(study.validation),
        STUDY_NAME: study_bytes(study),
    }
    write_folder(Path(path), contents, head=STUDY_NAME)


def study_bytes(study: Study) -> bytes:
    """The canonical study.toml; floats by repr, so that they are read back bit for bit."""
    lines = [f"format = {quoted(STUDY_FORMAT)}", "", *robot_lines(study.robot)]
    lines += provenance_lines(study.provenance)
    if study.truth is not None:
        lines += ["", *_truth_lines(study.truth)]
    return ("\n".join(lines) + "\n").encode()


def _truth_lines(truth: Truth) -> list[str]:
    lines = ["[truth]", f"seed = {truth.seed}", f"parameters = {matrix(truth.robot.parameters)}"]
    lines += ["", "[truth.camera]", *_pose_lines(truth.camera)]
    lines += ["", "[truth.target]", *_pose_lines(truth.target)]
    lines += ["", "[truth.mechanisms]"]
    for name in FIELDS:
        values = np.asarray(getattr(truth.mechanisms, name))
        text = repr(float(values)) if values.ndim == 0 else vector(values) if values.ndim == 1 else matrix(values)
        lines.append(f"{name} = {text}")
    return lines


def _pose_lines(pose: Pose) -> list[str]:
    return [f"position = {vector(pose.position)}", f"quaternion = {vector(pose.quaternion)}"]


def table_bytes(table: PoseTable) -> bytes:
    """The canonical CSV of a table; columns of `image` and `shared` only where the table has them."""
    extra = {} if table.image is None else {"image": table.image}
    names = [table.pose, table.run, *extra.values()]
    header = reading_columns(table.legs)
    header[2:2] = extra
    columns = [table.position, table.quaternion, table.length]
    if table.shared is not None:
        header += SHARED_COLUMNS
        columns.append(table.shared)
    values = np.concatenate(columns, axis=1).tolist()
    return csv_table(header, zip(zip(*names, strict=True), values, strict=True))
