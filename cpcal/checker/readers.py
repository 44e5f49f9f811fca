"""Readers of JSON values, from which schemas are built: a value that is not as it must be is refused in a sentence."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction as F
from itertools import pairwise
from math import inf, isfinite, nextafter
from typing import Any

# why nothing is proved -----------------------------------------------------------------------------------------------


class Refused(Exception):
    """A certificate or a run proves nothing: the reason, its code, and the line (from 1; 0 where there is none).

    Codes: "form" (a line is not as the format has it), "limit" (of this checker), "campaign" (campaign.json cannot be
    used, or is another one), "proof" (what is claimed is not proved), "run" (result.json states something else).
    """

    def __init__(self, reason: str, code: str = "form", line: int | None = None) -> None:
        self.reason, self.code, self.line = reason, code, line
        super().__init__(f"line {line}: {reason}" if line else reason)


class Unusable(Exception):
    """There is nothing to check: a file is missing or cannot be read."""


STRANGE = (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError, OverflowError, MemoryError)


def reason_of(error: Exception) -> str:
    """Why a file is refused: its own values may raise whatever is STRANGE."""
    if isinstance(error, KeyError):
        return f"lacks the key {shown(error.args[0])}"
    return str(error) if isinstance(error, (Refused, Unusable)) else "holds a value of the wrong kind"


@contextmanager
def reading(name: str) -> Iterator[None]:
    """What is wrong with the file of that name is a reason to refuse the run."""
    try:
        yield
    except (Refused, *STRANGE) as error:
        code = error.code if isinstance(error, Refused) else "run"
        if code == "campaign":
            raise
        raise Refused(f"{name} {reason_of(error)}", "limit" if code == "limit" else "run", 0) from None


# what a file states beside what is proved ---------------------------------------------------------------------------

Json = dict[str, Any]
Names = tuple[str, ...]
Fractions = tuple[F, ...]
Places = tuple[int, ...]  # of measurements, rows or unknowns among all
Stated = Iterator[tuple[str, Any, Any]]  # what, as it is stated, as it must be


def compare(stated: Iterable[tuple[str, Any, Any]]) -> None:
    for what, value, proved in stated:
        same(what, value, proved)


def same(what: str, stated: Any, proved: Any) -> None:
    """Equal, and of the same kind: true is not 1. Of lists in JSON entry by entry."""
    if isinstance(stated, list) and isinstance(proved, list | tuple) and len(stated) == len(proved):
        compare((what, *both) for both in zip(stated, proved, strict=True))
    elif stated != proved or isinstance(stated, bool) != isinstance(proved, bool):
        raise Refused(f"states another {what} than is proved")


def exact(value: Any) -> F:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Refused(f"holds {shown(value)} where a number is needed")
    return F(value)


# readers ------------------------------------------------------------------------------------------------------------

Reader = Callable[[Any], Any]
_HIGHEST_POWER = 1100
_DYADIC = re.compile(r"(-?)0x([0-9a-f]{1,64})(?:\.([0-9a-f]{1,64}))?p([-+][0-9]{1,4})")
_DECIMALS = re.compile(r"(?:-?[0-9]{1,30}+(?:\.[0-9]{1,30}+)?+(?:e[-+]?[0-9]{1,3}+)?+ )*+")


def shown(value: object) -> str:
    """At most 40 printable ASCII characters."""
    return f"{str(value)[:40]!a}"


def record(fields: Mapping[str, Reader]) -> Reader:
    """An object with these keys: the list of its values, in this order."""

    def read(value: Any) -> list[Any]:
        if not isinstance(value, dict) or value.keys() != fields.keys():
            raise Refused(f"an object with the keys {', '.join(fields)} is needed here")
        return [reader(value[name]) for name, reader in fields.items()]

    return read


def entry(*readers: Reader, defaults: tuple[Any, ...] = ()) -> Reader:
    """A list of so many values; `defaults` of the last ones, which may be left out."""
    most = len(readers)

    def read(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list) or not most - len(defaults) <= len(value) <= most:
            raise Refused(f"a list of {most} is needed here")
        found = [reader(v) for reader, v in zip(readers, value, strict=False)]
        return *found, *defaults[len(value) - most or most :]

    return read


def many(reader: Reader, count: int | None = None) -> Reader:
    """A list of one kind of value, `count` of them or any number."""

    return lambda value: tuple(map(reader, array(value, count)))


def ascending(below: int) -> Reader:
    """A list of whole numbers, ascending."""

    def read(value: Any) -> Places:
        found: Places = many(whole(below))(value)
        if any(a >= b for a, b in pairwise(found)):
            raise Refused("whole numbers in ascending order are needed here")
        return found

    return read


def maybe(reader: Reader) -> Reader:
    """null, or a value."""
    return lambda value: None if value is None else reader(value)


def whole(below: int, least: int = 0) -> Reader:
    """A whole number; true and 1.0 are none."""

    def read(value: Any) -> int:
        if type(value) is not int or not least <= value < below:
            raise Refused(f"{shown(value)} is no whole number from {least} to {below - 1}")
        return value

    return read


def choice(*values: Any) -> Reader:
    """One of these, and of its type; they are of one type."""
    kind = type(values[0])

    def read(value: Any) -> Any:
        if type(value) is not kind or value not in values:
            raise Refused(f"{shown(value)} is none of {', '.join(map(str, values))}")
        return value

    return read


def signs(count: int) -> Reader:
    """A text of so many signs."""

    def read(value: Any) -> str:
        if not isinstance(value, str) or len(value) != count or not set(value) <= set("-0+"):
            raise Refused(f"{shown(value)} is no text of {count} signs out of '-', '0' and '+'")
        return value

    return read


def text(value: Any) -> str:
    if not isinstance(value, str):
        raise Refused(f"{shown(value)} is no text")
    return value


def anything(value: Any) -> Any:
    return value


def array(value: Any, count: int | None = None) -> list[Any]:
    """A list of whatever there is in it; of so many."""
    if not isinstance(value, list) or count not in (None, len(value)):
        raise Refused(f"a list{'' if count is None else f' of {count}'} is needed here")
    return value


def dyadic(value: Any) -> F:
    """A number of a certificate: exactly what its hexadecimal digits say."""
    found = _DYADIC.fullmatch(value) if isinstance(value, str) else None
    if found is None or abs(int(found[4])) > _HIGHEST_POWER:
        raise Refused(f"{shown(value)} is not a number of this format")
    sign, head, fraction, exponent = found.groups(default="")
    return binary(int(sign + head + fraction, 16), int(exponent) - 4 * len(fraction))


def binary(mantissa: int, power: int) -> F:
    """A whole number times a power of two."""
    return F(mantissa << power) if power >= 0 else F(mantissa, 1 << -power)


def decimals(values: list[Any]) -> list[float]:
    """Numbers of a campaign: the float64 nearest to each decimal text."""
    joined = " ".join([*values, ""]) if {*map(type, values)} <= {str} else "?"
    if _DECIMALS.fullmatch(joined) is None or joined.count(" ") > len(values):
        wrong = next(v for v in values if type(v) is not str or " " in v or not _DECIMALS.fullmatch(v + " "))
        raise Refused(f"{shown(wrong)} is no decimal number")
    found = list(map(float, values))
    return found if all(map(isfinite, found)) else list(map(finite, values))  # which says what is not


def finite(value: str) -> float:
    """The float64 nearest to the text of a number."""
    number = float(value)
    if not isfinite(number):
        raise Refused(f"the number {shown(value)} is too large for a float64")
    return number


def up(value: F) -> float:
    """The least float64 that is not below it."""
    near = float(value)
    return near if F(near) >= value else nextafter(near, inf)
