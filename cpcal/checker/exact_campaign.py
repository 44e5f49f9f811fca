"""Reads campaign.json: the exact numbers of a campaign that certificates speak of."""

from __future__ import annotations

import hashlib
from fractions import Fraction as F
from pathlib import Path
from typing import Any

from .files import content, parsed
from .leg import Measurement
from .readers import anything, choice, decimal, entry, many, record, text
from .refusal import Refused

NAME = "campaign.json"
FORMAT = "cpcal-campaign-exact/1"
_KEYS = ("files", "robot", "uncertainty", "model", "provenance")
_FILE = record({"format": choice(FORMAT), **dict.fromkeys(_KEYS, anything), "measurements": many(many(anything))})


class ExactCampaign:
    """Measurements as rationals: each number is the float64 nearest to its decimal text."""

    def __init__(self, path: Path) -> None:
        """Raises Unusable where the file cannot be read, Refused where it is no campaign."""
        try:
            found = content(path)
            self.sha256 = hashlib.sha256(found).hexdigest()
            _, _, robot, *_, rows = _FILE(parsed(found))
            self.robot = robot.get("name") if isinstance(robot, dict) else None
            self.legs = (len(rows[0]) - 15) // 2 if rows else 0
            if self.legs < 1:
                raise Refused("it holds no measurements")
            self._rows: list[Any] = [_row(cells, self.legs) for cells in rows]
        except Refused as refused:
            raise Refused(f"{NAME}: {refused.reason}", "campaign", 0) from None

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def ids(self) -> list[str]:
        """pose/run of every measurement."""
        return [f"{pose}/{run}" for pose, run, *_ in self._rows]

    def measurement(self, k: int, leg: int) -> Measurement:
        """Row k from 0, leg from 1."""
        cells, radii = self._rows[k], self._rows[k][9 + self.legs :]
        length, *pose = map(F, (cells[8 + leg], *cells[2:9]))
        d_x, d_y, d_z, s_x, s_y, s_z, e = map(F, (*radii[:6], radii[5 + leg]))
        return Measurement(tuple(pose[:3]), tuple(pose[3:]), length, (d_x, d_y, d_z, s_x / 2, s_y / 2, s_z / 2, e))


def _row(cells: tuple[Any, ...], legs: int) -> tuple[Any, ...]:
    found: tuple[Any, ...] = entry(text, text, *[decimal] * (13 + 2 * legs))(list(cells))
    if not any(found[5:9]) or min(found[9 + legs :]) < 0:
        raise Refused("a measurement has a quaternion that is no rotation, or a negative half-width")
    return found


def beside(certificate: Path, sha256: Any) -> ExactCampaign:
    """The campaign beside a certificate that has this digest, or the only one that there is."""
    paths = sorted(certificate.parent.glob(f"*{NAME}")) or [certificate.parent / NAME]
    found = [ExactCampaign(path) for path in paths]
    return next((campaign for campaign in found if campaign.sha256 == sha256), found[0])
