"""target.toml (docs/vision-files.md): read with every problem and its line, written as canonical bytes."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from cpcal.common.atomic import write_file
from cpcal.common.errors import Problems, shown
from cpcal.files.campaign_writer import matrix, provenance_lines, quoted
from cpcal.vision.files.sections import Table, TomlReader, opened
from cpcal.vision.target import Target, wrong_deviations

TARGET_FORMAT = "cpcal-target/1"

_KEYS = ("name", "bright", "radius", "lines", "dots")
_MEASURED = ("scale", "scale_sigma", "dot_sigma")  # of the plate as it was printed


def load_target(path: str | os.PathLike[str]) -> Target:
    """The target in the file `path`. Raises one InputError that lists every problem of the file."""
    problems = Problems()
    reader = opened(path, TARGET_FORMAT, ("target",), problems)
    target = None if reader is None else _target(reader)
    problems.raise_any()
    assert target is not None  # what keeps it from being read is a problem, and was raised
    return target


def save_target(target: Target, path: str | os.PathLike[str], provenance: dict[str, str] | None = None) -> None:
    """Write the target to the file `path`, complete or not at all. Raises InputError when it cannot be written."""
    write_file(Path(path), target_bytes(target, provenance))


def target_bytes(target: Target, provenance: dict[str, str] | None = None) -> bytes:
    """The canonical target.toml; floats by repr, so that they are read back bit for bit."""
    lines = [f"format = {quoted(TARGET_FORMAT)}", "", "[target]", f"name = {quoted(target.name)}"]
    lines += [f"bright = {str(target.bright).lower()}", f"radius = {float(target.radius)!r}"]
    lines += [f"{key} = {value!r}" for key in _MEASURED[1:] if (value := float(getattr(target, key)))]
    lines += ["lines = [", *(f"    {list(line)}," for line in target.lines), "]"]
    lines += [f"dots = {matrix(target.dots)}", *provenance_lines(provenance or {})]
    return ("\n".join(lines) + "\n").encode()


def _target(reader: TomlReader) -> Target | None:
    problems = reader.problems
    reader.provenance()
    table = reader.required("target", _KEYS, _MEASURED)
    if table is None:
        return None
    name, bright = reader.text(("target", "name"), table), reader.truth(("target", "bright"), table)
    radius = reader.positive(("target", "radius"), table, "mm")
    scale = reader.positive(("target", "scale"), table, "true millimetres by stated ones")
    scale_sigma, dot_sigma = (
        reader.number(("target", key), key, table[key], signed=False) if key in table else 0.0 for key in _MEASURED[1:]
    )
    before = len(problems)
    dots = reader.rows(("target", "dots"), table, 2, "x and y in mm")
    if "dots" not in table or len(problems) > before:
        _lines(reader, table, None)
        return None
    lines = _lines(reader, table, len(dots))
    if problems.listed:
        return None
    places, radius = scale * np.array(dots), scale * radius
    wrong = Target.problems_of(places, radius, lines) or wrong_deviations(scale_sigma, dot_sigma, radius)
    for problem in wrong:
        key = problem.where.rpartition(" ")[2]  # radius, dots or lines
        what = problem.what if problem.what.startswith(("(", "the")) else f"{key} {problem.what}"
        reader.wrong(("target", key), what, problem.remedy)
    return None if problems.listed else Target(name, places, radius, lines, bright, scale_sigma, dot_sigma)


def _lines(reader: TomlReader, table: Table, dots: int | None) -> tuple[tuple[int, ...], ...]:
    """Rows of whole numbers; `dots`: how many there are, where that is known."""
    path, value = ("target", "lines"), table.get("lines", [])
    if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
        reader.wrong(path, "lines is not a list of rows", "write lines = [[0, 1, 2, 3], ...], numbers of dots from 0")
        return ()
    for i, row in enumerate(value):
        for number in row:
            if isinstance(number, bool) or not isinstance(number, int):
                reader.wrong(path, f"row {i} of lines holds {shown(number)}", "give whole numbers, dots from 0")
            elif not (number >= 0 and (dots is None or number < dots)):
                remedy = "number dots from 0" if dots is None else f"dots are numbered from 0 to {dots - 1}"
                reader.wrong(path, f"row {i} of lines names the dot {shown(number)}, which is not there", remedy)
    return tuple(tuple(row) for row in value)
