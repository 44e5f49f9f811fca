"""What all settings files have in common: sections and values of a TOML document, each problem with its line."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem, Problems, shown
from cpcal.common.files import NAME_MAX, NAME_REMEDY, TEXT_REMEDY, is_name, is_text, write_folder
from cpcal.common.values import Floats
from cpcal.files.tables import csv_table, toml_document
from cpcal.robot import (
    EXACT_OR_NOT,
    ROBOTS,
    Mechanisms,
    ModelChoice,
    Pose,
    PoseTable,
    Robot,
    Study,
    Truth,
    Uncertainty,
)
from cpcal.robot.campaign import QUATERNION_TOLERANCE, quaternion_problem
from cpcal.robot.robot import FIELDS, KINDS, LARGEST, wrong_value
from cpcal.robot.units import SHARED_COLUMNS, override_columns, reading_columns

if TYPE_CHECKING:
    from cpcal.robot import Campaign, ModelChoice, Robot, Uncertainty

KeyPath = tuple[str, ...]
Table = dict[str, object]


class TomlReader:
    """Reads values out of sections; what is wrong is noted, and something harmless returned."""

    def __init__(self, document: Table, lines: dict[KeyPath, int], where: str, problems: Problems) -> None:
        self.document, self.lines, self.where, self.problems = document, lines, where, problems

    @classmethod
    def of(cls, content: bytes, where: str, format_: str, sections: Iterable[str], problems: Problems) -> Self | None:
        """A reader of the bytes of a file called `where`, its format and the names of its sections checked.

        None, with a problem added, where the file is no TOML.
        """
        sections = ("format", *sections)
        start = f'format = "{format_}"' + "".join(f" and [{name}]" for name in sections[1:2])
        document = toml_document(content, where, problems, start)
        if document is None:
            return None
        reader = cls(document, line_numbers(content.decode("utf-8-sig"), document), where, problems)
        reader.known((), document, sections)
        reader._format(format_)
        return reader

    def _format(self, wanted: str) -> None:
        found = self.document.get("format")
        if "format" not in self.document:
            self.wrong((), "the key 'format' is missing", f'add the line format = "{wanted}" at the top')
        elif found != wanted:
            self.wrong(("format",), f"the format is {shown(found)}", f'this program reads "{wanted}" here')

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

    def complete(self, path: KeyPath, table: Table, keys: Iterable[str], remedy: str = "add {key} = ...") -> None:
        """Take note of keys that are missing."""
        for key in keys:
            if key not in table:
                self.wrong(path, f"the key {key!r} is missing in [{'.'.join(path)}]", remedy.format(key=key))

    def section(self, name: str) -> Table | None:
        """The section `name`; None where there is none, or a problem."""
        table = self.document.get(name)
        if table is None or isinstance(table, dict):
            return table
        self.wrong((name,), f"{name!r} is not a section", f"write a section [{name}]")
        return None

    def required(self, name: str, keys: Iterable[str], optional: Iterable[str] = ()) -> Table | None:
        """The section `name`, with note of it or keys of it that are missing or mean nothing."""
        table = self.section(name)
        if table is None:
            if name not in self.document:
                self.wrong((), f"the section [{name}] is missing", f"add [{name}] with {', '.join(keys)}")
            return None
        self.known((name,), table, (*keys, *optional))
        self.complete((name,), table, keys)
        return table

    def text(self, path: KeyPath, table: Table) -> str:
        value = table.get(path[-1], "")
        if not isinstance(value, str):
            self.wrong(path, f"{path[-1]} is {shown(value)}, not text", "put it in quotes")
            return ""
        return value

    def name(self, path: KeyPath, table: Table) -> str:
        """A text that can name something: see `is_name`."""
        text = self.text(path, table)
        if not is_name(text):
            self.wrong(path, f"{path[-1]} is {shown(text)}", NAME_REMEDY)
        return text

    def truth(self, path: KeyPath, table: Table) -> bool:
        value = table.get(path[-1], True)
        if not isinstance(value, bool):
            self.wrong(path, f"{path[-1]} is {shown(value)}", "write true or false")
            return True
        return value

    def whole(self, path: KeyPath, table: Table, least: int, most: int) -> int:
        value = table.get(path[-1], least)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            self.wrong(path, f"{path[-1]} is {shown(value)}", f"give a whole number from {least} to {most}")
            return least
        return value

    def positive(self, path: KeyPath, table: Table, unit: str) -> float:
        if path[-1] not in table:
            return 1.0
        before = len(self.problems)
        value = self.number(path, path[-1], table[path[-1]], signed=True)
        if len(self.problems) == before and not value > 0.0:
            self.wrong(path, f"{path[-1]} is {value:g}", f"give a positive number of {unit}")
        return value

    def rows(
        self, path: KeyPath, table: Table, width: int, meaning: str, *, by_leg: bool = False, legs: int | None = None
    ) -> list[list[float]]:
        """Rows of `width` numbers. A row is called by its number, from 0 as in the arrays; or, `by_leg`, by its leg."""
        name = path[-1]
        if name not in table:
            return []
        values, each = table[name], "one row for each leg" if by_leg else "rows"
        if not isinstance(values, list) or not values:
            self.wrong(path, f"{name} is not a list of rows", f"give {each}: {meaning}, in brackets")
            return []
        if legs is not None and len(values) != legs:
            self.wrong(path, f"{name} has {len(values)} rows for {legs} legs", f"give {each}: {meaning}")
        called = f"{name} of leg {{}}" if by_leg else f"row {{}} of {name}"
        return [
            self.checked(path, called.format(i), row, width, meaning, signed=True)
            for i, row in enumerate(values, start=int(by_leg))
        ]

    def numbers(self, path: KeyPath, table: Table, count: int | None, meaning: str, *, signed: bool) -> list[float]:
        if path[-1] not in table:
            return []
        return self.checked(path, path[-1], table[path[-1]], count, meaning, signed=signed)

    def checked(
        self, path: KeyPath, name: str, values: object, count: int | None, meaning: str, *, signed: bool
    ) -> list[float]:
        if not isinstance(values, list) or not values:
            self.wrong(path, f"{name} is not a list of numbers", f"give {meaning}, in brackets")
            return []
        if count is not None and len(values) != count:
            self.wrong(path, f"{name} has {len(values)} numbers, not {count}", f"give {meaning}")
        return [self.number(path, name, value, signed=signed) for value in values]

    def number(self, path: KeyPath, name: str, value: object, *, signed: bool) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.wrong(path, f"{name} holds {shown(value)}, which is not a number", "give a number, unquoted")
            return 0.0
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.wrong(path, f"{name} holds {number}", "give a finite number")
        elif abs(number) > LARGEST:
            self.wrong(path, f"{name} holds {number:g}", f"give a number up to {LARGEST:g}")
        elif number < 0 and not signed:
            self.wrong(path, f"{name} holds the negative number {number:g}", "give a number >= 0")
        return number

    def provenance(self) -> dict[str, str]:
        """The section [provenance]: texts, and numbers as they are written."""
        table = self.section("provenance") or {}
        texts = {}
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
# Campaigns to files: canonical bytes, their digest, and writing that never leaves anything half-written.

FORMAT = "cpcal-campaign/1"
TOML_NAME = "campaign.toml"
CSV_NAME = "measurements.csv"


def toml_bytes(campaign: Campaign) -> bytes:
    """The canonical campaign.toml; floats by repr, so that they are read back bit for bit."""
    lines = [f"format = {quoted(FORMAT)}", "", *robot_lines(campaign.robot)]
    lines += ["", "[uncertainty]"]
    if (stated := campaign.uncertainty) is None:
        lines.append("exact = true")
    else:
        lines += [] if stated.factor is None else [f"factor = {float(stated.factor)!r}"]
        suffix = "half_width" if stated.factor is None else "sigma"
        lines += [f"{name}_{suffix} = {vector(getattr(stated, name))}" for name in KINDS]
    if (model := campaign.model) is not None:
        lines += ["", "[model]", f"name = {quoted(model.name)}"]
        widths = ", ".join(f"{name} = {float(value)!r}" for name, value in model.half_widths.items())
        lines += [f"half_widths = {{ {widths} }}"] if widths else []
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


# ------------------------------------------------------------------------------------------------------------------
# Studies to files: canonical bytes, so that the same study is always the same files.

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


# ------------------------------------------------------------------------------------------------------------------
# Reads campaign.toml: every problem with its line number, whatever the state of the rest.

_SECTIONS = ("robot", "uncertainty", "model", "provenance")
_ROBOT_KEYS = ("name", "base", "mobile", "offset")
_SIGMA_KEYS = ("position_sigma", "rotation_sigma", "length_sigma")
_WIDTH_KEYS = ("position_half_width", "rotation_half_width", "length_half_width")


@dataclass(frozen=True)
class Settings:
    """What campaign.toml says; `robot` is None where it is unusable, `uncertainty` also where readings are exact.

    `legs` is the number of legs as far as it can be told (to read on), or None.
    """

    robot: Robot | None
    legs: int | None
    uncertainty: Uncertainty | None
    provenance: dict[str, str]
    model: ModelChoice | None = None


def read_settings(content: bytes, where: str, problems: Problems) -> Settings:
    """The settings in the bytes of a campaign.toml called `where`; adds to `problems`."""
    reader = SettingsReader.of(content, where, FORMAT, _SECTIONS, problems)
    if reader is None:
        return Settings(None, None, None, {})
    robot, legs = reader.robot()
    return Settings(robot, legs, reader.uncertainty(legs), reader.provenance(), reader.model())


def _each_kind(legs: int | None) -> tuple[tuple[int | None, str, str], ...]:
    """How many numbers of a position, a rotation and lengths there are, in words too, and their units."""
    return (3, "three", "mm"), (3, "three", "rad"), (legs, "one for each leg", "mm")


class SettingsReader(TomlReader):
    """Reads the sections of campaign.toml, of which study.toml has some too."""

    def robot(self) -> tuple[Robot | None, int | None]:
        """The robot, or None; and the number of its legs, as far as it can be told."""
        before, path = len(self.problems), ("robot",)
        table = self.required("robot", _ROBOT_KEYS)
        if table is None:
            return None, None
        name = self.name(("robot", "name"), table)
        counts = [len(value) for key in _ROBOT_KEYS[1:] if isinstance(value := table.get(key), list)]
        legs = counts[0] if counts else None
        meaning = "x, y and z in mm"
        base, mobile = (self.rows((*path, key), table, 3, meaning, by_leg=True, legs=legs) for key in _ROBOT_KEYS[1:3])
        offset = self.numbers(("robot", "offset"), table, legs, "one for each leg", signed=True)
        if len(self.problems) > before:
            return None, legs or None
        return Robot(name, np.array(base), np.array(mobile), np.array(offset)), legs

    def uncertainty(self, legs: int | None) -> Uncertainty | None:
        """The section [uncertainty], which says how far readings may be off, or that they are exact: None."""
        before, path = len(self.problems), ("uncertainty",)
        table = self.section("uncertainty")
        if table is None and "uncertainty" not in self.document:
            self.wrong((), "the section [uncertainty] is missing", EXACT_OR_NOT)
        if table is None:
            return None
        self.known(path, table, ("exact", "factor", *_SIGMA_KEYS, *_WIDTH_KEYS))
        if "exact" in table:
            if table["exact"] is not True:
                self.wrong((*path, "exact"), f"exact is {shown(table['exact'])}", EXACT_OR_NOT)
            elif len(table) > 1:
                other = next(key for key in table if key != "exact")
                self.wrong((*path, other), f"readings are exact, and {shown(other)} is given too", EXACT_OR_NOT)
            return None
        direct = any(key in table for key in _WIDTH_KEYS)
        if direct and any(key in table for key in ("factor", *_SIGMA_KEYS)):
            remedy = "give either factor and three *_sigma, or three *_half_width"
            self.wrong(path, "half-widths are given both directly and as factor * sigma", remedy)
            return None
        keys = _WIDTH_KEYS if direct else _SIGMA_KEYS
        self.complete(path, table, keys if direct else ("factor", *keys), f"add {{key}}; {EXACT_OR_NOT}")
        values = [
            self.numbers((*path, key), table, count, f"{each}, {unit}", signed=False)
            for key, (count, each, unit) in zip(keys, _each_kind(legs), strict=True)
        ]
        factor = None if direct else self.number((*path, "factor"), "factor", table.get("factor", 0), signed=False)
        if len(self.problems) > before or legs is None:
            return None
        position, rotation, length = (np.array(row) for row in values)
        try:
            return Uncertainty(position, rotation, length, factor)
        except InputError:  # single values were checked: a product overflows
            self.wrong(path, "factor * sigma is too large for a number", "give smaller ones")
            return None

    def model(self) -> ModelChoice | None:
        """The table [model]: its form. Which models there are is known where they are used."""
        table = self.section("model")
        if table is None:
            return None
        before, path = len(self.problems), ("model",)
        self.known(path, table, ("name", "half_widths"))
        name, widths = table.get("name"), table.get("half_widths", {})
        if not (isinstance(name, str) and name.isidentifier() and len(name) <= NAME_MAX):
            what = f"the model's name {shown(name)} cannot be one" if "name" in table else "[model] has no name"
            self.wrong((*path, "name"), what, 'add a name, such as name = "gain"')
        if not isinstance(widths, dict):
            self.wrong((*path, "half_widths"), "half_widths is not a table", "write half_widths = { s = 0.05 }")
            return None
        numbers = {}
        for key, value in widths.items():
            if not (key.isidentifier() and len(key) <= NAME_MAX):
                self.wrong((*path, "half_widths"), f"{shown(key)} cannot be a parameter", "give its name, such as s")
            numbers[key] = self.number((*path, "half_widths"), f"the half-width of {shown(key)}", value, signed=False)
        return None if len(self.problems) > before else ModelChoice(str(name), numbers)


# ------------------------------------------------------------------------------------------------------------------
# Reads study.toml: every problem with its line number, whatever the state of the rest.

_STUDY_SECTIONS = ("robot", "provenance", "truth")
_WHOLE = "add {key}, or take [truth] out"
_TRUTH_KEYS = ("seed", "parameters", "camera", "target", "mechanisms")


@dataclass(frozen=True)
class StudySettings:
    """What study.toml says; `robot` is None where it is unusable. `legs`: their number, as far as it can be told."""

    robot: Robot | None
    legs: int | None
    truth: Truth | None
    provenance: dict[str, str]


def read_study_settings(content: bytes, where: str, problems: Problems) -> StudySettings:
    """The settings in the bytes of a study.toml called `where`; adds to `problems`."""
    reader = _StudyReader.of(content, where, STUDY_FORMAT, _STUDY_SECTIONS, problems)
    if reader is None:
        return StudySettings(None, None, None, {})
    robot, legs = reader.robot()
    return StudySettings(robot, legs, reader.true_values(robot, legs), reader.provenance())


class _StudyReader(SettingsReader):
    def true_values(self, robot: Robot | None, legs: int | None) -> Truth | None:
        """The section [truth]; None where there is none, or a problem."""
        table = self.section("truth")
        if table is None:
            return None
        before = len(self.problems)
        self.known(("truth",), table, _TRUTH_KEYS)
        self.complete(("truth",), table, _TRUTH_KEYS, _WHOLE)
        seed = table.get("seed", 0)
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            self.wrong(("truth", "seed"), f"seed is {shown(seed)}", "give a whole number from 0")
            seed = 0
        meaning = "ax, ay, az, bx, by, bz, l in mm"
        parameters = self.rows(("truth", "parameters"), table, 7, meaning, by_leg=True, legs=legs)
        camera, target = self.pose("camera", table), self.pose("target", table)
        mechanisms = self.mechanisms(table, legs)
        if len(self.problems) > before or robot is None or camera is None or target is None or mechanisms is None:
            return None
        return Truth(seed, Robot.from_parameters(robot.name, parameters), mechanisms, camera, target)

    def part(self, name: str, table: Table, keys: tuple[str, ...]) -> Table | None:
        """The section [truth.name], with note of keys that mean nothing or are missing."""
        if name not in table:
            return None
        values = table[name]
        if not isinstance(values, dict):
            self.wrong(("truth", name), f"{name!r} is not a section", f"write a section [truth.{name}]")
            return None
        self.known(("truth", name), values, keys)
        self.complete(("truth", name), values, keys, _WHOLE)
        return values

    def pose(self, name: str, table: Table) -> Pose | None:
        values = self.part(name, table, ("position", "quaternion"))
        if values is None:
            return None
        before, path = len(self.problems), ("truth", name)
        position = self.numbers((*path, "position"), values, 3, "x, y and z in mm", signed=True)
        quaternion = self.numbers((*path, "quaternion"), values, 4, "qw, qx, qy and qz", signed=True)
        if len(self.problems) > before:
            return None
        norm = math.hypot(*quaternion)
        if abs(norm - 1.0) > QUATERNION_TOLERANCE:
            self.wrong((*path, "quaternion"), *quaternion_problem(norm))
        return Pose(np.array(position, dtype=np.float64), np.array(quaternion, dtype=np.float64))

    def mechanisms(self, table: Table, legs: int | None) -> Mechanisms | None:
        values = self.part("mechanisms", table, tuple(FIELDS))
        if values is None:
            return None
        before = len(self.problems)
        read = {name: self.field(name, width, values, legs) for name, width in FIELDS.items() if name in values}
        whole = legs is not None and len(read) == len(FIELDS) and len(self.problems) == before
        return Mechanisms(**read) if whole else None  # type: ignore[arg-type]

    def field(self, name: str, width: int | None, values: Table, legs: int | None) -> Floats | float:
        """One value of the mechanisms: a number, one number a leg, or one row a leg."""
        path, before = ("truth", "mechanisms", name), len(self.problems)
        read: object
        if width is None:
            read = self.number(path, name, values[name], signed=True)
        elif width == 1:
            read = self.numbers(path, values, legs, "one for each leg", signed=True)
        else:
            read = self.rows(path, values, width, f"{width} numbers for each leg", by_leg=True, legs=legs)
        if len(self.problems) > before:
            return np.zeros(0)
        array = np.array(read, dtype=np.float64)
        if (wrong := wrong_value(name, array)) is not None:
            self.wrong(path, f"{name} {wrong[0]}", wrong[1])
        return float(array) if width is None else array


# ------------------------------------------------------------------------------------------------------------------
# A commented campaign.toml to fill in: for a robot of the catalogue, or for one's own.

_LEGS_MAX = 1_000
_START = """\
# A campaign: what was measured on one robot. Beside this file stands measurements.csv; docs/your-data.md explains both.
# Every nan is to be replaced by a number. Lengths are in mm, angles in radians.
"""
_BASE = "# centres of the joints on the base, one row x, y, z a leg, mm, in the base frame"
_MOBILE = "# centres of the joints on the moving platform, one row a leg in the same order, mm, in the mobile frame"
_OFFSET = "# what a reading lacks of the leg's length, mm: length = reading + offset; 0 where whole lengths are read"
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
        raise InputError([Problem("option legs", f"has no meaning: {legs}", f"give 1 to {_LEGS_MAX}")])
    blank = np.full((legs, 3), np.nan)
    title, base, mobile, offset = name, blank, blank, blank[:, 0]
    source = []
    if known is not None:
        robot = known.robot
        title, base, mobile, offset = robot.name, robot.base, robot.mobile, robot.offset
        source = [f"# Dimensions: {known.source}"]
    lines = [_START + f"format = {quoted(FORMAT)}", "", "[robot]", *source, f"name = {quoted(title)}"]
    lines += [_BASE, f"base = {matrix(base)}", _MOBILE, f"mobile = {matrix(mobile)}"]
    lines += [_OFFSET, f"offset = {vector(offset)}"]
    lengths = f"length_sigma = {vector(np.full(len(offset), np.nan))}    # leg readings, mm, one for each leg"
    return "\n".join([*lines, _UNCERTAINTY + lengths, _REST])
