"""Files from outside: the bytes of regular files, and the TOML and JSON documents in them.

Every reader goes through here, so that no file can hang the program, fill the memory or raise what nobody expects:
pipes and devices are refused before they are read, sizes and nesting are bounded.
"""

from __future__ import annotations

import errno
import json
import math
import os
import re
import stat
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from cpcal.common.errors import InputError, Problem, Problems, shown

SETTINGS_MAX = 2**20  # bytes of a TOML file; a sensible one is hundreds of times smaller
JSON_MAX = 2**27  # bytes of a JSON file
DEPTH_MAX = 30  # of nested lists and tables

_BREAKS = re.compile(r"""[][{}=,"']""")
_DOTS_MAX = 1_000  # in a key: tomllib's time grows with its square
_DIGITS_MAX = 300  # of a whole number in JSON: one that is a float, too
_SURROGATE = re.compile(r"\\u[dD][89abABcdefCDEF]")


def open_regular(path: Path) -> BinaryIO:
    """The file, open to be read. Raises OSError, also for a pipe, which would hang, or a device, which never ends.

    The open file is checked, so that nothing can take its place between.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "its name holds a NUL")
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        code = errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL
        raise OSError(code, os.strerror(code) if code == errno.EISDIR else "it is no regular file")
    return os.fdopen(descriptor, "rb")


def small_file(path: Path, problems: Problems, absent: str, *, most: int = SETTINGS_MAX) -> bytes | None:
    """The bytes of a file, or None and a problem; `absent` is the remedy when there is no such file."""
    try:
        with open_regular(path) as file:
            content = file.read(most + 1)
    except OSError as error:
        problems.add(unreadable(path, error, absent))
        return None
    if len(content) > most:
        problems.add(Problem(str(path), f"is larger than {most:,} bytes", "is this the right file?"))
        return None
    return content


def unreadable(path: Path, error: OSError, absent: str) -> Problem:
    """What to say of a file that could not be opened."""
    if isinstance(error, FileNotFoundError):
        return Problem(str(path), "does not exist", absent)
    return Problem(str(path), f"cannot be read: {error.strerror or error}", "give a file that can be read")


def toml_document(content: bytes, where: str, problems: Problems, start: str) -> dict[str, object] | None:
    """The TOML document in the bytes of a file called `where`; None, with a problem added, if it is none.

    `start` says what an empty file should begin with.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        problems.add(Problem(where, "is not UTF-8 text", "save the file as UTF-8 text", line))
        return None
    if not text.strip():
        problems.add(Problem(where, "is empty", f"write at least {start}", 1))
        return None
    for number, row in enumerate(text.split("\n"), start=1):
        if max(part.count(".") for part in _BREAKS.split(row)) > _DOTS_MAX:
            problems.add(Problem(where, "has a key of too many parts", "is this the right file?", number))
            return None
    try:
        document = tomllib.loads(text)
        if not _deep(document):
            return document
    except tomllib.TOMLDecodeError as error:
        what, _, place = str(error).rpartition(" (at ")  # "(at line 3, column 5)" or "(at end of document)"
        digits = place.removeprefix("line ").partition(",")[0]
        line = int(digits) if digits.isdecimal() else text.rstrip().count("\n") + 1
        problems.add(Problem(where, f"is not TOML: {what[:200]}", "correct the line", line))
        return None
    except (ValueError, RecursionError):  # integers of thousands of digits; brackets nested thousands deep
        pass
    problems.add(Problem(where, "is not a sensible TOML file", "write it as the documentation shows"))
    return None


def json_object(path: Path, absent: str, again: str) -> dict[str, Any]:
    """The JSON object in a file: every key once, every number finite.

    `absent` is the remedy when there is no such file, `again` when it holds something else. Raises InputError.
    """
    problems = Problems()
    content = small_file(path, problems, absent, most=JSON_MAX)
    problems.raise_any()
    assert content is not None
    try:
        return parsed_object(content)
    except ValueError as error:
        line = error.lineno if isinstance(error, json.JSONDecodeError) else None
        what = error.msg if isinstance(error, json.JSONDecodeError) else str(error)
        raise InputError([Problem(str(path), f"is not JSON: {what}", again, line)]) from None


def parsed_object(content: bytes | str) -> dict[str, Any]:
    """The JSON object in a text. Raises ValueError, whatever the text is; see `json_object`."""
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("it is not UTF-8 text") from None
    try:
        data = json.loads(
            text, object_pairs_hook=_object, parse_constant=_no_number, parse_float=_number, parse_int=_whole
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


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        name, _ = Counter(name for name, _ in pairs).most_common(1)[0]
        raise ValueError(f"{shown(name)} is there twice")
    return table


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{shown(text)} is too large for a number")
    return value


def _whole(text: str) -> int:
    if len(text) > _DIGITS_MAX:
        raise ValueError(f"{shown(text)} is too large for a number")
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
