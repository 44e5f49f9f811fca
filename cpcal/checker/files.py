"""Files to check: regular ones, JSON in them, and a certificate's lines with the work that its check may cost."""

from __future__ import annotations

import json
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from .readers import shown
from .refusal import Refused, Unusable

WORK = 10_000_000  # see docs/certificate-format.md, "Limits"
ROBUST_NAME, POSE_SET_SUFFIX = "robust.json", ".pose.json"  # files of claims other than those of a run
LONGEST_LINE, LARGEST_FILE = 4 << 20, 16 << 20  # bytes


def opened(path: Path) -> BinaryIO:
    """A regular file: no device that never ends, no pipe that never begins."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise Unusable(f"{shown(path.name)} is no regular file")
        return path.open("rb")
    except OSError as error:
        raise Unusable(f"{shown(path.name)} cannot be read: {error.strerror}") from None


def content(path: Path) -> bytes:
    """The bytes of a file that is held in memory."""
    with opened(path) as stream:
        found = stream.read(LARGEST_FILE + 1)
    if len(found) > LARGEST_FILE:
        raise Refused(f"it is larger than {LARGEST_FILE} bytes", "limit")
    return found


def no_float(text: str) -> Any:
    raise ValueError(f"{text[:40]} is no number here")


def parsed(text: bytes, floats: Callable[[str], Any] = no_float) -> dict[str, Any]:
    """The object of a JSON text: UTF-8, no key twice; `floats` makes its numbers with a point or an exponent."""
    try:
        found = json.loads(text.decode("utf-8"), object_pairs_hook=_unique, parse_constant=no_float, parse_float=floats)
    except (ValueError, RecursionError, MemoryError) as error:
        raise Refused(f"is not JSON of this format: {shown(error)}") from None
    if not isinstance(found, dict):
        raise Refused("is not an object")
    return found


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice")
    return found


def work_of(measurements: int) -> int:
    """What certificates about so many measurements may cost more: each of them is looked at once, for a point."""
    return 300 * min(measurements, 200_000)


class Lines:
    """The objects of a certificate, line by line; `spend` counts the work that its check may cost."""

    def __init__(self, stream: BinaryIO, work: int = WORK) -> None:
        self._stream, self._left, self._most, self.line = stream, work, work, 0

    def __iter__(self) -> Iterator[dict[str, Any]]:
        while line := self._stream.readline(LONGEST_LINE + 1):
            self.line += 1
            if len(line) > LONGEST_LINE:
                raise Refused("the line is longer than 4 MiB", "limit")
            self.spend(20 + len(line) // 8)
            yield parsed(line)

    def following(self, what: str) -> dict[str, Any]:
        for value in self:
            return value
        self.line += 1
        raise Refused(f"the file ends before {what}, or it is empty")

    def allow(self, measurements: int) -> None:
        """More work for a campaign of so many."""
        more = work_of(measurements)
        self._left, self._most = self._left + more, self._most + more

    def spend(self, work: int) -> None:
        self._left -= work
        if self._left < 0:
            raise Refused(f"the check takes more work than the {self._most} that it may cost", "limit")
