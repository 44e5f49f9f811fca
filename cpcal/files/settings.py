"""What all settings files have in common: sections and values of a TOML document, each problem with its line."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from cpcal.common.errors import InputError, Problem, Problems, shown, unusable
from cpcal.common.files import NAME_MAX, NAME_REMEDY, TEXT_REMEDY, is_name, is_text, small_file, write_folder
from cpcal.common.values import Floats
from cpcal.files.tables import csv_table, toml_document
from cpcal.robot import (
    EXACT_OR_NOT,
    ROBOTS,
    Campaign,
    ModelChoice,
    Pose,
    PoseTable,
    Robot,
    Study,
    Truth,
    Uncertainty,
)
from cpcal.robot.campaign import QUATERNION_TOLERANCE, quaternion_problem
from cpcal.robot.robot import KINDS, LARGEST
from cpcal.robot.units import SHARED_COLUMNS, override_columns, reading_columns

KeyPath = tuple[str, ...]
Table = dict[str, object]
Shape = tuple[int | None, ...]
Read = Callable[["TomlReader", KeyPath, object], Any]  # a value of a schema
Schema = Mapping[str, Read]
_NONE: Schema = {}


class TomlReader:
    """Reads values out of sections; what is wrong is noted, and something harmless returned."""

    def __init__(self, content: bytes, document: Table, where: str, problems: Problems) -> None:
        self.document, self.where, self.problems = document, where, problems
        self.lines = line_numbers(content.decode("utf-8-sig"), document)
        self.sha256 = hashlib.sha256(content).hexdigest()

    @classmethod
    def opened(
        cls,
        path: Path,
        format_: str,
        sections: Iterable[str],
        problems: Problems,
        absent: str,
    ) -> Self | None:
        """A reader of a file, its format and the names of its sections checked.

        None, with a problem added, where there is no such file (`absent` is the remedy), or it is no TOML.
        """
        content, where, sections = small_file(path, problems, absent), str(path), ("format", *sections, "provenance")
        if content is None:
            return None
        document = toml_document(content, where, problems, f'format = "{format_}" and [{sections[1]}]')
        if document is None:
            return None
        reader = cls(content, document, where, problems)
        reader.known((), document, sections)
        found = document.get("format")
        if "format" not in document:
            reader.wrong((), "the key 'format' is missing", f'add the line format = "{format_}" at the top')
        elif found != format_:
            reader.wrong(("format",), f"the format is {shown(found)}", f'this program reads "{format_}" here')
        return reader

    def line(self, path: KeyPath) -> int | None:
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path)

    def wrong(self, path: KeyPath, what: str, remedy: str) -> None:
        self.problems.add(Problem(self.where, what, remedy, self.line(path)))

    def known(self, path: KeyPath, table: Table, keys: Iterable[str]) -> None:
        """Take note of keys that mean nothing."""
        place = f" in [{'.'.join(path)}]" if path else ""
        for key in table:
            if key not in keys:
                otherwise = "the keys there are: " + ", ".join(keys)
                what, line = f"unknown key {shown(key)}{place}", self.line((*path, key))
                self.problems.add_unknown(self.where, what, key, keys, otherwise, line)

    def section(self, name: str, keys: Schema, optional: Schema = _NONE, *, needed: bool = True, **more: str) -> Any:
        """The values of the section `name` by their keys; None where there is none, or a problem."""
        if name in self.document:
            return self.table((name,), self.document[name], keys, optional, **more)
        if needed:
            self.wrong((), f"the section [{name}] is missing", f"add [{name}] with {', '.join(keys)}")
        return None

    def table(
        self, path: KeyPath, table: object, keys: Schema, optional: Schema = _NONE, *, remedy: str = "add {key} = ..."
    ) -> dict[str, Any] | None:
        """The values of a table by their keys; None with a problem: a key is missing, means nothing, or is wrong."""
        if not isinstance(table, dict):
            self.wrong(path, f"{path[-1]!r} is not a section", f"write a section [{'.'.join(path)}]")
            return None
        before, every = len(self.problems), {**keys, **optional}
        self.known(path, table, every)
        for key in keys:
            if key not in table:
                self.wrong(path, f"the key {key!r} is missing in [{'.'.join(path)}]", remedy.format(key=key))
        found = {key: read(self, (*path, key), table[key]) for key, read in every.items() if key in table}
        return found if len(self.problems) == before else None

    def numbers(
        self, path: KeyPath, value: object, shape: Shape, meaning: str, *, name: str, signed: bool, by_leg: bool
    ) -> Any:
        """Nested lists of numbers. A row is called by its number, from 0 as in the arrays; or, `by_leg`, by its leg."""
        if not shape:
            return self.number(path, name, value, signed=signed)
        rows = len(shape) > 1
        what, of = ("rows", f" for {shape[0]} legs") if rows else ("numbers", f", not {shape[0]}")
        give = f"give {'one row for each leg: ' if by_leg else 'rows: ' if rows else ''}{meaning}"
        if not isinstance(value, list) or not value:
            self.wrong(path, f"{name} is not a list of {what}", f"{give}, in brackets")
            return []
        if shape[0] is not None and len(value) != shape[0]:
            self.wrong(path, f"{name} has {len(value)} {what}{of}", give)
            return []
        called = f"{name} of leg {{}}" if by_leg else f"row {{}} of {name}" if rows else name
        return [
            self.numbers(path, one, shape[1:], meaning, name=called.format(i), signed=signed, by_leg=False)
            for i, one in enumerate(value, start=int(by_leg))
        ]

    def number(self, path: KeyPath, name: str, value: object, *, signed: bool = True) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.wrong(path, f"{name} holds {shown(value)}, which is not a number", "give a number, unquoted")
            return 0.0
        if not abs(value) <= LARGEST:
            self.wrong(path, f"{name} holds {shown(value)}", f"give a finite number up to {LARGEST:g}")
            return 0.0
        if value < 0 and not signed:
            self.wrong(path, f"{name} holds the negative number {value:g}", "give a number >= 0")
        return float(value)

    def provenance(self) -> dict[str, str]:
        """The section [provenance]: texts, and numbers as they are written."""
        table, texts = self.document.get("provenance", {}), {}
        if not isinstance(table, dict):
            self.wrong(("provenance",), "'provenance' is not a section", "write a section [provenance]")
            return {}
        for key, value in table.items():
            path, name = ("provenance", key), f"{shown(key)} in [provenance]"
            if isinstance(value, (dict, list)):
                self.wrong(path, f"{name} is not a text", "write a text in quotes, or a number")
                continue
            texts[key] = value if isinstance(value, str) else str(value)
            if not is_name(key):
                self.wrong(path, f"{name} cannot be a name", NAME_REMEDY)
            if not is_text(texts[key]):
                self.wrong(path, f"{name} is {shown(texts[key])}", TEXT_REMEDY)
        return texts


def line_numbers(text: str, document: Table) -> dict[KeyPath, int]:
    """Where each section and key of the document is first written, by its path."""
    lines: dict[KeyPath, int] = {}
    section: KeyPath = ()
    for number, line in enumerate(text.split("\n"), start=1):
        if line.lstrip().startswith("["):
            path = _path(line.lstrip()[1:].partition("]")[0])
            if _leads_somewhere(path, document):  # a heading, not a row of an array
                section = path
        elif "=" in line:
            path = section + _path(line.partition("=")[0])
        else:
            continue
        if _leads_somewhere(path, document):
            for depth in range(1, len(path) + 1):
                lines.setdefault(path[:depth], number)
    return lines


def _path(dotted: str) -> KeyPath:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def _leads_somewhere(path: KeyPath, document: Table) -> bool:
    value: object = document
    for key in path:
        if not isinstance(value, dict) or key not in value:
            return False
        value = value[key]
    return True


# ------------------------------------------------------------------------------------------------------------------
# What a value may be: readers for a schema. Each takes note of what is wrong, and returns something harmless then.


def text(reader: TomlReader, path: KeyPath, value: object) -> str:
    if isinstance(value, str):
        return value
    reader.wrong(path, f"{path[-1]} is {shown(value)}, not text", "put it in quotes")
    return ""


def name(reader: TomlReader, path: KeyPath, value: object) -> str:
    """A text that can name something: see `is_name`."""
    found = text(reader, path, value)
    if not is_name(found):
        reader.wrong(path, f"{path[-1]} is {shown(found)}", NAME_REMEDY)
    return found


def one_of(choices: Iterable[str]) -> Read:
    def read(reader: TomlReader, path: KeyPath, value: object) -> object:
        if value not in list(choices):
            reader.wrong(path, f"{path[-1]} is {shown(value)}", f"give one of {', '.join(choices)}")
        return value

    return read


def truth(reader: TomlReader, path: KeyPath, value: object) -> bool:
    if not isinstance(value, bool):
        reader.wrong(path, f"{path[-1]} is {shown(value)}", "write true or false")
    return bool(value)


def whole(least: int, most: int | None = None) -> Read:
    def read(reader: TomlReader, path: KeyPath, value: object) -> int:
        if type(value) is int and least <= value <= (value if most is None else most):
            return value
        upper = "" if most is None else f" to {most}"
        reader.wrong(path, f"{path[-1]} is {shown(value)}", f"give a whole number from {least}{upper}")
        return least

    return read


def positive(unit: str) -> Read:
    def read(reader: TomlReader, path: KeyPath, value: object) -> float:
        before = len(reader.problems)
        found = reader.number(path, path[-1], value)
        if len(reader.problems) == before and not found > 0.0:
            reader.wrong(path, f"{path[-1]} is {found:g}", f"give a positive number of {unit}")
        return found

    return read


def array(shape: Shape, meaning: str = "", *, signed: bool = True, by_leg: bool = False) -> Read:
    """An array of numbers, or one number: of any length where the shape has None."""

    def read(reader: TomlReader, path: KeyPath, value: object) -> Floats | float:
        before = len(reader.problems)
        found = reader.numbers(path, value, shape, meaning, name=path[-1], signed=signed, by_leg=by_leg)
        if len(reader.problems) > before:
            return 0.0
        values = np.array(found, dtype=np.float64)
        return values if shape else float(values)

    return read


# ------------------------------------------------------------------------------------------------------------------
# Campaigns to files: canonical bytes, their digest, and writing that never leaves anything half-written.

FORMAT = "cpcal-campaign/1"
TOML_NAME = "campaign.toml"
CSV_NAME = "measurements.csv"


def toml_bytes(campaign: Campaign) -> bytes:
    """The canonical campaign.toml; floats by repr, so that they are read back bit for bit."""
    uncertainty: dict[str, object] = {"exact": True}
    if (stated := campaign.uncertainty) is not None:
        suffix = "half_width" if stated.factor is None else "sigma"
        uncertainty = {"factor": stated.factor} | {f"{kind}_{suffix}": getattr(stated, kind) for kind in KINDS}
    asked = campaign.model
    model = {} if asked is None else {"name": asked.name, "half_widths": asked.half_widths}
    return document(
        FORMAT, {"robot": _of_robot(campaign.robot), "uncertainty": uncertainty, "model": model}, campaign.provenance
    )


def _of_robot(robot: Robot) -> dict[str, object]:
    return {key: getattr(robot, key) for key in ("name", "base", "mobile", "offset")}


def document(format_: str, sections: Mapping[str, Mapping[str, object]], provenance: Mapping[str, str]) -> bytes:
    """A TOML file of its format and sections."""
    return toml_text({"format": format_, **sections, "provenance": provenance}).encode()


def toml_text(table: Mapping[str, Any]) -> str:
    """A TOML document; floats by repr. None and empty tables are left out."""
    return "\n".join(_toml(table, "")) + "\n"


def _toml(table: Mapping[str, Any], path: str) -> Iterator[str]:
    """Simple values first, then tables, then arrays of tables."""
    nested = {}
    for key, value in table.items():
        name = key if re.fullmatch("[A-Za-z0-9_-]+", key) else written(key)
        if isinstance(value, Mapping):
            nested[f"\n[{path}{name}]"] = f"{path}{name}.", [value] * bool(value)
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            nested[f"\n[[{path}{name}]]"] = f"{path}{name}.", value
        elif value is not None:
            yield f"{name} = {written(value)}"
    for head, (inner, parts) in nested.items():
        for part in parts:
            yield head
            yield from _toml(part, inner)


def written(value: Any) -> str:
    """A TOML value; floats by repr. Of an array of arrays each row has a line."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        parts = [written(part) for part in value]
        if value and isinstance(value[0], list | tuple):
            return "[\n" + "".join(f"    {part},\n" for part in parts) + "]"
        return f"[{', '.join(parts)}]"
    if isinstance(value, str):  # as JSON; a character beyond the basic plane is no two halves here
        text = json.dumps(value, ensure_ascii=False)
        return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in text)
    return repr(value).lower()


def csv_bytes(campaign: Campaign) -> bytes:
    """The canonical measurements.csv; an override column is there only where some row needs it."""
    radii = np.concatenate([campaign.position_radius, campaign.rotation_radius, campaign.length_radius], axis=1)
    stated = np.zeros(6 + campaign.legs) if campaign.uncertainty is None else campaign.uncertainty.half_widths
    own = np.where(radii != stated, radii, np.array(None)).T.tolist()
    widths = zip(override_columns(campaign.legs), own, strict=True)
    return _rows(campaign, {}, {name: column for name, column in widths if any(v is not None for v in column)})


def _rows(
    of: Campaign | PoseTable, image: Mapping[str, Sequence[str]], more: Mapping[str, Sequence[float | None]]
) -> bytes:
    """A CSV table of names, readings and `more` columns."""
    values = np.concatenate([of.position, of.quaternion, of.length], axis=1).T.tolist()
    names = {"pose": of.pose, "run": of.run, **image}
    columns = {**dict(zip(reading_columns(of.legs)[2:], values, strict=True)), **more}
    return csv_table([*names, *columns], zip(*names.values(), *columns.values(), strict=True))


def save_campaign(campaign: Campaign, path: str | os.PathLike[str]) -> None:
    """Write the campaign's two files into the folder `path`, which is made if need be.

    A new folder appears complete or not at all. In an existing folder other files stay, and campaign.toml is
    taken away first and put back last: an interruption leaves a folder that is refused, never a mixture.
    """
    write_folder(Path(path), {CSV_NAME: csv_bytes(campaign), TOML_NAME: toml_bytes(campaign)}, head=TOML_NAME)


# ------------------------------------------------------------------------------------------------------------------
# Studies to files: canonical bytes, so that the same study is always the same files.

STUDY_FORMAT = "cpcal-study/2"
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
    simulated: dict[str, object] = {}
    if (truth := study.truth) is not None:
        frames = {"camera": truth.camera, "target": truth.target}
        poses = {name: {"position": of.position, "quaternion": of.quaternion} for name, of in frames.items()}
        simulated = {"seed": truth.seed, "parameters": truth.robot.parameters, **poses}
    return document(STUDY_FORMAT, {"robot": _of_robot(study.robot), "truth": simulated}, study.provenance)


def table_bytes(table: PoseTable) -> bytes:
    """The canonical CSV of a table; columns of `image` and `shared` only where the table has them."""
    shared = () if table.shared is None else zip(SHARED_COLUMNS, table.shared.T.tolist(), strict=True)
    return _rows(table, {} if table.image is None else {"image": table.image}, dict(shared))


# ------------------------------------------------------------------------------------------------------------------
# Reads campaign.toml: every problem with its line number, whatever the state of the rest.

_SIGMA_KEYS = ("position_sigma", "rotation_sigma", "length_sigma")
_WIDTH_KEYS = ("position_half_width", "rotation_half_width", "length_half_width")
_STATED = (("factor", *_SIGMA_KEYS), _WIDTH_KEYS, ("exact",))


@dataclass(frozen=True)
class Settings:
    """What campaign.toml or study.toml says; `robot` is None where it is unusable, `uncertainty` also where readings
    are exact. `legs`: their number, as far as it can be told (to read on). `sha256`: of the file.
    """

    robot: Robot | None = None
    legs: int | None = None
    uncertainty: Uncertainty | None = None
    model: ModelChoice | None = None
    truth: Truth | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)
    sha256: str = ""


def read_settings(path: Path, problems: Problems, absent: str) -> Settings:
    """The settings in a campaign.toml; adds to `problems`."""
    reader = TomlReader.opened(path, FORMAT, ("robot", "uncertainty", "model"), problems, absent)
    if reader is None:
        return Settings()
    robot, legs = _robot(reader)
    remedy = 'add a name, such as name = "gain"'
    model = reader.section("model", {"name": _identifier}, {"half_widths": _widths}, needed=False, remedy=remedy)
    choice = None if model is None else ModelChoice(**model)
    stated = _uncertainty(reader, legs)
    return Settings(robot, legs, stated, choice, provenance=reader.provenance(), sha256=reader.sha256)


def _robot(reader: TomlReader) -> tuple[Robot | None, int | None]:
    """The robot, or None; and the number of its legs, as far as it can be told."""
    stated, keys = reader.document.get("robot"), ("base", "mobile", "offset")
    of = stated if isinstance(stated, dict) else {}
    legs = next((len(value) for key in keys if isinstance(value := of.get(key), list)), None)
    rows = array((legs, 3), "x, y and z in mm", by_leg=True)
    found = reader.section(
        "robot", {"name": name, "base": rows, "mobile": rows, "offset": array((legs,), "one for each leg")}
    )
    return (None if found is None else Robot(**found)), legs or None


def _uncertainty(reader: TomlReader, legs: int | None) -> Uncertainty | None:
    """The section [uncertainty], which says how far readings may be off, or that they are exact: None."""
    if "uncertainty" not in reader.document:
        reader.wrong((), "the section [uncertainty] is missing", EXACT_OR_NOT)
        return None
    each = ((3, "three, mm"), (3, "three, rad"), (legs, "one for each leg, mm"))
    reads = [array((count,), meaning, signed=False) for count, meaning in each]
    keys: Schema = {"factor": array((), signed=False), "exact": _exact}
    sizes = dict(zip((*_SIGMA_KEYS, *_WIDTH_KEYS), reads * 2, strict=True))
    found = reader.section("uncertainty", {}, {**keys, **sizes})
    if found is None:
        return None
    meant = max(_STATED, key=lambda ways: len(found.keys() & ways))
    for key in [key for key in meant if key not in found]:
        reader.wrong(("uncertainty",), f"the key {key!r} is missing in [uncertainty]", f"add {key}; {EXACT_OR_NOT}")
    for key in [key for key in found if key not in meant]:
        reader.wrong(("uncertainty", key), f"{key!r} is given beside {meant[0]!r}", EXACT_OR_NOT)
    if "exact" in meant or legs is None or found.keys() != {*meant}:
        return None
    position, rotation, length = (found[key] for key in meant[-3:])
    try:
        return Uncertainty(position, rotation, length, found.get("factor"))
    except InputError as error:  # single values were checked: a product overflows
        reader.wrong(("uncertainty",), error.problems[0].what, error.problems[0].remedy)
        return None


def _exact(reader: TomlReader, path: KeyPath, value: object) -> bool:
    if value is not True:
        reader.wrong(path, f"exact is {shown(value)}", EXACT_OR_NOT)
    return True


def _identifier(reader: TomlReader, path: KeyPath, value: object) -> str:
    """Of a model or its parameter; which there are is known where they are used."""
    if not (isinstance(value, str) and value.isidentifier() and len(value) <= NAME_MAX):
        reader.wrong(path, f"{shown(value)} cannot be a name", "give a word, such as gain or s")
    return str(value)


def _widths(reader: TomlReader, path: KeyPath, value: object) -> dict[str, float]:
    if not isinstance(value, dict):
        reader.wrong(path, "half_widths is not a table", "write half_widths = { s = 0.05 }")
        return {}
    return {
        _identifier(reader, path, k): reader.number(path, f"the half-width of {shown(k)}", v, signed=False)
        for k, v in value.items()
    }


# ------------------------------------------------------------------------------------------------------------------
# Reads study.toml: every problem with its line number, whatever the state of the rest.

_WHOLE = "add {key}, or take [truth] out"


def read_study_settings(path: Path, problems: Problems, absent: str) -> Settings:
    """The settings in a study.toml; adds to `problems`."""
    reader = TomlReader.opened(path, STUDY_FORMAT, ("robot", "truth"), problems, absent)
    if reader is None:
        return Settings()
    robot, legs = _robot(reader)
    parameters = array((legs, 7), "ax, ay, az, bx, by, bz, l in mm", by_leg=True)

    keys = {"seed": whole(0), "parameters": parameters, "camera": _pose, "target": _pose}
    found = reader.section("truth", keys, needed=False, remedy=_WHOLE)
    truth = None
    if found is not None and robot is not None:
        found["robot"] = Robot.from_parameters(robot.name, found.pop("parameters"))
        truth = Truth(**found)
    return Settings(robot, legs, truth=truth, provenance=reader.provenance())


def _pose(reader: TomlReader, path: KeyPath, value: object) -> Pose | None:
    keys = {"position": array((3,), "x, y and z in mm"), "quaternion": array((4,), "qw, qx, qy and qz")}
    found = reader.table(path, value, keys, remedy=_WHOLE)
    if found is None:
        return None
    norm = math.hypot(*found["quaternion"])
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        reader.wrong((*path, "quaternion"), *quaternion_problem(norm))
    return Pose(**found)


# ------------------------------------------------------------------------------------------------------------------
# A commented campaign.toml to fill in: for a robot of the catalogue, or for one's own.

_LEGS_MAX = 1_000
_START = """\
# A campaign: what was measured on one robot. Beside this file stands measurements.csv; docs/your-data.md explains both.
# Every nan is to be replaced by a number. Lengths are in mm, angles in radians.
"""
_COMMENTS = {
    "base": "centres of the joints on the base, one row x, y, z a leg, mm, in the base frame",
    "mobile": "centres of the joints on the moving platform, one row a leg in the same order, mm, in the mobile frame",
    "offset": "what a reading lacks of the leg's length, mm: length = reading + offset; 0 where whole lengths are read",
}
_UNCERTAINTY = """
[uncertainty]
# How far readings may be off: half-width = factor * standard deviation. Or put the one line `exact = true` here.
factor = 3.0
position_sigma = [nan, nan, nan]    # x, y, z of the pose, mm
rotation_sigma = [nan, nan, nan]    # rotation vector in the base frame, rad (0.01 degrees are 0.000175)
"""
_REST = """
# [model]                             # the leg model; without it the plain one: see docs/models.md
# name = "gain"

[provenance]                          # free text, shown in reports
# date = "2026-01-31"
# operator = ""
# serial = ""
"""


def settings_template(name: str, legs: int) -> str:
    """The text of a campaign.toml: the drawing of a known robot, or nan for `legs` legs of one called `name`.

    Raises InputError for a name or a number of legs that cannot be.
    """
    known = ROBOTS.get(name.casefold())
    if known is None and not 1 <= legs <= _LEGS_MAX:
        raise unusable("option legs", f"has no meaning: {legs}", f"give 1 to {_LEGS_MAX}")
    blank = np.full((legs, 3), np.nan)
    robot: dict[str, Any] = {"name": name, "base": blank, "mobile": blank, "offset": blank[:, 0]}
    lines = [f"{_START}format = {written(FORMAT)}", "", "[robot]"]
    if known is not None:
        robot = _of_robot(known.robot)
        lines.append(f"# Dimensions: {known.source}")
    for key, value in robot.items():
        lines += [*([f"# {_COMMENTS[key]}"] if key in _COMMENTS else []), f"{key} = {written(value)}"]
    lengths = np.full(len(robot["offset"]), np.nan)
    uncertain = f"{_UNCERTAINTY}length_sigma = {written(lengths)}    # leg readings, mm, one for each leg"
    return "\n".join([*lines, uncertain, _REST])
