"""What all settings files have in common: sections and values of a TOML document, each problem with its line."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Self

from cpcal.common.errors import Problem, Problems, shown
from cpcal.common.names import NAME_REMEDY, TEXT_REMEDY, is_name, is_text
from cpcal.files.documents import toml_document
from cpcal.robot.robot import LARGEST

Path = tuple[str, ...]
Table = dict[str, object]


class TomlReader:
    """Reads values out of sections; what is wrong is noted, and something harmless returned."""

    def __init__(self, document: Table, lines: dict[Path, int], where: str, problems: Problems) -> None:
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

    def line(self, path: Path) -> int | None:
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path)

    def wrong(self, path: Path, what: str, remedy: str) -> None:
        self.problems.add(Problem(self.where, what, remedy, self.line(path)))

    def known(self, path: Path, table: Table, keys: Iterable[str]) -> None:
        """Take note of keys that mean nothing."""
        place = f" in [{'.'.join(path)}]" if path else ""
        for key in table:
            if key not in keys:
                otherwise = "the keys there are: " + ", ".join(keys)
                what, line = f"unknown key {shown(key)}{place}", self.line((*path, key))
                self.problems.add_unknown(self.where, what, key, keys, otherwise, line)

    def complete(self, path: Path, table: Table, keys: Iterable[str], remedy: str = "add {key} = ...") -> None:
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

    def text(self, path: Path, table: Table) -> str:
        value = table.get(path[-1], "")
        if not isinstance(value, str):
            self.wrong(path, f"{path[-1]} is {shown(value)}, not text", "put it in quotes")
            return ""
        return value

    def name(self, path: Path, table: Table) -> str:
        """A text that can name something: see `is_name`."""
        text = self.text(path, table)
        if not is_name(text):
            self.wrong(path, f"{path[-1]} is {shown(text)}", NAME_REMEDY)
        return text

    def truth(self, path: Path, table: Table) -> bool:
        value = table.get(path[-1], True)
        if not isinstance(value, bool):
            self.wrong(path, f"{path[-1]} is {shown(value)}", "write true or false")
            return True
        return value

    def whole(self, path: Path, table: Table, least: int, most: int) -> int:
        value = table.get(path[-1], least)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            self.wrong(path, f"{path[-1]} is {shown(value)}", f"give a whole number from {least} to {most}")
            return least
        return value

    def positive(self, path: Path, table: Table, unit: str) -> float:
        if path[-1] not in table:
            return 1.0
        before = len(self.problems)
        value = self.number(path, path[-1], table[path[-1]], signed=True)
        if len(self.problems) == before and not value > 0.0:
            self.wrong(path, f"{path[-1]} is {value:g}", f"give a positive number of {unit}")
        return value

    def rows(
        self, path: Path, table: Table, width: int, meaning: str, *, by_leg: bool = False, legs: int | None = None
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

    def numbers(self, path: Path, table: Table, count: int | None, meaning: str, *, signed: bool) -> list[float]:
        if path[-1] not in table:
            return []
        return self.checked(path, path[-1], table[path[-1]], count, meaning, signed=signed)

    def checked(
        self, path: Path, name: str, values: object, count: int | None, meaning: str, *, signed: bool
    ) -> list[float]:
        if not isinstance(values, list) or not values:
            self.wrong(path, f"{name} is not a list of numbers", f"give {meaning}, in brackets")
            return []
        if count is not None and len(values) != count:
            self.wrong(path, f"{name} has {len(values)} numbers, not {count}", f"give {meaning}")
        return [self.number(path, name, value, signed=signed) for value in values]

    def number(self, path: Path, name: str, value: object, *, signed: bool) -> float:
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


def line_numbers(text: str, document: Table) -> dict[Path, int]:
    """Where each section and key of the document is first written, by its path."""
    lines: dict[Path, int] = {}
    section: Path = ()
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


def _path(dotted: str) -> Path:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def _leads_somewhere(path: Path, document: Table) -> bool:
    value: object = document
    for key in path:
        if not isinstance(value, dict) or key not in value:
            return False
        value = value[key]
    return True
