"""Reads campaign.json: the exact numbers of a campaign that certificates speak of."""

from __future__ import annotations

import hashlib
from array import array as array_of
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from .files import LARGEST_FILE, LONGEST_LINE, opened, parsed
from .leg import Measurement
from .readers import anything, array, choice, decimals, many, record, text
from .refusal import Refused

NAME = "campaign.json"
FORMAT = "cpcal-campaign-exact/1"
_KEYS = ("files", "robot", "uncertainty", "model", "provenance")
_LARGEST = 64 << 20  # bytes of a file that is read line by line
_FILE = record({"format": choice(FORMAT), **dict.fromkeys(_KEYS, anything), "measurements": many(array)})
_LINE = record({"row": array})


class ExactCampaign:
    """Measurements as rationals: each number is the float64 nearest to its decimal text."""

    def __init__(self, path: Path) -> None:
        """Raises Unusable where the file cannot be read, Refused where it is no campaign."""
        try:
            with opened(path) as stream:
                reading = _Reading(stream)
                first = next(reading.rows, [])
                self.legs = (len(first) - 15) // 2
                if self.legs < 1:
                    raise Refused("it holds no measurements")
                self._rows: list[tuple[str, str, array_of[float]]] = [
                    _row(first, self.legs),
                    *(_row(cells, self.legs) for cells in reading.rows),
                ]
            _, _, robot, *_ = _FILE(reading.rest)
            self.robot, self.sha256 = robot.get("name") if isinstance(robot, dict) else None, reading.sha256
        except Refused as refused:
            raise Refused(f"{NAME}: {refused.reason}", "campaign", 0) from None

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def ids(self) -> list[str]:
        """pose/run of every measurement."""
        return [f"{pose}/{run}" for pose, run, _ in self._rows]

    def measurement(self, k: int, leg: int) -> Measurement:
        """Row k from 0, leg from 1."""
        numbers, first = self._rows[k][2], 7 + self.legs
        widths = (*numbers[first : first + 6], numbers[first + 5 + leg])
        return Measurement(numbers[3:7], numbers[:3], numbers[6 + leg], widths)


class _Reading:
    """A file's measurements, one after the other; when there are no more, its digest, and the `rest` of the object.

    A large file has each measurement on a line of its own, as cpcal writes it: no more than one is held as JSON.
    """

    def __init__(self, stream: BinaryIO) -> None:
        whole = stream.read(LARGEST_FILE + 1)
        self.rest: dict[str, Any] = {}
        self._digest = hashlib.sha256()
        self.rows = self._by_line(stream) if len(whole) > LARGEST_FILE else self._at_once(whole)

    @property
    def sha256(self) -> str:
        return self._digest.hexdigest()

    def _at_once(self, whole: bytes) -> Iterator[list[Any]]:
        self._digest.update(whole)
        self.rest = parsed(whole)
        *_, rows = _FILE(self.rest)
        yield from rows

    def _by_line(self, stream: BinaryIO) -> Iterator[list[Any]]:
        stream.seek(0)
        lines, around = self._lines(stream), list[bytes]()
        for line in lines:
            around.append(line)
            if line.strip() == b'"measurements": [' or stream.tell() > LARGEST_FILE:
                break
        more = True
        for line in lines:
            text = line.strip()
            if not more:
                around += [line, *lines]
                if sum(map(len, around)) > LARGEST_FILE:
                    raise Refused(f"it holds more than {LARGEST_FILE} bytes beside its measurements", "limit")
                self.rest = parsed(b"".join(around))
                if self.rest.get("measurements") != []:
                    raise Refused("a comma is missing after a measurement")
                return
            more = text.endswith(b",")
            yield from _LINE(parsed(b'{"row":' + text.removesuffix(b",") + b"}"))
        raise Refused("it ends before its measurements do, or is too large to have several of them on a line")

    def _lines(self, stream: BinaryIO) -> Iterator[bytes]:
        size = 0
        while line := stream.readline(LONGEST_LINE + 1):
            size += len(line)
            if size > _LARGEST or len(line) > LONGEST_LINE:
                raise Refused(f"it is larger than {_LARGEST} bytes, or has a line of over {LONGEST_LINE}", "limit")
            self._digest.update(line)
            yield line


def _row(cells: list[Any], legs: int) -> tuple[str, str, array_of[float]]:
    if len(cells) != 15 + 2 * legs:
        raise Refused(f"a list of {15 + 2 * legs} is needed here")
    pose, run, numbers = text(cells[0]), text(cells[1]), decimals(cells[2:])
    if not any(numbers[3:7]) or min(numbers[7 + legs :]) < 0:
        raise Refused("a measurement has a quaternion that is no rotation, or a negative half-width")
    return pose, run, array_of("d", numbers)


def beside(certificate: Path, sha256: Any) -> ExactCampaign:
    """The campaign beside a certificate that has this digest, or the only one that there is."""
    paths = sorted(certificate.parent.glob(f"*{NAME}")) or [certificate.parent / NAME]
    found = [ExactCampaign(path) for path in paths]
    return next((campaign for campaign in found if campaign.sha256 == sha256), found[0])
