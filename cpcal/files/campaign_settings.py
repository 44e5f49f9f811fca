"""Reads campaign.toml: every problem with its line number, whatever the state of the rest."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cpcal.errors import InputError, Problem, Problems, shown
from cpcal.files.campaign_writer import FORMAT
from cpcal.robot import ModelChoice, Robot, Uncertainty

SIZE_MAX = 2**20  # bytes; a sensible campaign.toml is hundreds of times smaller

_SECTIONS = ("format", "robot", "uncertainty", "model", "provenance")
_ROBOT_KEYS = ("name", "base", "mobile", "offset")
_SIGMA_KEYS = ("position_sigma", "rotation_sigma", "length_sigma")
_WIDTH_KEYS = ("position_half_width", "rotation_half_width", "length_half_width")
_BREAKS = re.compile(r"""[][{}=,"']""")
_DOTS_MAX = 1_000  # in a key: tomllib's time grows with its square
_UNITS = {"position": "mm", "rotation": "rad", "length": "mm"}


@dataclass(frozen=True)
class Settings:
    """What campaign.toml says; `robot` and `uncertainty` are None where it is unusable or absent.

    `legs` is the number of legs as far as it can be told (to read on), or None.
    """

    robot: Robot | None
    legs: int | None
    uncertainty: Uncertainty | None
    provenance: dict[str, str]
    model: ModelChoice | None = None


def read_settings(content: bytes, where: str, problems: Problems) -> Settings:
    """The settings in the bytes of a campaign.toml called `where`; adds to `problems`."""
    document = parsed(content, where, problems)
    if document is None:
        return Settings(None, None, None, {})
    reader = Reader(document, line_numbers(content.decode("utf-8-sig"), document), where, problems)
    reader.known((), document, _SECTIONS)
    reader.format()
    robot, legs = reader.robot()
    return Settings(robot, legs, reader.uncertainty(legs), reader.provenance(), reader.model())


def parsed(content: bytes, where: str, problems: Problems, format_: str = FORMAT) -> dict[str, object] | None:
    """The TOML document in the bytes of a file called `where`; None, with a problem added, if it is none."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        problems.add(Problem(where, "is not UTF-8 text", "save the file as UTF-8 text", line))
        return None
    if not text.strip():
        problems.add(Problem(where, "is empty", f'write at least format = "{format_}" and [robot]', 1))
        return None
    for number, row in enumerate(text.split("\n"), start=1):
        if max(part.count(".") for part in _BREAKS.split(row)) > _DOTS_MAX:
            problems.add(Problem(where, "has a key of too many parts", "is this the right file?", number))
            return None
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        what, _, place = str(error).rpartition(" (at ")  # "(at line 3, column 5)" or "(at end of document)"
        digits = place.removeprefix("line ").partition(",")[0]
        line = int(digits) if digits.isdecimal() else text.rstrip().count("\n") + 1
        problems.add(Problem(where, f"is not TOML: {what[:200]}", "correct the line", line))
    except (ValueError, RecursionError):  # integers of thousands of digits; brackets nested thousands deep
        problems.add(Problem(where, "is not a sensible TOML file", "write it as the documentation shows"))
    return None


def line_numbers(text: str, document: dict[str, object]) -> dict[tuple[str, ...], int]:
    """Where each section and key of the document is first written, by its path."""
    lines: dict[tuple[str, ...], int] = {}
    section: tuple[str, ...] = ()
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


def _path(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def _leads_somewhere(path: tuple[str, ...], document: dict[str, object]) -> bool:
    value: object = document
    for key in path:
        if not isinstance(value, dict) or key not in value:
            return False
        value = value[key]
    return True


class Reader:
    """Walks the parsed document and takes note of what is wrong with it."""

    def __init__(
        self,
        document: dict[str, object],
        lines: dict[tuple[str, ...], int],
        where: str,
        problems: Problems,
    ) -> None:
        self.document, self.lines, self.where, self.problems = document, lines, where, problems

    def line(self, path: tuple[str, ...]) -> int | None:
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path)

    def wrong(self, path: tuple[str, ...], what: str, remedy: str) -> None:
        self.problems.add(Problem(self.where, what, remedy, self.line(path)))

    def known(self, path: tuple[str, ...], table: dict[str, object], keys: Iterable[str]) -> None:
        place = f" in [{'.'.join(path)}]" if path else ""
        for key in table:
            if key not in keys:
                otherwise = "the keys there are: " + ", ".join(keys)
                what, line = f"unknown key {shown(key)}{place}", self.line((*path, key))
                self.problems.add_unknown(self.where, what, key, keys, otherwise, line)

    def format(self, format_: str = FORMAT) -> None:
        found = self.document.get("format")
        if "format" not in self.document:
            self.wrong((), "the key 'format' is missing", f'add the line format = "{format_}" at the top')
        elif found != format_:
            self.wrong(("format",), f"the format is {shown(found)}", f'this program reads "{format_}" here')

    def section(self, name: str) -> dict[str, object] | None:
        table = self.document.get(name)
        if table is None or isinstance(table, dict):
            return table
        self.wrong((name,), f"{name!r} is not a section", f"write a section [{name}]")
        return None

    def robot(self) -> tuple[Robot | None, int | None]:
        table = self.section("robot")
        if table is None:
            if "robot" not in self.document:
                self.wrong((), "the section [robot] is missing", "add [robot] with name, base, mobile, offset")
            return None, None
        before = len(self.problems)
        self.known(("robot",), table, _ROBOT_KEYS)
        for key in _ROBOT_KEYS:
            if key not in table:
                self.wrong(("robot",), f"the key {key!r} is missing in [robot]", f"add {key} = ...")
        name = table.get("name", "")
        if not isinstance(name, str):
            self.wrong(("robot", "name"), f"the robot's name {shown(name)} is not text", "put it in quotes")
        counts = [len(value) for key in _ROBOT_KEYS[1:] if isinstance(value := table.get(key), list)]
        legs = counts[0] if counts else None
        base = self.points("base", table, legs)
        mobile = self.points("mobile", table, legs)
        offset = self.numbers(("robot", "offset"), table, legs, "one for each leg", signed=True)
        if len(self.problems) > before or not isinstance(name, str):
            return None, legs or None
        return Robot(name, np.array(base), np.array(mobile), np.array(offset)), legs

    def points(self, key: str, table: dict[str, object], legs: int | None) -> list[list[float]]:
        if key not in table:
            return []
        rows = table[key]
        if not isinstance(rows, list) or not rows:
            self.wrong(("robot", key), f"{key} is not a list of points", f"write {key} = [[x, y, z], ...], mm")
            return []
        if legs is not None and len(rows) != legs:
            remedy = "give one point for each leg in base and mobile, and one offset"
            self.wrong(("robot", key), f"{key} has {len(rows)} points for {legs} legs", remedy)
        return [
            self.checked(("robot", key), f"{key} of leg {i}", row, 3, "x, y and z in mm", signed=True)
            for i, row in enumerate(rows, start=1)
        ]

    def numbers(
        self,
        path: tuple[str, ...],
        table: dict[str, object],
        count: int | None,
        meaning: str,
        *,
        signed: bool,
    ) -> list[float]:
        if path[-1] not in table:
            return []
        return self.checked(path, path[-1], table[path[-1]], count, meaning, signed=signed)

    def checked(
        self,
        path: tuple[str, ...],
        name: str,
        values: object,
        count: int | None,
        meaning: str,
        *,
        signed: bool,
    ) -> list[float]:
        if not isinstance(values, list) or not values:
            self.wrong(path, f"{name} is not a list of numbers", f"give {meaning}, in brackets")
            return []
        if count is not None and len(values) != count:
            self.wrong(path, f"{name} has {len(values)} numbers, not {count}", f"give {meaning}")
        return [self.number(path, name, value, signed=signed) for value in values]

    def number(self, path: tuple[str, ...], name: str, value: object, *, signed: bool) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.wrong(path, f"{name} holds {shown(value)}, which is not a number", "give a number, unquoted")
            return 0.0
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.wrong(path, f"{name} holds {number}", "give a finite number")
        elif number < 0 and not signed:
            self.wrong(path, f"{name} holds the negative number {number:g}", "give a number >= 0")
        return number

    def uncertainty(self, legs: int | None) -> Uncertainty | None:
        table = self.section("uncertainty")
        if table is None:
            return None
        before, path = len(self.problems), ("uncertainty",)
        self.known(path, table, ("factor", *_SIGMA_KEYS, *_WIDTH_KEYS))
        direct = any(key in table for key in _WIDTH_KEYS)
        if direct and any(key in table for key in ("factor", *_SIGMA_KEYS)):
            remedy = "give either factor and three *_sigma, or three *_half_width"
            self.wrong(path, "half-widths are given both directly and as factor * sigma", remedy)
            return None
        keys = _WIDTH_KEYS if direct else _SIGMA_KEYS
        for key in keys if direct else ("factor", *keys):
            if key not in table:
                self.wrong(path, f"the key {key!r} is missing in [uncertainty]", "add it (0 means: exact)")
        values = []
        for key in keys:
            kind = key.partition("_")[0]
            meaning = f"one for each leg, {_UNITS[kind]}" if kind == "length" else f"three, {_UNITS[kind]}"
            count = legs if kind == "length" else 3
            values.append(self.numbers((*path, key), table, count, meaning, signed=False))
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
        if not (isinstance(name, str) and name.isidentifier()):
            what = f"the model's name {shown(name)} cannot be one" if "name" in table else "[model] has no name"
            self.wrong((*path, "name"), what, 'add a name, such as name = "gain"')
        if not isinstance(widths, dict):
            self.wrong((*path, "half_widths"), "half_widths is not a table", "write half_widths = { s = 0.05 }")
            return None
        numbers = {}
        for key, value in widths.items():
            if not key.isidentifier():
                self.wrong((*path, "half_widths"), f"{shown(key)} cannot be a parameter", "give its name, such as s")
            numbers[key] = self.number((*path, "half_widths"), f"the half-width of {shown(key)}", value, signed=False)
        return None if len(self.problems) > before else ModelChoice(str(name), numbers)

    def provenance(self) -> dict[str, str]:
        table = self.section("provenance") or {}
        for key, value in table.items():
            if isinstance(value, (dict, list)):
                remedy = "write a text in quotes, or a number"
                self.wrong(("provenance", key), f"{shown(key)} in [provenance] is not a text", remedy)
        return {key: value if isinstance(value, str) else str(value) for key, value in table.items()}
