"""Strict reading: regular files, JSON, and exact numbers; whatever is wrong is refused in one sentence."""

from __future__ import annotations

import json
import re
import stat
from collections.abc import Callable, Iterator
from fractions import Fraction as F
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

from .refusal import Refused, Unusable

LONGEST_LINE = 4 << 20  # bytes
WORK = 10_000_000  # see docs/certificate-format.md, "Limits"
_HIGHEST_POWER = 1100
_DYADIC = re.compile(r"(-?)0x([0-9a-f]{1,64})(?:\.([0-9a-f]{1,64}))?p([-+][0-9]{1,4})")
_DECIMAL = re.compile(r"-?[0-9]{1,30}(?:\.[0-9]{1,30})?(?:e[-+]?[0-9]{1,3})?")


def opened(path: Path) -> BinaryIO:
    """A regular file: no device that never ends, no pipe that never begins."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise Unusable(f"{shown(path.name)} is no regular file")
        return path.open("rb")
    except OSError as error:
        raise Unusable(f"{shown(path.name)} cannot be read: {error.strerror}") from None


def parsed(content: bytes, *, floats: Callable[[str], Any]) -> Any:
    """The value of a JSON text: UTF-8, no key twice; `floats` makes its numbers with a point or an exponent."""
    try:
        return json.loads(
            content.decode("utf-8"), object_pairs_hook=_unique, parse_constant=no_float, parse_float=floats
        )
    except (ValueError, RecursionError, MemoryError) as error:
        raise ValueError(f"is not JSON of this format: {shown(error)}") from None


def no_float(text: str) -> Any:
    raise ValueError(f"{text[:40]} is no number here")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice")
    return found


def shown(value: object) -> str:
    """At most 40 printable ASCII characters."""
    return f"{str(value)[:40]!a}"


def decimal(value: Any) -> F:
    """The float64 nearest to a decimal text. Raises ValueError."""
    if not isinstance(value, str) or _DECIMAL.fullmatch(value) is None:
        raise ValueError(f"{shown(value)} is no decimal number")
    number = float(value)
    if number - number != 0.0:
        raise ValueError(f"{shown(value)} is too large for a float64")
    return F(number)


class Lines:
    """The objects of a certificate, line by line, and the work that its check may still cost."""

    def __init__(self, stream: BinaryIO, work: int = WORK) -> None:
        self._stream, self._left, self._most, self.line = stream, work, work, 0

    def __iter__(self) -> Iterator[dict[str, Any]]:
        while line := self._stream.readline(LONGEST_LINE + 1):
            self.line += 1
            if len(line) > LONGEST_LINE:
                raise self.refused("the line is longer than 4 MiB")
            self.spend(20 + len(line) // 8)
            try:
                value = parsed(line, floats=no_float)
            except ValueError as error:
                raise self.refused(str(error)) from None
            if not isinstance(value, dict):
                raise self.refused("is not an object")
            yield value

    def following(self, what: str) -> dict[str, Any]:
        for value in self:
            return value
        self.line += 1
        raise self.refused(f"the file ends before {what}, or it is empty")

    def refused(self, reason: str) -> Refused:
        return Refused(self.line, reason)

    def spend(self, work: int) -> None:
        self._left -= work
        if self._left < 0:
            raise self.refused(f"the check takes more work than the {self._most} multiplications that it may cost")

    def keys(self, value: Any, *names: str) -> list[Any]:
        if not isinstance(value, dict) or set(value) != set(names):
            raise self.refused(f"an object with the keys {', '.join(names)} is needed here")
        return [value[name] for name in names]

    def number(self, value: Any) -> F:
        found = _DYADIC.fullmatch(value) if isinstance(value, str) else None
        if found is None or abs(int(found[4])) > _HIGHEST_POWER:
            raise self.refused(f"{shown(value)} is not a number of this format")
        sign, whole, fraction, exponent = found.groups(default="")
        power = int(exponent) - 4 * len(fraction)
        mantissa = int(sign + whole + fraction, 16)
        return F(mantissa << power) if power >= 0 else F(mantissa, 1 << -power)

    def integer(self, value: Any, below: int, least: int = 0) -> int:
        if type(value) is not int or not least <= value < below:
            raise self.refused(f"{shown(value)} is no whole number from {least} to {below - 1}")
        return value

    def integers(self, value: Any, below: int) -> tuple[int, ...]:
        """Whole numbers, ascending."""
        found = tuple(self.integer(v, below) for v in self.list(value))
        if any(a >= b for a, b in pairwise(found)):
            raise self.refused("whole numbers in ascending order are needed here")
        return found

    def list(self, value: Any, *lengths: int) -> list[Any]:
        if not isinstance(value, list) or (lengths and len(value) not in lengths):
            of = f" of {' or '.join(map(str, lengths))}" if lengths else ""
            raise self.refused(f"a list{of} is needed here")
        return value

    def vector(self, value: Any, length: int) -> tuple[F, ...]:
        return tuple(self.number(v) for v in self.list(value, length))

    def sign(self, value: Any) -> int:
        if value not in (1, -1) or type(value) is not int:
            raise self.refused("the sign in a product of bounds is 1 or -1")
        return value

    def signs(self, value: Any, count: int) -> str:
        if not isinstance(value, str) or len(value) != count or not set(value) <= set("-0+"):
            raise self.refused(f"{shown(value)} is no text of {count} signs out of '-', '0' and '+'")
        return value
