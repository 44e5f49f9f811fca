"""rig.toml (docs/vision-files.md): cameras that stand still to each other."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, Problems
from cpcal.common.names import is_name
from cpcal.files.campaign_writer import matrix, quoted
from cpcal.vision.camera import CAMERA_NUMBERS, Camera
from cpcal.vision.files.camera_file import CameraRecord
from cpcal.vision.files.sections import Table, TomlReader, opened
from cpcal.vision.rig.rig import EACH, MOST, Rig

RIG_FORMAT = "cpcal-rig/1"
_KEYS = ("names", "sizes", "cameras", "positions", "quaternions", "covariance", "rms")


def load_rig(path: str | os.PathLike[str]) -> Rig:
    """The rig in a rig.toml. Raises one InputError that lists every problem."""
    problems = Problems()
    reader = opened(path, RIG_FORMAT, ("rig",), problems)
    rig = None if reader is None else _rig(reader)
    problems.raise_any()
    assert rig is not None  # what keeps it from being read is a problem, and was raised
    return rig


def save_rig(rig: Rig, path: str | os.PathLike[str]) -> None:
    """Write the rig to the file `path`, complete or not at all. Raises InputError when it cannot be written."""
    write_file(Path(path), rig_bytes(rig))


def rig_bytes(rig: Rig) -> bytes:
    """The canonical rig.toml; floats by repr, so that they are read back bit for bit."""
    lines = [f"format = {quoted(RIG_FORMAT)}", "", "[rig]", f"names = [{', '.join(map(quoted, rig.names))}]"]
    lines.append(f"sizes = {[[int(c.width), int(c.height)] for c in rig.cameras]}")
    lines.append(f"cameras = {matrix(np.array([c.numbers for c in rig.cameras]))}")
    lines += [f"positions = {matrix(rig.position)}", f"quaternions = {matrix(rig.quaternion)}"]
    lines += [f"rms = {float(rig.rms)!r}", f"covariance = {matrix(rig.covariance)}"]
    return ("\n".join(lines) + "\n").encode()


def _rig(reader: TomlReader) -> Rig | None:
    reader.provenance()
    table = reader.required("rig", _KEYS)
    if table is None:
        return None
    names = _names(reader, table)
    count = len(names)
    sizes = _rows(reader, table, "sizes", 2, "width and height of each camera's images", count)
    numbers = _rows(reader, table, "cameras", len(CAMERA_NUMBERS), ", ".join(CAMERA_NUMBERS), count)
    positions = _rows(reader, table, "positions", 3, "of the first camera's frame in each, mm", count)
    turns = _rows(reader, table, "quaternions", 4, "of the first camera's frame in each, scalar first", count)
    covariance = _rows(reader, table, "covariance", EACH * count, f"{EACH} rows for each camera", EACH * count)
    rms = reader.number(("rig", "rms"), "rms", table.get("rms", 0.0), signed=False)
    if reader.problems.listed:
        return None
    try:
        cameras = []
        for (width, height), row in zip(sizes, numbers, strict=True):
            pinhole = np.array(row)
            cameras.append(Camera(int(width), int(height), pinhole[:2], pinhole[2:4], pinhole[4:]))
            CameraRecord(cameras[-1])
        return Rig(names, tuple(cameras), np.array(positions), np.array(turns), np.array(covariance), rms)
    except InputError as error:
        for problem in error.problems:
            reader.wrong(("rig",), f"{problem.where} {problem.what}", problem.remedy)
        return None


def _names(reader: TomlReader, table: Table) -> tuple[str, ...]:
    value = table.get("names")
    good = isinstance(value, list) and 2 <= len(value) <= MOST
    if not (good and isinstance(value, list) and all(isinstance(name, str) and is_name(name) for name in value)):
        reader.wrong(("rig", "names"), "names is no list of names", f"give from 2 to {MOST}, as the folders of images")
        return ()
    return tuple(value)


def _rows(reader: TomlReader, table: Table, key: str, width: int, meaning: str, count: int) -> list[list[float]]:
    rows = reader.rows(("rig", key), table, width, meaning)
    if rows and len(rows) != count:
        reader.wrong(("rig", key), f"{key} has {len(rows)} rows, not {count}", f"give {meaning}")
    return rows
