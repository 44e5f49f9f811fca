"""JSON files read with care: bounded, strict, and one clear error for whatever is wrong.

Other than the standard module: no key twice, no NaN, no number too large for a float64, no file that never ends.
"""

from __future__ import annotations

import json
import math
import os
import stat
from pathlib import Path
from typing import Any

from cpcal.errors import InputError, Problem, shown

LARGEST = 1 << 28  # bytes
_LONGEST_INTEGER = 40  # digits


def read_json(path: Path, *, remedy: str) -> Any:
    """The value in a file. Raises InputError, which says `remedy`."""
    try:
        return parsed(_read(path))
    except json.JSONDecodeError as error:
        raise InputError([Problem(str(path), f"is not JSON: {error.msg}", remedy, error.lineno)]) from None
    except OSError as error:
        raise InputError([Problem(str(path), f"cannot be read: {error.strerror or error}", remedy)]) from None
    except RecursionError:
        raise InputError([Problem(str(path), "is nested too deeply", remedy)]) from None
    except ValueError as error:
        raise InputError([Problem(str(path), f"is not JSON that cpcal wrote: {error}", remedy)]) from None


def parsed(content: bytes) -> Any:
    """The value of a text in UTF-8. Raises ValueError or RecursionError."""
    return json.loads(
        content.decode("utf-8"),
        object_pairs_hook=_unique,
        parse_constant=_no_number,
        parse_float=_finite,
        parse_int=_integer,
    )


def _read(path: Path) -> bytes:
    """A device or FIFO is refused before it is read, and so is what is too large."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        state = os.fstat(descriptor)
        if not stat.S_ISREG(state.st_mode):
            raise OSError(0, "it is no regular file")
        if state.st_size > LARGEST:
            raise OSError(0, f"it is larger than {LARGEST >> 20} MiB")
        content = file.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise OSError(0, f"it is larger than {LARGEST >> 20} MiB")
    return content


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"the key {shown(next(key for key in keys if keys.count(key) > 1))} stands twice")
    return found


def _no_number(text: str) -> Any:
    raise ValueError(f"{text} is no number of JSON")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{shown(text)} is too large")
    return value


def _integer(text: str) -> int:
    if len(text) > _LONGEST_INTEGER:
        raise ValueError(f"{shown(text)} has {len(text)} digits")
    return int(text)
