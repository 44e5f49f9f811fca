"""Reads campaign.json: the exact numbers of a campaign that certificates speak of."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from .leg import Measurement
from .refusal import Refused
from .strict import decimal, no_float, opened, parsed

NAME = "campaign.json"
FORMAT = "cpcal-campaign-exact/1"
KEYS = {"format", "files", "robot", "uncertainty", "model", "provenance", "measurements"}
_LARGEST = 16 << 20  # bytes


class ExactCampaign:
    """Measurements as rationals: each number is the float64 nearest to its decimal text."""

    def __init__(self, path: Path) -> None:
        """Raises Unusable where the file cannot be read, Refused where it is no campaign."""
        with opened(path) as stream:
            content = stream.read(_LARGEST + 1)
        if len(content) > _LARGEST:
            raise Refused(0, f"{NAME} is larger than {_LARGEST} bytes")
        self.sha256 = hashlib.sha256(content).hexdigest()
        try:
            value = parsed(content, floats=no_float)
        except ValueError as error:
            raise Refused(0, f"{NAME} {error}") from None
        if not isinstance(value, dict) or value.get("format") != FORMAT or set(value) != KEYS:
            raise Refused(0, f"{NAME} is not of format {FORMAT}")
        self.robot = value["robot"].get("name") if isinstance(value["robot"], dict) else None
        rows, self._known = value["measurements"], dict[tuple[int, int], Measurement]()
        sizes = {len(row) if isinstance(row, list) else 0 for row in rows} if isinstance(rows, list) else set()
        self.legs = (min(sizes, default=0) - 15) // 2
        if sizes != {15 + 2 * self.legs} or self.legs < 1:
            raise Refused(0, f"{NAME}: the measurements are not lists of one length")
        self._rows: list[list[Any]] = rows

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def ids(self) -> list[str]:
        """pose/run of every measurement."""
        return [f"{row[0]}/{row[1]}" for row in self._rows]

    def of(self, leg: int) -> LegRows:
        return LegRows(self, leg)

    def measurement(self, k: int, leg: int) -> Measurement:
        """Row k from 0, leg from 1; read when first used."""
        if (k, leg) not in self._known:
            self._known[k, leg] = self._read(k, leg)
        return self._known[k, leg]

    def _read(self, k: int, leg: int) -> Measurement:
        row, last = self._rows[k], 15 + self.legs
        try:
            reading, radii = ([decimal(v) for v in cells] for cells in (row[2:9], row[last - 6 : last]))
            length, radius = decimal(row[8 + leg]), decimal(row[last - 1 + leg])
        except ValueError as error:
            raise Refused(0, f"{NAME}: measurement {k} cannot be used: {error}") from None
        radii = [*radii[:3], *(r / 2 for r in radii[3:]), radius]
        if not any(reading[3:]) or min(radii) < 0:
            raise Refused(0, f"{NAME}: measurement {k} has a quaternion that is no rotation, or a negative half-width")
        return Measurement(tuple(reading[:3]), tuple(reading[3:]), length, tuple(radii))


class LegRows:
    """The measurements of one leg."""

    def __init__(self, campaign: ExactCampaign, leg: int) -> None:
        self._campaign, self._leg = campaign, leg

    def __len__(self) -> int:
        return len(self._campaign)

    def __getitem__(self, k: int) -> Measurement:
        return self._campaign.measurement(k, self._leg)


def beside(certificate: Path, sha256: str) -> ExactCampaign:
    """The campaign beside a certificate that has this digest, or the only one that there is."""
    paths = sorted(certificate.parent.glob(f"*{NAME}")) or [certificate.parent / NAME]
    found = [ExactCampaign(path) for path in paths]
    return next((campaign for campaign in found if campaign.sha256 == sha256), found[0])
