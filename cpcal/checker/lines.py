"""Reads the lines of a certificate, strictly. Standard library only; part of the checker."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from fractions import Fraction as F
from itertools import pairwise
from typing import Any, BinaryIO

from cpcal.checker.refusal import Refused

Rational = Callable[[int, int], F]  # numerator, denominator: Fraction, or another exact kind of number

_LONGEST_LINE = 4 << 20
_NUMBER = re.compile(r"(-?)0x([0-9a-f]{1,64})(?:\.([0-9a-f]{1,64}))?p([-+][0-9]{1,4})")


class Lines:
    """Objects line by line; `refused` names the line that was read last."""

    def __init__(self, stream: BinaryIO, rational: Rational) -> None:
        self._stream, self._rational, self.line = stream, rational, 0

    def __iter__(self) -> Iterator[dict[str, Any]]:
        while line := self._stream.readline(_LONGEST_LINE + 1):
            self.line += 1
            if len(line) > _LONGEST_LINE:
                raise self.refused("the line is longer than 4 MiB")
            try:
                value = json.loads(line.decode("utf-8"), object_pairs_hook=_unique, parse_constant=_no_constant)
            except (ValueError, RecursionError) as error:
                raise self.refused(f"is not JSON of this format: {str(error)[:100]}") from None
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

    def keys(self, value: Any, *names: str) -> list[Any]:
        if not isinstance(value, dict) or set(value) != set(names):
            raise self.refused(f"an object with the keys {', '.join(names)} is needed here")
        return [value[name] for name in names]

    def number(self, value: Any) -> F:
        found = _NUMBER.fullmatch(value) if isinstance(value, str) else None
        if found is None:
            raise self.refused(f"{str(value)[:40]!a} is not a number of this format")
        sign, whole, fraction, exponent = found.groups(default="")
        power = int(exponent) - 4 * len(fraction)
        mantissa = int(sign + whole + fraction, 16)
        return self._rational(mantissa << power, 1) if power >= 0 else self._rational(mantissa, 1 << -power)

    def integer(self, value: Any, below: int, least: int = 0) -> int:
        if type(value) is not int or not least <= value < below:
            raise self.refused(f"{str(value)[:40]!a} is no whole number from {least} to {below - 1}")
        return value

    def integers(self, value: Any, below: int) -> tuple[int, ...]:
        """Whole numbers, ascending."""
        found = tuple(self.integer(v, below) for v in self.list(value))
        if any(a >= b for a, b in pairwise(found)):
            raise self.refused("whole numbers in ascending order are needed here")
        return found

    def list(self, value: Any, length: int | None = None) -> list[Any]:
        if not isinstance(value, list) or (length is not None and len(value) != length):
            raise self.refused("a list" + (f" of {length}" if length is not None else "") + " is needed here")
        return value

    def vector(self, value: Any, length: int) -> tuple[F, ...]:
        return tuple(self.number(v) for v in self.list(value, length))

    def weight(self, value: Any) -> int:
        return self.integer(value, 1 << 60)

    def sign(self, value: Any) -> int:
        if value not in (1, -1) or type(value) is not int:
            raise self.refused("the sign in a product of bounds is 1 or -1")
        return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice")
    return found


def _no_constant(text: str) -> Any:
    raise ValueError(f"{text} is no number here")
