"""Files to check: regular ones, JSON in them, and a certificate's lines with the work that its check may cost."""

import json
import stat
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from .readers import Json, Refused, Unusable, shown

WORK = 72_000_000  # of one certificate, or of a run of up to 1,000 measurements: 9 s at 8,000,000 units a second
_A_MEASUREMENT = 1_000  # more of a leg, for each measurement beyond
A_FILE = 10_000  # at least
POSE_SET_SUFFIX = ".pose.json"  # files of claims other than those of a run
STUDY_NAME = "study.json"  # of hand-eye runs
HAND_EYE_NAME, ACCURACY_NAME = "handeye.json", "accuracy.json"
# kinds of runs other than those of legs: by its head, the module and the function that say what is accepted of one
KINDS = {HAND_EYE_NAME: ("hand_eye", "check_hand_eye"), ACCURACY_NAME: ("platform", "check_accuracy")}
LONGEST_LINE, LARGEST_FILE = 4 << 20, 8 << 20  # bytes of a line, and of a file that is held in memory
_MOST_VALUES = 3_000_000  # of such a file: 200 MB


def opened(path: Path) -> BinaryIO:
    """A regular file: no device that never ends, no pipe that never begins."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise Unusable(f"{shown(path.name)} is no regular file")
        return path.open("rb")
    except OSError as error:
        raise Unusable(f"{shown(path.name)} cannot be read: {error.strerror}") from None


def content(path: Path, most: int = LARGEST_FILE) -> bytes:
    """The bytes of a file that is held in memory."""
    with opened(path) as stream:
        found = stream.read(most + 1)
    if len(found) > most or sum(map(found.count, (b",", b"[", b"{"))) > _MOST_VALUES:
        raise Refused(f"it is larger than {most} bytes, or holds more than {_MOST_VALUES} values", "limit")
    return found


def no_float(text: str) -> Any:
    raise ValueError(f"{text[:40]} is no number here")


def _unique(pairs: list[tuple[str, Any]]) -> Json:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice")
    return found


def parsed(text: bytes, floats: Callable[[str], Any] = no_float) -> Json:
    """The object of a JSON text: UTF-8, no key twice; `floats` makes its numbers with a point or an exponent."""
    try:
        found = json.loads(text.decode(), parse_float=floats, parse_constant=no_float, object_pairs_hook=_unique)
    except (ValueError, RecursionError, MemoryError) as error:
        raise Refused(f"is not JSON of this format: {shown(error)}") from None
    if not isinstance(found, dict):
        raise Refused("is not an object")
    return found


def leg_work(legs: int, measurements: int) -> int:
    """What the check of each of so many legs of a run may cost."""
    return WORK // max(legs, 1) + _A_MEASUREMENT * max(0, measurements - 1_000)


class Budget:
    """Work that the check of a whole run may cost, in tenths of a microsecond, about."""

    def __init__(self, most: int) -> None:
        self.most = self.left = most
        self.known: dict[Hashable, Any] = {}  # what long steps leave, which other certificates of a run have too

    def spend(self, work: int) -> None:
        self.left -= work
        if self.left < 0:
            what = f"the check takes more work than the {self.most} that it may cost"
            raise Refused(f"{what}: `python -m cpcal.checker --work` spends more", "limit")


class Lines:
    """The objects of a certificate, line by line; `spend` counts the work that its check costs."""

    def __init__(self, stream: BinaryIO, budget: Budget) -> None:
        self._stream, self.budget, self.line, self.text = stream, budget, 0, b""
        self.spend = budget.spend

    def __iter__(self) -> Iterator[Json]:
        while line := self._stream.readline(LONGEST_LINE + 1):
            self.line += 1
            if len(line) > LONGEST_LINE:
                raise Refused("the line is longer than 4 MiB", "limit")
            self.spend(200 + 3 * len(line))
            self.text = line
            yield parsed(line)

    def following(self, what: str) -> Json:
        for value in self:
            return value
        self.line += 1
        raise Refused(f"the file ends before {what}, or it is empty")
