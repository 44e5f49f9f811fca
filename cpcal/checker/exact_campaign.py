"""Reads campaign.json: the exact numbers of a campaign that certificates speak of."""

from __future__ import annotations

from array import array as array_of
from fractions import Fraction as F
from pathlib import Path
from typing import Any

from .files import Members, opened
from .leg import Measurement
from .readers import array, decimals, shown, text
from .refusal import Refused

NAME = "campaign.json"
FORMAT = "cpcal-campaign-exact/1"
_OTHERS = ("files", "robot", "uncertainty", "model", "provenance")
_LARGEST = 32 << 20  # bytes
_DEEPEST = 28  # lists and objects, one in the other


class ExactCampaign:
    """Measurements as rationals: each number is the float64 nearest to its decimal text."""

    def __init__(self, path: Path) -> None:
        """Raises Unusable where the file cannot be read, Refused where it is no campaign."""
        self.robot: Any = None
        self.legs = 0
        self.place: dict[str, int] = {}  # number of each measurement by its name, pose/run
        self._numbers = array_of("d")
        self._shortest: dict[int, F] = {}
        try:
            with opened(path) as stream:
                members = Members(stream, _LARGEST)
                self._read(members)
        except Refused as refused:
            raise Refused(f"{NAME}: {refused.reason}", "campaign", 0) from None
        self.sha256 = members.digest.hexdigest()

    def _read(self, members: Members) -> None:
        keys = ["format", *_OTHERS, "measurements"]
        for key in members:
            if key not in keys:
                raise Refused(f"it holds {shown(key)}, or lacks another key")
            keys.remove(key)
            if key == "measurements":
                for cells in members.elements():
                    self._add(array(cells))
                continue
            value = members.value()
            if key == "format" and value != FORMAT:
                raise Refused(f"its format is not {FORMAT}")
            if _depth(value) > _DEEPEST:
                raise Refused(f"its {key} is nested too deeply")
            if key == "robot" and isinstance(value, dict):
                self.robot = value.get("name")
        if keys or not self.place:
            raise Refused(f"it lacks {', '.join(keys) or 'measurements'}")

    def _add(self, cells: list[Any]) -> None:
        self.legs = self.legs or (len(cells) - 15) // 2
        if self.legs < 1 or len(cells) != 15 + 2 * self.legs:
            raise Refused(f"a list of {15 + 2 * max(self.legs, 1)} is needed here")
        name, numbers = f"{text(cells[0])}/{text(cells[1])}", decimals(cells[2:])
        if not any(numbers[3:7]) or min(numbers[7 + self.legs :]) < 0:
            raise Refused("a measurement has a quaternion that is no rotation, or a negative half-width")
        if self.place.setdefault(name, len(self.place)) * len(numbers) < len(self._numbers):
            raise Refused(f"two measurements have the name {shown(name)}")
        self._numbers.extend(numbers)

    def __len__(self) -> int:
        return len(self.place)

    def measurement(self, k: int, leg: int) -> Measurement:
        """Row k from 0, leg from 1."""
        width, first = 13 + 2 * self.legs, 7 + self.legs
        numbers = self._numbers[k * width : (k + 1) * width]
        widths = (*numbers[first : first + 6], numbers[first + 5 + leg])
        return Measurement(numbers[3:7], numbers[:3], numbers[6 + leg], widths)

    def shortest(self, leg: int) -> F:
        """Of all lengths that the readings of a leg may stand for."""
        if leg not in self._shortest:
            self._shortest[leg] = min(self.measurement(k, leg).shortest for k in range(len(self)))
        return self._shortest[leg]


def _depth(value: Any) -> int:
    if not isinstance(value, dict | list):
        return 0
    return 1 + max(map(_depth, value.values() if isinstance(value, dict) else value), default=0)


def beside(certificate: Path, sha256: str) -> ExactCampaign:
    """The campaign beside a certificate: the file that is named after its digest, where there is one."""
    own = certificate.parent / f"{sha256[:12]}.{NAME}"
    return ExactCampaign(own if sha256[:12].isalnum() and own.exists() else certificate.parent / NAME)
