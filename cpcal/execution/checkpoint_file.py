"""A checkpoint as a file: JSON Lines, compressed, that says what it is of and is read whole or not at all.

{"format": "cpcal-checkpoint/1", "of": {...}}     what it is of, word for word
...                                               what was kept, a JSON object a line
{"lines": n, "sha256": "..."}                     how many lines stand before this one, and their digest
"""

from __future__ import annotations

import gzip
import hashlib
import json
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from cpcal.common.atomic import replacing
from cpcal.common.errors import InputError, Problem

FORMAT = "cpcal-checkpoint/1"
SIZE_MAX = 2**31  # bytes, unpacked

Line = dict[str, Any]

_LEVEL = 3  # of compression: a tenth of the size, in little time
_REMEDY = "run again without --resume, which begins anew"


def write_checkpoint(path: Path, of: Mapping[str, Any], lines: Iterable[Line]) -> None:
    """Replace the checkpoint, all or nothing. Raises InputError; then the one before is there as it was."""
    digest, count = hashlib.sha256(), 0
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError([Problem(str(path), f"cannot be written: {error.strerror}", "make room there")]) from None
    with replacing(path) as raw, gzip.GzipFile("", "wb", _LEVEL, raw, mtime=0) as file:
        for line in ({"format": FORMAT, "of": dict(of)}, *lines):
            text = json.dumps(line, separators=(",", ":")).encode() + b"\n"
            digest.update(text)
            file.write(text)
            count += 1
        file.write(json.dumps({"lines": count, "sha256": digest.hexdigest()}).encode() + b"\n")


def read_checkpoint(path: Path, of: Mapping[str, Any]) -> list[Line]:
    """What was kept. Raises InputError for a file that is cut off, garbled, of another version or of other things."""
    try:
        with gzip.open(path, "rb") as file:
            content = file.read(SIZE_MAX + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise _refused(path, f"is cut off or no checkpoint ({error})") from None
    if len(content) > SIZE_MAX or not content.endswith(b"\n"):
        raise _refused(path, "is cut off, or too large")
    *texts, last = content[:-1].split(b"\n")
    try:
        end, lines = json.loads(last), [json.loads(text) for text in texts]
    except (ValueError, RecursionError):
        raise _refused(path, "is garbled") from None
    digest = hashlib.sha256(b"".join(text + b"\n" for text in texts)).hexdigest()
    if end != {"lines": len(texts), "sha256": digest} or not all(isinstance(line, dict) for line in lines):
        raise _refused(path, "is cut off or garbled: its last line does not fit the others")
    if not lines or lines[0].get("format") != FORMAT:
        raise _refused(path, f"is not of format {FORMAT}")
    others = _different(lines[0].get("of"), json.loads(json.dumps(dict(of))))
    if others:
        raise _refused(path, f"is of another run: {', '.join(others)} differ")
    return lines[1:]


def _different(stated: Any, of: dict[str, Any]) -> list[str]:
    if not isinstance(stated, dict):
        return ["all"]
    return sorted(key for key in {*stated, *of} if stated.get(key) != of.get(key))


def _refused(path: Path, what: str) -> InputError:
    return InputError([Problem(str(path), what, _REMEDY)])
