"""Files to check: regular ones, JSON in them, and a certificate's lines with the work that its check may cost."""

from __future__ import annotations

import codecs
import hashlib
import json
import re
import stat
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from .readers import Refused, Unusable, shown

WORK = 72_000_000  # of one certificate, or of a run of up to 1,000 measurements: 9 s at 8,000,000 units a second
_A_MEASUREMENT = 1_500  # more of a leg, for each measurement beyond
A_FILE = 10_000  # at least
POSE_SET_SUFFIX = ".pose.json"  # files of claims other than those of a run
STUDY_NAME = "study.json"  # of hand-eye runs
ACCURACY_NAME = "accuracy.json"
LONGEST_LINE, LARGEST_FILE = 4 << 20, 8 << 20  # bytes of a line, and of a file that is held in memory


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


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice")
    return found


_STRICT: dict[str, Any] = {"object_pairs_hook": _unique, "parse_constant": no_float}
_NO_JSON = (ValueError, RecursionError, MemoryError)


def parsed(text: bytes, floats: Callable[[str], Any] = no_float) -> dict[str, Any]:
    """The object of a JSON text: UTF-8, no key twice; `floats` makes its numbers with a point or an exponent."""
    try:
        found = json.loads(text.decode("utf-8"), parse_float=floats, **_STRICT)
    except _NO_JSON as error:
        raise Refused(f"is not JSON of this format: {shown(error)}") from None
    if not isinstance(found, dict):
        raise Refused("is not an object")
    return found


class Members:
    """A JSON object that is read as it comes: iteration gives its keys, none twice; then `value` or `elements` has what
    stands there. No more than twice LONGEST_LINE of the file is held, which no value and no element may exceed."""

    _decode = json.JSONDecoder(parse_float=no_float, **_STRICT).raw_decode
    _space = re.compile(r"[ \t\n\r]*")

    def __init__(self, stream: BinaryIO, most: int) -> None:
        self.digest = hashlib.sha256()
        self._stream, self._left, self._ended = stream, most, False
        self._utf8 = codecs.getincrementaldecoder("utf-8")()
        self._text, self._at = "", 0

    def __iter__(self) -> Iterator[str]:
        self._take("{")
        known = set[str]()
        while True:
            key = self.value()
            if not isinstance(key, str) or key in known:
                raise Refused("a key is no text, or stands twice")
            known.add(key)
            self._take(":")
            yield key
            if self._take(",}") == "}":
                break
        if self._next():
            raise Refused("something follows the object")

    def elements(self) -> Iterator[Any]:
        """Of the list that stands here."""
        self._take("[")
        if self._next() == "]":
            self._take("]")
            return
        yield self.value()
        while self._take(",]") == ",":
            yield self.value()

    def value(self) -> Any:
        self._next()
        self._fill(LONGEST_LINE)
        try:
            found, end = self._decode(self._text, self._at)
        except _NO_JSON as error:
            long = "" if self._ended else f", or a value takes more than {LONGEST_LINE} bytes"
            raise Refused(f"is not JSON of this format: {shown(error)}{long}") from None
        if end - self._at > LONGEST_LINE or (end == len(self._text) and not self._ended):
            raise Refused(f"a value takes more than {LONGEST_LINE} bytes", "limit")
        self._at = end
        return found

    def _take(self, signs: str) -> str:
        """The next sign, one of these."""
        sign = self._next()
        if not sign or sign not in signs:
            raise Refused(f"is not JSON of this format: one of {signs} is needed where {shown(sign)} stands")
        self._at += 1
        return sign

    def _next(self) -> str:
        """The next sign that is no white space, which is passed over; "" at the end."""
        while True:
            space = self._space.match(self._text, self._at)
            self._at = self._at if space is None else space.end()
            if self._at < len(self._text) or self._ended:
                return self._text[self._at : self._at + 1]
            self._fill(1)

    def _fill(self, ahead: int) -> None:
        """More than so many characters ahead, or all that there are."""
        while len(self._text) - self._at <= ahead and not self._ended:
            chunk = self._stream.read(LONGEST_LINE)
            self._left -= len(chunk)
            if self._left < 0:
                raise Refused("the file is too large", "limit")
            self.digest.update(chunk)
            self._ended = not chunk
            try:
                self._text = self._text[self._at :] + self._utf8.decode(chunk, self._ended)
            except UnicodeDecodeError as error:
                raise Refused(f"is not UTF-8: {shown(error)}") from None
            self._at = 0


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

    def __iter__(self) -> Iterator[dict[str, Any]]:
        while line := self._stream.readline(LONGEST_LINE + 1):
            self.line += 1
            if len(line) > LONGEST_LINE:
                raise Refused("the line is longer than 4 MiB", "limit")
            self.spend(200 + 2 * len(line))
            self.text = line
            yield parsed(line)

    def following(self, what: str) -> dict[str, Any]:
        for value in self:
            return value
        self.line += 1
        raise Refused(f"the file ends before {what}, or it is empty")

    def spend(self, work: int) -> None:
        self.budget.spend(work)
