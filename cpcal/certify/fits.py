"""x_c and x_c_sigma as solutions (the paper, section 5.1.2): how many measurements refute each, leg by leg."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpcal.calibration import CalibrationRecord
from cpcal.certify.point import certify_point
from cpcal.errors import InputError, Problem
from cpcal.legs import PLAIN
from cpcal.results import VerifiedPoint
from cpcal.robot import Campaign

FORMAT = "cpcal-fits/1"
FITS_NAME = "fits.json"


@dataclass(frozen=True)
class VerifiedFit:
    """One leg of a fit at eps = 0, and the file that certifies it (in the folder of `fits.json`)."""

    leg: int
    verified: VerifiedPoint
    certificate: str


@dataclass(frozen=True)
class CertifiedFits:
    """Both fits of a campaign, legs in ascending order."""

    campaign_sha256: str
    x_c: tuple[VerifiedFit, ...]
    x_c_sigma: tuple[VerifiedFit, ...]

    @property
    def both(self) -> tuple[tuple[str, tuple[VerifiedFit, ...]], ...]:
        """With their names."""
        return (("x_c", self.x_c), ("x_c_sigma", self.x_c_sigma))


def certify_fits(
    campaign: Campaign,
    record: CalibrationRecord,
    folder: str | os.PathLike[str],
    *,
    legs: Sequence[int] | None = None,
) -> CertifiedFits:
    """Verify both fits of the record by `certify_point` at eps = 0, with certificates and `fits.json` in `folder`.

    They are fits of the plain model. A leg of a fit satisfies a measurement when THERE EXISTS a reading in its set at
    which the leg equation holds.
    Raises InputError when the record is of another campaign, OSError when the folder cannot be written.
    """
    if record.campaign_sha256 != campaign.sha256:
        raise InputError([Problem("calibration record", "is of another campaign", "calibrate again")])
    Path(folder).mkdir(parents=True, exist_ok=True)

    def verified(name: str, values: tuple[tuple[float, ...], ...]) -> tuple[VerifiedFit, ...]:
        out = []
        for leg in legs or range(1, campaign.legs + 1):
            file = f"{name}.leg{leg}.cert.jsonl"
            found = certify_point(campaign, leg, values[leg - 1], certificate=Path(folder) / file, model=PLAIN.name)
            out.append(VerifiedFit(leg, found.verified, file))
        return tuple(out)

    both = verified("x_c", record.x_c.values), verified("x_c_sigma", record.x_c_sigma.values)
    found = CertifiedFits(campaign.sha256, *both)
    text = json.dumps(_to_json(found), indent=1, allow_nan=False)
    (Path(folder) / FITS_NAME).write_text(text + "\n", encoding="utf-8")
    return found


def load_fits(folder: str | os.PathLike[str]) -> CertifiedFits:
    """Read `fits.json` in `folder`. Raises InputError."""
    path = Path(folder) / FITS_NAME
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(data, dict) or data["format"] != FORMAT:
            raise ValueError(f"is not of format {FORMAT}")
        both = (_from_json(data[name]) for name in ("x_c", "x_c_sigma"))
        return CertifiedFits(str(data["campaign_sha256"]), *both)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError([Problem(str(path), f"cannot be used: {error!r}", "certify the fits again")]) from None


def _to_json(found: CertifiedFits) -> dict[str, Any]:
    def rows(fits: tuple[VerifiedFit, ...]) -> list[dict[str, Any]]:
        return [{"leg": fit.leg, **fit.verified.to_json(), "certificate": fit.certificate} for fit in fits]

    legs = {name: rows(fits) for name, fits in found.both}
    return {"format": FORMAT, "campaign_sha256": found.campaign_sha256, **legs}


def _from_json(rows: list[dict[str, Any]]) -> tuple[VerifiedFit, ...]:
    return tuple(VerifiedFit(int(row["leg"]), VerifiedPoint.from_json(row), str(row["certificate"])) for row in rows)
