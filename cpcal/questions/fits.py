"""x_c and x_c_sigma as solutions (the paper, section 5.1.2): how many measurements refute each, leg by leg.

A folder of fits holds campaign.json and a certificate for each leg of each fit. It states nothing else: what is known
of the fits is what the checker accepts.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cpcal.calibration import CalibrationRecord
from cpcal.checker import Accepted
from cpcal.common.errors import InputError, Problem
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import FITTED, answers_into
from cpcal.models import PLAIN
from cpcal.questions.bracket import certify_point
from cpcal.questions.result import VerifiedPoint
from cpcal.robot import Campaign

_FILE = re.compile(r"(x_c|x_c_sigma)\.leg([1-9][0-9]{0,3})\.cert\.jsonl")


@dataclass(frozen=True)
class VerifiedFit:
    """The point of one leg of a fit at eps = 0, and what is proved of it."""

    leg: int
    point: tuple[float, ...]
    verified: VerifiedPoint


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
    """Verify both fits of the record by `certify_point` at eps = 0, with certificates in `folder`.

    They are fits of the plain model. A leg of a fit satisfies a measurement when THERE EXISTS a reading in its set at
    which the leg equation holds.
    Raises InputError when the record is of another campaign, or the folder cannot be written.
    """
    if record.campaign_sha256 != campaign_sha256(campaign):
        raise InputError([Problem("calibration record", "is of another campaign", "calibrate again")])
    found: dict[str, tuple[VerifiedFit, ...]] = {}
    with answers_into(folder, FITTED, campaign) as draft:
        for name, values in (("x_c", record.x_c.values), ("x_c_sigma", record.x_c_sigma.values)):
            fits = []
            for leg in sorted(legs or range(1, campaign.legs + 1)):
                path = draft / f"{name}.leg{leg}.cert.jsonl"
                point = certify_point(campaign, leg, values[leg - 1], certificate=path, model=PLAIN.name)
                fits.append(VerifiedFit(leg, point.point, point.verified))
            found[name] = tuple(fits)
    return CertifiedFits(record.campaign_sha256, found["x_c"], found["x_c_sigma"])


def fits_of(folder: Path, accepted: Mapping[str, Accepted | str]) -> CertifiedFits:
    """What the certificates of a folder prove, by their names; a text says why one is refused. Raises InputError."""
    found: dict[str, dict[int, VerifiedFit]] = {"x_c": {}, "x_c_sigma": {}}
    for name, one in accepted.items():
        what, match = one if isinstance(one, str) else "", _FILE.fullmatch(name)
        if isinstance(one, Accepted):
            point = one.claims.point
            if match is None or point is None or (one.leg, one.model) != (int(match[2]), PLAIN.name):
                what = "it proves nothing of a fit that is called so"
            elif len(one.chosen) < one.count:
                what = "it leaves measurements out"
            else:
                *at, eps = map(float, point.at)
                counts = VerifiedPoint(eps, len(point.holds), len(point.fails), one.count)
                found[match[1]][int(match[2])] = VerifiedFit(int(match[2]), tuple(at), counts)
        if what:
            raise InputError([Problem(str(folder / name), f"is refused: {what}", "certify the fits again")])
    if not found["x_c"] or found["x_c"].keys() != found["x_c_sigma"].keys():
        raise InputError([Problem(str(folder), "lacks a certificate of a leg", "certify the fits again")])
    campaigns = {one.campaign for one in accepted.values() if isinstance(one, Accepted)}
    both = {name: tuple(fits[leg] for leg in sorted(fits)) for name, fits in found.items()}
    return CertifiedFits(str(campaigns.pop()), **both)
