"""The checker's own small reader of campaign folders: exact numbers of the rows used. Standard library only."""

from __future__ import annotations

import csv
import hashlib
import io
import math
import tomllib
from collections.abc import Mapping
from fractions import Fraction as F
from pathlib import Path

from cpcal.checker.lines import Rational
from cpcal.checker.measurement import Measurement
from cpcal.checker.refusal import Refused

_PLACES = ("x", "y", "z")
_TURNS = ("qw", "qx", "qy", "qz")


class ExactCampaign:
    """The rows of one leg, as exact rationals of the float64 numbers that the files hold."""

    def __init__(self, folder: Path, leg: int, rational: Rational = F) -> None:
        try:
            toml = (folder / "campaign.toml").read_bytes()
            table = (folder / "measurements.csv").read_bytes()
            settings = tomllib.loads(toml.decode("utf-8-sig"))
            rows = list(csv.DictReader(io.StringIO(table.decode("utf-8-sig"))))
        except (OSError, ValueError, csv.Error) as error:
            raise Refused(0, f"the campaign in {folder} cannot be read: {error}") from None
        self.sha256 = hashlib.sha256(toml + b"\0" + table).hexdigest()
        self._leg, self._rows = leg, [row for row in rows if any(row.values())]
        self._rational = rational
        self._radii = [self._exact(v) for v in _half_widths(settings.get("uncertainty", {}), leg)]

    def __len__(self) -> int:
        return len(self._rows)

    def measurement(self, k: int) -> Measurement:
        """Row k, from 0."""
        row = self._rows[k]
        try:
            radii = [
                self._number(row[name]) if (row.get(name) or "").strip() else default
                for name, default in zip(_overrides(self._leg), self._radii, strict=True)
            ]
            position = tuple(self._number(row[name]) for name in _PLACES)
            quaternion = tuple(self._number(row[name]) for name in _TURNS)
            length = self._number(row[f"L{self._leg}"])
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise Refused(0, f"measurement {k} of the campaign cannot be read: {error}") from None
        if not any(quaternion) or min(radii) < 0:
            raise Refused(0, f"measurement {k} has a quaternion that is no rotation, or a negative half-width")
        return Measurement(position, quaternion, length, tuple(radii[:3]), tuple(radii[3:6]), radii[6])

    def _number(self, text: str) -> F:
        value = float(text)
        if not math.isfinite(value):
            raise ValueError(f"{text!r} is not finite")
        return self._exact(value)

    def _exact(self, value: float) -> F:
        return self._rational(*value.as_integer_ratio())


def _overrides(leg: int) -> tuple[str, ...]:
    return ("dx", "dy", "dz", "drx", "dry", "drz", f"dL{leg}")


def _half_widths(settings: Mapping[str, object], leg: int) -> list[float]:
    """p, r and lambda of all rows: float64 products `factor * sigma`, or what is given."""
    if settings == {"exact": True}:
        return [0.0] * 7
    try:
        sigma = "factor" in settings
        factor = float(settings["factor"]) if sigma else 1.0  # type: ignore[arg-type]
        end = "sigma" if sigma else "half_width"
        names = [f"{name}_{end}" for name in ("position", "rotation", "length")]
        position, rotation, length = (settings[name] for name in names)
        if len(position) != 3 or len(rotation) != 3:  # type: ignore[arg-type]
            raise ValueError("three numbers each are needed for position and rotation")
        values = [*position, *rotation, length[leg - 1]]  # type: ignore[misc, index]
        found = [factor * float(v) for v in values]
        if not all(map(math.isfinite, found)):
            raise ValueError("a half-width is not finite")
        return found
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        raise Refused(0, f"the uncertainty of the campaign cannot be read: {error!r}") from None
