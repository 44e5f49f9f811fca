"""x_c and x_c_sigma as solutions (the paper, section 5.1.2): how many measurements refute each, leg by leg."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cpcal.calibration import CalibrationRecord
from cpcal.common.errors import InputError, Problem
from cpcal.files import campaign_sha256
from cpcal.files.codec import checked, load, save
from cpcal.files.run_folder import FITTED, answers_into
from cpcal.legs import PLAIN
from cpcal.questions import VerifiedPoint
from cpcal.questions.bracket import certify_point
from cpcal.robot import Campaign

FORMAT = "cpcal-fits/3"
FITS_NAME = "fits.json"


@dataclass(frozen=True)
class VerifiedFit:
    """The point of one leg of a fit at eps = 0, and the file that certifies it (in the folder of `fits.json`)."""

    leg: int = field(metadata=checked("the certificate: each leg once"))
    point: tuple[float, ...] = field(metadata=checked("the claim of the certificate"))
    verified: VerifiedPoint = field(metadata=checked("the claim of the certificate, and how many measurements it has"))
    certificate: str = field(metadata=checked("a file of the folder, which is accepted"))


@dataclass(frozen=True)
class CertifiedFits:
    """Both fits of a campaign, legs in ascending order."""

    campaign_sha256: str = field(metadata=checked("campaign.json, and each certificate"))
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
    Raises InputError when the record is of another campaign, or the folder cannot be written.
    """
    if record.campaign_sha256 != campaign_sha256(campaign):
        raise InputError([Problem("calibration record", "is of another campaign", "calibrate again")])
    both = (("x_c", record.x_c.values), ("x_c_sigma", record.x_c_sigma.values))
    with answers_into(folder, FITTED, campaign) as draft:
        fits = {name: _verified(campaign, name, values, draft, legs) for name, values in both}
        found = CertifiedFits(campaign_sha256(campaign), fits["x_c"], fits["x_c_sigma"])
        save(found, draft / FITS_NAME, FORMAT)
    return found


def _verified(
    campaign: Campaign, name: str, values: Sequence[Sequence[float]], folder: Path, legs: Sequence[int] | None
) -> tuple[VerifiedFit, ...]:
    """The legs of the fit called `name`, with certificates in `folder`."""
    out = []
    for leg in legs or range(1, campaign.legs + 1):
        file = f"{name}.leg{leg}.cert.jsonl"
        found = certify_point(campaign, leg, values[leg - 1], certificate=folder / file, model=PLAIN.name)
        out.append(VerifiedFit(leg, found.point, found.verified, file))
    return tuple(out)


def load_fits(folder: str | os.PathLike[str]) -> CertifiedFits:
    """Read `fits.json` in `folder`. Raises InputError."""
    return load(CertifiedFits, Path(folder) / FITS_NAME, FORMAT, remedy="certify the fits again")
