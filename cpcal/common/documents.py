"""Documents of settings, tables and JSON: read with every problem and its line, written so that they are read back.

Every file from outside goes through here, so that none can hang the program, fill the memory or raise what nobody
expects: pipes and devices are refused before they are read, sizes and nesting are bounded.
"""

import csv
import hashlib
import io
import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from cpcal.common.errors import InputError, Problems, shown, unusable
from cpcal.common.files import NAME_MAX, NAME_REMEDY, TEXT_REMEDY, is_text, small_file
from cpcal.common.values import LARGEST, Floats, Json, Texts

# ------------------------------------------------------------------------------------------------------------------
# Tables as CSV, safe to open in a spreadsheet.
#
# A spreadsheet computes a text that begins with = + - or @, so such a name is written with an apostrophe before it, and
# read back without. A name that has apostrophes there of its own gets one more, so that every name comes back as it
# was.

_RUNS = re.compile("'*[=+\\-@\uff1d\uff0b\uff0d\uff20]")  # also the wide forms, which some spreadsheets take for them


def guarded(text: str) -> str:
    """The text of a cell as it is written."""
    return "'" + text if _RUNS.match(text) else text


def unguarded(cell: str) -> str:
    """The text that was written so."""
    return cell[1:] if cell.startswith("'") and _RUNS.match(cell) else cell


def csv_table(header: Sequence[str], rows: Iterable[Iterable[str | float | None]]) -> bytes:
    """A CSV file. Floats by repr, so that they are read back bit for bit; None: empty."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([guarded(cell) if isinstance(cell, str) else cell for cell in row] for row in rows)
    return buffer.getvalue().encode()


# Numbers as people and programs write them, in the digits 0 to 9, by the sign between whole and rest.
NUMBERS = {
    sign: re.compile(rf"[-+]?(\d+(\{sign}\d*)?|\{sign}\d+)(e[-+]?\d+)?", re.ASCII | re.IGNORECASE) for sign in ".,"
}


# ------------------------------------------------------------------------------------------------------------------
# TOML and JSON documents in the bytes of files.

JSON_MAX = 2**27  # bytes of a JSON file
DEPTH_MAX = 30  # of nested lists and tables

_BREAKS = re.compile(r"""[][{}=,"']""")
_DOTS_MAX = 1_000  # in a key: tomllib's time grows with its square
_SURROGATE = re.compile(r"\\u[dD][89abABcdefCDEF]")


def toml_document(content: bytes, where: str, problems: Problems, start: str) -> dict[str, object] | None:
    """The TOML document in the bytes of a file called `where`; None, with a problem added, if it is none.

    `start` says what an empty file should begin with.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        problems.wrong(where, "is not UTF-8 text", "save the file as UTF-8 text", line)
        return None
    if not text.strip():
        problems.wrong(where, "is empty", f"write at least {start}", 1)
        return None
    for number, row in enumerate(text.split("\n"), start=1):
        if max(part.count(".") for part in _BREAKS.split(row)) > _DOTS_MAX:
            problems.wrong(where, "has a key of too many parts", "is this the right file?", number)
            return None
    try:
        document = tomllib.loads(text)
        if not _deep(document):
            return document
    except tomllib.TOMLDecodeError as error:
        what, _, place = str(error).rpartition(" (at ")  # "(at line 3, column 5)" or "(at end of document)"
        digits = place.removeprefix("line ").partition(",")[0]
        line = int(digits) if digits.isdecimal() else text.rstrip().count("\n") + 1
        problems.wrong(where, f"is not TOML: {what[:200]}", "correct the line", line)
        return None
    except (ValueError, RecursionError):  # integers of thousands of digits; brackets nested thousands deep
        pass
    problems.wrong(where, "is not a sensible TOML file", "write it as the documentation shows")
    return None


def json_object(path: Path, absent: str, again: str) -> Json:
    """The JSON object in a file: every key once, every number finite.

    `absent` is the remedy when there is no such file, `again` when it holds something else. Raises InputError.
    """
    content = small_file(path, absent, most=JSON_MAX)
    try:
        return parsed_object(content)
    except ValueError as error:
        line = error.lineno if isinstance(error, json.JSONDecodeError) else None
        what = error.msg if isinstance(error, json.JSONDecodeError) else str(error)
        raise unusable(path, f"is not JSON: {what}", again, line) from None


def parsed_object(content: bytes | str) -> Json:
    """The JSON object in a text. Raises ValueError, whatever the text is; see `json_object`."""
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("it is not UTF-8 text") from None
    try:
        data = json.loads(
            text, object_pairs_hook=_object, parse_constant=_number, parse_float=_number, parse_int=_whole
        )
        if _SURROGATE.search(text):
            json.dumps(data, ensure_ascii=False).encode()
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except UnicodeEncodeError:
        raise ValueError("it holds half a character") from None
    if not isinstance(data, dict):
        raise ValueError("it is no object")
    if _deep(data):
        raise ValueError("it is nested too deeply")
    return data


def _object(pairs: list[tuple[str, Any]]) -> Json:
    table = dict(pairs)
    if len(table) < len(pairs):
        name, _ = Counter(name for name, _ in pairs).most_common(1)[0]
        raise ValueError(f"{shown(name)} is there twice")
    return table


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{shown(text)} is no finite number")
    return value


def _whole(text: str) -> int:
    _number(text)
    return int(text)


def _deep(document: object) -> bool:
    """Whether lists and tables are nested deeper than any file of cpcal's."""
    level = [document]
    for _ in range(DEPTH_MAX):
        level = [
            part
            for value in level
            if isinstance(value, (dict, list))
            for part in (value.values() if isinstance(value, dict) else value)
        ]
        if not level:
            return False
    return any(isinstance(value, (dict, list)) for value in level)


# ------------------------------------------------------------------------------------------------------------------
# Sections and values of a TOML document, each problem with its line.

T = TypeVar("T")
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
    def opened(cls, path: Path, format_: str, sections: Iterable[str], problems: Problems, absent: str) -> Self | None:
        """A reader of a file, its format and the names of its sections checked.

        None, with a problem added, where there is no such file (`absent` is the remedy), or it is no TOML.
        """
        where, sections = str(path), ("format", *sections, "provenance")
        if (content := problems.of(partial(small_file, path, absent))) is None:
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
        self.problems.wrong(self.where, what, remedy, self.line(path))

    def made(self, make: Callable[[], T], place: Callable[[str], KeyPath]) -> T | None:
        """A value of what was read; None where it cannot be, its problems taken note of at the `place` of what they are
        about."""
        try:
            return make()
        except InputError as error:
            for problem in error.problems:
                self.wrong(place(problem.where.rpartition(" ")[2]), problem.what, problem.remedy)
            return None

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
    ) -> Json | None:
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
            if not is_text(key, NAME_MAX):
                self.wrong(path, f"{name} cannot be a name", NAME_REMEDY)
            if not is_text(texts[key]):
                self.wrong(path, f"{name} is {shown(texts[key])}", TEXT_REMEDY)
        return texts


def line_numbers(text: str, document: Table) -> dict[KeyPath, int]:
    """Where each section and key of the document is first written, by its path."""
    lines: dict[KeyPath, int] = {}
    section: KeyPath = ()
    for number, line in enumerate(text.split("\n"), start=1):
        heading = line.lstrip().startswith("[")
        if not heading and "=" not in line:
            continue
        dotted = line.lstrip()[1:].partition("]")[0] if heading else line.partition("=")[0]
        path = (*(() if heading else section), *(part.strip().strip("\"'") for part in dotted.split(".")))
        value: object = document
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        if value is None:  # a row of an array, say
            continue
        section = path if heading else section
        for depth in range(1, len(path) + 1):
            lines.setdefault(path[:depth], number)
    return lines


# ------------------------------------------------------------------------------------------------------------------
# What a value may be: readers for a schema. Each takes note of what is wrong, and returns something harmless then.


def text(reader: TomlReader, path: KeyPath, value: object) -> str:
    if isinstance(value, str):
        return value
    reader.wrong(path, f"{path[-1]} is {shown(value)}, not text", "put it in quotes")
    return ""


def name(reader: TomlReader, path: KeyPath, value: object) -> str:
    """A text that can name something: see `is_text`."""
    found = text(reader, path, value)
    if not is_text(found, NAME_MAX):
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
    """An array of numbers, or one number: of any length where the shape has None. In a problem a row is called by its
    number, from 0 as in the arrays; or, `by_leg`, by its leg."""

    def read(reader: TomlReader, path: KeyPath, value: object) -> Floats | float:
        def numbers(value: object, shape: Shape, name: str, by_leg: bool) -> Any:
            if not shape:
                return reader.number(path, name, value, signed=signed)
            rows = len(shape) > 1
            what, of = ("rows", f" for {shape[0]} legs") if rows else ("numbers", f", not {shape[0]}")
            give = f"give {'one row for each leg: ' if by_leg else 'rows: ' if rows else ''}{meaning}"
            if not isinstance(value, list) or not value:
                reader.wrong(path, f"{name} is not a list of {what}", f"{give}, in brackets")
                return []
            if shape[0] is not None and len(value) != shape[0]:
                reader.wrong(path, f"{name} has {len(value)} {what}{of}", give)
                return []
            called = f"{name} of leg {{}}" if by_leg else f"row {{}} of {name}" if rows else name
            each = enumerate(value, start=int(by_leg))
            return [numbers(one, shape[1:], called.format(i), by_leg=False) for i, one in each]

        before, found = len(reader.problems), numbers(value, shape, path[-1], by_leg)
        if len(reader.problems) > before:
            return 0.0
        values = np.array(found, np.float64)
        return values if shape else float(values)

    return read


# ------------------------------------------------------------------------------------------------------------------
# TOML documents to files.


def document(format_: str, sections: Mapping[str, Mapping[str, object]], provenance: Texts) -> bytes:
    """A TOML file of its format and sections."""
    return toml_text({"format": format_, **sections, "provenance": provenance}).encode()


def toml_text(table: Mapping[str, Any], path: str = "") -> str:
    """A TOML document, or the part of one that `path` leads to: simple values, then tables, then arrays of tables.

    Floats by repr. None and empty tables are left out.
    """
    text, nested = "", {}
    for key, value in table.items():
        name = key if re.fullmatch("[A-Za-z0-9_-]+", key) else written(key)
        if isinstance(value, Mapping):
            nested[f"\n[{path}{name}]\n"] = f"{path}{name}.", [value] * bool(value)
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            nested[f"\n[[{path}{name}]]\n"] = f"{path}{name}.", value
        elif value is not None:
            text += f"{name} = {written(value)}\n"
    return text + "".join(head + toml_text(part, inner) for head, (inner, parts) in nested.items() for part in parts)


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
